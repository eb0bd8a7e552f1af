"""Define the levels of a survey, and the blocks that they are made in."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from types import EllipsisType

import numpy as np

from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.values.quantities import held, shape_of

GROUP = "levels"
LARGEST = 512  # cells along an axis of a survey that needs no levels
LEAST = 256  # cells along an axis that is not halved any more
#: Cells along an axis of a block, a chunk of each level, and numbers of a variable in one: some 130 MB of a worker.
SIDE, BLOCK_NUMBERS = 2048, 1 << 24

Pair = tuple[int, int]  # along (epsilon, delta)


@dataclass(frozen=True)
class Level:
    """A level: its number from 1, how many cells of the survey one of its cells has along each axis, and its shape."""

    number: int
    cells: Pair
    shape: Pair

    @property
    def path(self) -> str:
        """The group that it is in."""
        return f"{GROUP}/{self.number}"


@dataclass(frozen=True)
class LevelBlock:
    """A rectangle of the survey that is one chunk of each level, and where it is among these."""

    place: Pair
    epsilon: slice
    delta: slice
    along: Along = ()  # in which slice it is

    @property
    def at(self) -> tuple[int | EllipsisType | slice, ...]:
        """Its part of a variable."""
        return *self.along, ..., self.epsilon, self.delta

    def at_level(self, level: Level) -> tuple[int | EllipsisType | slice, ...]:
        """Return the same of a level."""
        spans = zip((self.epsilon, self.delta), level.cells, strict=True)
        return *self.along, ..., *(slice(span.start // cells, -(-span.stop // cells)) for span, cells in spans)


def halvings(shape: Pair) -> tuple[Level, ...]:
    """Return all levels that cells of this shape can have, down to a single one.

    An axis of more than LEAST is halved while there is one, then both are.

    Returns
    -------
    tuple[Level, ...]
        The levels.
    """
    cells, found, now = (1, 1), list[Level](), shape
    while max(now) > 1:
        least = LEAST if max(now) > LEAST else 1
        cells = _pair(each * 2 if size > least else each for each, size in zip(cells, now, strict=True))
        now = _pair(-(-size // each) for size, each in zip(shape, cells, strict=True))
        found.append(Level(len(found) + 1, cells, now))
    return tuple(found)


def levels_of(shape: Pair) -> tuple[Level, ...]:
    """Return the levels that a survey of this shape has in its store: none up to LARGEST, then down to LEAST."""
    all_of = halvings(shape) if max(shape) > LARGEST else ()
    return all_of[: 1 + sum(max(level.shape) > LEAST for level in all_of)]


def steps_of(levels: tuple[Level, ...]) -> list[Pair]:
    """Return how many cells of the level before, the survey first, each level's cells have along each axis: 1 or 2."""
    cells = [(1, 1), *(level.cells for level in levels)]
    return [_pair(new // old for old, new in zip(*both, strict=True)) for both in pairwise(cells)]


def block_shape(request: SurveyRequest) -> Pair:
    """Cells of a block along each axis. It depends on the grid and the variables, and not on the tiles."""
    per_cell = (each for each in held(request.quantities, request.model) if each.per_cell)
    maps = max(math.prod(shape_of(each, (1, 1), request.n_slots)) for each in per_cell)
    side = SIDE
    while side * side * maps > BLOCK_NUMBERS:
        side //= 2
    return _pair(max(side, cells) for cells in levels_of(request.shape)[-1].cells)


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


def centres(axis: np.ndarray, cells: int) -> np.ndarray:
    """Return the middles of a level's cells, so many of the survey's each, whose own are `axis`.

    Evenly spaced, as if the last one had as many as the others.

    Returns
    -------
    np.ndarray
        Middles of the cells.
    """
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    found: np.ndarray = axis[0] + step * (cells * np.arange(-(-axis.size // cells)) + (cells - 1) / 2)
    return found


def _pair(values: Iterable[int]) -> Pair:
    first, second = values
    return first, second
