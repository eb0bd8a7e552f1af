"""Surveys on worker processes have the same bits as a serial run, also after kills, stops and resumes."""

import gc
import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import pytest
import xarray as xr
from depth import deep
from distributed import Client, Worker
from distributed.scheduler import TaskGroup
from intruders import certificates, listening
from waiting import HANG, wait_until
from written import compute_and_write_tile

import gear_rattle.workers.certificates
import gear_rattle.workers.cluster.cluster
import gear_rattle.workers.cluster.joining
import gear_rattle.workers.cluster.runner
import gear_rattle.workers.cluster.submission
import gear_rattle.workers.families.blocks
from gear_rattle.workers import (
    Axis,
    ClusterLostError,
    Group,
    StoppedError,
    SurveyError,
    SurveyRequest,
    TileRecord,
    complete,
    complete_on_cluster,
    connect,
    create_store,
    embedded_cluster,
    finish_store,
    join_attractors_of_survey,
    lacks_families,
    open_survey,
    run_tiles,
    tiles_done,
    tiles_of,
)
from rattle import MissingExtraError

REQUEST = SurveyRequest(
    delta=Axis(start=0.58, stop=0.78, num=8),
    epsilon=Axis(start=0.05, stop=0.24, num=8),
    initial_conditions={"count": 4},
    tile={"delta": 2, "epsilon": 2},
)
TILES = tiles_of(REQUEST)


