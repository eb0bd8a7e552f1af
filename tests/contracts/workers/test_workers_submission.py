"""Which tiles are taken from their workers, without a cluster."""

import time
from types import SimpleNamespace
from typing import Any

import pytest

import workers.cluster.submission
from workers import Axis, SurveyRequest, tiles_of
from workers.cluster.submission import Submission
from workers.survey.tiles import Tile

REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.6, num=4),
    epsilon=Axis(start=0.05, stop=0.1, num=2),
    quantities=("region",),
    tile={"delta": 2, "epsilon": 1},
)


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
        workers.cluster.submission, "end_tasks", lambda _, futures: ended.extend(each.key for each in futures)
    )
    monkeypatch.setattr(workers.cluster.submission, "TILE_SECONDS", -1.0)
    submission = Submission(lambda: None, REQUEST, "nowhere", Client())  # type: ignore[arg-type, return-value]
    first, second = tiles_of(REQUEST)[:2]
    submission.submit(first)
    submission.submit(second)

    def apart() -> set[int]:
        return {each.work.tile.index for each in submission.in_flight.values() if each.work.apart}

    for _ in range(3):
        submission.set_endless_tile_apart()
        assert apart() == {first.index}
    assert len(ended) == 1
    monkeypatch.setattr(submission, "_next_end", 0.0)  # a minute later
    submission.set_endless_tile_apart()
    assert apart() == {first.index, second.index}
    monkeypatch.setattr(submission, "_next_end", 0.0)
    submission.set_endless_tile_apart()
    assert len(ended) == 2  # what is apart has its own limits


def test_a_large_tile_may_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of a large survey that is refined were taken for endless on a machine that had other things to do."""
    monkeypatch.setattr(workers.cluster.submission, "end_tasks", lambda *_: None)
    submission = Submission(lambda: None, REQUEST, "nowhere", Client())  # type: ignore[arg-type, return-value]
    small, large = (Tile(index, slice(0, side), slice(0, side)) for index, side in enumerate((64, 128)))
    submission.submit(large)
    submission.submit(small)
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + 1.5 * workers.cluster.submission.TILE_SECONDS)
    submission.set_endless_tile_apart()
    monkeypatch.setattr(submission, "_next_end", 0.0)
    submission.set_endless_tile_apart()
    assert [each.work.tile for each in submission.in_flight.values() if each.work.apart] == [small]
