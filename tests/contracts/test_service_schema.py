"""schemathesis over the whole OpenAPI document, and every example of it executed."""

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import jsonschema_rs
import pytest
import uvicorn
from service_support import BODY, no_cluster

from service import jobs
from service.app import create_app
from service.settings import Settings
from service.tables import JobRow, State
from workers import SurveyRequest, compute_tile, create_store, finish_store, tiles_of
from workers.store import write_tile

EXAMPLES, SEED = 12, 20090811
#: Answers that are never 200 for data that fit the schema: what does not exist is not found, what is too large for the
#: service's settings, or inconsistent in itself (an axis that falls), is refused.
CONFIG = """
[checks]
positive_data_acceptance.expected-statuses = ["2xx", "304", "404", "409", "416", "422", "429", "503"]
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a survey, whole."""
    path = tmp_path_factory.mktemp("finished") / "survey.zarr"
    request = SurveyRequest(**BODY)
    create_store(request, path)
    for tile in tiles_of(request):
        write_tile(request, str(path), tile, compute_tile(request, tile)[0])
    finish_store(path)
    return path


@contextmanager
def serving(data: Path) -> Iterator[str]:
    """A server without a cluster, in this process; its URL."""
    settings = Settings(data=data, max_jobs=10**6, max_point_count=16, max_point_seconds=5, heartbeat_seconds=0.5)
    server = uvicorn.Server(uvicorn.Config(create_app(settings, ready_at_once), port=0, log_level="error"))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            assert thread.is_alive()
            thread.join(0.05)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        thread.join(30)


@contextmanager
def ready_at_once() -> Iterator[None]:
    """A cluster that nobody computes with."""
    yield None


@pytest.fixture(scope="module")
def url(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service whose surveys are successful at once, with the numbers of another one; every fifth fails."""

    def compute(manager: Any, job: JobRow, _: Any) -> None:
        if not manager._database.set_state(job.id, State.RUNNING):
            return
        if job.number % 5 == 0:
            raise RuntimeError("no luck")
        shutil.copytree(finished, manager._directory.store(job.id), copy_function=os.link)
        manager._database.set_state(job.id, State.SUCCESSFUL)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs.JobManager, "_compute", compute)
        with serving(tmp_path_factory.mktemp("data")) as url:
            yield url


@pytest.fixture(scope="module")
def document(url: str) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{url}/openapi.json").json()
    return found


def test_schemathesis_finds_nothing(url: str, tmp_path: Path) -> None:
    (tmp_path / "schemathesis.toml").write_text(CONFIG)
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(tmp_path / "schemathesis.toml")]
    options = ["--checks", "all", "--max-examples", str(EXAMPLES), "--seed", str(SEED), "--no-color", "--no-shrink"]
    options += ["--generation-deterministic", "--continue-on-failure", "--request-timeout", "20", "--warnings", "off"]
    run = subprocess.run(
        [*command, "run", f"{url}/openapi.json", *options], cwd=tmp_path, capture_output=True, text=True, timeout=280
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "Stateful" in run.stdout
