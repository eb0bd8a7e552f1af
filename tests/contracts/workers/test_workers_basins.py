"""The optional variables of basins: a survey holds what the library says of each cell, however it is cut into tiles."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from depth import DEEP, deep
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import Axis, Group, SurveyRequest, create_store, finish_store, tiles_of
from gear_rattle.workers.pictures import maps
from gear_rattle.workers.pictures.maps import render_map_picture

pytestmark = pytest.mark.usefixtures("templates_once")

NAMES = ("basin_entropy", "boundary_basin_entropy", "boundary_distance", "boundary_distance_phase", "crisis_side")
# quiet alone, another basin, chaos, past its crisis, so near the quiet limit that nothing can be told, no quiet motion
REQUEST = SurveyRequest(
    delta=Axis(start=0.55, stop=0.6, num=2),
    epsilon=Axis(start=0.01, stop=0.229, num=6),
    quantities=(Group.BASINS,),
    initial_conditions={"v_max": 6.0},
    tile={"delta": 2, "epsilon": 6},
)


def survey_of(request: SurveyRequest, path: Path) -> xr.Dataset:
    create_store(request, path)
    for tile in tiles_of(request):
        compute_and_write_tile(request, str(path), tile)
    finish_store(path)
    return xr.open_zarr(path, chunks=None).load()


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return survey_of(REQUEST, tmp_path_factory.mktemp("basins") / "survey.zarr")


def test_a_cell_is_what_the_library_says(survey: xr.Dataset) -> None:
    assert set(survey.data_vars) == {*NAMES, "status"}
    for i, epsilon in enumerate(survey.epsilon.values):
        for j, delta in enumerate(survey.delta.values):
            if (i + j) % 2 and not DEEP:  # cells of every kind remain
                continue
            gear, cell = rattle.Gear(float(delta), float(epsilon)), survey.isel(epsilon=i, delta=j)
            margin = gear.boundary_distance(v_max=6.0)
            late = np.isnan(margin.v) and margin.undecided == 0
            entropy = (np.nan, np.nan) if late else rattle.basin_entropy(gear.basins(100, 6.0, "refined"))
            known = (*entropy[:2], margin.v, margin.tau, int(rattle.crisis_side(delta, epsilon)))
            assert np.array_equal([float(cell[name]) for name in NAMES], known, equal_nan=True)
    assert np.isinf(survey.boundary_distance).any()
    assert (survey.boundary_distance == 0).any()
    assert set(np.unique(survey.crisis_side)) >= {1, 2, 3}


@deep
def test_tiles_do_not_show(survey: xr.Dataset, tmp_path: Path) -> None:
    other = REQUEST.model_copy(update={"tile": REQUEST.tile.model_copy(update={"delta": 1, "epsilon": 4})})
    again = survey_of(other, tmp_path / "survey.zarr")
    for name in NAMES:
        assert survey[name].values.tobytes() == again[name].values.tobytes(), name


def test_nothing_is_said_just_below_the_quiet_limit(survey: xr.Dataset) -> None:
    here = survey.isel(epsilon=4, delta=1)
    assert 0.97 < float(here.epsilon) / rattle.Gear(float(here.delta), 0.0).quiet_limit < 1
    assert np.isnan([float(here[name]) for name in NAMES[:4]]).all()


@pytest.mark.parametrize(
    ("name", "meanings"),
    [
        ("boundary_distance", {"undecided", "infinite", "no quiet motion", "SN1", "quiet limit"}),
        ("basin_entropy", {"undecided", "SN1", "quiet limit"}),
        ("boundary_basin_entropy", {"no boundary, or undecided", "SN1", "quiet limit"}),
        ("boundary_distance_phase", {"no such impact"}),
        ("crisis_side", {"SN1", "quiet limit"}),
    ],
)
def test_a_map_says_what_cells_without_a_value_mean(
    survey: xr.Dataset, name: str, meanings: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    draw = maps.draw_legend
    monkeypatch.setattr(
        maps, "draw_legend", lambda axes: (said.extend(axes.get_legend_handles_labels()[1]), draw(axes))
    )
    assert render_map_picture(survey, name).startswith(b"\x89PNG")
    assert set(said) == meanings
