"""Fair turns between surveys: in which order they come, and that none loses anything by it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from service_support import BODY, front_of, idle_cluster, local_client
from waiting import wait_until

from gear_rattle.service.app import create_app
from gear_rattle.service.database.survey_rows import ActiveSurvey
from gear_rattle.service.jobs import manager, turns
from gear_rattle.service.jobs.turns import TURN_SECONDS, TurnScheduler
from gear_rattle.service.settings import Settings
from gear_rattle.workers import TileRecord


def served(
    turns: TurnScheduler, cells: dict[str, int], owners: dict[str, str] | None = None, each: int = 3
) -> Iterator[str]:
    """The surveys that have turns, each of so many cells, until all are computed; others may be added meanwhile."""
    while cells:
        active = [ActiveSurvey(name, (owners or {}).get(name), left) for name, left in cells.items()]
        following = turns.next_survey(active)
        assert following is not None
        turns.begin_turn(following)
        cells[following.id] -= each
        if cells[following.id] <= 0:
            del cells[following.id]
        yield following.id


def test_a_small_survey_is_behind_no_more_than_two_turns() -> None:
    cells = {"A": 1000, "B": 1000}
    order = served(TurnScheduler(), cells)
    for _ in range(7):
        next(order)
    cells["c"] = 3
    assert "c" in (next(order), next(order))


def test_no_survey_waits_for_ever_behind_small_ones() -> None:
    """Although a new one comes with every turn."""
    cells = {"A": 40}
    order = served(TurnScheduler(), cells)
    had = [next(order)]
    for number in range(100):
        cells[f"small {number}"] = 1
        had.append(next(order))
    assert "A" not in cells
    assert had.count("A") == 14


def test_keys_have_turns_one_after_the_other_however_many_surveys_they_have() -> None:
    cells = {f"{owner} {number}": 30 for owner, count in (("x", 9), ("y", 1)) for number in range(count)}
    owners = {name: name[0] for name in cells}
    order = list(served(TurnScheduler(), cells, owners))
    assert [name[0] for name in order[:20]] == ["x", "y"] * 10


def test_one_without_cells_left_counts_as_the_largest() -> None:
    """Proving its attractors takes hours."""
    cells = {"proved": 0, "A": 1000, "B": 2000}
    order = [each for _, each in zip(range(12), _kept(TurnScheduler(), cells), strict=False)]
    assert order.count("A") == 6
    assert order.count("proved") == order.count("B") == 3
    cells["c"] = 3
    following = _kept(TurnScheduler(), cells)
    assert "c" in (next(following), next(following))
    assert next(_kept(TurnScheduler(), {"proved": 0})) == "proved"


def _kept(turns: TurnScheduler, cells: dict[str, int]) -> Iterator[str]:
    """The surveys that have turns, of which none gets further."""
    while following := turns.next_survey([ActiveSurvey(name, None, left) for name, left in cells.items()]):
        turns.begin_turn(following)
        yield following.id


def test_a_turn_is_bounded_in_seconds_whatever_a_tile_takes() -> None:
    now = 0.0
    turns = TurnScheduler(lambda: now)
    turns.begin_turn(ActiveSurvey("A", None, 9))
    now = TURN_SECONDS - 0.01
    assert not turns.is_turn_over
    now += 0.02
    assert turns.is_turn_over
    turns.begin_turn(ActiveSurvey("B", None, 9))
    assert not turns.is_turn_over


def test_surveys_take_turns_and_say_what_they_wait_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The long one, at work, makes room for the small one, and no tile is computed twice."""
    computed: list[tuple[str, int]] = []
    checked: list[str] = []
    said: dict[str, str] = {}
    small: list[str] = []
    carried: dict[str, list[object]] = {}

    def compute(request: Any, _path: Any, tiles: Any, _client: Any, on_tile: Any, stop: Any, *others: Any) -> None:
        _, should_pause, run_state, on_left = others
        carried.setdefault(request.name, []).append(run_state)
        on_left(70.0)
        job = path.rpartition("/")[2]
        if request.name == "long":
            assert 60.0 < front_of(client).manager.seconds_left(job) <= 70.0
        else:
            assert front_of(client).manager.seconds_left(job) is None
        for tile in tiles:
            if request.name == "long" and len(computed) == 1 and not small:
                small.append(client.post("/v1/surveys", json=BODY | {"name": "small"}).headers["location"])
                said["small"] = client.get(small[0]).json()["message"]
            on_tile(TileRecord(tile.index, tile.n_cells, (), 0, 0.0))
            computed.append((request.name, tile.index))
            if request.name == "small":
                said["long"] = client.get(path).json()["message"]
            if stop() or should_pause():
                return

    monkeypatch.setattr(turns, "TURN_SECONDS", 0.0)
    monkeypatch.setattr(manager, "create_store", lambda request, *_: checked.append(request.name))
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set(range(100)))
    monkeypatch.setattr(manager, "is_incomplete", lambda *_: False)
    monkeypatch.setattr(manager, "finish_store", lambda *_: None)
    monkeypatch.setattr(manager, "run_tiles", compute)
    app = create_app(Settings(data=tmp_path, explorer=False, preload=False), idle_cluster)
    with local_client(app) as client:
        long = BODY | {"name": "long", "epsilon": BODY["epsilon"] | {"num": 8}}
        path = client.post("/v1/surveys", json=long).headers["location"]
        wait_until(lambda: client.get(path).json()["state"] == "successful")
        assert client.get(small[0]).json()["state"] == "successful"
        front = front_of(client)
        assert front.database.active_surveys() == []
        assert front.manager._missing_tiles == {}
    waits = "waits for its turn: {} is computed now"
    assert said == {"small": waits.format("long"), "long": waits.format("small")}
    assert sorted(computed) == [("long", tile) for tile in range(8)] + [("small", tile) for tile in range(4)]
    assert computed.index(("small", 3)) < computed.index(("long", 7))
    assert len(carried["long"]) > 1
    assert len({id(run_state) for run_state in carried["long"]}) == 1  # what is computed is not computed again
    assert checked == ["long", "small"]  # all chunks are read once, not at every turn


