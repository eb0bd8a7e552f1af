"""Join a grid piece by piece: continue orbits into a piece from its neighbours, then connect all attractors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.families.join import (
    allocate_orbits,
    assign_component_numbers,
    concat_tables,
    continue_orbits,
    continue_orbits_until_complete,
    enlarge_orbit_arrays,
    table_of_continued_orbits,
)
from rattle.families.spread import ORBIT_COLUMNS, CellRectangle, add_new_orbits

no_attractors = AttractorTable.empty


class GridPiece:
    """A rectangular piece of a larger grid, whose cells are computed in several steps.

    After each step `add_attractors` adds the attractors of the new cells, and continues them into the whole piece.
    orbits: the orbits found so far, in the arrays that `continue_orbits_into_neighbours` fills. n: their number.
    samples (n,): the number of samples that reach an orbit in its cell, −1 for an orbit that continuation found.
    """

    def __init__(self, shape: tuple[int, int], cells: Any) -> None:
        self.shape, self._cells = shape, cells
        self.orbits, self.n = allocate_orbits(64, shape[0] * shape[1]), 0
        self.samples = np.zeros(0, np.int64)

    def add_attractors(self, table: AttractorTable) -> None:
        """Add the periodic attractors of some cells, and continue the new ones into the other cells.

        table: the attractors of the cells. The number of samples of each periodic attractor is stored in `samples`,
        also if continuation had found the attractor before.
        """
        table = table.take(table.kind == Outcome.PERIODIC)
        before, which = self.n, np.zeros(table.cell.size, np.int64)
        while self.orbits.cell.size < before + which.size:
            self.orbits = enlarge_orbit_arrays(self.orbits)
        columns = (getattr(table, name) for name in ORBIT_COLUMNS)
        n = int(add_new_orbits(*columns, before, self._cells, self.orbits, which))
        inside = CellRectangle(0, self.shape[0], 0, self.shape[1])
        self.orbits, self.n = continue_orbits_until_complete(before, n, self.shape[1], inside, self._cells, self.orbits)
        self.samples = np.append(self.samples, np.full(self.n - before, -1))
        self.samples[which] = table.samples


def continue_into_piece(
    inside: AttractorTable,
    outside: AttractorTable,
    inside_is_continued: bool,
    columns: int,
    piece: CellRectangle,
    cells: Any,
) -> AttractorTable:
    """Continue orbits from cell to cell into a rectangle of a grid, and return the orbits that are new in its cells.

    Parameters
    ----------
    inside, outside : AttractorTable
        The attractors in the rectangle, and the attractors in the cells next to it; rows of the same cell follow each
        other.
    inside_is_continued : bool
        Whether an earlier call continued the orbits of `inside`; then only those of `outside` are continued.
    columns : int
        The number of columns of the grid.
    piece : CellRectangle
        The rectangle.
    cells : NamedTuple of ndarray
        The cells of the grid as kernels take them.

    Returns
    -------
    AttractorTable
        A row, with 0 samples, for each new orbit of each cell of the rectangle.
    """
    n, m = (int(np.count_nonzero(table.kind == Outcome.PERIODIC)) for table in (inside, outside))
    orbits, end = continue_orbits(
        concat_tables(inside, outside), columns, piece, cells, n if inside_is_continued else 0
    )
    return table_of_continued_orbits(orbits, n + m, end)


def connect_attractors(table: AttractorTable, shape: tuple[int, int], cells: Any) -> NDArray[np.int64]:
    """Return a number for each attractor of a grid, the same for attractors of neighbouring cells that are one motion.

    table: all attractors, in the order of their cells, including all orbits that continuation finds. shape: the numbers
    of rows and columns of the grid.

    Returns
    -------
    NDArray[np.int64]
        The numbers (rows,): rows of the table with the same number are one motion in several cells. Quiet motion has
        the number QUIET_FAMILY, the row for a cell's undecided samples has NO_FAMILY.
    """
    orbits, _n = continue_orbits(table, shape[1], CellRectangle(0, shape[0], 0, shape[1]), cells)
    return assign_component_numbers(table, np.flatnonzero(table.kind == Outcome.PERIODIC), orbits, shape, cells)
