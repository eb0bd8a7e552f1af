"""Levels: what several cells have together, and that no order, tile, kill or damage shows in their bytes."""

import json
import shutil
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from written import write_tile

import gear_rattle.workers.survey.levels.grid as grid
from gear_rattle.workers import (
    QUANTITIES,
    PopulationRequest,
    SurveyRequest,
    complete,
    compute_tile,
    create_store,
    examine,
    finish_store,
    is_incomplete,
    open_survey,
    place_of,
    tiles_of,
)
from gear_rattle.workers.overviews import build_pyramid_levels
from gear_rattle.workers.pictures.levels import level_opener, reduce_map
from gear_rattle.workers.storage.added import run_in_this_process
from gear_rattle.workers.storage.store import remove_outdated_results
from gear_rattle.workers.survey.levels import reduce
from gear_rattle.workers.survey.levels.grid import (
    GROUP,
    Pair,
    coarsening_factors_of_levels,
    level_blocks,
    stored_levels_of_shape,
)
from gear_rattle.workers.survey.levels.template import OCCURS, SHARE, code_meanings
from gear_rattle.workers.survey.slices import select_slice
from gear_rattle.workers.survey.values.quantities import variables_of_groups
from gear_rattle.workers.survey.values.schema import is_phase
from rattle import REGIONS

TILES = ({"delta": 4, "epsilon": 3}, {"delta": 7, "epsilon": 9})
SHAPES: tuple[Pair, ...] = ((9, 13), (16, 8), (1, 31), (5, 5))
STEPS: list[Pair] = [(2, 2), (2, 2), (1, 2)]

pytestmark = pytest.mark.usefixtures("small_levels", "templates_once")


def survey(tile: dict[str, int] = TILES[0], **fields: Any) -> SurveyRequest:
    given = {
        "delta": {"start": 0.5, "stop": 0.9, "num": 11},
        "epsilon": {"start": 0.05, "stop": 0.2, "num": 9},
        "quantities": ("region", "orbits"),
        "tile": tile,
    }
    return SurveyRequest.model_validate(given | fields)


JOINED = survey(
    quantities=("region", "orbits", "attractors", "lyapunov", "families"),
    initial_conditions={"count": 8},
    slots=3,
    beta={"start": 0.6, "stop": 0.7, "num": 2},
    delta={"start": 0.5, "stop": 0.7, "num": 7},
    epsilon={"start": 0.05, "stop": 0.2, "num": 5},
)


def fill(request: SurveyRequest, path: Path, order: Callable[[list[Any]], Iterable[Any]] = list) -> None:
    create_store(request, path)
    for tile in order(tiles_of(request)):
        write_tile(request, str(path), tile, compute_tile(request, tile)[0])


def make(request: SurveyRequest, path: Path, order: Callable[[list[Any]], Iterable[Any]] = list) -> Path:
    fill(request, path, order)
    complete(request, path)
    finish_store(path)
    return path


def files_of(path: Path) -> dict[str, bytes]:
    levels = path / GROUP
    return {str(file.relative_to(levels)): file.read_bytes() for file in levels.rglob("*") if file.is_file()}


