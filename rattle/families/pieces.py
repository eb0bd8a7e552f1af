"""The join of a grid piece by piece: what enters a piece from its rim, and what is one in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.table import PERIODIC, Attractors
from rattle.families.join import components, continued, entered, together
from rattle.families.spread import Rectangle


def no_attractors() -> Attractors:
    """A table without rows."""
    real = ("tau", "v", "first", "second", "error", "watched")
    return Attractors._make(np.zeros(0, np.float64 if name in real else np.int64) for name in Attractors._fields)


def entering(
    inside: Attractors, beside: Attractors, tried: bool, columns: int, piece: Rectangle, cells: Any
) -> Attractors:
    """The orbits that enter the cells of a piece of a grid with so many columns: those of its attractors, and of those
    beside it, are continued in it until nothing new is found.

    Rows of one cell are side by side. tried: those inside have been continued before.
    """
    n, m = (int(np.count_nonzero(table.kind == PERIODIC)) for table in (inside, beside))
    orbits, end = continued(together(inside, beside), columns, piece, cells, n if tried else 0)
    return entered(orbits, n + m, end)


def connected(table: Attractors, shape: tuple[int, int], cells: Any) -> NDArray[np.int64]:
    """Which attractors of a grid that has everything that enters it are one (rows,), as `components` has it; table: in
    their order.
    """
    orbits, _n = continued(table, shape[1], Rectangle(0, shape[0], 0, shape[1]), cells)
    return components(table, np.flatnonzero(table.kind == PERIODIC), orbits, shape, cells)