def test_what_follows_from_tiles_makes_room_too_and_what_is_verified_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a part of it; one that is refused to be verified because it runs goes on with what it has."""
    done: list[str] = []
    checked: list[str] = []
    refused: list[int] = []
    turn = iter(range(3))

    def run_tiles(request: Any, _path: Any, tiles: Any, _client: Any, on_tile: Any, *_: Any) -> None:
        for tile in tiles:
            on_tile(TileRecord(tile.index, tile.n_cells, (), 0, 0.0))
        if request.name == "small":
            refused.append(client.post(f"{path}/verify").status_code)

    def complete(_client: Any, request: Any, _path: Any, _stop: Any, _on_proved: Any, should_pause: Any) -> None:
        number = next(turn)
        if number == 0:
            small.append(client.post("/v1/surveys", json=BODY | {"name": "small"}).headers["location"])
            assert should_pause() or should_pause()  # it had waited for as many turns as the small one
            return
        if number == 1:
            client.delete(path)
            assert client.post(f"{path}/verify").status_code == 202
            return
        done.append(request.name)

    small: list[str] = []
    monkeypatch.setattr(turns, "TURN_SECONDS", 0.0)
    monkeypatch.setattr(manager, "create_store", lambda request, *_: checked.append(request.name))
    monkeypatch.setattr(manager, "tiles_done", lambda *_: set(range(100)))
    monkeypatch.setattr(manager, "is_incomplete", lambda request, _: request.name == "bounded" and not done)
    monkeypatch.setattr(manager, "finish_store", lambda *_: None)
    monkeypatch.setattr(manager, "run_tiles", run_tiles)
    monkeypatch.setattr(manager, "complete_on_cluster", complete)
    app = create_app(Settings(data=tmp_path, explorer=False, preload=False), idle_cluster)
    with local_client(app) as client:
        bounded = BODY | {"name": "bounded", "epsilon": BODY["epsilon"] | {"num": 8}}
        path = client.post("/v1/surveys", json=bounded).headers["location"]
        wait_until(lambda: client.get(path).json()["state"] in ("successful", "failed"))
        assert client.get(path).json()["message"] == ""
        assert client.get(small[0]).json()["state"] == "successful"
    assert checked == ["bounded", "small", "bounded"]  # the second time because it was verified
    assert refused == [409]
