"""The scheduler of a service is lost, or killed and started again; the service resumes its survey by itself."""

import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from depth import deep
from faults import REQUEST, Faults
from service_processes import ROOT, assert_bit_identical, client_of, free_port, serial_run, server
from service_support import IdleClient, local_client
from waiting import wait_until
from written import compute_and_write_tile

from gear_rattle.service.app import create_app
from gear_rattle.service.jobs import manager
from gear_rattle.service.settings import Settings
from gear_rattle.workers import ClusterLostError, open_survey
from gear_rattle.workers.kinds import template_of

MIDDLE = 5  # tiles that are done while the others are held


@contextmanager
def dask(faults: Faults, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments, "--no-dashboard"],
        cwd=ROOT,
        env=faults.environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


class Cluster(IdleClient):
    """Stands in for a dask client, for surveys whose tiles this process computes until the scheduler is lost."""

    @contextmanager
    def opened(self) -> Iterator[Any]:
        self.status = "running"
        yield self


@pytest.mark.parametrize(
    "error",
    [
        ClusterLostError("the dask scheduler is gone"),
        pytest.param(KeyError("what dask looks up then"), marks=deep),
    ],
)
def test_another_cluster_goes_on_where_one_was_lost(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster, computed = Cluster(), Counter[int]()

    def run_tiles(request: Any, path: Path, tiles: Any, client: Any, on_tile: Any, *_: Any) -> None:
        for tile in tiles:
            computed[tile.index] += 1
            if len(computed) > MIDDLE and computed.total() == len(computed):
                client.status = "closed"
                raise error
            on_tile(compute_and_write_tile(request, str(path), tile))

    monkeypatch.setattr(manager, "run_tiles", run_tiles)
    monkeypatch.setattr(
        manager, "compute_template_on_cluster", lambda _, request, created, __: template_of(request, created)
    )
    monkeypatch.setattr(manager, "FIRST_PAUSE", 0.01)
    app = create_app(Settings(data=tmp_path, explorer=False, preload=False), cluster.opened)
    with local_client(app) as client:
        survey = client.post("/v1/surveys", json=REQUEST.model_dump(mode="json")).json()["links"]["self"]
        wait_until(lambda: client.get(survey).json()["state"] in ("successful", "failed"))
        document = client.get(survey).json()
        assert (document["state"], document["tiles_done"]) == ("successful", REQUEST.n_tiles), document["message"]
        assert client.get("/v1/health").json()["cluster"] == "ready"
    assert_bit_identical(open_survey(tmp_path / "surveys" / f"{document['id']}.zarr"), serial_run(REQUEST))
    assert computed == Counter([*range(REQUEST.n_tiles), MIDDLE])  # only the running tile is repeated


@deep
def test_killed_and_started_again(tmp_path: Path) -> None:
    faults, port, scheduler_port = Faults(tmp_path), free_port(), free_port()
    faults.hold(MIDDLE)
    url = f"tcp://127.0.0.1:{scheduler_port}"

    def start_cluster(stack: ExitStack) -> subprocess.Popen[bytes]:
        scheduler = ("scheduler", "--host", "127.0.0.1", "--port", str(scheduler_port))
        worker = ("worker", url, "--nthreads", "1", "--no-nanny")
        process = stack.enter_context(dask(faults, *scheduler))
        stack.enter_context(dask(faults, *worker))
        return process

    with ExitStack() as stack, server(tmp_path / "data", port, "--scheduler", url), client_of(port) as client:
        scheduler = start_cluster(stack)
        job = client.submit(REQUEST)
        wait_until(lambda: job.refresh().document["tiles_done"] == MIDDLE and faults.executions()[MIDDLE])
        scheduler.kill()
        scheduler.wait()
        wait_until(lambda: client.call("GET", "/v1/health").json()["status"] == "degraded")
        assert job.refresh().state == "running"
        assert job.document["tiles_done"] == MIDDLE
        faults.release()
        start_cluster(stack)
        job.wait()
        assert_bit_identical(job.open(), serial_run(REQUEST))
    assert set(faults.executions()) == set(range(REQUEST.n_tiles))
    assert faults.executions().total() <= REQUEST.n_tiles + 1  # only the running tile is repeated
