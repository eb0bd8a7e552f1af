"""The join of a grid piece by piece: what enters a piece from its rim, and what is one in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.families.join import components, continued, entered, longer, room_for, spread_all, together
from rattle.families.spread import OF_ORBIT, Rectangle, enter

no_attractors = AttractorTable.empty


class GridPiece:
    """A grid that gets to know its attractors some cells at a time: which orbits exist in it, continued everywhere.

    orbits, n: as `spread` has them. samples (n,): that go to an orbit in its cell, −1 of what was entered.
    """

    def __init__(self, shape: tuple[int, int], cells: Any) -> None:
        self.shape, self._cells = shape, cells
        self.orbits, self.n = room_for(64, shape[0] * shape[1]), 0
        self.samples = np.zeros(0, np.int64)

    def learn(self, table: AttractorTable) -> None:
        """Take the periodic rows of a table of cells of which none were known, and continue what is new."""
        table = table.take(table.kind == Outcome.PERIODIC)
        before, which = self.n, np.zeros(table.cell.size, np.int64)
        while self.orbits.cell.size < before + which.size:
            self.orbits = longer(self.orbits)
        columns = (getattr(table, name) for name in OF_ORBIT)
        n = int(enter(*columns, before, self._cells, self.orbits, which))
        inside = Rectangle(0, self.shape[0], 0, self.shape[1])
        self.orbits, self.n = spread_all(before, n, self.shape[1], inside, self._cells, self.orbits)
        self.samples = np.append(self.samples, np.full(self.n - before, -1))
        self.samples[which] = table.samples


def entering(
    inside: AttractorTable, beside: AttractorTable, tried: bool, columns: int, piece: Rectangle, cells: Any
) -> AttractorTable:
    """Return the orbits that enter the cells of a piece of a grid with `columns` columns.

    Orbits of the attractors inside the piece, and of those beside it, are continued in it until nothing new is found.
    Rows of one cell are side by side.

    Parameters
    ----------
    tried : bool
        Those inside have been continued before.

    Returns
    -------
    AttractorTable
        A row for each orbit and each cell that it enters.
    """
    n, m = (int(np.count_nonzero(table.kind == Outcome.PERIODIC)) for table in (inside, beside))
    orbits, end = continued(together(inside, beside), columns, piece, cells, n if tried else 0)
    return entered(orbits, n + m, end)


def connected(table: AttractorTable, shape: tuple[int, int], cells: Any) -> NDArray[np.int64]:
    """Return numbers (rows,) that join the attractors of a complete grid, as `components` has them.

    The table has everything that enters its cells, in the order of its cells.

    Returns
    -------
    NDArray[np.int64]
        (rows,), the number of each row's component.
    """
    orbits, _n = continued(table, shape[1], Rectangle(0, shape[0], 0, shape[1]), cells)
    return components(table, np.flatnonzero(table.kind == Outcome.PERIODIC), orbits, shape, cells)
