"""Populations computed on a cluster, by a command and by a service have the same bytes after a kill and a resume."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from depth import deep
from service_processes import client_of, finish, free_port, server, start
from waiting import wait_until
from written import write_tile

from gear_rattle.service.client import Job
from gear_rattle.workers import PopulationRequest, compute_tile, create_store, finish_store, tiles_of
from gear_rattle.workers.answers import read_finished_population

FIELDS: dict[str, Any] = {
    "gear": {"delta": 0.6, "epsilon": {"distribution": "uniform", "low": 0.08, "high": 0.18}},
    "gears": 120,
    "count": 8,
    "tile": 2,
}
OPTIONS = ["--delta", "0.6", "--epsilon", "uniform:0.08:0.18", "--gears", "120", "--count", "8", "--tile", "2"]
REQUEST = PopulationRequest.model_validate(FIELDS)


def chunks(path: Path) -> dict[str, bytes]:
    """Return the files that tiles have written."""
    files = (each for each in path.rglob("*") if "c" in each.parts and each.is_file())
    return {str(each.relative_to(path)): each.read_bytes() for each in files}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "population.zarr"
    create_store(REQUEST, path)
    for tile in reversed(tiles_of(REQUEST)):
        write_tile(REQUEST, str(path), tile, compute_tile(REQUEST, tile)[0])
    finish_store(path)
    return path


@deep
def test_a_command_that_was_killed_goes_on(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "population.zarr"
    first = start("tolerance", *OPTIONS, "--workers", "1", "--out", str(out))
    wait_until(lambda: len(list(out.glob("status/c/*"))) >= 3)
    os.killpg(first.pid, signal.SIGKILL)
    first.wait()
    again = finish("tolerance", *OPTIONS, "--workers", "1", "--out", str(out))
    assert again.returncode == 0, again.stderr
    assert "runs quietly with a probability of" in again.stdout
    assert chunks(out) == chunks(whole)


@deep
def test_a_service_that_was_killed_goes_on(whole: Path, tmp_path: Path) -> None:
    data, port = tmp_path / "data", free_port()
    process = start("serve", "--port", str(port), "--data", str(data))
    with client_of(port) as client:
        wait_until(lambda: _answers(client, process))
        job = client.submit_population(REQUEST)
        wait_until(lambda: job.refresh().document["tiles_done"] >= 3)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        with server(data, port):
            found = job.wait().answers()
            assert found["gears"] == 120
            assert found["quiet"] == dict(read_finished_population(whole).quiet._asdict())
            assert chunks(_store(data, job)) == chunks(whole)
            with job.open() as opened:
                assert dict(opened.sizes) == {"gear": 120, "sample": 8}


def _answers(client: Any, process: Any) -> bool:
    assert process.poll() is None, "the server ended"
    try:
        return bool(client.call("GET", "/v1/health").is_success)
    except Exception:
        return False


def _store(data: Path, job: Job) -> Path:
    return next(each for each in data.rglob(f"*{job.id}*") if each.is_dir())
