"""The blocks (rectangles of cells) in which a survey's attractors are joined to families, and their temporary files.

Blocks do not depend on the tiles of the survey. The store holds the temporary files during the join.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from types import EllipsisType

import numpy as np
import zarr

from gear_rattle.workers.errors import report_damage
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.request import Along, SurveyRequest
from gear_rattle.workers.survey.stored_families import (
    ATTRACTOR_VARIABLES,
    FAMILY,
    GROUP,
    ListedAttractors,
    attractors_in_slots,
)
from rattle import Attractors
from rattle.families import CellRectangle

#: Largest number of slots in a block, for which a worker needs some 100 MB. With another number about one
#: continued orbit in 10⁸ would get another family; all others would keep theirs.
SLOTS_OF_BLOCK = 1 << 19


@dataclass(frozen=True)
class FamilyBlock:
    """A rectangle of cells whose attractors one task joins to families; a chunk of the array of family numbers.

    row, column: the position of the block among all blocks. cells: the ranges of its rows and columns of cells.
    cells_per_side: the number of cells along a side of a block; blocks at the ends of the axes may be smaller. along:
    the index of the slice that contains the block; () without a third axis.
    """

    row: int
    column: int
    cells: CellRectangle
    cells_per_side: int
    along: Along = ()

    @property
    def chunk_key(self) -> str:
        """The key of the chunk with the family numbers of the block's slots."""
        return "/".join([FAMILY, "c", *map(str, (*self.along, 0, self.row, self.column))])

    def temporary_key(self, what: str) -> str:
        """Return the key of a temporary file, which exists during the join only. what: COMPONENTS or TARGETS."""
        return ".".join([f"{GROUP}/joining", *map(str, (*self.along, self.row, self.column)), what])


#: Names of a block's temporary files: the component (connected part of a family) of each attractor, and each
#: attractor's slot after the join.
COMPONENTS, TARGETS = "components", "slots"


def blocks_of_grid(request: SurveyRequest, along: Along = ()) -> list[FamilyBlock]:
    """Return the blocks that cover the grid of a slice, or of a survey without a third axis, row by row."""
    side, (rows, columns) = max(1, math.isqrt(SLOTS_OF_BLOCK // request.n_slots)), request.shape
    return [
        FamilyBlock(i // side, j // side, CellRectangle(i, min(i + side, rows), j, min(j + side, columns)), side, along)
        for i in range(0, rows, side)
        for j in range(0, columns, side)
    ]


def extend_by_rim(cells: CellRectangle, shape: tuple[int, int], before: int = 1) -> CellRectangle:
    """Extend a rectangle by a rim one cell wide, but not beyond a grid of this shape.

    before: 1 for a rim on all sides, 0 for a rim only after the last row and column.

    Returns
    -------
    CellRectangle
        The larger rectangle.
    """
    return CellRectangle(
        max(cells.top - before, 0),
        min(cells.bottom + 1, shape[0]),
        max(cells.left - before, 0),
        min(cells.right + 1, shape[1]),
    )


def are_cells_in_rectangle(cell: np.ndarray, cells: CellRectangle, columns: int) -> np.ndarray:
    """Return for each cell number whether the cell is in a rectangle. columns: number of columns of the whole grid."""
    row, column = np.divmod(cell, columns)
    found: np.ndarray = (cells.top <= row) & (row < cells.bottom) & (cells.left <= column) & (column < cells.right)
    return found


def renumber_cells_in_rectangle(table: Attractors, cells: CellRectangle, columns: int) -> Attractors:
    """Return attractors with the numbers of their cells in a rectangle, instead of the numbers in the grid."""
    row, column = np.divmod(table.cell, columns)
    return table.replace(cell=(row - cells.top) * (cells.right - cells.left) + column - cells.left)


def renumber_cells_in_grid(table: Attractors, cells: CellRectangle, columns: int) -> Attractors:
    """Return attractors with the numbers of their cells in the grid, instead of the numbers in a rectangle."""
    row, column = np.divmod(table.cell, cells.right - cells.left)
    return table.replace(cell=(row + cells.top) * columns + column + cells.left)


def read_attractors(request: SurveyRequest, place: Place, cells: CellRectangle, along: Along) -> ListedAttractors:
    """Read the attractors that a survey lists in a rectangle of a slice. Cells are numbered in the whole grid.

    Returns
    -------
    ListedAttractors
        The attractors, sorted by cell, and their slots.
    """
    at: tuple[int | slice | EllipsisType, ...] = (
        *along,
        ...,
        slice(cells.top, cells.bottom),
        slice(cells.left, cells.right),
    )
    with report_damage(f"the attractors of {place}"):
        values = {
            name: np.asarray(zarr.open_array(place.zarr(), path=name, mode="r")[at]) for name in ATTRACTOR_VARIABLES
        }
    found = attractors_in_slots(values, request.initial_conditions.count)
    return found._replace(attractors=renumber_cells_in_grid(found.attractors, cells, request.shape[1]))


def read_components(place: Place, block: FamilyBlock) -> np.ndarray:
    """Return the number of the component (connected part of a family) of each attractor of a block.

    The attractors, sorted by cell, are those that a slot lists and the orbits that were continued into the block.

    Returns
    -------
    np.ndarray
        Shape (attractors,), int64. −1 in an entry that stands for the undecided samples of a cell, which a slot lists
        like an attractor.
    """
    with report_damage(f"a temporary file of {place}"):
        return np.frombuffer(place.read(block.temporary_key(COMPONENTS)), np.int32).astype(np.int64)


def intersect_rectangles(one: CellRectangle, other: CellRectangle) -> CellRectangle:
    """Return the intersection of two rectangles; an empty intersection has bottom ≤ top or right ≤ left."""
    return CellRectangle(
        max(one.top, other.top),
        min(one.bottom, other.bottom),
        max(one.left, other.left),
        min(one.right, other.right),
    )


def read_target_slots(
    request: SurveyRequest, place: Place, cells: CellRectangle, blocks: Iterable[FamilyBlock]
) -> np.ndarray:
    """Read the slots to which the attractors in a rectangle of cells must move.

    blocks: the blocks that cover the rectangle.

    Returns
    -------
    np.ndarray
        Shape (slots, m, n), int8. Entry k of a cell is the new slot of its k-th listed attractor, −1 if the cell lists
        fewer attractors.
    """
    found = np.empty((request.n_slots, cells.bottom - cells.top, cells.right - cells.left), np.int8)
    for block in blocks:
        of, both = block.cells, intersect_rectangles(block.cells, cells)
        with report_damage(f"a temporary file of {place}"):
            kept = np.frombuffer(place.read(block.temporary_key(TARGETS)), np.int8)
        kept = kept.reshape(request.n_slots, of.bottom - of.top, of.right - of.left)
        found[_index_of_part(both, cells)] = kept[_index_of_part(both, of)]
    return found


def _index_of_part(part: CellRectangle, whole: CellRectangle) -> tuple[slice, slice, slice]:
    """Return the index that selects a part of a rectangle in an array (slots, m, n) over the whole rectangle."""
    return (
        slice(None),
        slice(part.top - whole.top, part.bottom - whole.top),
        slice(part.left - whole.left, part.right - whole.left),
    )


def ranks_within_cells(cell: np.ndarray) -> np.ndarray:
    """Return for each attractor how many attractors of the same cell precede it. cell: sorted cell numbers."""
    found: np.ndarray = np.arange(cell.size) - np.searchsorted(cell, cell)
    return found
