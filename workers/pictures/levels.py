"""Reduce a survey that has more cells than a picture has pixels.

Of the cells that become one, the rare value is displayed, so no island vanishes, however small it becomes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from gear_rattle.workers.errors import reading
from gear_rattle.workers.pictures.planes import drawn_numbers, plane_of, with_periodic
from gear_rattle.workers.survey.levels import reduce
from gear_rattle.workers.survey.levels.grid import GROUP, Level, Pair, centres, halvings, levels_of
from gear_rattle.workers.survey.levels.template import LEVEL_CELL, OCCURS, SHARE, STATISTIC
from gear_rattle.workers.survey.slices import slice_of
from gear_rattle.workers.survey.values.evaluate import FAILED
from gear_rattle.workers.survey.values.schema import CELL, is_phase

BAND = 1 << 22  # cells that are reduced at a time
RARE = 2.0  # an extreme is rare if the mean is more than so many times closer to the other extreme

NEAR = 1  # cells on each side in which the frequencies of codes are compared

#: A function that opens a group of a survey's store; None if there is no such group.
OpenGroup = Callable[[str], xr.Dataset | None]


@dataclass(frozen=True)
class DisplayedCells:
    """Displayed cells (epsilon, delta): float32 values, and the status of each.

    shares: shares of codes among the survey's own cells. without: share of the survey's own cells that have no number.
    """

    values: np.ndarray
    status: np.ndarray
    shares: Mapping[int, float] = field(default_factory=dict)
    without: float | None = None


@dataclass(frozen=True)
class LevelPart:
    """A rectangle of cells, along (epsilon, delta), of a map (level None) or of one of its levels."""

    level: Level | None
    at: tuple[slice, slice]


def part_for(levels: Sequence[Level], first: Pair, end: Pair, room: Pair) -> LevelPart:
    """Return the finest level in which a window has at most so many cells.

    The window reaches from the cells `first` to `end`. If no level is coarse enough, it is the coarsest.

    Returns
    -------
    LevelPart
        The level, and the window's cells in it.
    """
    for level in (None, *levels):
        cells = level.cells if level else (1, 1)
        rows, columns = (slice(a // each, -(-b // each)) for a, b, each in zip(first, end, cells, strict=True))
        found = LevelPart(level, (rows, columns))
        if rows.stop - rows.start <= room[0] and columns.stop - columns.start <= room[1]:
            break
    return found


def of_cells(plane: xr.DataArray, values: np.ndarray, status: np.ndarray, level: Level) -> DisplayedCells:
    """Return the displayed cells of a map (m, n), as `drawn_numbers` returns it, reduced to a level."""
    steps = [_step(level.cells, number) for number in range(max(level.cells).bit_length() - 1)]
    states = _codes(status, status > 0, steps, FAILED + 1, level.cells[0])
    known = (status > 0) & (status != FAILED)
    if count := _number_of_codes(plane):
        found = _codes(values, known, steps, count, level.cells[0])
        everything = slice(None)
        sizes = (_sizes(size, cells, everything) for size, cells in zip(values.shape, level.cells, strict=True))
        return _coded(found, states, *sizes)
    *_, statistics = (reduce.phases if is_phase(str(plane.name)) else reduce.numbers)(values, known, steps)
    return _numbered(plane, statistics, states)


def _codes(values: np.ndarray, known: np.ndarray, steps: Sequence[Pair], number: int, rows: int) -> reduce.Codes:
    """Return the level of codes that `reduce.codes` yields last, whose cells have so many rows.

    It works band by band, because the reduction takes hundreds of bytes a cell.

    Returns
    -------
    reduce.Codes
        Most frequent codes, their shares, and all codes that occur.
    """
    together = max(1, BAND // (rows * values.shape[1])) * rows
    parts = []
    for begin in range(0, values.shape[0], together):
        band = slice(begin, begin + together)
        *_, last = reduce.codes(np.nan_to_num(values[band]).astype(np.int8), known[band], steps, number)
        parts.append(last)
    return reduce.Codes(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def of_level(
    plane: xr.DataArray, stored: xr.Dataset, index: int, level: Level, at: tuple[slice, slice]
) -> DisplayedCells:
    """Return the displayed cells of a part of a stored level; plane: the same map of the survey."""
    name = str(plane.name)

    def read(name: str) -> np.ndarray:
        array = stored[name]
        beside = [dim for dim in array.dims[:-2] if dim != STATISTIC]
        chosen = dict(zip(beside, [index] + [0] * len(beside), strict=False))
        return np.asarray(array.isel(chosen | dict(zip(LEVEL_CELL, at, strict=True))))

    with reading(f"the map of {name}"):
        states = reduce.Codes(*(read("status" + end) for end in ("", SHARE, OCCURS)))
        if _number_of_codes(plane):
            found = reduce.Codes(*(read(name + end) for end in ("", SHARE, OCCURS)))
            return _coded(found, states, *(_sizes(*each) for each in zip(plane.shape, level.cells, at, strict=True)))
        return _numbered(plane, read(name), states)


def overview(dataset: xr.Dataset, variable: str, index: int, room: Pair, opened: OpenGroup | None) -> xr.Dataset:
    """Return an open survey, or a slice of it, with a single map reduced to so few cells that a picture has room.

    Parameters
    ----------
    opened : OpenGroup | None
        Opens groups of the same survey or slice; if its store has no levels, the whole map is read.

    Returns
    -------
    xr.Dataset
        The reduced map and the status.

    Raises
    ------
    SurveyError
        There is no such map, or it cannot be read.
    """
    plane = plane_of(dataset, variable, index)
    shape = plane.shape[0], plane.shape[1]
    part = part_for(halvings(shape), (0, 0), shape, room)
    if (level := part.level) is None:
        return dataset
    stored = opened(level.path) if opened and level in levels_of(shape) else None
    if stored is not None and variable in stored:  # of families there are numbers of cells alone
        seen = of_level(plane, stored, index, level, part.at)
    else:
        with reading(f"the map of {variable}"):
            cells = drawn_numbers(with_periodic(dataset, plane.load(), index))
            seen = of_cells(plane, cells, np.asarray(dataset["status"]), level)
    axes = {name: centres(dataset[name].values, cells) for name, cells in zip(CELL, level.cells, strict=True)}
    modulus = {"long_name": f"|{plane.attrs.get('long_name', variable)}|"} if np.iscomplexobj(plane) else {}
    whole = np.issubdtype(plane.dtype, np.integer) or plane.dtype == bool
    values = np.nan_to_num(seen.values).astype(plane.dtype) if whole else seen.values
    beside = {name: value for name, value in plane.coords.items() if not value.dims}
    return xr.Dataset(
        {variable: (CELL, values, plane.attrs | modulus), "status": (CELL, seen.status, dataset["status"].attrs)},
        {**axes, **beside},
        dataset.attrs,
    )


def levels_in_groups(opened: Callable[[str], xr.Dataset], number: int | None, has_levels: bool) -> OpenGroup:
    """Return a function that opens a level of a survey, or of a slice of it."""
    return lambda path: slice_of(opened(path), number) if has_levels and path.startswith(GROUP) else None


def _step(cells: Pair, number: int) -> Pair:
    """Return how many cells become one in a halving of this number, while an axis still needs halving."""
    return (2 if cells[0] >> number > 1 else 1), (2 if cells[1] >> number > 1 else 1)


def _number_of_codes(plane: xr.DataArray) -> int:
    return 2 if plane.dtype == bool else len(plane.attrs.get("flag_meanings", "").split())


def _status(states: reduce.Codes) -> np.ndarray:
    """Return the status of reduced cells: failed if one of their cells failed."""
    failed = (states.occurs >> FAILED & 1).astype(bool)
    found: np.ndarray = np.where(failed, np.int8(FAILED), states.most).astype(np.int8)
    return found


def _sizes(size: int, cells: int, at: slice) -> np.ndarray:
    """Return the number of cells of an axis in each cell of a level, which is `cells` except at the end."""
    begins = np.arange(0, size, cells)[at]
    found: np.ndarray = np.minimum(size - begins, cells)
    return found


def _coded(found: reduce.Codes, states: reduce.Codes, rows: np.ndarray, columns: np.ndarray) -> DisplayedCells:
    """Return displayed codes: the most frequent code of a cell, or a rarer one.

    Among the other codes of a cell, the one that occurs in the fewest cells around it is displayed, or else in the
    fewest of this picture; rows, columns: numbers of the survey's cells in these.

    Returns
    -------
    DisplayedCells
        Codes as float32, with their shares.
    """
    values = found.most.astype(np.int64)
    others = found.occurs & ~(found.occurs.dtype.type(1) << found.most.astype(found.occurs.dtype))
    cells = {
        code: (found.occurs >> code & 1).astype(bool)
        for code in range(8 * found.occurs.itemsize)
        if (found.occurs >> code & 1).any()
    }
    shown = np.where(found.share > 0.5, others, found.occurs)
    fewest = np.full(values.shape, np.iinfo(np.int64).max)
    for code in sorted(cells, key=lambda code: int(cells[code].sum())):
        around = _around(cells[code])
        better = (shown >> code & 1).astype(bool) & (around < fewest)
        values[better], fewest[better] = code, around[better]
    return DisplayedCells(
        values.astype(np.float32), _status(states), _shares(found, others, cells, np.outer(rows, columns))
    )


def _around(cells: np.ndarray) -> np.ndarray:
    """Return how many of the cells about each are set."""
    size = 2 * NEAR + 1
    sums = np.pad(cells, ((NEAR + 1, NEAR), (NEAR + 1, NEAR))).astype(np.int64).cumsum(axis=0).cumsum(axis=1)
    found: np.ndarray = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return found


def _shares(
    found: reduce.Codes, others: np.ndarray, cells: Mapping[int, np.ndarray], sizes: np.ndarray
) -> dict[int, float]:
    """Return the shares of codes: exact if all cells are known and no cell of a level has more than two codes."""
    known = sizes[found.occurs > 0].sum()
    each = (1 - found.share) / np.maximum(np.bitwise_count(others), 1)
    return {
        code: float((sizes * np.where(found.most == code, found.share, each))[there].sum() / known)
        for code, there in cells.items()
    }


def _numbered(plane: xr.DataArray, statistics: np.ndarray, states: reduce.Codes) -> DisplayedCells:
    """Return displayed numbers: the mean, or an extreme if it is rare; none where cells without a number are rare."""
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
        infinite = np.isinf(largest)
        values = np.where(infinite & (share <= 0.5) & (share > 0), mean, values)
        lacking = np.where(infinite, largest, np.nan)
        values = np.where(((share < 1) & (share > 0.5)) | (share == 0), lacking, values)
    known = np.isfinite(share)
    without = None if infinite.any() or not known.any() else float(1 - share[known].mean())
    return DisplayedCells(values.astype(np.float32), _status(states), without=without)
