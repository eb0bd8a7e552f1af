"""Every shell command of docs/operations.md runs as it stands there, or is named with the reason why it cannot here."""

import os
import re
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from s3_server import BUCKET, S3
from service_processes import (
    ENVIRONMENT,
    FIELDS,
    OPTIONS,
    ROOT,
    answers,
    assert_bit_identical,
    client_of,
    free_port,
    serial_run,
)
from waiting import HANG, wait_until

from gear_rattle.workers import SurveyRequest, open_survey

TEXT = (ROOT / "docs" / "operations.md").read_text()
PROGRAMS = "rattle|sqlite3|docker compose|kubectl|caddy|cp|pip install"

ENVIRONMENT_OF_A_BUCKET = "export AWS_ACCESS_KEY_ID=… AWS_SECRET_ACCESS_KEY=… AWS_REGION=…"
SECRETS = (
    'echo "POSTGRES_PASSWORD=$(openssl rand -hex 24)" > .env',
    'echo "POSTGRES_PASSWORD=$(openssl rand -hex 24)" > deploy/kubernetes/base/secret.env',
)
SERVE = "rattle serve"
BACK_UP = """sqlite3 DATA/jobs.sqlite ".backup 'jobs.backup.sqlite'\""""
COPY = "rattle copy DATA/surveys/ID.zarr s3://BUCKET/PREFIX/ID.zarr"
RUN_IN_BUCKET = "rattle run --out s3://BUCKET/PREFIX/survey.zarr …"
SERVE_BUCKET = "rattle serve --store s3://BUCKET/PREFIX …"
COPY_SETTINGS = "cp bucket/bucket.env.example bucket/bucket.env"
HERE = {ENVIRONMENT_OF_A_BUCKET, *SECRETS, SERVE, BACK_UP, COPY, RUN_IN_BUCKET, SERVE_BUCKET, COPY_SETTINGS}

CONTAINERS = "needs a docker daemon; tests/integration/test_compose_commands.py runs the commands of the services"
KUBERNETES = "needs a Kubernetes cluster; tests/contracts/service/test_kubernetes.py builds and validates the manifests"
NODES = (
    "needs eight nodes; tests/integration/test_slurm.py submits the scripts to two, with fewer processors and memory"
)
PROXY = "needs a host name; tests/integration/test_proxies.py runs Caddy"
NETWORK = "needs a network and an environment of its own; tests/install/check_wheel.py installs the wheel"
PREFIX = "needs a proxy; tests/integration/test_proxies.py serves below a path"
SCHEDULER = "needs a cluster on HOST; tests/integration/test_workers_versions.py uses one by address and scheduler file"
VERIFY = "needs a store of its own; tests/integration/test_verify_processes.py verifies with several processes"
LONG = "takes half an hour; the integration tests run surveys of fewer cells with the same options"
CANNOT = {
    "rattle verify --processes 8": VERIFY,
    "rattle verify --processes 2": VERIFY,
    "rattle run --delta 0.4:1.0:10000 --epsilon 0.005:0.3:10000 --quantity region": LONG,
    "docker compose build scheduler": CONTAINERS,
    "docker compose run --rm front rattle key add NAME --scope submit": CONTAINERS,
    "docker compose up --scale worker=8": CONTAINERS,
    "RATTLE_SITE=gears.example.org RATTLE_PUBLISH=443:8443 docker compose up": CONTAINERS,
    "docker compose exec -T postgres pg_dump --username rattle --format custom rattle > rattle.dump": CONTAINERS,
    "RATTLE_SITE=gears.example.org RATTLE_FRONT=127.0.0.1:8000 caddy run --config deploy/Caddyfile": PROXY,
    "rattle serve --root-path /rattle": PREFIX,
    "pip wheel --no-deps --wheel-dir dist .": NETWORK,
    "pip install --find-links dist 'gear-rattle[service]'": NETWORK,
    "pip install --constraint constraints.txt …": NETWORK,
    "pip install 'gear-rattle[service,s3]'": NETWORK,
    "pip install 'gear-rattle[workers,s3]'": NETWORK,
    "rattle run --scheduler tcp://HOST:8786": SCHEDULER,
    "rattle serve --scheduler …": SCHEDULER,
    "cd deploy/slurm": NODES,
    "sbatch --nodes=8 --ntasks-per-node=32 survey.sbatch --delta 0.4:1.0:3162 --epsilon 0.005:0.3:3162"
    " --out /shared/plane.zarr": NODES,
    "export RATTLE_CLUSTER=/shared/cluster": NODES,
    "sbatch --nodes=8 --ntasks-per-node=32 cluster.sbatch": NODES,
    "source /shared/cluster/environment": NODES,
    "rattle serve --data /shared/data --scheduler /shared/cluster/scheduler.json": NODES,
    "kubectl apply -k deploy/kubernetes/base": KUBERNETES,
    "kubectl create -f deploy/kubernetes/base/first-key.yaml": KUBERNETES,
    "kubectl apply -k deploy/kubernetes/bucket": KUBERNETES,
    "kubectl -n gear-rattle scale daskworkergroup rattle-default --replicas=64": KUBERNETES,
}
#: A survey of one tile, because each tile is an object for each variable; and its options.
REQUEST = SurveyRequest(**{**FIELDS, "tile": {"delta": 6, "epsilon": 6}})
OPTIONS_OF_IT = " ".join([*OPTIONS, "--workers", "1"]).replace("2x2", "6x6")


