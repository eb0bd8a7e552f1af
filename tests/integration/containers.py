"""The commands of docker-compose.yml and of the manifests of Kubernetes, run as processes without containers."""

import os
import pwd
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import postgres
from service_processes import ROOT, free_port
from waiting import HANG, SELDOM, wait_until

import rattle.numerics.compile

PASSWORD = "of this test only"


class Here:
    """Replaces host names, ports, directories and the password of a container file by those of this machine.

    Parameters
    ----------
    directory
        Directory for everything that the containers write.
    services
        Containers by name, in the format of docker compose: `command`, `environment`, `healthcheck`.
    more
        Further replacements: regular expressions and their replacements.
    """

    def __init__(self, directory: Path, services: dict[str, Any], more: Mapping[str, str] | None = None) -> None:
        self.directory, self.services = directory, services
        self.front, self.database, self.proxy = free_port(), free_port(), free_port()
        scheduler = free_port()
        self.table = {
            **(more or {}),
            r"\bscheduler(?=:8786)": "127.0.0.1",
            r"(?<=@)postgres(?=:5432)": "127.0.0.1",
            r"^0\.0\.0\.0$": "127.0.0.1",
            r"\b8786\b": str(scheduler),
            r"\b8000\b": str(self.front),
            r"\b5432\b": str(self.database),
            r"^/data$": str(directory / "data"),
            r"^/tmp$": str(directory / "tmp"),
            r"^\$\{POSTGRES_PASSWORD:\?.*\}$": PASSWORD,
            r"^\$\{RATTLE_SITE:-http://:\d+\}$": f"http://127.0.0.1:{self.proxy}",
            r"^/etc/caddy/Caddyfile$": str(directory / "Caddyfile"),
        }
        #: Environment variables that the container images set.
        self.image = {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), str(programs()), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
            "RATTLE_CACHE_DIR": str(rattle.numerics.compile.cache_directory().parent),
            "PGHOST": "127.0.0.1",
            "PGPORT": str(self.database),
            "HOME": str(directory),
            "RATTLE_FRONT": f"127.0.0.1:{self.front}",
            # These tests use neither the explorer nor the point kernels, and both slow the start.
            "RATTLE_EXPLORER": "false",
            "RATTLE_PRELOAD": "false",
        }

    def text(self, text: str) -> str:
        for pattern, here in self.table.items():
            text = re.sub(pattern, here, text)
        return text

    def words(self, words: list[str]) -> list[str]:
        return [self.text(word) for word in words]

    def environment(self, name: str) -> dict[str, str]:
        given = self.services[name].get("environment", {})
        return self.image | {variable: self.text(value) for variable, value in given.items()}

    def run(self, name: str, *command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command, env=self.environment(name), cwd=self.directory, text=True, capture_output=True, timeout=HANG
        )

    @contextmanager
    def started(
        self, name: str, number: int = 0, prefix: tuple[str, ...] = (), *more: str, check: bool = True
    ) -> Iterator[None]:
        """Run the command of a container, and wait until its health check passes, if it has one."""
        with (self.directory / f"{name}{number}.log").open("w") as log:
            command = [*prefix, *self.words(self.services[name]["command"]), *more]
            environment = self.environment(name)
            process = subprocess.Popen(command, env=environment, cwd=self.directory, stdout=log, stderr=log)
        try:
            test = self.services[name]["healthcheck"].get("test") if check else None
            if test:
                assert test[0] == "CMD"
                wait_until(lambda: self._healthy(name, process, self.words(test[1:])), SELDOM)
            yield
            assert process.poll() is None, (self.directory / f"{name}{number}.log").read_text()
        finally:
            process.terminate()
            process.wait(timeout=HANG)

    def _healthy(self, name: str, process: subprocess.Popen[bytes], check: list[str]) -> bool:
        assert process.poll() is None, "\n".join(log.read_text() for log in self.directory.glob(f"{name}*.log"))
        return self.run(name, *check).returncode == 0


def programs() -> Path:
    found = postgres._programs()
    assert found is not None
    return found


@contextmanager
def database(here: Here) -> Iterator[None]:
    """Run PostgreSQL with the user, password and database that its image would create from the environment."""
    directory = Path(tempfile.mkdtemp(prefix="rattle-compose-"))  # readable by the user that PostgreSQL runs as
    try:
        given = here.environment("postgres")
        prefix: tuple[str, ...] = ()
        if os.geteuid() == 0:
            user = pwd.getpwnam(str(postgres._user()))
            os.chown(directory, user.pw_uid, user.pw_gid)
            prefix = ("setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups")
        password = directory / "password"
        password.write_text(given["POSTGRES_PASSWORD"])
        password.chmod(0o644)
        data, user_name = str(directory / "data"), given["POSTGRES_USER"]
        initdb = [
            "initdb",
            "-D",
            data,
            "-U",
            user_name,
            "-A",
            "scram-sha-256",
            f"--pwfile={password}",
            "--no-sync",
            "-E",
            "UTF8",
            "--locale=C",
        ]
        subprocess.run([*prefix, *initdb], env=here.image, cwd=directory, check=True, capture_output=True)
        more = ("-D", data, "-p", str(here.database), "-c", f"unix_socket_directories={directory}", "-c", "fsync=off")
        with here.started("postgres", 0, prefix, *more):
            made = subprocess.run(
                ["createdb", "-U", user_name, given["POSTGRES_DB"]],
                env=here.image | {"PGPASSWORD": PASSWORD},
                capture_output=True,
                text=True,
            )
            assert made.returncode == 0, made.stderr
            yield
    finally:
        shutil.rmtree(directory, ignore_errors=True)