@pytest.fixture(autouse=True)
def _long_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Allow for a busy machine, on which a worker takes minutes to start or to be replaced."""
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "CONNECT_SECONDS", HANG)
    for room in (gear_rattle.workers.cluster.submission, gear_rattle.workers.cluster.joining):
        monkeypatch.setattr(room, "WORKERLESS_SECONDS", HANG)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Client]:
    with ExitStack() as stack:
        # The cluster makes its own certificate, whatever dask's settings say.
        with dask.config.set(
            {"distributed.comm.require-encryption": False, "distributed.comm.tls.ca-file": "none.pem"}
        ):
            client = stack.enter_context(embedded_cluster(2))
        yield client
        pids = processes(client)
    wait_until(lambda: not any(alive(pid) for pid in pids))


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    path = tmp_path_factory.mktemp("serial") / "survey.zarr"
    create_store(REQUEST, path)
    for tile in TILES:
        compute_and_write_tile(REQUEST, str(path), tile)
    return open_survey(path).load()


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "survey.zarr"
    create_store(REQUEST, path)
    return path


def run(store: Path, client: Client, on_tile: Callable[[TileRecord], None] = lambda _: None) -> None:
    """Compute the tiles that are not done."""
    done = tiles_done(REQUEST, store)
    run_tiles(REQUEST, store, [tile for tile in TILES if tile.index not in done], client, on_tile, lambda: False)


def assert_serial(store: Path, serial: xr.Dataset) -> None:
    finish_store(store)
    computed = open_survey(store).load()
    for name in serial.data_vars:
        assert computed[name].values.tobytes() == serial[name].values.tobytes(), name


def after(count: int, act: Callable[[], None]) -> Callable[[TileRecord], None]:
    """Return an `on_tile` that calls `act` at the tile with this number."""
    seen: list[TileRecord] = []

    def on_tile(record: TileRecord) -> None:
        seen.append(record)
        if len(seen) == count:
            act()

    return on_tile


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def processes(client: Client) -> list[int]:
    return list(client.run(os.getpid).values())


def test_two_processes_of_one_thread_on_loopback(cluster: Client) -> None:
    assert len(set(processes(cluster)) - {os.getpid()}) == 2
    assert set(cluster.nthreads().values()) == {1}
    assert set(cluster.run(lambda: os.environ["NUMBA_NUM_THREADS"]).values()) == {"1"}
    assert all(address.startswith("tls://127.0.0.1:") for address in [*cluster.nthreads(), cluster.scheduler.address])
    assert {address for address, _ in listening(os.getpid())} == {"127.0.0.1"}


def test_nothing_is_kept_of_what_is_over(cluster: Client) -> None:
    def groups() -> int:
        gc.collect()
        return sum(type(each) is TaskGroup for each in gc.get_objects())  # isinstance fails on dead proxies

    def notes(dask_worker: Worker) -> list[int]:
        return [len(dask_worker.batched_stream.recent_message_log), len(dask_worker.profile_history)]

    before, last, scheduler = groups(), gear_rattle.workers.cluster.cluster.FEW_RECORDS, cluster.cluster.scheduler
    for number in range(3 * last):  # each stands for a window of the explorer
        assert cluster.submit(int, number, key=f"window{number}").result() == number
        wait_until(lambda: not scheduler.tasks)  # otherwise dask adds the next task to the same computation
    wait_until(lambda: groups() - before <= last)  # a forgotten group may still be referenced for a moment
    for stream in (*scheduler.stream_comms.values(), *scheduler.client_comms.values()):
        assert len(stream.recent_message_log) <= last
    for messages, profiles in cluster.run(notes).values():
        assert messages <= last
        assert not profiles


def test_the_same_bits_as_a_serial_run(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    records: list[TileRecord] = []
    run(store, cluster, records.append)
    assert sorted(record.index for record in records) == [tile.index for tile in TILES]
    assert sum(record.cells for record in records) == REQUEST.n_cells
    assert_serial(store, serial)


def test_finished_tiles_are_released(cluster: Client, store: Path) -> None:
    run(store, cluster, lambda _: wait_until(lambda: len(cluster.futures) <= 2))  # one per worker
    wait_until(lambda: not cluster.futures and not cluster.cluster.scheduler.tasks)


@deep
def test_a_killed_worker_does_not_show(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    victim = processes(cluster)[0]
    run(store, cluster, after(3, lambda: os.kill(victim, signal.SIGKILL)))
    assert victim not in processes(cluster)
    assert_serial(store, serial)


def test_stopped_and_resumed(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    reported: list[int] = []
    run_tiles(REQUEST, store, TILES, cluster, lambda record: reported.append(record.index), lambda: len(reported) >= 2)
    assert 2 <= len(reported) < len(TILES)
    assert set(reported) <= tiles_done(REQUEST, store)
    run(store, cluster)
    assert_serial(store, serial)


def test_an_interrupt_leaves_a_store_that_resumes(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(store, cluster, after(2, interrupt))
    assert 2 <= len(tiles_done(REQUEST, store)) < len(TILES)
    run(store, cluster)
    assert_serial(store, serial)


def test_workers_outlive_an_interrupt_of_the_terminal(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    pids = processes(cluster)

    def interrupt() -> None:
        for pid in pids:
            os.kill(pid, signal.SIGINT)

    run(store, cluster, after(1, interrupt))
    assert processes(cluster) == pids
    assert_serial(store, serial)


def test_a_store_moved_under_a_run_ends_it_and_is_resumed(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    # Either a worker notices it when it writes a tile, or the run when it records one.
    with pytest.raises(SurveyError, match=r"survey\.zarr is gone: "):
        run(store, cluster, after(2, lambda: store.rename(store.with_name("moved"))))
    assert not store.exists()
    store.with_name("moved").rename(store)
    run(store, cluster)
    assert_serial(store, serial)


def test_an_existing_scheduler(cluster: Client, store: Path, serial: xr.Dataset) -> None:
    with dask.config.set(certificates(cluster)), connect(cluster.scheduler.address) as client:
        run(store, client)
    assert len(processes(cluster)) == 2  # connect leaves the cluster running
    assert_serial(store, serial)


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "CONNECT_SECONDS", 0.3)
    for url in ("tcp://127.0.0.1:9", "unknown://x", "", "tcp://127.0.0.1:no"):
        with pytest.raises(ClusterLostError), connect(url):
            pass


def test_a_connection_that_ends_with_its_cluster_says_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """dask noticed the end late, and a service that stopped logged a traceback among its last lines."""

    @contextmanager
    def left(*_: Any) -> Iterator[None]:
        yield
        logging.getLogger("distributed.batched").error("Batched Comm Closed")

    client = SimpleNamespace(register_plugin=lambda _: None)
    processes = SimpleNamespace(wait_for_workers=lambda _: None, started=threading.Event())
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "_cluster_without_workers", left)
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "_WorkerProcesses", lambda *_: nullcontext(processes))
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "Client", lambda *_, **__: nullcontext(client))
    handler = logging.StreamHandler()  # dask's own handler writes where this test cannot read
    logging.getLogger("distributed").addHandler(handler)
    try:
        with embedded_cluster(1):
            pass
    finally:
        logging.getLogger("distributed").removeHandler(handler)
    assert capfd.readouterr().err == ""


def test_a_cluster_of_nobody_is_refused() -> None:
    with pytest.raises(SurveyError, match="must be at least 1, got 0"), embedded_cluster(0):
        pass


@pytest.fixture
def own_scheduler(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Start a scheduler and a worker that the test may kill."""
    address = tmp_path / "scheduler.json"
    start = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": Path(__file__).parents[2]}
    dask = [sys.executable, "-m", "dask"]
    options = ["--scheduler-file", str(address), "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *options], **start)
    worker = subprocess.Popen([*dask, "worker", "--nthreads", "1", "--no-nanny", *options], **start)
    try:
        wait_until(lambda: address.exists() and address.stat().st_size > 0)
        yield json.loads(address.read_text())["address"], scheduler
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()


def test_a_dead_scheduler_is_told_from_a_stop(
    own_scheduler: tuple[str, subprocess.Popen[bytes]], cluster: Client, store: Path, serial: xr.Dataset
) -> None:
    address, scheduler = own_scheduler
    with connect(address) as client, pytest.raises(ClusterLostError):
        run(store, client, after(2, scheduler.kill))
    assert 2 <= len(tiles_done(REQUEST, store)) < len(TILES)
    run(store, cluster)
    assert_serial(store, serial)


def test_a_worker_that_preloads_the_package_has_what_tiles_need_and_a_start_no_more() -> None:
    """Otherwise the import would block the heartbeat of a worker of an existing cluster; xarray alone takes 0.5 s."""
    asked = """
import sys, gear_rattle.workers.cluster
gear_rattle.workers.cluster.dask_setup(None)
assert "gear_rattle.workers.cluster.runner" in sys.modules
import gear_rattle.service.app
print(*sys.modules.keys() & {"xarray", "pandas", "matplotlib", "scipy.optimize", "bokeh", "alembic.command"})
"""
    said = subprocess.run(
        [sys.executable, "-c", asked], cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=HANG
    )
    assert (said.returncode, said.stdout.strip()) == (0, ""), said.stderr


def test_a_task_that_began_while_it_was_given_up_has_ended(
    cluster: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even if the scheduler does not know yet that a worker runs it: a second join would read data that it moves."""
    begun = tmp_path / "begun"

    def endless() -> None:
        begun.touch()
        while True:
            time.sleep(0.01)

    future = cluster.submit(endless, pure=False)
    wait_until(begun.exists)
    monkeypatch.setattr(cluster, "processing", dict)
    gear_rattle.workers.cluster.cluster.end_tasks_and_wait(cluster, [future])
    at_work = cluster.run(lambda dask_worker: len(dask_worker.state.executing))
    assert set(at_work.values()) <= {0}
    cluster.wait_for_workers(2)


def test_families_are_joined_on_the_cluster(cluster: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Joined block by block, the survey has the bytes of a join in this process. After a stop, it is joined later."""
    monkeypatch.setattr(gear_rattle.workers.families.blocks, "SLOTS_OF_BLOCK", 8 * 3**2)
    request = REQUEST.model_copy(update={"quantities": tuple(map(Group, ("attractors", "lyapunov", "families")))})
    there, here = tmp_path / "there.zarr", tmp_path / "here.zarr"
    create_store(request, there)
    run_tiles(request, there, tiles_of(request), cluster, lambda _: None, lambda: False)
    shutil.copytree(there, here)
    with pytest.raises(StoppedError):
        complete_on_cluster(cluster, request, there, lambda: True)
    assert lacks_families(request, there)
    complete_on_cluster(cluster, request, there, lambda: False)
    join_attractors_of_survey(request, here)
    assert not lacks_families(request, there)
    files = [path.relative_to(here) for path in here.rglob("*") if path.is_file()]
    assert [file for file in files if (here / file).read_bytes() != (there / file).read_bytes()] == []


@pytest.mark.parametrize("kill", [False, pytest.param(True, marks=deep)])
def test_attractors_are_proved_on_the_cluster(
    cluster: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kill: bool
) -> None:
    """Proofs that are stopped and resumed, also after the kill of a worker, have the same bytes as in this process."""
    monkeypatch.setattr(gear_rattle.workers.certificates, "AT_ONCE", 1)
    asked = {"quantities": (Group.ATTRACTORS,), "certify": True}
    request = REQUEST.model_copy(update=asked)
    there, here = tmp_path / "there.zarr", tmp_path / "here.zarr"
    create_store(request, there)
    run_tiles(request, there, tiles_of(request), cluster, lambda _: None, lambda: False)
    shutil.copytree(there, here)
    told: list[tuple[int, int]] = []
    with pytest.raises(StoppedError):
        complete_on_cluster(cluster, request, there, lambda: bool(told[1:]), lambda *numbers: told.append(numbers))

    def tell(done: int, number: int) -> None:
        if kill and not told:
            os.kill(next(iter(cluster.run(os.getpid).values())), signal.SIGKILL)
        told.append((done, number))

    resumed = told.pop()[0]
    told.clear()
    complete_on_cluster(cluster, request, there, lambda: False, tell)
    assert told[0][0] == resumed > 0
    assert told[-1][0] == told[-1][1]
    complete(request, here)
    proved, again = (path.with_name(f"{path.stem}.certificates.zarr") for path in (here, there))
    files = [path.relative_to(proved) for path in proved.rglob("*") if path.is_file()]
    assert len(files) > 3
    assert [file for file in files if (proved / file).read_bytes() != (again / file).read_bytes()] == []
    cluster.wait_for_workers(2)


def test_workers_that_cannot_prove_say_so_before_they_compute(
    cluster: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise MissingExtraError("proofs need python-flint")

    monkeypatch.setattr(gear_rattle.workers.cluster.runner, "require_proof_extra", missing)
    request = REQUEST.model_copy(update={"certify": True})
    create_store(request, tmp_path / "survey.zarr")
    with pytest.raises(MissingExtraError):
        run_tiles(request, tmp_path / "survey.zarr", TILES, cluster, lambda _: None, lambda: False)
    assert not tiles_done(request, tmp_path / "survey.zarr")
