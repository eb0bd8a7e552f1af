"""Workers are killed, frozen, poisoned or stopped: the survey has the same bits, and executions are counted."""

import os
import random
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from depth import deep
from distributed import Client
from faults import BOUNDED, FEW_AUDITED, REQUEST, SPARE, Faults
from service_processes import assert_bit_identical, serial_run, written_in
from waiting import HANG, wait_until

import gear_rattle.workers.cluster.cluster
import gear_rattle.workers.cluster.runner
import gear_rattle.workers.cluster.submission
from gear_rattle.workers import (
    SurveyError,
    TileRecord,
    compute_template_on_cluster,
    create_store,
    embedded_cluster,
    finish_store,
    open_survey,
    run_survey,
    run_tiles,
)
from gear_rattle.workers.cluster.isolation import CELL_SECONDS
from gear_rattle.workers.survey.template import template_of
from gear_rattle.workers.survey.tiles import POLL_SECONDS, tiles_of
from gear_rattle.workers.survey.values.evaluate import FAILED

TILES = tiles_of(REQUEST)
N_TILES = REQUEST.n_tiles
DELTA, EPSILON = REQUEST.delta.values(), REQUEST.epsilon.values()
#: Cells (row, column) of the survey POISONED, which the patch recognizes by its seed: the first kills the process that
#: evaluates it, the second raises.
DEADLY, RAISING = (4, 3), (1, 6)
POISONED = REQUEST.model_copy(update={"seed": 13})
POISON = """
    @patch("gear_rattle.workers.survey.tiles")
    def poison(tiles):
        deadly, raising = {}, {}
        def act(request, cells):
            if request.seed != 13:
                return
            note(f"cells {{cells.delta[0]:.6f}} {{cells.epsilon[0]:.6f}} {{cells.delta.size * cells.epsilon.size}}")
            if deadly[0] in cells.delta and deadly[1] in cells.epsilon:
                die()
            if raising[0] in cells.delta and raising[1] in cells.epsilon:
                raise FloatingPointError("no such cell")
        before(tiles, "_evaluate_cells_of_survey", act)
"""
#: A survey with a cell that never ends. In the separate process of a tile, the patch sends at once the signal with
#: which the system would end it at its limit of processor time.
ENDLESS = REQUEST.model_copy(update={"seed": 14})
ENDLESS_CELL = (3, 5)
NEVER_ENDING = """
    @patch("gear_rattle.workers.survey.tiles")
    def endless(tiles):
        import resource
        def act(request, cells):
            if request.seed == 14 and {0} in cells.delta and {1} in cells.epsilon:
                limit = resource.getrlimit(resource.RLIMIT_CPU)[0]
                note(f"endless {{limit - time.process_time():.0f}}")
                if "gear_rattle.workers.cluster.isolation" in sys.modules and limit > 0:
                    os.kill(os.getpid(), signal.SIGXCPU)
                while True:
                    time.sleep(0.01)
        before(tiles, "_evaluate_cells_of_survey", act)
"""
#: A worker that freezes once when its result is requested, after the fault was armed.
FREEZING = """
    @patch("distributed.worker")
    def freezing(worker):
        def act(*args, **kwargs):
            if disarmed("freezing"):
                note(f"frozen {os.getpid()}")
                os.kill(os.getpid(), signal.SIGSTOP)
        before(worker.Worker, "get_data", act)
"""

CREATED = "2026-11-22T12:00:00+00:00"
#: For surveys whose seed is 100 + n: the first n processes that trace the curves are killed.
DEADLY_CURVES = """
    @patch("gear_rattle.workers.survey.template")
    def deadly(template):
        def act(request, created=None):
            if request.seed >= 100:
                note("curves")
                with open(LOG) as log:
                    if log.read().count("curves") <= request.seed - 100:
                        die()
        before(template, "template_of", act)
"""


