"""The contents of a cell depend on the request and the cell alone: not on tiles, their order, or its neighbours."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from depth import deep, either
from hypothesis import given, settings
from hypothesis import strategies as st
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import Axis, SurveyRequest, create_store, open_survey, tiles_done
from gear_rattle.workers.survey.tiles import compute_tile, tiles_of
from rattle.models import model as models
from rattle.parameters import Parameters

# Periodic, chaotic and quiet cells, on both sides of the quiet limit.
GRID = {"delta": Axis(start=0.58, stop=0.78, num=6), "epsilon": Axis(start=0.05, stop=0.24, num=5)}


def survey(delta: int, epsilon: int) -> SurveyRequest:
    return SurveyRequest(**GRID, initial_conditions={"count": 5}, tile={"delta": delta, "epsilon": epsilon}, seed=3)


WHOLE = survey(6, 5)


def run(request: SurveyRequest, path: Path, order: list[int] | None = None) -> xr.Dataset:
    create_store(request, path)
    tiles = tiles_of(request)
    for index in order or range(len(tiles)):
        compute_and_write_tile(request, str(path), tiles[index])
    return open_survey(path, as_stored=True).load()


def assert_bits(first: xr.Dataset, second: xr.Dataset) -> None:
    assert set(first.variables) == set(second.variables)
    for name in first.variables:
        assert first[name].dtype == second[name].dtype
        assert np.array_equal(first[name].values.view(), second[name].values, equal_nan=first[name].dtype.kind in "fc")
        if first[name].dtype.kind in "fcib":
            assert first[name].values.tobytes() == second[name].values.tobytes(), name


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return run(WHOLE, tmp_path_factory.mktemp("whole") / "survey.zarr")


@given(
    shape=st.tuples(st.integers(2, 60), st.integers(2, 60)),
    tile=st.tuples(st.integers(1, 60), st.integers(1, 60)),
)
def test_tiles_cover_every_cell_once(shape: tuple[int, int], tile: tuple[int, int]) -> None:
    request = SurveyRequest(
        delta=Axis(start=0.5, stop=1, num=shape[0]),
        epsilon=Axis(start=0, stop=1, num=shape[1]),
        tile={"delta": min(tile[0], shape[0]), "epsilon": min(tile[1], shape[1])},
    )
    covered = np.zeros(request.shape, int)
    tiles = tiles_of(request)
    for each in tiles:
        covered[each.epsilon, each.delta] += 1
        assert each.n_cells == covered[each.epsilon, each.delta].size
    assert np.all(covered == 1)
    assert [each.index for each in tiles] == list(range(request.n_tiles))


def test_the_grid_has_every_kind_of_motion(whole: xr.Dataset) -> None:
    assert {1, 2, 3} <= set(np.unique(whole.attractor_kind))
    assert len(np.unique(whole.region)) >= 3


@pytest.mark.parametrize(
    ("delta", "epsilon"), [(5, 4), *(pytest.param(*shape, marks=deep) for shape in ((2, 3), (1, 1), (6, 1)))]
)
def test_tile_shape_does_not_show(tmp_path: Path, whole: xr.Dataset, delta: int, epsilon: int) -> None:
    assert_bits(run(survey(delta, epsilon), tmp_path / "survey.zarr"), whole)


@settings(max_examples=either(1, 3))
@given(order=st.permutations(range(9)))
def test_order_does_not_show(tmp_path_factory: pytest.TempPathFactory, whole: xr.Dataset, order: list[int]) -> None:
    assert_bits(run(survey(2, 2), tmp_path_factory.mktemp("order") / "survey.zarr", order), whole)


def test_a_tile_done_twice_and_a_resumed_run_do_not_show(tmp_path: Path, whole: xr.Dataset) -> None:
    path, request = tmp_path / "survey.zarr", survey(2, 2)
    create_store(request, path)
    for tile in (tiles_of(request)[i] for i in (4, 0, 4)):
        compute_and_write_tile(request, str(path), tile)
    assert tiles_done(request, path) == {0, 4}
    missing = sorted(set(range(request.n_tiles)) - tiles_done(request, path))
    assert_bits(run(request, path, missing), whole)


@pytest.mark.parametrize(("i", "j"), [(0, 0), (1, 1), (4, 3)])
def test_a_cell_is_one_call_of_the_library(whole: xr.Dataset, i: int, j: int) -> None:
    cell = whole.isel(epsilon=i, delta=j)
    gear = rattle.Gear(float(cell.delta), float(cell.epsilon), WHOLE.beta)
    found = gear.attractors(count=5, v_max=7.0, seed=3)
    assert int(cell.region) == gear.region()
    assert int(cell.n_attractors) == len(found)
    for slot, attractor in enumerate(found[:8]):
        at = cell.isel(attractor=slot)
        label = (int(at.attractor_m), int(at.attractor_n_plus), int(at.attractor_n_minus))
        assert label == (attractor.m, attractor.n_plus, attractor.n_minus)
        assert float(at.attractor_fraction) == np.float32(attractor.fraction)
        point = [*at.attractor_lyapunov.values, float(at.attractor_phase), float(at.attractor_velocity)]
        np.testing.assert_array_equal(point, [*attractor.lyapunov, attractor.tau, attractor.v])
    names = [str(name) for name in whole.orbit.values[cell.orbit_exists.values]]
    assert names == [orbit.name for orbit in gear.orbits()]


def test_a_failing_cell_loses_only_itself(monkeypatch: pytest.MonkeyPatch, whole: xr.Dataset) -> None:
    bad = (2, 3)
    delta, epsilon = WHOLE.delta.values()[bad[1]], WHOLE.epsilon.values()[bad[0]]
    attractors_of_samples = models.attractors_of_samples

    def failing(classifier: Any, cells: Parameters, *args: Any) -> rattle.Attractors:
        if np.any((cells.delta == delta) & (cells.epsilon == epsilon)):
            raise rattle.RattleError("no luck here")
        return attractors_of_samples(classifier, cells, *args)

    monkeypatch.setattr(models, "attractors_of_samples", failing)
    tile = tiles_of(survey(4, 3))[0]
    values, record = compute_tile(survey(4, 3), tile)
    assert record.failed_cells == ((*bad, "RattleError: no luck here"),)
    assert values["status"][bad] == 3
    assert values["region"][bad] == 0
    assert np.isnan(values["lyapunov_max"][bad])
    ok = np.ones((3, 4), bool)
    ok[bad] = False
    for name, value in values.items():
        expected = whole[name].values[..., tile.epsilon, tile.delta]
        assert value[..., ok].tobytes() == expected[..., ok].tobytes(), name


def test_a_failure_of_the_machine_is_not_stored_as_a_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    def exhausted(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(models, "attractors_of_samples", exhausted)
    with pytest.raises(MemoryError):
        compute_tile(WHOLE, tiles_of(WHOLE)[0])


def test_undecided_samples_are_counted_openly(monkeypatch: pytest.MonkeyPatch) -> None:
    none, nan, some = np.zeros(30, int), np.full(30, np.nan), np.full(30, 0.1)
    undecided = rattle.Attractors(
        np.arange(30), none + 4, none, none, none, none + 5, some, some, nan, nan, nan, none + 100, some
    )
    monkeypatch.setattr(models, "attractors_of_samples", lambda *_: undecided)
    values, record = compute_tile(WHOLE, tiles_of(WHOLE)[0])
    assert record.undecided_cells == record.cells == 30
    assert np.all(values["status"] == 2)
    assert np.all(values["undecided_fraction"] == 1)
    assert np.all(np.isnan(values["lyapunov_max"]))
