"""Tiles that are taken from their workers, without a cluster."""

import time
from collections import deque
from contextlib import nullcontext
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ended_tasks
import pytest

import gear_rattle.workers.cluster.submission
from gear_rattle.workers import Axis, SurveyRequest, TileRecord, tiles_of
from gear_rattle.workers.cluster import runner
from gear_rattle.workers.cluster.submission import SubmittedTiles
from gear_rattle.workers.survey.tiles import Tile

REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.6, num=4),
    epsilon=Axis(start=0.05, stop=0.1, num=2),
    quantities=("region",),
    tile={"delta": 2, "epsilon": 1},
)


RECORD = TileRecord(0, 2, (), 0, 0.0)


class Future:
    """A task that never ends."""

    def __init__(self, key: str) -> None:
        self.key = key

    def add_done_callback(self, _: Any) -> None:
        pass

    def release(self) -> None:
        pass


class Client:
    """Enough of dask's for tasks that never end."""

    loop = SimpleNamespace(add_callback=print)

    def submit(self, *_: Any, key: str, **__: Any) -> Future:
        return Future(key)


def test_endless_tiles_are_taken_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes that end at once can both be given the same tile, and that is two deaths of it."""
    ended: list[str] = []
    monkeypatch.setattr(
        gear_rattle.workers.cluster.submission,
        "end_tasks",
        lambda _, futures: ended.extend(each.key for each in futures),
    )
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "TILE_SECONDS", -1.0)
    submission = SubmittedTiles(lambda: None, REQUEST, "nowhere", Client())  # type: ignore[arg-type, return-value]
    first, second = tiles_of(REQUEST)[:2]
    submission.submit(first)
    submission.submit(second)

    def apart() -> set[int]:
        return {each.work.tile.index for each in submission.in_flight.values() if each.work.isolated}

    for _ in range(3):
        submission.isolate_endless_tile()
        assert apart() == {first.index}
    assert len(ended) == 1
    monkeypatch.setattr(submission, "_next_end", 0.0)  # a minute later
    submission.isolate_endless_tile()
    assert apart() == {first.index, second.index}
    monkeypatch.setattr(submission, "_next_end", 0.0)
    submission.isolate_endless_tile()
    assert len(ended) == 2  # what is apart has its own limits


def test_a_large_tile_may_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of a large survey that is refined were taken for endless on a machine that had other things to do."""
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "end_tasks", lambda *_: None)
    submission = SubmittedTiles(lambda: None, REQUEST, "nowhere", Client())  # type: ignore[arg-type, return-value]
    small, large = (Tile(index, slice(0, side), slice(0, side)) for index, side in enumerate((64, 128)))
    submission.submit(large)
    submission.submit(small)
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 1.5 * gear_rattle.workers.cluster.submission.TILE_SECONDS)
    submission.isolate_endless_tile()
    monkeypatch.setattr(submission, "_next_end", 0.0)
    submission.isolate_endless_tile()
    assert [each.work.tile for each in submission.in_flight.values() if each.work.isolated] == [small]


def test_a_late_tile_is_repeated_once_while_others_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tile that is only slow would occupy one worker after the other; holders of undelivered results come last."""
    asked: list[str] = []

    class Four(Client):
        def submit(self, *_: Any, key: str, workers: Any = None, **__: Any) -> Future:
            asked.extend(workers or [])
            return Future(key)

        def processing(self) -> dict[str, list[str]]:
            return {"holding": [], "slow": ["tile"], "idle": []}

        def who_has(self, _: Any) -> dict[str, tuple[str, ...]]:
            return {"other": ("holding",)}

    submission = SubmittedTiles(lambda: None, REQUEST, "nowhere", Four())  # type: ignore[arg-type, return-value]
    submission.submit(tiles_of(REQUEST)[0])
    submission.repeat_late_tiles(again=True)
    assert asked == []
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_SECONDS", -1.0)
    for again, expected in ((False, ["idle"]), (False, ["idle"]), (True, ["idle", "idle"])):
        submission.repeat_late_tiles(again)
        assert asked == expected


def test_a_result_that_waits_with_one_of_a_frozen_worker_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client may ask for two results at once, and gets neither if one is at a frozen worker, which looks idle."""
    tiles, rounds = deque(tiles_of(REQUEST)), count()

    class Two(Client):
        """Workers hold the results of the first two tasks; then one is frozen, and the other answers."""

        def __init__(self) -> None:
            self.held: dict[str, str] = {}
            self.at: dict[str, list[str]] = {"frozen": [], "good": []}

        def nthreads(self) -> dict[str, int]:
            return dict.fromkeys(self.at, 1)

        def processing(self) -> dict[str, list[str]]:
            return self.at

        def who_has(self, _: Any) -> dict[str, tuple[str]]:
            return {key: (address,) for key, address in self.held.items()}

        def submit(self, *arguments: Any, key: str, workers: Any = None, **__: Any) -> Future:
            future = Future(key)
            if len(self.held) < 2:
                self.held[key] = ("good", "frozen")[len(self.held)]
            elif (workers or ["good"])[0] == "frozen":
                self.at["frozen"].append(key)
            else:
                (tile,) = (each for each in arguments if isinstance(each, Tile))
                submission._ended.put((future, TileRecord(tile.index, tile.n_cells, (), 0, 0.0), None))
            return future

    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_SECONDS", -1.0)
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "end_tasks", lambda *_: None)
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "LATE_FACTOR", 0)
    monkeypatch.setattr(runner, "POLL_SECONDS", 0.0)
    submission = SubmittedTiles(lambda: None, REQUEST, "nowhere", Two())  # type: ignore[arg-type, return-value]
    done: list[Any] = []
    runner._run_submission(
        submission, tiles, done.append, lambda: next(rounds) > 100, lambda: True, lambda: False, print
    )
    assert sorted(record.index for record in done) == [tile.index for tile in tiles_of(REQUEST)]


def test_attempts_that_lost_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such attempts may overwrite a tile that a later round has changed."""
    submission = SubmittedTiles(lambda: None, REQUEST, "nowhere", Client())  # type: ignore[arg-type, return-value]
    for _ in range(3):
        submission.submit(tiles_of(REQUEST)[0])
    slow, quick, late = submission.in_flight.values()
    monkeypatch.setattr(submission, "next_result", lambda _: (quick, RECORD))
    assert submission.next_record(0.0) == RECORD
    assert submission.superseded_futures == [slow.future, late.future]
    assert not submission.in_flight


def test_a_pause_begins_no_tile_and_gives_up_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended = list[int](), list[int]()

    def compute(_request: Any, _path: str, tile: Any, *_: Any) -> TileRecord:
        begun.append(tile.index)
        return TileRecord(tile.index, tile.n_cells, (), 0, 0.0)

    monkeypatch.setattr(runner, "advance_tile", compute)
    monkeypatch.setattr(runner, "remove_outdated_results", lambda *_: None)
    monkeypatch.setattr(runner, "tile_recorder", lambda _: nullcontext(lambda _: None))
    client, tiles = ended_tasks.Client(2), tiles_of(REQUEST)

    def run(should_pause: Any) -> None:
        left: Any = (tile for tile in tiles if tile.index not in ended)
        told: Any = client, lambda record: ended.append(record.index)
        runner.run_tiles(REQUEST, tmp_path, left, *told, lambda: False, should_pause=should_pause)

    run(lambda: bool(ended))
    assert begun == ended
    assert len(begun) == 2  # the second one was at work when the first ended
    run(lambda: False)
    assert begun == ended
    assert sorted(begun) == [0, 1, 2, 3]
