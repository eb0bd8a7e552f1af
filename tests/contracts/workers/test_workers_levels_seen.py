"""Pictures of more cells than they have room for: no island of one cell is lost, at any size."""

from io import BytesIO

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from depth import either
from matplotlib.colors import to_rgb

from gear_rattle.workers.pictures.levels import DisplayedCells, choose_level_for_window, reduce_cells
from gear_rattle.workers.pictures.maps import CODE_COLOURS, render_map_picture
from gear_rattle.workers.survey.levels.grid import possible_levels
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.schema import CELL
from rattle import KINDS

SHAPE, WHOLE = (70, 45), (64, 32)  # that have cells of levels with fewer cells, and that have none
CODED = {"flag_meanings": " ".join(KINDS)}
NAN, INF = float("nan"), float("inf")
ISLANDS = [
    ("attractor_kind", CODED, np.int8, 1.0, 3.0),
    ("attractor_kind", CODED, np.int8, 3.0, 1.0),
    ("orbit_exists", {}, bool, 0.0, 1.0),
    ("orbit_exists", {}, bool, 1.0, 0.0),
    ("attractor_m", {}, np.int32, 1.0, 40.0),
    ("n_attractors", {}, np.int16, 5.0, 1.0),
    ("lyapunov_max", {}, np.float64, 0.5, -0.25),
    ("lyapunov_max", {}, np.float64, -0.5, 0.25),
    ("lyapunov_max", {}, np.float64, NAN, 0.25),
    ("lyapunov_max", {}, np.float64, 0.25, NAN),
    ("boundary_distance", {}, np.float64, 1.5, 0.0),
    ("boundary_distance", {}, np.float64, 0.0, 1.5),
    ("boundary_distance", {}, np.float64, 1.5, INF),
    ("boundary_distance", {}, np.float64, INF, 1.5),
    ("worst_level", {}, np.float64, -20.0, -INF),
    ("worst_level", {}, np.float64, -INF, -20.0),
    ("attractor_phase", {}, np.float64, 0.0, 0.5),
    ("attractor_phase", {}, np.float64, 0.75, 0.25),
    ("attractor_phase", {}, np.float64, NAN, 0.25),
]


def plane_of(name: str, attributes: dict[str, str], kind: type, values: np.ndarray) -> xr.DataArray:
    return xr.DataArray(np.nan_to_num(values, posinf=0, neginf=0).astype(kind), dims=CELL, name=name, attrs=attributes)


@pytest.mark.parametrize(("name", "attributes", "kind", "sea", "island"), ISLANDS)
def test_no_island_is_lost(name: str, attributes: dict[str, str], kind: type, sea: float, island: float) -> None:
    shape = SHAPE if attributes or kind is bool else WHOLE  # the mean of two cells is not one of theirs
    for at in ((0, 0), (shape[0] - 1, shape[1] - 1), (33, 17)):
        values, status = np.full(shape, sea), np.ones(shape, np.int8)
        values[at] = island
        plane = plane_of(name, attributes, kind, values)
        for level in possible_levels(shape)[:4]:
            seen = reduce_cells(plane, values, status, level)
            assert seen.values.shape == level.shape
            place = at[0] // level.covered_cells[0], at[1] // level.covered_cells[1]
            expected = np.full(level.shape, sea)
            expected[place] = island
            np.testing.assert_allclose(seen.values, expected, atol=1e-6)
            assert (seen.status == 1).all()


def test_of_several_codes_the_rarest_is_shown() -> None:
    values, status = np.ones(SHAPE), np.ones(SHAPE, np.int8)
    values[:, ::2] = 2
    values[8:10, 8:10] = [[1, 2], [3, 1]]
    plane = plane_of("attractor_kind", CODED, np.int8, values)
    for level in possible_levels(SHAPE)[:5]:
        assert (reduce_cells(plane, values, status, level).values == 3).sum() == 1


