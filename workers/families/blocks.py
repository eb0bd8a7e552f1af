"""The blocks in which a survey is joined, independent of its tiles, and their temporary files in the store."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from types import EllipsisType

import numpy as np
import zarr

from gear_rattle.workers.errors import reading
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.families import FAMILY, GROUP, STORED, Slots, attractors_in_slots
from gear_rattle.workers.survey.request import Along, SurveyRequest
from rattle import Attractors
from rattle.families import Rectangle

#: Slots of the cells of a block, some 100 MB of a worker. It changes the bits of one continued orbit in 10⁸.
SLOTS_OF_BLOCK = 1 << 19


@dataclass(frozen=True)
class Block:
    """A rectangle of cells, with its row and column among blocks of `side` cells; also a chunk of the family arrays."""

    row: int
    column: int
    cells: Rectangle
    side: int
    along: Along = ()  # index of its slice

    @property
    def chunk(self) -> str:
        """The key of the chunk with the families of its slots."""
        return "/".join([FAMILY, "c", *map(str, (*self.along, 0, self.row, self.column))])

    def kept(self, what: str) -> str:
        """Return the key of a temporary file of the block, which exists while the survey is joined."""
        return ".".join([f"{GROUP}/joining", *map(str, (*self.along, self.row, self.column)), what])


COMPONENTS, TARGETS = "components", "slots"  # names of the temporary files


def blocks_of(request: SurveyRequest, along: Along = ()) -> list[Block]:
    """Return the blocks that cover the grid of a survey without a third axis, or of a slice, row by row."""
    side, (rows, columns) = max(1, math.isqrt(SLOTS_OF_BLOCK // request.n_slots)), request.shape
    return [
        Block(i // side, j // side, Rectangle(i, min(i + side, rows), j, min(j + side, columns)), side, along)
        for i in range(0, rows, side)
        for j in range(0, columns, side)
    ]


def with_rim(cells: Rectangle, shape: tuple[int, int], before: int = 1) -> Rectangle:
    """Return a rectangle extended by the cells around it; with before=0, by those after it only."""
    return Rectangle(
        max(cells.top - before, 0),
        min(cells.bottom + 1, shape[0]),
        max(cells.left - before, 0),
        min(cells.right + 1, shape[1]),
    )


def within(cell: np.ndarray, cells: Rectangle, columns: int) -> np.ndarray:
    """Return whether cells, given by their number in the grid, are in a rectangle."""
    row, column = np.divmod(cell, columns)
    found: np.ndarray = (cells.top <= row) & (row < cells.bottom) & (cells.left <= column) & (column < cells.right)
    return found


def numbered_in(table: Attractors, cells: Rectangle, columns: int) -> Attractors:
    """Return a table whose cells are numbered in a rectangle instead of in the grid."""
    row, column = np.divmod(table.cell, columns)
    return table.replace(cell=(row - cells.top) * (cells.right - cells.left) + column - cells.left)


def numbered_over(table: Attractors, cells: Rectangle, columns: int) -> Attractors:
    """Return a table whose cells are numbered in the grid instead of in a rectangle."""
    row, column = np.divmod(table.cell, cells.right - cells.left)
    return table.replace(cell=(row + cells.top) * columns + column + cells.left)


def attractors_in(request: SurveyRequest, place: Place, cells: Rectangle, along: Along) -> Slots:
    """Return the attractors that a survey lists in a rectangle of a slice, in order, with their cells in the grid.

    Returns
    -------
    Slots
        One row for each attractor.
    """
    at: tuple[int | slice | EllipsisType, ...] = (
        *along,
        ...,
        slice(cells.top, cells.bottom),
        slice(cells.left, cells.right),
    )
    with reading(f"the attractors of {place}"):
        values = {name: np.asarray(zarr.open_array(place.zarr(), path=name, mode="r")[at]) for name in STORED}
    found = attractors_in_slots(values, request.initial_conditions.count)
    return found._replace(attractors=numbered_over(found.attractors, cells, request.shape[1]))


def read_components(place: Place, block: Block) -> np.ndarray:
    """Return the component for each attractor of the block, continued ones included, in their order."""
    with reading(f"what is kept of {place}"):
        return np.frombuffer(place.read(block.kept(COMPONENTS)), np.int32).astype(np.int64)


def common(one: Rectangle, other: Rectangle) -> Rectangle:
    """Return the intersection of two rectangles; an empty one ends before it begins."""
    return Rectangle(
        max(one.top, other.top),
        min(one.bottom, other.bottom),
        max(one.left, other.left),
        min(one.right, other.right),
    )


def read_targets(request: SurveyRequest, place: Place, cells: Rectangle, blocks: Iterable[Block]) -> np.ndarray:
    """Return the slots (places, m, n) for the first, the second, … listed attractor of the cells of a rectangle.

    blocks: those that cover it.

    Returns
    -------
    np.ndarray
        int8; −1 where a cell has fewer attractors.
    """
    found = np.empty((request.n_slots, cells.bottom - cells.top, cells.right - cells.left), np.int8)
    for block in blocks:
        of, both = block.cells, common(block.cells, cells)
        with reading(f"what is kept of {place}"):
            kept = np.frombuffer(place.read(block.kept(TARGETS)), np.int8)
        kept = kept.reshape(request.n_slots, of.bottom - of.top, of.right - of.left)
        found[_at(both, cells)] = kept[_at(both, of)]
    return found


def _at(part: Rectangle, whole: Rectangle) -> tuple[slice, slice, slice]:
    """Return the position of a part of a rectangle in an array (slots, m, n) over it."""
    return (
        slice(None),
        slice(part.top - whole.top, part.bottom - whole.top),
        slice(part.left - whole.left, part.right - whole.left),
    )


def place_in_cell(cell: np.ndarray) -> np.ndarray:
    """Return for each row of a sorted table how many rows of the same cell precede it."""
    found: np.ndarray = np.arange(cell.size) - np.searchsorted(cell, cell)
    return found
