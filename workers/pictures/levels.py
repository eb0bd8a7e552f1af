"""Reduce a survey that has more cells than a picture has pixels.

Several cells become one, which displays the rarest of their values, so that even the smallest island stays visible.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from gear_rattle.workers.errors import report_damage
from gear_rattle.workers.pictures.planes import map_of_variable, mask_nonperiodic, values_to_draw
from gear_rattle.workers.survey.levels import reduce
from gear_rattle.workers.survey.levels.grid import (
    GROUP,
    Pair,
    PyramidLevel,
    centres_of_level_cells,
    possible_levels,
    stored_levels_of_shape,
)
from gear_rattle.workers.survey.levels.template import LEVEL_CELL, OCCURS, SHARE, STATISTIC
from gear_rattle.workers.survey.slices import select_slice
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.schema import CELL, is_phase

BAND = 1 << 22  # at most this many cells are reduced at a time
RARE = 2.0  # an extreme counts as rare if it is more than RARE times as far from the mean as the other extreme

NEAR = 1  # to find the rarest code around a cell, count the codes of cells up to this many cells away on each side

#: A function that opens a group of a survey's store. It returns None if there is no such group.
OpenGroup = Callable[[str], xr.Dataset | None]


@dataclass(frozen=True)
class DisplayedCells:
    """The cells (epsilon, delta) that a picture displays, each of which stands for several cells of the survey.

    values: float32. status: the status of each displayed cell. code_shares: for a map of codes, the share of each code
    among the survey's cells. share_without_number: for a map of numbers, the share of the survey's cells that have no
    number; None if this share is not known.
    """

    values: np.ndarray
    status: np.ndarray
    code_shares: Mapping[int, float] = field(default_factory=dict)
    share_without_number: float | None = None


@dataclass(frozen=True)
class LevelPart:
    """A rectangle of the cells of a pyramid level.

    level: the level, or None for the full map. spans: the rows and the columns of the rectangle on this level.
    """

    level: PyramidLevel | None
    spans: tuple[slice, slice]


def choose_level_for_window(levels: Sequence[PyramidLevel], first: Pair, end: Pair, room: Pair) -> LevelPart:
    """Return the finest pyramid level on which a window has at most `room` cells along (epsilon, delta).

    first, end: the first cell of the window, and the cell after the last one, as (row, column) of the map. If no level
    is coarse enough, the coarsest level is returned.

    Returns
    -------
    LevelPart
        The level, and the cells of the window on this level.
    """
    for level in (None, *levels):
        cells = level.covered_cells if level else (1, 1)
        rows, columns = (slice(a // each, -(-b // each)) for a, b, each in zip(first, end, cells, strict=True))
        found = LevelPart(level, (rows, columns))
        if rows.stop - rows.start <= room[0] and columns.stop - columns.start <= room[1]:
            break
    return found


def reduce_cells(plane: xr.DataArray, values: np.ndarray, status: np.ndarray, level: PyramidLevel) -> DisplayedCells:
    """Reduce a map to a pyramid level. values: the map's values, from `values_to_draw`. status: each cell's status."""
    steps = [
        _halving_factors(level.covered_cells, number) for number in range(max(level.covered_cells).bit_length() - 1)
    ]
    states = _reduce_codes(status, status > 0, steps, FAILED + 1, level.covered_cells[0])
    known = (status > 0) & (status != FAILED)
    if count := _number_of_codes(plane):
        found = _reduce_codes(values, known, steps, count, level.covered_cells[0])
        everything = slice(None)
        sizes = (
            _covered_cell_counts(size, cells, everything)
            for size, cells in zip(values.shape, level.covered_cells, strict=True)
        )
        return _choose_displayed_codes(found, states, *sizes)
    *_, statistics = (reduce.reduce_phases_by_level if is_phase(str(plane.name)) else reduce.reduce_numbers_by_level)(
        values, known, steps
    )
    return _choose_displayed_numbers(plane, statistics, states)


def _reduce_codes(
    values: np.ndarray, known: np.ndarray, steps: Sequence[Pair], number: int, rows: int
) -> reduce.LevelCodes:
    """Reduce a map of codes step by step, and return the last, coarsest level.

    known: flags of the cells that have a value. steps: for each halving, how many cells become one along (epsilon,
    delta). number: the number of codes. rows: how many rows of the map a cell of the last level covers. The map is
    reduced in bands of rows, because the reduction takes hundreds of bytes for each cell.

    Returns
    -------
    reduce.LevelCodes
        The most frequent codes, their shares, and all codes that occur.
    """
    together = max(1, BAND // (rows * values.shape[1])) * rows
    parts = []
    for begin in range(0, values.shape[0], together):
        band = slice(begin, begin + together)
        *_, last = reduce.reduce_codes_by_level(np.nan_to_num(values[band]).astype(np.int8), known[band], steps, number)
        parts.append(last)
    return reduce.LevelCodes(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def read_displayed_level_cells(
    plane: xr.DataArray, stored: xr.Dataset, index: int, level: PyramidLevel, at: tuple[slice, slice]
) -> DisplayedCells:
    """Return the displayed cells in the part `at` of a stored pyramid level. plane: the map in full resolution."""
    name = str(plane.name)

    def read_part(name: str) -> np.ndarray:
        array = stored[name]
        beside = [dim for dim in array.dims[:-2] if dim != STATISTIC]
        chosen = dict(zip(beside, [index] + [0] * len(beside), strict=False))
        return np.asarray(array.isel(chosen | dict(zip(LEVEL_CELL, at, strict=True))))

    with report_damage(f"the map of {name}"):
        states = reduce.LevelCodes(*(read_part("status" + end) for end in ("", SHARE, OCCURS)))
        if _number_of_codes(plane):
            found = reduce.LevelCodes(*(read_part(name + end) for end in ("", SHARE, OCCURS)))
            return _choose_displayed_codes(
                found,
                states,
                *(_covered_cell_counts(*each) for each in zip(plane.shape, level.covered_cells, at, strict=True)),
            )
        return _choose_displayed_numbers(plane, read_part(name), states)


def reduce_map(dataset: xr.Dataset, variable: str, index: int, room: Pair, opened: OpenGroup | None) -> xr.Dataset:
    """Reduce one map of an open survey, or of a slice, to at most `room` cells along (epsilon, delta).

    Parameters
    ----------
    opened : OpenGroup | None
        Function that opens groups of the same survey or slice. The whole map is read if it is None, or if the store has
        no pyramid levels.

    Returns
    -------
    xr.Dataset
        A dataset with only the reduced map and the status; the survey itself if it is small enough.

    Raises
    ------
    SurveyError
        There is no such map, or it cannot be read.
    """
    plane = map_of_variable(dataset, variable, index)
    shape = plane.shape[0], plane.shape[1]
    part = choose_level_for_window(possible_levels(shape), (0, 0), shape, room)
    if (level := part.level) is None:
        return dataset
    stored = opened(level.path) if opened and level in stored_levels_of_shape(shape) else None
    if stored is not None and variable in stored:  # maps of families have no stored levels
        seen = read_displayed_level_cells(plane, stored, index, level, part.spans)
    else:
        with report_damage(f"the map of {variable}"):
            cells = values_to_draw(mask_nonperiodic(dataset, plane.load(), index))
            seen = reduce_cells(plane, cells, np.asarray(dataset["status"]), level)
    axes = {
        name: centres_of_level_cells(dataset[name].values, cells)
        for name, cells in zip(CELL, level.covered_cells, strict=True)
    }
    modulus = {"long_name": f"|{plane.attrs.get('long_name', variable)}|"} if np.iscomplexobj(plane) else {}
    whole = np.issubdtype(plane.dtype, np.integer) or plane.dtype == bool
    values = np.nan_to_num(seen.values).astype(plane.dtype) if whole else seen.values
    beside = {name: value for name, value in plane.coords.items() if not value.dims}
    return xr.Dataset(
        {variable: (CELL, values, plane.attrs | modulus), "status": (CELL, seen.status, dataset["status"].attrs)},
        {**axes, **beside},
        dataset.attrs,
    )


def level_opener(opened: Callable[[str], xr.Dataset], number: int | None, has_levels: bool) -> OpenGroup:
    """Return a function that opens the pyramid level at a path, and returns None if there is no level.

    number: the number of the slice, None without a third axis. has_levels: whether the store has pyramid levels.

    Returns
    -------
    OpenGroup
        The function.
    """
    return lambda path: select_slice(opened(path), number) if has_levels and path.startswith(GROUP) else None


def _halving_factors(cells: Pair, number: int) -> Pair:
    """Return how many cells along each axis halving number `number` joins to one; the first halving is number 0.

    cells: how many cells along each axis all halvings together join to one, for example (8, 2).

    Returns
    -------
    Pair
        For epsilon and for delta: 2, or 1 if the axis needs no more halvings.
    """
    return (2 if cells[0] >> number > 1 else 1), (2 if cells[1] >> number > 1 else 1)


def _number_of_codes(plane: xr.DataArray) -> int:
    """Return the number of codes of a map: 2 for flags, 0 for a map of numbers."""
    return 2 if plane.dtype == bool else len(plane.attrs.get("flag_meanings", "").split())


def _reduced_status(states: reduce.LevelCodes) -> np.ndarray:
    """Return the status of each reduced cell: failed if one of its cells failed, else the most frequent status."""
    failed = (states.occurrence_mask >> FAILED & 1).astype(bool)
    found: np.ndarray = np.where(failed, np.int8(FAILED), states.most_frequent).astype(np.int8)
    return found


def _covered_cell_counts(size: int, cells: int, at: slice) -> np.ndarray:
    """Return how many of the `size` map cells of an axis each level cell in `at` covers: at most `cells`."""
    begins = np.arange(0, size, cells)[at]
    found: np.ndarray = np.minimum(size - begins, cells)
    return found


def _choose_displayed_codes(
    found: reduce.LevelCodes, states: reduce.LevelCodes, rows: np.ndarray, columns: np.ndarray
) -> DisplayedCells:
    """Choose the displayed code of each cell of a level.

    A cell of the level covers several cells of the survey. If the covered cells have several codes, the rarest of these
    codes is displayed, except a code that more than half of the covered cells have. The rarest code is the one that
    occurs in the fewest level cells around this cell (up to NEAR cells away); among equally rare codes, it is the one
    that occurs in the fewest cells of the whole picture. rows, columns: how many of the survey's cells each row and
    each column of the level covers.

    Returns
    -------
    DisplayedCells
        The codes as float32; and for each code, its share of the survey's cells.
    """
    values = found.most_frequent.astype(np.int64)
    others = found.occurrence_mask & ~(
        found.occurrence_mask.dtype.type(1) << found.most_frequent.astype(found.occurrence_mask.dtype)
    )
    cells = {
        code: (found.occurrence_mask >> code & 1).astype(bool)
        for code in range(8 * found.occurrence_mask.itemsize)
        if (found.occurrence_mask >> code & 1).any()
    }
    shown = np.where(found.share > 0.5, others, found.occurrence_mask)
    fewest = np.full(values.shape, np.iinfo(np.int64).max)
    for code in sorted(cells, key=lambda code: int(cells[code].sum())):
        around = _count_flagged_neighbours(cells[code])
        better = (shown >> code & 1).astype(bool) & (around < fewest)
        values[better], fewest[better] = code, around[better]
    return DisplayedCells(
        values.astype(np.float32), _reduced_status(states), _code_shares(found, others, cells, np.outer(rows, columns))
    )


def _count_flagged_neighbours(cells: np.ndarray) -> np.ndarray:
    """Count for each cell the flagged cells in the square that reaches NEAR cells to each side of it.

    cells: the flags (m, n).

    Returns
    -------
    np.ndarray
        Counts (m, n).
    """
    size = 2 * NEAR + 1
    sums = np.pad(cells, ((NEAR + 1, NEAR), (NEAR + 1, NEAR))).astype(np.int64).cumsum(axis=0).cumsum(axis=1)
    found: np.ndarray = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return found


def _code_shares(
    found: reduce.LevelCodes, others: np.ndarray, cells: Mapping[int, np.ndarray], sizes: np.ndarray
) -> dict[int, float]:
    """Return the share of each code among the survey's cells.

    others: for each cell of the level a bit mask of its codes, without the most frequent code. cells: for each code the
    flags of the cells in which it occurs. sizes: how many of the survey's cells each cell of the level covers. The
    shares are exact if all cells are computed and no cell of the level has more than two codes.

    Returns
    -------
    dict[int, float]
        Shares by code.
    """
    known = sizes[found.occurrence_mask > 0].sum()
    each = (1 - found.share) / np.maximum(np.bitwise_count(others), 1)
    return {
        code: float((sizes * np.where(found.most_frequent == code, found.share, each))[there].sum() / known)
        for code, there in cells.items()
    }


def _choose_displayed_numbers(plane: xr.DataArray, statistics: np.ndarray, states: reduce.LevelCodes) -> DisplayedCells:
    """Choose the displayed number of each cell of a level, which covers several cells of the survey.

    The cell displays the mean of the covered cells, or, in a map of integers, the extreme nearer to the mean. A rare
    extreme (RARE) is displayed instead. If all covered cells lack a finite number, or some of them but fewer than half,
    the cell displays no number, or ±∞ if a covered number is infinite. So a few cells without a number remain visible.

    Returns
    -------
    DisplayedCells
        The numbers as float32.
    """
    mean, least, largest, share = statistics.astype(float)
    with np.errstate(invalid="ignore"):
        above, below = largest - mean, mean - least
        values = mean.copy()
        if np.issubdtype(plane.dtype, np.integer):  # a mean of integers would not be a value of the map
            values = np.where(above < below, largest, least)
        values = np.where(above > RARE * below, largest, values)
        values = np.where(below > RARE * above, least, values)
        if is_phase(str(plane.name)):
            values = values % 1.0
        extreme = np.where(np.isinf(largest), largest, least)
        infinite = np.isinf(extreme)
        values = np.where(infinite & (share <= 0.5) & (share > 0), mean, values)
        lacking = np.where(infinite, extreme, np.nan)
        values = np.where(((share < 1) & (share > 0.5)) | (share == 0), lacking, values)
    known = np.isfinite(share)
    without = None if infinite.any() or not known.any() else float(1 - share[known].mean())
    return DisplayedCells(values.astype(np.float32), _reduced_status(states), share_without_number=without)