def test_shares_are_those_of_the_cells() -> None:
    random = np.random.default_rng(0)
    values, status = random.integers(1, 3, (64, 32)).astype(float), np.ones((64, 32), np.int8)
    plane = plane_of("attractor_kind", CODED, np.int8, values)
    numbers = np.where(random.random(values.shape) < 0.3, np.nan, values)
    for level in possible_levels(values.shape)[:5]:
        shares = reduce_cells(plane, values, status, level).code_shares
        assert shares == pytest.approx({code: (values == code).mean() for code in (1, 2)})
        seen = reduce_cells(plane_of("lyapunov_max", {}, np.float64, values), numbers, status, level)
        assert seen.share_without_number == pytest.approx(np.isnan(numbers).mean())


def test_what_is_not_computed_or_failed_is_told() -> None:
    values, status = np.ones((8, 8)), np.zeros((8, 8), np.int8)
    status[:4], status[5, 5], status[2, 2] = 1, 1, FAILED
    values[status != 1] = 0
    found: DisplayedCells = reduce_cells(
        plane_of("attractor_kind", CODED, np.int8, values), values, status, possible_levels((8, 8))[1]
    )
    assert found.status.tolist() == [[FAILED, 1], [0, 1]]
    assert found.values.tolist() == [[1, 1], [0, 1]]
    assert found.code_shares == {1: 1.0}


def test_the_finest_level_that_there_is_room_for() -> None:
    levels = possible_levels((3000, 1000))
    assert choose_level_for_window(levels, (0, 0), (3000, 1000), (3000, 1000)).level is None
    whole = choose_level_for_window(levels, (0, 0), (3000, 1000), (512, 512))
    assert whole.level is not None
    assert whole.level.shape == (375, 250)
    some = choose_level_for_window(levels, (1001, 500), (2001, 1000), (512, 512))
    assert some.level == levels[0]
    assert some.spans == (slice(500, 1001), slice(250, 500))
    assert choose_level_for_window(levels[:1], (0, 0), (3000, 1000), (9, 9)).level == levels[0]


def test_an_island_is_in_the_picture() -> None:
    """In whichever cell it is, of more cells than the picture has pixels."""

    def pixels(at: tuple[int, int] | None) -> np.ndarray:
        exists = np.zeros((1, 1300, 1100), bool)
        if at:
            exists[0, *at] = True
        survey = xr.Dataset(
            {"orbit_exists": (("orbit", *CELL), exists), "status": (CELL, np.ones(exists.shape[1:], np.int8))},
            {"epsilon": np.linspace(0.1, 0.2, 1300), "delta": np.linspace(0.4, 1.0, 1100), "orbit": ["A"], "beta": 0.6},
        )
        picture = matplotlib.image.imread(BytesIO(render_map_picture(survey, "orbit_exists")))[..., :3]
        found: np.ndarray = np.isclose(picture, to_rgb(CODE_COLOURS[1]), atol=0.01).all(axis=-1)
        return found

    sea = pixels(None)
    for at in either(((1299, 1099),), ((700, 301), (1299, 1099))):
        assert (pixels(at) & ~sea).sum() > 0


def test_an_island_beside_what_is_rarer_is_shown_too() -> None:
    """Beside a line of what is in fewer cells, whose other cells are shown."""
    values, status = np.ones(SHAPE), np.ones(SHAPE, np.int8)
    values[:, 30:] = 2
    values[16:40, 9] = 3
    values[25, 10] = 2
    plane = plane_of("attractor_kind", CODED, np.int8, values)
    for level in possible_levels(SHAPE)[1:3]:  # in which the island and the line are in one cell
        seen = reduce_cells(plane, values, status, level).values
        island = 25 // level.covered_cells[0], 10 // level.covered_cells[1]
        assert seen[island] == 2
        line = seen[16 // level.covered_cells[0] : 40 // level.covered_cells[0], island[1]]
        assert (line == 3).sum() == line.size - 1
