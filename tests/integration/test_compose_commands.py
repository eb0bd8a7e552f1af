"""The commands of docker-compose.yml, as they stand there, run as processes: PostgreSQL, scheduler, workers, front."""

import os
import pwd
import re
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import postgres
import pytest
import yaml
from depth import either
from service_processes import REQUEST, ROOT, assert_bit_identical, client_of, free_port, serial_run, server
from waiting import HANG, SELDOM, wait_until

import rattle.numerics.compile
from gear_rattle.service.client import Client
from gear_rattle.service.errors import ResponseError, ServiceError

SERVICES: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
PASSWORD = "of this test only"


class Here:
    """Everything that is other here than in the file: names of hosts, ports, directories, the password."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.front, self.database, self.proxy = free_port(), free_port(), free_port()
        scheduler = free_port()
        self.table = {
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
        #: What the images bring, for processes without one.
        self.image = {
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), str(programs()), os.environ["PATH"]]),
            "PYTHONPATH": str(ROOT),
            "RATTLE_CACHE_DIR": str(rattle.numerics.compile.cache_directory().parent),
            "PGHOST": "127.0.0.1",
            "PGPORT": str(self.database),
            "HOME": str(directory),
            "RATTLE_FRONT": f"127.0.0.1:{self.front}",
            # Beside the other tests: neither the page nor the kernels of points, which nobody asks for.
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
        given = SERVICES[name].get("environment", {})
        return self.image | {variable: self.text(value) for variable, value in given.items()}

    def run(self, name: str, *command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command, env=self.environment(name), cwd=self.directory, text=True, capture_output=True, timeout=HANG
        )

    @contextmanager
    def started(
        self, name: str, number: int = 0, prefix: tuple[str, ...] = (), *more: str, check: bool = True
    ) -> Iterator[None]:
        """A service's command, healthy by its own check if it has one."""
        with (self.directory / f"{name}{number}.log").open("w") as log:
            command = [*prefix, *self.words(SERVICES[name]["command"]), *more]
            environment = self.environment(name)
            process = subprocess.Popen(command, env=environment, cwd=self.directory, stdout=log, stderr=log)
        try:
            test = SERVICES[name]["healthcheck"].get("test") if check else None
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
    """PostgreSQL with the user, password and database that its image makes of the environment."""
    directory = Path(tempfile.mkdtemp(prefix="rattle-compose-"))  # open to the user that PostgreSQL runs as
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


@pytest.mark.skipif(bool(postgres.missing()), reason=postgres.missing())
def test_a_survey_through_everything(tmp_path: Path) -> None:
    here = Here(tmp_path)
    for name in ("data", "tmp"):
        (tmp_path / name).mkdir()
    with ExitStack() as stack:
        stack.enter_context(database(here))
        stack.enter_context(here.started("scheduler"))
        for number in range(either(1, SERVICES["worker"]["deploy"]["replicas"])):
            stack.enter_context(here.started("worker", number))
        assert here.run("front", *here.words(SERVICES["front"]["command"])).returncode == 2  # no key yet
        added = here.run("front", "rattle", "key", "add", "me", "--scope", "submit")
        assert added.returncode == 0, added.stderr
        stack.enter_context(here.started("front"))
        expected: dict[str, np.ndarray] = serial_run(REQUEST)
        with client_of(here.front, added.stdout.strip()) as client:
            job = client.submit(REQUEST)
            with job.wait().open() as dataset:
                assert_bit_identical(dataset, expected)
        assert list((tmp_path / "data" / "surveys").iterdir())
        assert not (tmp_path / "data" / "jobs.sqlite").exists()


SLOW = {
    "half a header": b"GET /v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ",
    "a body that does not come": b"POST /v1/surveys HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n",
}


@pytest.mark.skipif(shutil.which("caddy") is None, reason="Caddy is not installed (apt-get install caddy)")
def test_the_proxy_cuts_off_slow_clients_and_passes_on_what_the_front_says(tmp_path: Path) -> None:
    here = Here(tmp_path)
    caddyfile = (ROOT / SERVICES["proxy"]["configs"][0]["target"].replace("/etc/caddy", "deploy")).read_text()
    short = re.sub(r"read_(header|body) \d+s", r"read_\1 1s", caddyfile)  # or the test would take long
    assert short.count(" 1s\n") == 2
    (tmp_path / "Caddyfile").write_text(short.replace("http_port 8000", f"http_port {here.proxy}"))
    with server(tmp_path / "data", here.front), here.started("proxy", check=False), client_of(here.proxy) as client:
        wait_until(lambda: is_reached(client))
        with pytest.raises(ResponseError, match="API key"):  # what comes through a proxy needs one
            client.call("GET", "/v1/surveys")
        for name, sent in SLOW.items():
            with socket.create_connection(("127.0.0.1", here.proxy), timeout=HANG) as connection:
                connection.sendall(sent)
                assert not connection.recv(2**16).startswith(b"HTTP/1.1 2"), name  # the end, whatever it says


def is_reached(client: Client) -> bool:
    """Whether the proxy listens, and reaches the front."""
    try:
        return bool(client.call("GET", "/v1/health").json())
    except (ServiceError, httpx.TransportError):
        return False
