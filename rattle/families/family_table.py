"""The families of attractors over a grid of cells, and a table of their properties."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.families.sums import QUIET_FAMILY, ComponentSums, assign_family_numbers


class FamilyTable(NamedTuple):
    """The properties of the families of a grid, as arrays (families,) whose index is the number of the family.

    Family 0 is quiet motion; the others are in order of falling number of cells.
    kind: the number in KINDS. m, n_plus, n_minus: the label, 0 unless periodic.
    cells: the number of its cells. unsampled: the number of its attractors that no sample reaches.
    delta_low, delta_high, epsilon_low, epsilon_high: the box of its cells.
    largest_fraction: its largest basin fraction in a cell, at (delta_at, epsilon_at). mean_fraction: the mean over its
    cells. exponent: the largest Lyapunov exponent of its attractors, NaN if none is known.
    monodromy: whether a cell has two attractors of the family, which are connected through other cells.
    """

    kind: NDArray[np.int64]
    m: NDArray[np.int64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]
    cells: NDArray[np.int64]
    unsampled: NDArray[np.int64]
    delta_low: NDArray[np.float64]
    delta_high: NDArray[np.float64]
    epsilon_low: NDArray[np.float64]
    epsilon_high: NDArray[np.float64]
    largest_fraction: NDArray[np.float64]
    mean_fraction: NDArray[np.float64]
    delta_at: NDArray[np.float64]
    epsilon_at: NDArray[np.float64]
    exponent: NDArray[np.float64]
    monodromy: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Families:
    """The attractors of the cells `epsilon` (m,) × `delta` (n,), joined to families.

    count: the number of samples of a cell.
    attractors: the attractors of all cells, row by row of the grid; orbits that were found by continuation have 0
    samples. entered (rows,): whether an attractor was found by continuation. family (rows,): the number of its family,
    −1 for undecided samples.
    table: the properties of the families.
    """

    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]
    count: int
    attractors: AttractorTable
    entered: NDArray[np.bool_]
    family: NDArray[np.int64]
    table: FamilyTable

    def fractions(self, number: int) -> NDArray[np.float64]:
        """Return the basin fraction of a family in each cell (m, n), NaN in cells where the family has no attractor."""
        rows, shape = self.family == number, (self.epsilon.size, self.delta.size)
        cell, samples = self.attractors.cell, self.attractors.samples
        n_cells = shape[0] * shape[1]
        won = np.bincount(cell[rows], samples[rows], n_cells)
        there = np.bincount(cell[rows], minlength=n_cells) > 0
        return np.where(there, won / self.count, np.nan).reshape(shape)


def tabulate_families(
    delta: NDArray[np.float64], epsilon: NDArray[np.float64], count: int, sums: ComponentSums
) -> FamilyTable:
    """Return the properties of all families on a grid of cells.

    delta (n,), epsilon (m,): the axes of the grid. count: the number of samples of a cell. sums: the sums over all
    cells, from which the properties are computed.

    Returns
    -------
    FamilyTable
        A row for each family.
    """
    family = assign_family_numbers(sums)[sums.component]
    n = int(family.max(initial=QUIET_FAMILY)) + 1

    def arrange_by_family(values: NDArray[Any], default: float = 0) -> NDArray[Any]:
        """Return values in the order of families.

        values: one value for each entry of `sums`. default: the value of a family without an entry in `sums`. Only
        quiet motion can be without one: it has its family number even if no cell has quiet motion.

        Returns
        -------
        NDArray[Any]
            Values (families,).
        """
        column = np.full(n, default, values.dtype)
        column[family] = values
        return column

    def axis_range(
        axis: NDArray[np.float64], first: NDArray[np.int64], last: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the least and the largest value of an axis at the cells of each family.

        first, last: for each entry of `sums`, the indices along the axis of its first and its last cell. The axis may
        rise or fall.

        Returns
        -------
        tuple[NDArray[np.float64], NDArray[np.float64]]
            Values (families,), NaN for a family without cells.
        """
        low, high = np.minimum(axis[first], axis[last]), np.maximum(axis[first], axis[last])
        return arrange_by_family(low, np.nan), arrange_by_family(high, np.nan)

    row, column = np.divmod(sums.at, delta.size)
    exponent = np.where(np.isfinite(sums.exponent), sums.exponent, np.nan)
    return FamilyTable(
        arrange_by_family(sums.kind, Outcome.QUIET),
        arrange_by_family(sums.m),
        arrange_by_family(sums.n_plus),
        arrange_by_family(sums.n_minus),
        arrange_by_family(sums.cells),
        arrange_by_family(sums.unsampled),
        *axis_range(delta, sums.left, sums.right),
        *axis_range(epsilon, sums.top, sums.bottom),
        arrange_by_family(sums.most / count),
        arrange_by_family(sums.samples / (count * np.maximum(sums.cells, 1))),
        arrange_by_family(delta[column], np.nan),
        arrange_by_family(epsilon[row], np.nan),
        arrange_by_family(exponent, np.nan),
        arrange_by_family(sums.rows > sums.cells),
    )