#: Tiles of the survey BOUNDED that kill their process when they are half written: the fourth tile, and one of those
#: that go through a further round.
DEADLY_WRITES = """
    @patch("gear_rattle.workers.storage.location")
    def deadly(location):
        def act(place, key, content):
            if place.path.name == "bounded.zarr" and key.startswith("audit_leaf/c/"):
                note("written " + key)
                with open(LOG) as log:
                    notes = log.read()
                deaths = notes.count("dead")
                if deaths < 2 and notes.count("written") >= (4, 12)[deaths]:
                    note("dead")
                    die()
        before(location.StoreDirectory, "put", act)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Faults]:
    """Inject the faults into every worker of this module."""
    faults = Faults(tmp_path_factory.mktemp("faults"))
    row, column = ENDLESS_CELL
    faults.inject(
        POISON.format(*((float(DELTA[column]), float(EPSILON[row])) for row, column in (DEADLY, RAISING))),
        NEVER_ENDING.format(float(DELTA[column]), float(EPSILON[row])),
        DEADLY_CURVES,
        FREEZING,
        DEADLY_WRITES,
        FEW_AUDITED,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", faults.environment["PYTHONPATH"])
        yield faults


@pytest.fixture
def faults(environment: Faults) -> Iterator[Faults]:
    environment.forget()
    yield environment
    environment.release()


@pytest.fixture(autouse=True)
def _long_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Allow for a busy machine, on which a worker takes minutes to be replaced."""
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "WORKERLESS_SECONDS", HANG)


@pytest.fixture(scope="module")
def client(environment: Faults) -> Iterator[Client]:  # noqa: ARG001
    """Start two workers that are not replaced when they are silent."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gear_rattle.workers.cluster.cluster, "SILENT_SECONDS", HANG)
        with embedded_cluster(2) as client:
            yield client


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "survey.zarr"
    create_store(REQUEST, path)
    return path


def run(store: Path, client: Client, act: Callable[[int], None] = lambda _: None) -> list[TileRecord]:
    """Run the survey to its end, and call `act` after each tile with the number of tiles done."""
    records: list[TileRecord] = []

    def on_tile(record: TileRecord) -> None:
        records.append(record)
        act(len(records))

    run_tiles(REQUEST, store, TILES, client, on_tile, lambda: False)
    finish_store(store)
    assert sorted(record.index for record in records) == [tile.index for tile in TILES]
    return records


def pids(client: Client) -> list[int]:
    """Return the living worker processes of a cluster, including frozen ones."""
    return [worker.pid for worker in client.cluster.scheduler.workers.values() if psutil.pid_exists(worker.pid)]


def replaced(client: Client, *old: int) -> bool:
    """Return whether two other workers have replaced these."""
    return len(client.nthreads()) == 2 == len(pids(client)) and not {*old} & {*pids(client)}


def test_workers_killed_at_random(faults: Faults, client: Client, store: Path, expected: dict[str, np.ndarray]) -> None:
    chance, killed = random.Random(1), []

    def kill(done: int) -> None:
        if done % 5 == 0 and (alive := pids(client)):
            killed.append(chance.choice(alive))
            os.kill(killed[-1], signal.SIGKILL)

    records = run(store, client, kill)
    assert len(killed) == 3
    assert not any(record.failed_cells for record in records)
    assert_bit_identical(open_survey(store), expected)
    executed = faults.executions()
    assert set(executed) == set(range(N_TILES))
    # Per death, at most two tiles are repeated: the one that ran, and one that had just ended.
    assert executed.total() <= N_TILES + 2 * len(killed)
    wait_until(lambda: replaced(client, *killed))


@deep
def test_a_refined_survey_has_the_same_bytes_whatever_is_killed(
    faults: Faults, client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gear_rattle.workers.survey.refined.rounds.FIRST_AUDIT_FACTOR", SPARE)
    run_survey(BOUNDED, out=tmp_path / "bounded.zarr", cluster=client).close()
    assert faults.notes("written").total() >= 2 * BOUNDED.n_tiles  # there was a further round
    assert faults.notes("dead").total() == 2
    with run_survey(BOUNDED, out=tmp_path / "here.zarr") as here:
        assert here.attrs["refined_wrong_share_upper"] <= BOUNDED.refine.bound  # type: ignore[union-attr]
    written, expected = (written_in(tmp_path / name) for name in ("bounded.zarr", "here.zarr"))
    assert written == expected


def test_a_frozen_worker_is_replaced(
    faults: Faults, store: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gear_rattle.workers.cluster.cluster, "SILENT_SECONDS", 1)  # dask's minimum is 5 s
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_SECONDS", HANG)  # late tiles are not repeated
    with embedded_cluster(2) as client:
        before = pids(client)
        victim = before[0]
        records = run(store, client, lambda done: os.kill(victim, signal.SIGSTOP) if done == 5 else None)
        wait_until(lambda: replaced(client, victim))
        assert not psutil.pid_exists(victim)
        ended = faults.processes() - {*pids(client)}
    assert not any(record.failed_cells for record in records)
    assert_bit_identical(open_survey(store), expected)
    assert faults.executions().total() <= N_TILES + 2 * len(ended)  # other workers may be silent as well


def test_a_tile_of_a_frozen_worker_is_repeated_elsewhere(
    faults: Faults, client: Client, store: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scheduler waits minutes for the silent worker, as the scheduler of an existing cluster does."""
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_SECONDS", 0.1)
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_FACTOR", 0)
    victim = pids(client)[0]
    run(store, client, lambda done: os.kill(victim, signal.SIGSTOP) if done == 5 else None)
    before = snapshot(store)
    os.kill(victim, signal.SIGCONT)  # it goes on with its tile, and writes it
    wait_until(lambda: psutil.Process(victim).status() != psutil.STATUS_STOPPED)
    assert client.run(os.getpid).keys() == client.nthreads().keys()
    wait_until(lambda: not any(client.processing().values()))
    assert snapshot(store) == before
    assert_bit_identical(open_survey(store), expected)
    # Each worker computes a tile at most once, however slow, and the frozen one once more if it had ended the tile.
    assert max(faults.executions().values()) <= 3