def commands() -> set[str]:
    """Return the commands of the document: lines of indented blocks, and words between backquotes."""
    text = re.sub(r"^```.*?^```$", "", TEXT, flags=re.DOTALL | re.MULTILINE)
    lines = {re.sub(r"\s{2,}#.*", "", line).strip() for line in re.findall(r"^ {4}(\S.*)$", text, re.MULTILINE)}
    inline = re.findall(rf"`((?:[A-Z_]+=\S+ )*(?:{PROGRAMS}) [^`]+)`", text)
    options = {"rattle run --tile 64x64", "rattle serve --help"}  # words about a command, as its name alone is
    return lines | {each for each in inline if each not in options and not re.fullmatch(r"rattle \w+", each)}


def test_every_command_is_run_or_has_a_reason() -> None:
    assert commands() == HERE | CANNOT.keys()
    named = {path for reason in CANNOT.values() for path in re.findall(r"tests/\S+\.py", reason)}
    assert all((ROOT / path).is_file() for path in named)


class Shell:
    """A shell in a directory, where the placeholders of the document stand for what this test has."""

    def __init__(self, directory: Path, settings: dict[str, str], placeholders: dict[str, str]) -> None:
        self.directory, self.placeholders = directory, placeholders
        path = os.pathsep.join([str(Path(sys.executable).parent), ENVIRONMENT["PATH"]])
        self.environment = {**ENVIRONMENT, **settings, "PATH": path}

    def line(self, command: str, others: str = "") -> str:
        """Return a command without placeholders; the ellipsis stands for other options."""
        for name, value in self.placeholders.items():
            command = command.replace(name, value)
        return command.replace("…", others)

    def run(self, *lines: str) -> None:
        """Run lines to their end."""
        script = "\n".join(["set -euo pipefail", *lines])
        ran = subprocess.run(
            ["bash", "-c", script],
            cwd=self.directory,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=HANG,
        )
        assert ran.returncode == 0, ran.stderr

    @contextmanager
    def running(self, line: str, port: int) -> Iterator[None]:
        """Run a service; it ends at SIGTERM without an error."""
        process = subprocess.Popen(
            ["bash", "-c", f"exec {line}"], cwd=self.directory, env=self.environment, text=True, start_new_session=True
        )
        try:
            wait_until(lambda: answers(process, port))
            yield
            process.send_signal(signal.SIGTERM)
            assert process.wait(timeout=HANG) == 0
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def test_commands_run_as_they_stand(storage: S3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port, prefix = free_port(), "documented"
    for folder in ("deploy/kubernetes/base", "deploy/kubernetes/bucket"):
        (tmp_path / folder).mkdir(parents=True)
    example = ROOT / "deploy/kubernetes/bucket/bucket.env.example"
    (tmp_path / "deploy/kubernetes/bucket" / example.name).write_text(example.read_text())
    given = {name: storage.settings[name] for name in ("AWS_ENDPOINT", "AWS_ALLOW_HTTP")}
    settings = {**given, "RATTLE_PORT": str(port), "RATTLE_DATA": "data", "RATTLE_WORKERS": "1"}
    shell = Shell(tmp_path, settings, {"BUCKET": BUCKET, "PREFIX": prefix, "DATA": "data"})
    export = re.sub(r"(\w+)=…", lambda found: f"{found[1]}={storage.settings[found[1]]}", ENVIRONMENT_OF_A_BUCKET)
    expected: dict[str, np.ndarray] = serial_run(REQUEST)

    shell.run(*SECRETS, "cd deploy/kubernetes", COPY_SETTINGS)
    for name in (".env", "deploy/kubernetes/base/secret.env"):
        assert re.fullmatch(r"POSTGRES_PASSWORD=[0-9a-f]{48}\n", (tmp_path / name).read_text())
    with shell.running(SERVE, port), client_of(port) as client:
        job = client.submit(REQUEST)
        job.wait()
        shell.run(shell.line(BACK_UP))
    with sqlite3.connect(tmp_path / "jobs.backup.sqlite") as backup:
        assert backup.execute("select count(*) from tiles").fetchone() == (REQUEST.n_tiles,)
    (store,) = (tmp_path / "data" / "surveys").glob("*.zarr")
    shell.placeholders["ID"] = store.stem
    shell.run(export, shell.line(COPY), shell.line(RUN_IN_BUCKET, OPTIONS_OF_IT))
    for name, value in storage.settings.items():
        monkeypatch.setenv(name, value)
    for name in (f"{store.stem}.zarr", "survey.zarr"):
        with open_survey(f"s3://{BUCKET}/{prefix}/{name}") as survey:
            assert_bit_identical(survey, expected)
    shell.environment |= storage.settings | {"RATTLE_DATA": "other"}
    serve = shell.line(SERVE_BUCKET).replace(prefix, "served")
    with shell.running(serve, port), client_of(port) as client, client.submit(REQUEST).wait().open() as survey:
        assert_bit_identical(survey, expected)
