"""An embedded cluster executes what its own processes send, and nothing that another account of the machine sends."""

import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from depth import either
from distributed import Client, Worker
from intruders import CERTIFICATE_REQUIRED, anybody, intrude, is_private, listening, named_sockets, refusal, stranger
from service_processes import free_port, get, nannies_of, server
from waiting import wait_until

from gear_rattle.workers import embedded_cluster

WORKERS = either(1, 2)
#: Pages that dask's HTTP servers would have if they were on.
PAGES = ("", "status", "health", "metrics", "info/main/workers.html", "json/identity.json", "api/v1/")


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a temporary directory in which another account has already made dask's scratch directory, open to all."""
    shared = tmp_path_factory.mktemp("shared")
    (shared / "dask-scratch-space").mkdir()
    (shared / "dask-scratch-space").chmod(0o777)
    return shared


@pytest.fixture(scope="module")
def cluster(shared: Path) -> Iterator[Client]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(shared))
        with embedded_cluster(WORKERS) as client:
            yield client
    left = {each.name: each for each in shared.iterdir()}
    assert left.pop("dask-scratch-space")
    assert not left


@pytest.fixture(scope="module")
def addresses(cluster: Client) -> list[str]:
    """Return the addresses of the scheduler, of the workers and of their nannies."""
    found = [
        cluster.scheduler.address,
        *cluster.nthreads(),
        *cluster.run(lambda dask_worker: dask_worker.nanny).values(),
    ]
    assert len(set(found)) == 1 + 2 * WORKERS
    return found


def test_who_has_the_certificate_gets_in(cluster: Client, addresses: list[str], tmp_path: Path) -> None:
    """The other tests' requests are refused because they lack the certificate, not because they are malformed."""
    context = cluster.security.get_connection_args("client")["ssl_context"]
    pids = {os.getpid(), *(each.pid for each in nannies_of(os.getpid())), *cluster.run(os.getpid).values()}
    assert intrude(addresses, context, tmp_path / "executed") == pids


def test_nothing_is_executed_without_tls(addresses: list[str], tmp_path: Path) -> None:
    assert intrude(addresses, None, tmp_path / "executed") == set()


def test_nothing_is_executed_without_a_certificate(addresses: list[str], tmp_path: Path) -> None:
    assert intrude(addresses, anybody(), tmp_path / "executed") == set()


def test_nothing_is_executed_with_another_certificate(addresses: list[str], tmp_path: Path) -> None:
    assert intrude(addresses, stranger(), tmp_path / "executed") == set()


def test_modules_are_taken_from_no_place_of_others(cluster: Client, shared: Path) -> None:
    def searched(dask_worker: Worker) -> list[str]:
        return [dask_worker.local_directory, *sys.path]

    for paths in [sys.path, *cluster.run(searched).values()]:
        inside = [Path(path) for path in paths if Path(path).is_relative_to(shared)]
        assert inside
        assert shared / "dask-scratch-space" not in inside
        for path in inside:
            assert is_private(next(each for each in (path, *path.parents) if each.parent == shared))


def test_a_service_listens_for_http_and_for_its_own_certificate_only(tmp_path: Path) -> None:
    port = free_port()
    settings = {"RATTLE_EXPLORER": "true"}
    arguments = ("--workers", str(WORKERS))
    with server(tmp_path, port, *arguments, settings=settings) as process:
        wait_until(lambda: get(f"http://127.0.0.1:{port}/v1/health").json()["cluster"] == "ready")
        assert get(f"http://127.0.0.1:{port}/v1/orbits?delta=0.6&epsilon=0.1").is_success  # starts a process for points
        found = listening(process.pid)
        assert found.pop(("127.0.0.1", port)) == process.pid
        assert {address for address, _ in found} == {"127.0.0.1"}
        assert named_sockets(process.pid) == []
        answers = Counter(answer(each) for _, each in found)
        # Scheduler, nannies and workers have a port each; scheduler and workers have another for HTTP.
        assert answers == {CERTIFICATE_REQUIRED: 1 + 2 * WORKERS, "404": 1 + WORKERS}
        lists = [get(f"http://127.0.0.1:{each}/sitemap.json").json() for _, each in found if answer(each) == "404"]
        assert lists == [{"paths": ["/sitemap.json"]}] * (1 + WORKERS)


def answer(port: int) -> str:
    """Return the status of every page of a port, or the error with which it refuses a client without a certificate."""
    try:
        return " ".join({str(get(f"http://127.0.0.1:{port}/{page}").status_code) for page in PAGES})
    except httpx.TransportError:
        return refusal(port)
