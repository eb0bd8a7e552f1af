"""Tiles in parts: no part shows in what is stored, none takes long, and what they cost tells the time left."""

import heapq
import math
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import ended_tasks
import numpy as np
import pytest

import rattle
from gear_rattle.workers import Axis, PopulationRequest, SurveyRequest, TileRecord, compute_tile, tiles_of
from gear_rattle.workers.cluster import costs, partial, runner
from gear_rattle.workers.cluster.costs import RunState, sort_tiles_evenly
from gear_rattle.workers.cluster.partial import PART_SECONDS, PartialTile, compute_tile_partly, is_tile_divisible
from gear_rattle.workers.kinds import AnyRequest
from rattle.models import model as models
from rattle.parameters import Parameters

GRID: dict[str, Any] = {
    "delta": Axis(start=0.58, stop=0.78, num=7),
    "epsilon": Axis(start=0.05, stop=0.24, num=5),
    "quantities": ("region", "attractors", "lyapunov", "intensity"),
    "initial_conditions": {"count": 3},
}
SURVEY = SurveyRequest(**GRID, tile={"delta": 7, "epsilon": 5})
GEARS = PopulationRequest.model_validate(
    {
        "gear": {"delta": 0.6, "epsilon": {"distribution": "uniform", "low": 0.05, "high": 0.25}, "beta": 0.6},
        "gears": 6,
        "count": 4,
        "pairs": 0,
        "tile": 6,
    }
)


def in_parts(request: AnyRequest, tile: Any, seconds: float) -> Iterator[PartialTile]:
    part = None
    while part is None or not part.is_whole:
        yield (part := compute_tile_partly(request, tile, part, seconds))


@pytest.mark.parametrize("seconds", [0.0, 0.01, math.inf])
@pytest.mark.parametrize("request_", [SURVEY, GEARS], ids=["survey", "population"])
def test_parts_do_not_show(request_: AnyRequest, seconds: float) -> None:
    (tile,) = tiles_of(request_)
    values, record = compute_tile(request_, tile)
    *_, part = in_parts(request_, tile, seconds)
    assert set(part.values) == set(values)
    for name, value in values.items():
        assert part.values[name].dtype == value.dtype
        assert part.values[name].tobytes() == value.tobytes(), name
    same = "index", "cells", "failed_cells", "undecided_cells", "impacts", "filled_cells"
    assert [getattr(part.record, name) for name in same] == [getattr(record, name) for name in same]


def test_a_cell_that_fails_has_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    bad, attractors_of_samples = (2, 5), models.attractors_of_samples
    point = SURVEY.delta.values()[bad[1]], SURVEY.epsilon.values()[bad[0]]

    def failing(classifier: Any, cells: Parameters, *others: Any) -> rattle.Attractors:
        if np.any((cells.delta == point[0]) & (cells.epsilon == point[1])):
            raise rattle.RattleError("no luck here")
        return attractors_of_samples(classifier, cells, *others)

    monkeypatch.setattr(models, "attractors_of_samples", failing)
    (tile,) = tiles_of(SURVEY)
    *_, part = in_parts(SURVEY, tile, 0.0)
    assert part.record.failed_cells == ((*bad, "RattleError: no luck here"),)
    assert part.values["status"][bad] == 3


