"""Define the pyramid levels of a survey, and the blocks (rectangles of cells) in which levels are built."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from types import EllipsisType

import numpy as np

from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.values.quantities import shape_of_variable, variables_of_groups

GROUP = "levels"
LARGEST_WITHOUT_LEVELS = 512  # a survey has levels if one of its axes has more cells than this number
LARGEST_NOT_HALVED = 256  # an axis of at most this many cells is not halved while the other axis has more
#: Largest number of cells along a side of a block. A block becomes one chunk of each level.
LARGEST_SIDE = 2048
#: Largest number of values of one variable in a block, for which a worker needs about 130 MB.
BLOCK_NUMBERS = 1 << 24

Pair = tuple[int, int]  # one number for each axis: (epsilon, delta)


@dataclass(frozen=True)
class PyramidLevel:
    """A pyramid level: the whole survey at lower resolution. Pairs are along (epsilon, delta).

    number: 1 for the finest level. covered_cells: how many cells of the survey a cell of the level covers along each
    axis.
    shape: how many cells the level has along each axis.
    """

    number: int
    covered_cells: Pair
    shape: Pair

    @property
    def path(self) -> str:
        """The path of the level's group in the store."""
        return f"{GROUP}/{self.number}"


@dataclass(frozen=True)
class LevelBlock:
    """A rectangle of the survey's cells that becomes one chunk of each level.

    position: the row and the column of the block among all blocks. epsilon, delta: the ranges of its cells in the grid.
    along: the index of its slice; () without a third axis.
    """

    position: Pair
    epsilon: slice
    delta: slice
    along: Along = ()

    @property
    def selection(self) -> tuple[int | EllipsisType | slice, ...]:
        """The index that selects the block's cells in the array of a variable of the survey."""
        return *self.along, ..., self.epsilon, self.delta

    def selection_at_level(self, level: PyramidLevel) -> tuple[int | EllipsisType | slice, ...]:
        """Return the index that selects the block's cells in the array of a variable of a level."""
        spans = zip((self.epsilon, self.delta), level.covered_cells, strict=True)
        return *self.along, ..., *(slice(span.start // cells, -(-span.stop // cells)) for span, cells in spans)


def possible_levels(shape: Pair) -> tuple[PyramidLevel, ...]:
    """Return all levels that a grid of this shape can have, down to a single cell.

    While an axis has more than LARGEST_NOT_HALVED cells, only axes with more than LARGEST_NOT_HALVED cells are halved.
    After that both axes are halved.

    Returns
    -------
    tuple[PyramidLevel, ...]
        From the finest to the coarsest.
    """
    cells, found, now = (1, 1), list[PyramidLevel](), shape
    while max(now) > 1:
        least = LARGEST_NOT_HALVED if max(now) > LARGEST_NOT_HALVED else 1
        cells = _as_pair(each * 2 if size > least else each for each, size in zip(cells, now, strict=True))
        now = _as_pair(-(-size // each) for size, each in zip(shape, cells, strict=True))
        found.append(PyramidLevel(len(found) + 1, cells, now))
    return tuple(found)


def stored_levels_of_shape(shape: Pair) -> tuple[PyramidLevel, ...]:
    """Return the levels that the store of a survey of this shape has.

    A survey of at most LARGEST_WITHOUT_LEVELS cells along each axis has no levels. In other surveys the coarsest level
    is the first one with at most LARGEST_NOT_HALVED cells along each axis.

    Returns
    -------
    tuple[PyramidLevel, ...]
        From the finest to the coarsest; empty for a small survey.
    """
    all_of = possible_levels(shape) if max(shape) > LARGEST_WITHOUT_LEVELS else ()
    return all_of[: 1 + sum(max(level.shape) > LARGEST_NOT_HALVED for level in all_of)]


def coarsening_factors_of_levels(levels: tuple[PyramidLevel, ...]) -> list[Pair]:
    """Return for each level how many cells of the next finer level a cell covers along each axis, 1 or 2."""
    cells = [(1, 1), *(level.covered_cells for level in levels)]
    return [_as_pair(new // old for old, new in zip(*both, strict=True)) for both in pairwise(cells)]


def block_shape(request: SurveyRequest) -> Pair:
    """Return how many cells a block has along each axis. The numbers depend on grid and variables, not on the tiles."""
    per_cell = (each for each in variables_of_groups(request.quantities, request.model) if each.is_per_cell)
    maps = max(math.prod(shape_of_variable(each, (1, 1), request.n_slots)) for each in per_cell)
    side = LARGEST_SIDE
    while side * side * maps > BLOCK_NUMBERS:
        side //= 2
    return _as_pair(max(side, cells) for cells in stored_levels_of_shape(request.shape)[-1].covered_cells)


def level_blocks(request: SurveyRequest) -> list[LevelBlock]:
    """Return the blocks that cover a survey with levels, slice by slice, row by row."""
    rows, columns = (
        [slice(start, min(start + size, num)) for start in range(0, num, size)]
        for num, size in zip(request.shape, block_shape(request), strict=True)
    )
    return [
        LevelBlock((i, j), row, column, along)
        for along in request.slices
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
    ]


def centres_of_level_cells(axis: np.ndarray, cells: int) -> np.ndarray:
    """Return the centres of a level's cells along an axis.

    axis: the centres of the survey's cells. cells: how many of the survey's cells each cell of the level covers along
    the axis. The returned centres are evenly spaced, although the last cell of the level may cover fewer cells.

    Returns
    -------
    np.ndarray
        Shape (cells of the level,).
    """
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    found: np.ndarray = axis[0] + step * (cells * np.arange(-(-axis.size // cells)) + (cells - 1) / 2)
    return found


def _as_pair(values: Iterable[int]) -> Pair:
    first, second = values
    return first, second
