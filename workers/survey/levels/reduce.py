"""Reduce several cells to one: codes, numbers and phases of rectangles of cells.

The functions `reduce_codes_by_level`, `reduce_numbers_by_level` and `reduce_phases_by_level` take values (m, n), flags
`known` (m, n) of the cells that count, and `steps`: for each level how many cells of the next finer level a cell covers
along each axis, 1 or 2. A cell counts if it is computed, has not failed and has the variable. The functions yield the
arrays of each level. Every level is computed from the survey's cells and not from the next finer level, because the
most frequent of several most frequent codes need not be the most frequent code of all cells. The last cell of an axis
may cover fewer cells.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.levels.grid import Pair

#: Names of the statistics of the numbers in several cells. "share" is the number of cells with a finite number, divided
#: by the number of cells that count (see the top of this file).
STATISTICS = ("mean", "least", "largest", "share")


class LevelCodes(NamedTuple):
    """The codes in the cells (m, n) of a level, each of which covers several cells of the survey.

    most_frequent: the most frequent code in a cell, the lowest one of equally frequent codes. share: the number of
    covered cells with this code, divided by the number of covered cells that count (see the top of this file); NaN if
    no covered cell counts. occurrence_mask: a bit mask; bit i is set if code i occurs.
    """

    most_frequent: np.ndarray
    share: np.ndarray
    occurrence_mask: np.ndarray


def pool_cells(
    values: np.ndarray, step: Pair, pool: Callable[[np.ndarray, np.ndarray], np.ndarray], filler: float = 0
) -> np.ndarray:
    """Combine each group of step[0] × step[1] cells to one cell by the function `pool`; `filler` pads the edges."""
    lacking = [(0, -size % each) for size, each in zip(values.shape, step, strict=True)]
    if any(after for _, after in lacking):
        values = np.pad(values, lacking, constant_values=filler)
    return reduce(pool, [values[i :: step[0], j :: step[1]] for i in range(step[0]) for j in range(step[1])])


def reduce_codes_by_level(
    values: np.ndarray, known: np.ndarray, steps: Sequence[Pair], number: int
) -> Iterator[LevelCodes]:
    """Yield the codes of each level, from the finest. Values are codes from 0 to number − 1; number is at most 32."""
    there = np.flatnonzero(np.bincount(values[known], minlength=number)).tolist()
    counts = {code: (values == code) & known for code in there}
    of = known.astype(np.int32)
    for step in steps:
        counts = {code: pool_cells(count.astype(np.int32), step, np.add) for code, count in counts.items()}
        of = pool_cells(of, step, np.add)
        most, highest = np.zeros(of.shape, values.dtype), np.zeros(of.shape, np.int32)
        occurs = np.zeros(of.shape, smallest_mask_dtype(number))
        for code, count in counts.items():
            more = count > highest
            most[more], highest[more] = code, count[more]
            occurs[count > 0] |= occurs.dtype.type(1 << code)
        yield LevelCodes(most, _divide_or_nan(highest, of).astype(np.float32), occurs)


def smallest_mask_dtype(number: int) -> np.dtype[np.unsignedinteger]:
    """Return the smallest unsigned type that has a bit for each of `number` codes."""
    return np.dtype(np.uint8 if number <= 8 else np.uint16 if number <= 16 else np.uint32)


def reduce_numbers_by_level(values: np.ndarray, known: np.ndarray, steps: Sequence[Pair]) -> Iterator[np.ndarray]:
    """Yield for each level the mean, least, largest and share of the numbers in its cells, float32 (4, m, n).

    The mean is that of the finite numbers; least and largest include infinite numbers. The share is the number of
    finite numbers, divided by the number of covered cells that count (flag `known`). The mean is NaN in cells without a
    finite number. Least and largest are NaN in cells without any number. The share is NaN where no covered cell counts.

    Yields
    ------
    np.ndarray
        Statistics of a level.
    """
    values = np.where(known, values, np.nan).astype(float)
    finite = np.isfinite(values)
    total, count, of = np.where(finite, values, 0.0), finite.astype(np.int32), known.astype(np.int32)
    least, largest = values, values
    for step in steps:
        total, count, of = (pool_cells(each, step, np.add) for each in (total, count, of))
        least, largest = (pool_cells(each, step, pool, np.nan) for each, pool in ((least, np.fmin), (largest, np.fmax)))
        # Rounding may put a mean below the least or above the largest value, so it is clipped.
        mean = np.clip(_divide_or_nan(total, count), least, largest)
        yield _stack_as_float32(mean, least, largest, _divide_or_nan(count, of))


def reduce_phases_by_level(values: np.ndarray, known: np.ndarray, steps: Sequence[Pair]) -> Iterator[np.ndarray]:
    """Yield for each level the mean, least, largest and share of the phases in its cells, float32 (4, m, n).

    A phase of 1 equals a phase of 0. The mean is the direction of the sum of unit vectors, in [0, 1). Least and largest
    are the ends of the interval around the mean that contains all phases, so least may be below 0, and largest 1 or
    more. All three are NaN in cells without any phase. The share is the number of phases, divided by the number of
    covered cells that count (see the top of this file); it is NaN where no cell counts.

    Yields
    ------
    np.ndarray
        Statistics of a level.
    """
    values = np.where(known, values, np.nan).astype(float)
    finite = np.isfinite(values)
    angle = 2 * np.pi * np.where(finite, values, 0.0)
    along, across = np.where(finite, np.cos(angle), 0.0), np.where(finite, np.sin(angle), 0.0)
    count, of = finite.astype(np.int32), known.astype(np.int32)
    for level, step in enumerate(steps, start=1):
        along, across, count, of = (pool_cells(each, step, np.add) for each in (along, across, count, of))
        mean = np.where(count > 0, np.arctan2(across, along) / (2 * np.pi) % 1.0, np.nan)
        here = mean
        for each in reversed(steps[:level]):
            here = here.repeat(each[0], axis=0).repeat(each[1], axis=1)
        away = (values - here[: values.shape[0], : values.shape[1]] + 0.5) % 1.0 - 0.5
        least = largest = away
        for each in steps[:level]:
            least, largest = pool_cells(least, each, np.fmin, np.nan), pool_cells(largest, each, np.fmax, np.nan)
        yield _stack_as_float32(mean, mean + least, mean + largest, _divide_or_nan(count, of))


def _divide_or_nan(count: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Return count / total, NaN where `total` is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found: np.ndarray = np.where(total > 0, count / total, np.nan)
    return found


def _stack_as_float32(*statistics: np.ndarray) -> np.ndarray:
    """Stack arrays as float32; numbers too large for float32 become infinite."""
    with np.errstate(over="ignore"):
        return np.stack([each.astype(np.float32) for each in statistics])