def test_a_part_takes_as_long_as_it_may_or_one_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of a tile costs 6 s a cell, the other half 10 ms; by a clock that goes on as cells are computed."""
    now = 0.0
    groups: list[int] = []

    def compute(_request: Any, tile: Any) -> tuple[dict[str, np.ndarray], TileRecord]:
        nonlocal now
        epsilon = np.arange(tile.epsilon.start, tile.epsilon.stop)
        rows = np.where(epsilon < 7, 0.01, 6.0)
        now += float(rows.sum()) * (tile.delta.stop - tile.delta.start)
        groups.append(tile.n_cells)
        shape = epsilon.size, tile.delta.stop - tile.delta.start
        return {"status": np.ones(shape, np.int8)}, TileRecord(tile.index, tile.n_cells, (), 0, 0.0)

    monkeypatch.setattr(partial, "compute_tile", compute)
    monkeypatch.setattr(partial.time, "perf_counter", lambda: now)
    request = SurveyRequest(
        delta=Axis(start=0.5, stop=0.6, num=15),
        epsilon=Axis(start=0.05, stop=0.1, num=15),
        quantities=("attractors",),
        tile={"delta": 15, "epsilon": 15},
    )
    (tile,) = tiles_of(request)
    began, longest = now, 0.0
    for part in in_parts(request, tile, PART_SECONDS):  # noqa: B007
        longest, began = max(longest, now - began), now
    assert longest <= PART_SECONDS + 6.0
    assert part.values["status"].all()
    assert sum(groups) == 225  # none twice
    assert now == pytest.approx(7 * 15 * 0.01 + 8 * 15 * 6.0)
    groups.clear()
    compute_tile_partly(request, tile, None, PART_SECONDS, expected=1e-3)
    assert groups == [225]  # where all was quick so far, parts would only cost


@pytest.mark.parametrize(
    ("quantities", "expected"), [(("region",), False), (("attractors",), True), (("basins",), True)]
)
def test_closed_forms_have_no_parts(quantities: tuple[str, ...], expected: bool) -> None:
    assert is_tile_divisible(SurveyRequest(**GRID | {"quantities": quantities}), 16) is expected
    assert is_tile_divisible(GEARS, 16)
    assert not is_tile_divisible(GEARS, 15)


def test_after_a_pause_a_tile_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of it is computed twice."""
    request = SurveyRequest(**GRID, tile={"delta": 4, "epsilon": 3})
    cells: list[tuple[int, int]] = []
    measured: list[Any] = []

    def advance(request: Any, _path: str, tile: Any, _apart: bool, before: Any, _: float, seconds: float) -> Any:
        part = compute_tile_partly(request, tile, before, seconds and 1e-9)
        cells.extend((tile.index, int(cell)) for cell in np.flatnonzero(part.is_computed))
        return part.record if part.is_whole else part

    def cost(_request: Any, tile: Any) -> Any:
        measured.append(tile)
        return {}, TileRecord(tile.index, tile.n_cells, (), 0, float(tile.n_cells))

    monkeypatch.setattr(runner, "advance_tile", advance)
    monkeypatch.setattr(runner, "remove_outdated_results", lambda *_: None)
    monkeypatch.setattr(runner, "tile_recorder", lambda _: nullcontext(lambda _: None))
    monkeypatch.setattr(runner, "is_tile_divisible", lambda *_: True)
    monkeypatch.setattr(costs, "MANY", 1)
    monkeypatch.setattr(costs, "LEAST_MEASURED", 1)
    monkeypatch.setattr(partial, "compute_tile", cost)
    run_state, ended, left = RunState(), list[TileRecord](), list[float]()

    def run(should_pause: Any) -> None:
        tiles = [tile for tile in tiles_of(request) if tile.index not in {each.index for each in ended}]
        runner.run_tiles(
            request, tmp_path, tiles, ended_tasks.Client(2), ended.append, lambda: False,
            should_pause=should_pause, run_state=run_state, on_left=left.append,
        )  # fmt: skip

    run(lambda: len(cells) > 8)
    assert run_state.seconds_per_cell.keys() == {0, 1, 2, 3}
    assert not ended
    computed = {index: int(part.is_computed.sum()) for index, part in run_state.partial.items()}
    assert max(computed.values()) > 1
    assert min(computed.values()) == 1
    run(lambda: False)
    assert sorted((each.index, each.cells) for each in ended) == [(0, 12), (1, 9), (2, 8), (3, 6)]
    assert run_state.partial == {}
    assert sum(tile.n_cells for tile in measured) == request.n_cells
    assert left[-1] == 0.0


@pytest.mark.parametrize("threads", [1, 2])
def test_the_time_left_is_told_within_a_factor_of_one_and_a_half(threads: int) -> None:
    """A tenth of the plane has nearly all of the cost, as that of a drawing has; from a fifth of the time on."""
    rows, columns, side = 12, 13, 5
    request = SurveyRequest(
        delta=Axis(start=0.5, stop=0.6, num=columns * side),
        epsilon=Axis(start=0.05, stop=0.1, num=rows * side),
        quantities=("attractors",),
        tile={"delta": side, "epsilon": side},
    )
    x, y = np.meshgrid(np.linspace(0, 1, columns * side), np.linspace(0, 1, rows * side))
    noise = np.random.default_rng(5).lognormal(0.0, 0.5, x.shape)
    costs = (0.005 + 6.0 * np.exp(-(((x - 0.8) / 0.15) ** 2) - ((y - 0.75) / 0.2) ** 2)) * noise
    tiles = tiles_of(request)
    run_state = RunState()
    run_state.predict_costs(tiles, columns)
    for tile in run_state.tiles_to_measure(tiles, columns):
        i, j = tile.epsilon.start + side // 2, tile.delta.start + side // 2
        record = TileRecord(tile.index, 1, (), 0, float(costs[i, j]))
        run_state.partial[tile.index] = PartialTile({}, np.zeros((side, side), bool), record, 0.0)
        run_state.record_measured_cell(tile)
    assert not run_state.tiles_to_measure(tiles, columns)
    run_state.partial.clear()
    run_state.predict_costs(tiles, columns)
    idle, ends = [0.0] * threads, list[tuple[float, int, float]]()
    order = run_state.sort_by_cost(tiles, columns)
    assert float(costs[order[0].epsilon, order[0].delta].mean()) > 5.0 * costs.mean()
    for tile in order:
        seconds = float(costs[tile.epsilon, tile.delta].sum())
        end = heapq.heappop(idle) + seconds
        heapq.heappush(idle, end)
        ends.append((end, tile.index, seconds))
    total, told = max(idle), 0
    for end, index, seconds in sorted(ends):
        run_state.record_finished_tile(TileRecord(index, side * side, (), 0, seconds))
        left = run_state.seconds_left(threads)
        assert left is not None
        if 0.2 * total <= end <= 0.9 * total:  # at the very end a tile more or less decides
            assert 1 / 1.5 < left / (total - end) < 1.5
            told += 1
    assert told > 10


def test_the_first_tiles_are_from_all_over_the_plane() -> None:
    request = SurveyRequest(**GRID | {"quantities": ("region",)}, tile={"delta": 1, "epsilon": 1})
    tiles = tiles_of(request)
    for number in (4, 12):
        first = sort_tiles_evenly(tiles, 7)[:number]
        assert {(each.epsilon.start // 3, each.delta.start // 4) for each in first} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert sorted(each.index for each in sort_tiles_evenly(tiles, 7)) == [each.index for each in tiles]
