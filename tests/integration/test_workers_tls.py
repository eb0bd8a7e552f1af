"""Scheduler, worker and service over TLS with certificates of one authority; all other clients are refused."""

import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import dask
import pytest
from depth import deep
from parts import Settings, authority, dask_part, environment
from service_processes import client_of, free_port, server
from waiting import HANG, wait_until

import gear_rattle.workers.cluster.cluster
from gear_rattle.workers import ClusterLostError, connect

BODY = {
    "delta": (0.5, 0.7, 4),
    "epsilon": (0.05, 0.15, 2),
    "initial_conditions": {"count": 4},
    "tile": {"delta": 2, "epsilon": 2},
}


@pytest.fixture
def hopeless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the wait for an answer, for tests in which none comes."""
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "CONNECT_SECONDS", 1)


@pytest.fixture(autouse=True, scope="module")
def _patience() -> Iterator[None]:
    """Lengthen the wait for an answer in the other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gear_rattle.workers.cluster.cluster, "CONNECT_SECONDS", HANG)
        yield


@pytest.fixture(scope="module")
def trusted(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return authority(tmp_path_factory.mktemp("trusted") / "ca") | {"distributed.comm.require-encryption": "true"}


@pytest.fixture(scope="module")
def scheduler(trusted: Settings, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Start a scheduler with one worker, and yield its address."""
    port = free_port()
    url = f"tls://127.0.0.1:{port}"
    local = str(tmp_path_factory.mktemp("local"))
    with ExitStack() as stack:
        address = ["--protocol", "tls", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        stack.enter_context(dask_part(trusted, "scheduler", *address))
        one = ["--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1"]
        stack.enter_context(dask_part(trusted, "worker", url, *one, "--local-directory", local))
        wait_until(lambda: reachable(url, trusted))
        yield url


def reachable(url: str, settings: Settings) -> bool:
    with dask.config.set(settings):
        try:
            with connect(url) as client:
                return bool(client.nthreads())
        except ClusterLostError:
            return False


@deep
def test_a_survey_is_computed_over_tls(scheduler: str, trusted: Settings, tmp_path: Path) -> None:
    port = free_port()
    with server(tmp_path, port, "--scheduler", scheduler, settings=environment(trusted)), client_of(port) as client:
        job = client.submit(**BODY).wait()
        assert job.document["cells_done"] == 8
        with job.open() as dataset:
            assert set(dataset["status"].values.flat) <= {1, 2}


def test_every_port_speaks_tls(scheduler: str, trusted: Settings) -> None:
    with dask.config.set(trusted), connect(scheduler) as client:
        (worker,) = client.nthreads()
        assert worker.startswith("tls://127.0.0.1:")
        assert client.submit(os.getpid).result(timeout=HANG) != os.getpid()


@pytest.mark.usefixtures("hopeless")
def test_a_client_without_tls_is_refused(scheduler: str) -> None:
    with pytest.raises(ClusterLostError, match="tcp://"), connect(scheduler.replace("tls://", "tcp://")):
        pass


@pytest.mark.usefixtures("hopeless")
def test_a_client_without_a_certificate_is_told_so(scheduler: str) -> None:
    with pytest.raises(ClusterLostError, match="TLS"), connect(scheduler):
        pass


@pytest.mark.usefixtures("hopeless")
def test_a_certificate_of_another_authority_is_refused(scheduler: str, tmp_path: Path) -> None:
    stranger = authority(tmp_path / "stranger")
    with dask.config.set(stranger), pytest.raises(ClusterLostError, match=scheduler), connect(scheduler):
        pass


@pytest.mark.usefixtures("hopeless")
def test_who_trusts_any_scheduler_still_needs_a_certificate_of_the_authority(
    scheduler: str, trusted: Settings, tmp_path: Path
) -> None:
    stranger = authority(tmp_path / "stranger") | {
        "distributed.comm.tls.ca-file": trusted["distributed.comm.tls.ca-file"]
    }
    with dask.config.set(stranger), pytest.raises(ClusterLostError, match=scheduler), connect(scheduler):
        pass


@pytest.mark.usefixtures("hopeless")
def test_with_encryption_required_nothing_is_sent_in_the_clear(scheduler: str, trusted: Settings) -> None:
    tcp = scheduler.replace("tls://", "tcp://")
    with dask.config.set(trusted), pytest.raises(ClusterLostError, match="encryption"), connect(tcp):
        pass