def test_a_result_that_a_frozen_worker_holds_is_not_waited_for(
    faults: Faults, client: Client, store: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The worker freezes when its result is requested: the tile is repeated, and so are later tiles sent to it."""
    monkeypatch.setattr(
        gear_rattle.workers.cluster.submission, "LATE_SECONDS", 10 * POLL_SECONDS
    )  # the result is requested many times until then
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_FACTOR", 0)
    try:
        run(store, client, lambda done: faults.arm("freezing") if done == 5 else None)
    finally:
        frozen = [int(pid) for pid in faults.notes("frozen")]
        for pid in frozen:
            os.kill(pid, signal.SIGCONT)
    assert len(frozen) == 1
    assert_bit_identical(open_survey(store), expected)


def snapshot(path: Path) -> dict[str, bytes]:
    """Return the content of the finished files, without temporary files that workers are writing."""
    written = (file for file in path.rglob("*") if ".partial" not in file.name and file.is_file())
    return {str(file.relative_to(path)): file.read_bytes() for file in written}


def test_curves_whose_processes_are_killed_are_traced_again(faults: Faults, client: Client) -> None:
    """A process that ends because its survey was dismissed may just have been given the curves of the next one."""
    request = REQUEST.model_copy(update={"seed": 102})
    assert compute_template_on_cluster(client, request, CREATED, lambda: False) == template_of(request, CREATED)
    assert faults.notes("curves").total() == 3


@deep
def test_curves_that_kill_their_processes_fail_the_survey(
    faults: Faults, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gear_rattle.workers.cluster.runner, "ATTEMPTS", 1)
    with pytest.raises(SurveyError, match="the process that creates the empty store was killed"):
        compute_template_on_cluster(client, REQUEST.model_copy(update={"seed": 10**6}), None, lambda: False)
    assert faults.notes("curves").total() == 2
    wait_until(lambda: len(client.nthreads()) == 2)


def test_a_poison_cell_is_the_only_one_lost(faults: Faults, client: Client, tmp_path: Path) -> None:
    path = tmp_path / "poisoned.zarr"
    create_store(POISONED, path)
    records: list[TileRecord] = []
    run_tiles(POISONED, path, TILES, client, records.append, lambda: False)
    finish_store(path)
    failed = {(i, j): message for record in records for i, j, message in record.failed_cells}
    assert set(failed) == {DEADLY, RAISING}
    assert failed[DEADLY] == "killed its process 2 times (SIGKILL)"
    assert failed[RAISING] == "FloatingPointError: no such cell"

    survey = open_survey(path, as_stored=True).load()
    assert {(i, j) for i, j in zip(*np.nonzero(survey["status"].values == FAILED), strict=True)} == set(failed)
    whole = np.ones(POISONED.shape, dtype=bool)
    whole[DEADLY] = whole[RAISING] = False
    for name, values in serial_run(POISONED).items():
        assert survey[name].values[..., whole].tobytes() == values[..., whole].tobytes(), name

    executed = faults.executions()
    row, column = DEADLY
    guilty = next(
        tile.index
        for tile in TILES
        if row in range(*tile.epsilon.indices(8)) and column in range(*tile.delta.indices(8))
    )
    assert executed[guilty] == 3  # it killed two workers, and then ran in a separate process
    assert executed.total() <= N_TILES + 4  # a worker may die before it reports its previous tile
    assert faults.notes("cells")[f"{DELTA[column]:.6f} {EPSILON[row]:.6f} 1"] == 2
    assert faults.notes("cells")[f"{DELTA[column - 1]:.6f} {EPSILON[row]:.6f} 1"] == 1  # the cell beside it
    wait_until(lambda: len(client.nthreads()) == 2)


def test_unwanted_tiles_end_at_once(faults: Faults, client: Client, store: Path) -> None:
    faults.hold(0)
    at_work = pids(client)
    stop = threading.Event()
    thread = threading.Thread(
        target=run_tiles, args=(REQUEST, store, TILES, client, lambda _: None, stop.is_set, stop.is_set)
    )
    thread.start()
    wait_until(lambda: faults.executions().total() == 2)
    stop.set()
    thread.join(HANG)
    assert not thread.is_alive()
    wait_until(lambda: not any(psutil.pid_exists(pid) for pid in at_work))  # although their tiles never end
    wait_until(lambda: replaced(client, *at_work))
    assert faults.executions().total() == 2


def test_a_cell_that_never_ends_is_the_only_one_lost(
    faults: Faults, client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its tile is taken from the worker, and computed in a separate process with a limit of processor time per cell."""
    path = tmp_path / "endless.zarr"
    create_store(ENDLESS, path)
    records: list[TileRecord] = []
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "TILE_SECONDS", HANG)

    looks: list[float] = []

    def should_stop() -> bool:
        # Only the endless tile is left. The limit holds for one call, so that the tile is taken from one worker.
        if len(records) == N_TILES - 1:
            looks.append(HANG if looks else 0.0)
            monkeypatch.setattr(gear_rattle.workers.cluster.submission, "TILE_SECONDS", looks[-1])
        return False

    run_tiles(ENDLESS, path, TILES, client, records.append, should_stop)
    finish_store(path)
    failed = {(i, j): message for record in records for i, j, message in record.failed_cells}
    assert failed == {ENDLESS_CELL: f"took more than {CELL_SECONDS} s of processor time"}
    limits = sorted(int(left) for left in faults.notes("endless"))
    assert limits[0] < 0  # the worker itself has no limit
    # The separate process evaluates the cell once, and its limit does not count the time of the cells before.
    assert limits[1:] == [pytest.approx(CELL_SECONDS, abs=2)]
    survey = open_survey(path, as_stored=True).load()
    assert survey["status"].values[ENDLESS_CELL] == FAILED
    whole = survey["status"].values != FAILED
    assert whole.sum() == ENDLESS.n_cells - 1
    for name, values in serial_run(ENDLESS).items():
        assert survey[name].values[..., whole].tobytes() == values[..., whole].tobytes(), name
