"""Workers that are killed, frozen, poisoned or no longer wanted: the same bits, and executions counted."""

import os
import random
import signal
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest
from distributed import Client
from faults import REQUEST, Faults
from service_processes import assert_bit_identical, wait_until

import workers.cluster
import workers.submission
from workers import SurveyRequest, TileRecord, create_store, embedded_cluster, finish_store, open_survey, run_tiles
from workers.evaluate import FAILED
from workers.tiles import tiles_of

TILES = tiles_of(REQUEST)


@pytest.fixture
def faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Faults:
    faults = Faults(tmp_path)
    monkeypatch.setenv("PYTHONPATH", faults.environment["PYTHONPATH"])
    return faults


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "survey.zarr"
    create_store(REQUEST, path)
    return path


def run(
    store: Path, client: Client, act: Callable[[int], None] = lambda _: None, request: SurveyRequest = REQUEST
) -> list[TileRecord]:
    """Run to the end; act is called with the number of tiles done after each."""
    records: list[TileRecord] = []

    def on_tile(record: TileRecord) -> None:
        records.append(record)
        act(len(records))

    run_tiles(request, store, tiles_of(request), client, on_tile, lambda: False)
    finish_store(store)
    assert sorted(record.index for record in records) == [tile.index for tile in tiles_of(request)]
    return records


def pids(client: Client) -> list[int]:
    """The worker processes that live, frozen or not."""
    return [nanny.pid for nanny in client.cluster.workers.values() if nanny.pid]


def test_workers_killed_at_random(faults: Faults, store: Path, expected: dict[str, np.ndarray]) -> None:
    chance, killed = random.Random(1), []

    def kill(done: int) -> None:
        if done % 9 == 0 and (alive := pids(client)):
            killed.append(chance.choice(alive))
            os.kill(killed[-1], signal.SIGKILL)

    with embedded_cluster(2) as client:
        records = run(store, client, kill)
    assert len(killed) >= 4
    assert not any(record.failed_cells for record in records)
    assert_bit_identical(open_survey(store), expected)
    executed = faults.executions()
    assert set(executed) == set(range(64))
    # Only what a dead worker was at is computed again, or had just ended.
    assert executed.total() <= 64 + 2 * len(killed)


def test_a_frozen_worker_is_replaced(
    faults: Faults, store: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers.cluster, "SILENT_SECONDS", 1)  # dask makes it 5 at least
    with embedded_cluster(2) as client:
        victim = pids(client)[0]
        began = time.monotonic()
        records = run(store, client, lambda done: os.kill(victim, signal.SIGSTOP) if done == 5 else None)
        assert time.monotonic() - began < 45
        assert not psutil.pid_exists(victim)
        wait_until(lambda: len(pids(client)) == 2)
    assert not any(record.failed_cells for record in records)
    assert_bit_identical(open_survey(store), expected)
    assert faults.executions().total() <= 65


def test_a_tile_of_a_frozen_worker_is_repeated_elsewhere(
    faults: Faults, store: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on an existing cluster, whose scheduler waits for minutes."""
    monkeypatch.setattr(workers.cluster, "SILENT_SECONDS", 300)
    monkeypatch.setattr(workers.submission, "LATE_SECONDS", 1.0)
    monkeypatch.setattr(workers.submission, "LATE_FACTOR", 0)
    with embedded_cluster(2) as client:
        victim = pids(client)[0]
        began = time.monotonic()
        run(store, client, lambda done: os.kill(victim, signal.SIGSTOP) if done == 5 else None)
        assert time.monotonic() - began < 45
        before = snapshot(store)
        os.kill(victim, signal.SIGCONT)  # it goes on with its tile, and with the write
        wait_until(lambda: psutil.Process(victim).status() != psutil.STATUS_STOPPED)
        assert client.run(os.getpid).keys() == client.nthreads().keys()
        wait_until(lambda: not any(client.processing().values()))
        assert {name: content for name, content in snapshot(store).items() if ".partial" not in name} == before
    assert_bit_identical(open_survey(store), expected)
    assert faults.executions().total() <= 66


def snapshot(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


POISON = """
    # One cell kills the process that evaluates it, another raises.
    @patch("workers.tiles")
    def poison(tiles):
        def act(request, cells):
            note(f"cells {cells.delta[0]:.6f} {cells.epsilon[0]:.6f} {cells.delta.size * cells.epsilon.size}")
            if DEADLY[0] in cells.delta and DEADLY[1] in cells.epsilon:
                die()
            if RAISING[0] in cells.delta and RAISING[1] in cells.epsilon:
                raise FloatingPointError("no such cell")
        before(tiles, "_evaluate", act)
"""


def test_a_poison_cell_is_the_only_one_lost(faults: Faults, store: Path, expected: dict[str, np.ndarray]) -> None:
    delta, epsilon = REQUEST.delta.values(), REQUEST.epsilon.values()
    cells = [tuple(map(float, cell)) for cell in ((delta[5], epsilon[8]), (delta[12], epsilon[1]))]
    faults.inject("DEADLY, RAISING = {}, {}\n".format(*cells) + textwrap.dedent(POISON))
    with embedded_cluster(2) as client:
        records = run(store, client)
    failed = {(i, j): message for record in records for i, j, message in record.failed_cells}
    assert set(failed) == {(8, 5), (1, 12)}
    assert failed[8, 5] == "killed its process 2 times (SIGKILL)"
    assert failed[1, 12] == "FloatingPointError: no such cell"

    survey = open_survey(store).load()
    assert {(i, j) for i, j in zip(*np.nonzero(survey["status"].values == FAILED), strict=True)} == set(failed)
    whole = np.ones(REQUEST.shape, dtype=bool)
    whole[8, 5] = whole[1, 12] = False
    for name, values in expected.items():
        assert survey[name].values[..., whole].tobytes() == values[..., whole].tobytes(), name

    executed = faults.executions()
    guilty = next(
        tile.index for tile in TILES if 8 in range(*tile.epsilon.indices(16)) and 5 in range(*tile.delta.indices(16))
    )
    assert executed[guilty] == 3  # two workers died of it, and once apart
    assert executed.total() <= 68  # a death can take the record of the tile before with it
    assert faults.notes("cells")[f"{delta[5]:.6f} {epsilon[8]:.6f} 1"] == 2
    assert faults.notes("cells")[f"{delta[4]:.6f} {epsilon[8]:.6f} 1"] == 1  # its neighbour


def test_unwanted_tiles_end_at_once(tmp_path: Path) -> None:
    long = SurveyRequest(
        delta=REQUEST.delta,
        epsilon=REQUEST.epsilon,
        initial_conditions={"count": 65_536},
        tile={"delta": 4, "epsilon": 4},
    )
    path = tmp_path / "long.zarr"
    create_store(long, path)
    with embedded_cluster(2) as client:
        at_work = pids(client)
        stop = threading.Event()
        thread = threading.Thread(
            target=run_tiles, args=(long, path, tiles_of(long), client, lambda _: None, stop.is_set, stop.is_set)
        )
        thread.start()
        wait_until(lambda: sum(map(len, client.processing().values())) == 2)
        began = time.monotonic()
        stop.set()
        wait_until(lambda: not any(psutil.pid_exists(pid) for pid in at_work))
        assert time.monotonic() - began < 2
        thread.join(timeout=30)
        assert not thread.is_alive()
        wait_until(lambda: len(client.nthreads()) == 2 and not set(pids(client)) & set(at_work))