@pytest.fixture(scope="module")
def small_levels() -> Iterator[None]:
    """Levels of surveys of a few cells, in several blocks."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"LARGEST_WITHOUT_LEVELS": 6, "LARGEST_NOT_HALVED": 3, "LARGEST_SIDE": 8}.items():
            patch.setattr(grid, name, value)
        yield


@pytest.fixture(scope="module")
def store(small_levels: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert small_levels is None
    return make(survey(), tmp_path_factory.mktemp("store") / "survey.zarr")


@pytest.fixture(scope="module")
def joined(small_levels: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert small_levels is None
    return make(JOINED, tmp_path_factory.mktemp("joined") / "survey.zarr")


def cells_of_level(shape: Pair, steps: list[Pair]) -> Iterator[tuple[Pair, tuple[slice, slice]]]:
    """Return the cells of the last level, each with the cells of the survey that it covers."""
    height, width = (int(np.prod([step[axis] for step in steps])) for axis in (0, 1))
    for i in range(-(-shape[0] // height)):
        for j in range(-(-shape[1] // width)):
            yield (i, j), (slice(i * height, (i + 1) * height), slice(j * width, (j + 1) * width))


@pytest.mark.parametrize("shape", SHAPES)
def test_codes_are_counted(shape: Pair) -> None:
    random = np.random.default_rng(1)
    values, known = random.integers(0, 5, shape).astype(np.int8), random.random(shape) < 0.8
    for level, found in enumerate(reduce.reduce_codes_by_level(values, known, STEPS, 5), start=1):
        for at, cells in cells_of_level(shape, STEPS[:level]):
            counts = Counter(values[cells][known[cells]].tolist())
            most = min(counts, key=lambda code: (-counts[code], code), default=0)
            share = counts[most] / counts.total() if counts else np.nan
            assert found.most_frequent[at] == most
            np.testing.assert_array_equal(found.share[at], np.float32(share))
            assert found.occurrence_mask[at] == sum(1 << code for code in counts)


@pytest.mark.parametrize("shape", SHAPES)
def test_numbers_are_added_and_compared(shape: Pair) -> None:
    random = np.random.default_rng(2)
    values, known = random.normal(size=shape), random.random(shape) < 0.8
    values[random.random(shape) < 0.3] = np.nan
    values[random.random(shape) < 0.1] = np.inf
    for level, found in enumerate(reduce.reduce_numbers_by_level(values, known, STEPS), start=1):
        for at, cells in cells_of_level(shape, STEPS[:level]):
            some = values[cells][known[cells]]
            finite, numbers = some[np.isfinite(some)], some[~np.isnan(some)]
            mean = finite.mean() if finite.size else np.nan
            ends = (numbers.min(), numbers.max()) if numbers.size else (np.nan, np.nan)
            share = finite.size / some.size if some.size else np.nan
            np.testing.assert_allclose(found[:, *at], np.array([mean, *ends, share], np.float32), rtol=2e-7, atol=1e-7)


def test_phases_go_round() -> None:
    random = np.random.default_rng(3)
    shape = SHAPES[0]
    values, known = (0.9 + 0.2 * random.random(shape)) % 1, random.random(shape) < 0.8  # from 0.9 on to 0.1
    for level, (mean, least, largest, share) in enumerate(reduce.reduce_phases_by_level(values, known, STEPS), start=1):
        for at, cells in cells_of_level(shape, STEPS[:level]):
            some = values[cells][known[cells]]
            if not some.size:
                assert np.isnan([mean[at], least[at], largest[at]]).all()
                continue
            vector = np.exp(2j * np.pi * some).mean()
            assert np.exp(2j * np.pi * mean[at]) == pytest.approx(vector / abs(vector), abs=1e-6)
            around = (some + 0.5) % 1 - 0.5  # about 0, where none of these is cut
            of_mean = (mean[at] + 0.5) % 1 - 0.5
            assert least[at] - mean[at] == pytest.approx(around.min() - of_mean, abs=1e-6)
            assert largest[at] - mean[at] == pytest.approx(around.max() - of_mean, abs=1e-6)
            assert share[at] == 1


@pytest.mark.parametrize(
    ("shape", "shapes"),
    [
        ((512, 512), []),
        ((513, 512), [(257, 256), (129, 256)]),
        ((1024, 1024), [(512, 512), (256, 256)]),
        ((3000, 40), [(1500, 40), (750, 40), (375, 40), (188, 40)]),
        ((16384, 4096), [(8192, 2048), (4096, 1024), (2048, 512), (1024, 256), (512, 256), (256, 256)]),
    ],
)
def test_axes_are_halved_down_to_256(shape: Pair, shapes: list[Pair], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid, "LARGEST_WITHOUT_LEVELS", 512)
    monkeypatch.setattr(grid, "LARGEST_NOT_HALVED", 256)
    assert [level.shape for level in stored_levels_of_shape(shape)] == shapes
    assert all(set(step) <= {1, 2} for step in coarsening_factors_of_levels(stored_levels_of_shape(shape)))


def test_an_island_of_one_cell_is_in_every_level(tmp_path: Path) -> None:
    """A cell of a region of its own, one that failed, one in which something is that is nowhere else."""
    request = survey()
    create_store(request, tmp_path)
    for tile in tiles_of(request):
        values = compute_tile(request, tile)[0]
        for name, value in (("region", 17), ("orbit_velocity", 99.0), ("orbit_exists", True)):
            if tile.index == 4:
                values[name][..., 1, 2] = value
        if tile.index == 5:
            values["status"][0, 0] = 3
        write_tile(request, str(tmp_path), tile, values)
    complete(request, tmp_path)
    island = int(np.flatnonzero(open_survey(tmp_path).region.values.ravel() == 17)[0])
    row, column = divmod(island, 11)
    for level in stored_levels_of_shape(request.shape):
        of = open_survey(tmp_path, level.path)
        at = {"level_epsilon": row // level.covered_cells[0], "level_delta": column // level.covered_cells[1]}
        assert int(of.region_occurs.isel(at)) >> 17 & 1
        assert ((of.region_occurs.values >> 17 & 1).sum(), (of.status_occurs.values >> 3 & 1).sum()) == (1, 1)
        assert (of.orbit_velocity.isel(at).sel(statistic="largest") == 99).all()
        assert (of.orbit_exists_occurs.isel(at) >= 2).all()


def bits(cells: np.ndarray) -> int:
    return sum(1 << int(code) for code in set(cells.tolist()))


def test_levels_are_of_what_the_cells_hold_in_the_end(joined: Path) -> None:
    """Slots are those after the join; each slice has its own levels; complex numbers are represented by moduli."""
    whole, (level, *_) = open_survey(joined), stored_levels_of_shape(JOINED.shape)
    of = open_survey(joined, level.path).load()
    names = [
        each.name
        for each in variables_of_groups(JOINED.quantities, JOINED.model)
        if each.is_per_cell and not is_phase(each.name)
    ]
    assert int(whole.attractor_kind.isel(attractor=1).max()) > 0
    for name in names:
        cells = np.abs(whole[name].values) if np.iscomplexobj(whole[name]) else whole[name].values.astype(float)
        for at, (rows, columns) in cells_of_level(
            JOINED.shape, coarsening_factors_of_levels(stored_levels_of_shape(JOINED.shape))[:1]
        ):
            some = cells[..., rows, columns].reshape(*cells.shape[:-2], -1)
            found = of[name].isel(level_epsilon=at[0], level_delta=at[1])
            if name + OCCURS in of:
                np.testing.assert_array_equal(of[name + OCCURS].values[..., *at], np.apply_along_axis(bits, -1, some))
                share = (some == found.values[..., None]).mean(axis=-1).astype(np.float32)
                np.testing.assert_array_equal(of[name + SHARE].values[..., *at], share)
            else:
                for statistic, pool in (("least", np.fmin), ("largest", np.fmax)):
                    expected = pool.reduce(some, axis=-1).astype(np.float32)
                    np.testing.assert_array_equal(found.sel(statistic=statistic), expected, name)


def test_what_levels_do_not_have_is_drawn_from_the_cells(joined: Path) -> None:
    levels = level_opener(partial(open_survey, joined), 1, True)
    one = select_slice(open_survey(joined), 1)
    drawn = reduce_map(one, "attractor_family", 0, (3, 4), levels)
    assert drawn.attractor_family.shape == (3, 4)
    assert np.isin(drawn.attractor_family, one.attractor_family[0]).all()


def test_any_reader_finds_them(joined: Path) -> None:
    """Readers are xarray in all its ways, consolidated metadata, and the convention for levels."""
    levels = stored_levels_of_shape(JOINED.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(joined) as survey:
            assert not {"level_delta", "statistic"} & set(survey.dims)
        with xr.open_datatree(joined, engine="zarr") as tree:
            for level in levels:
                one = xr.open_zarr(joined, group=level.path)
                assert tree[level.path].to_dataset()[list(one.variables)].identical(one)
                assert (one.sizes["level_epsilon"], one.sizes["level_delta"]) == level.shape
                first = slice(0, level.covered_cells[1])
                assert float(one.level_delta[0]) == pytest.approx(float(survey.delta[first].mean()), rel=1e-14)
                assert one.region_occurs.attrs["flag_masks"] == [1 << code for code in range(len(REGIONS))]
    attributes = json.loads((joined / GROUP / "zarr.json").read_bytes())["attributes"]
    (convention,) = attributes["zarr_conventions"]
    assert convention["uuid"] == "d35379db-88df-4056-af3a-620245f8e347"
    layout = attributes["multiscales"]["layout"]
    assert [each["asset"] for each in layout] == [str(level.number) for level in levels]
    for each, step in zip(layout, coarsening_factors_of_levels(levels), strict=True):
        assert each["transform"]["scale"] == list(step)
        assert each.get("derived_from", "0") == str(int(each["asset"]) - 1)


def test_no_order_and_no_tile_shows_in_their_bytes(store: Path, tmp_path: Path) -> None:
    other = survey(tile=TILES[1])
    assert len(level_blocks(other)) == 4
    for name, request, order in (("back", survey(), lambda x: reversed(x)), ("other", other, list)):
        assert files_of(make(request, tmp_path / name, order)) == files_of(store)

    def backwards(task: Any, request: Any, path: str, items: Any) -> list[Any]:
        return run_in_this_process(task, request, path, items[::-1])[::-1]

    build_pyramid_levels(survey(), tmp_path / "back", backwards)
    assert files_of(tmp_path / "back") == files_of(store)
    assert examine(tmp_path / "back").is_whole


def test_who_is_killed_leaves_a_survey_without_levels(store: Path, tmp_path: Path) -> None:
    path = tmp_path / "survey.zarr"
    fill(survey(), path)

    def dying(task: Any, request: Any, path: str, items: Any) -> list[Any]:
        run_in_this_process(task, request, path, items[:2])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        complete(survey(), path, dying)
    assert is_incomplete(survey(), path)
    assert examine(path).is_whole
    with xr.open_datatree(path, engine="zarr") as tree:
        assert GROUP not in tree.children
    complete(survey(), path)
    assert files_of(path) == files_of(store)
    assert not is_incomplete(survey(), path)


def test_what_is_damaged_is_made_again(store: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(store, tmp_path / "survey.zarr"))
    chunk = path / GROUP / "1" / "region_occurs" / "c" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"x")
    assert [Path(key).parts[:3] for key in examine(path).template] == [(GROUP, "1", "region_occurs")]
    create_store(survey(), path)
    assert is_incomplete(survey(), path)
    complete(survey(), path)
    assert examine(path).is_whole
    assert files_of(path) == files_of(store)


def test_tiles_that_are_computed_anew_take_levels_with_them_where_slots_are_moved(joined: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(joined, tmp_path / "survey.zarr"))
    remove_outdated_results(JOINED, place_of(path))
    assert examine(path).is_whole
    assert is_incomplete(JOINED, path)
    with xr.open_datatree(path, engine="zarr") as tree:
        assert GROUP not in tree.children


def test_no_survey_of_512_cells_a_side_and_no_population_has_levels(tmp_path: Path) -> None:
    few = survey(delta={"start": 0.5, "stop": 0.9, "num": 6}, epsilon={"start": 0.05, "stop": 0.2, "num": 6})
    fill(few, tmp_path / "survey.zarr")
    assert not is_incomplete(few, tmp_path / "survey.zarr")
    assert not is_incomplete(PopulationRequest.model_construct(), tmp_path / "survey.zarr")


def test_the_codes_of_every_variable_fit_in_their_masks() -> None:
    for quantity in QUANTITIES:
        words = code_meanings(quantity)
        assert 8 * reduce.smallest_mask_dtype(len(words)).itemsize >= len(words)
