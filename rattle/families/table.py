"""Families of attractors over a grid of cells, and what is known of each."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.table import CHAOTIC, PERIODIC, QUIET, Attractors

QUIET_FAMILY, NO_FAMILY = 0, -1


class FamilyTable(NamedTuple):
    """Families of a grid, all arrays (families,), by number: quiet motion is 0, the others by falling number of cells.

    kind indexes KINDS; m, n_plus, n_minus: the label, 0 unless periodic. cells: that have it; unsampled: those
    of them where no sample goes to it. delta_low to epsilon_high: the box of its cells.
    largest_fraction of the samples of a cell, delta_at and epsilon_at that cell; mean_fraction over its cells.
    exponent: the largest λ₁ of them. monodromy: some cell has two attractors of this family, which are one on a way
    round through other cells.
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
    """The attractors of the cells `epsilon` (m,) × `delta` (n,), joined.

    count: samples of a cell. attractors: of all cells, row by row of the grid, with the orbits that were continued into
    cells that did not know them, which have samples 0. entered (rows,): whether it is one of these; family (rows,): its
    number, −1 where samples are undecided. table: of the families.
    """

    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]
    count: int
    attractors: Attractors
    entered: NDArray[np.bool_]
    family: NDArray[np.int64]
    table: FamilyTable

    def fractions(self, number: int) -> NDArray[np.float64]:
        """The share of the samples that a family wins, (m, n); NaN where it is not."""
        rows, shape = self.family == number, (self.epsilon.size, self.delta.size)
        cell, samples = self.attractors.cell, self.attractors.samples
        n_cells = shape[0] * shape[1]
        won = np.bincount(cell[rows], samples[rows], n_cells)
        there = np.bincount(cell[rows], minlength=n_cells) > 0
        return np.where(there, won / self.count, np.nan).reshape(shape)


def numbered(attractors: Attractors, component: NDArray[np.int64]) -> NDArray[np.int64]:
    """Family numbers (rows,) from components (rows,) in any numbers: by falling number of cells, where these are equal
    by their first rows. So nothing but the cells decides a number.
    """
    family = np.full(component.size, NO_FAMILY)
    family[attractors.kind == QUIET] = QUIET_FAMILY
    rows = np.flatnonzero((attractors.kind == PERIODIC) | (attractors.kind == CHAOTIC))
    _, first, which = np.unique(component[rows], return_index=True, return_inverse=True)
    here, _ = _distinct(which, attractors.cell[rows])
    order = np.lexsort((first, -np.bincount(here, minlength=first.size)))
    family[rows] = 1 + np.argsort(order)[which]
    return family


def _distinct(family: NDArray[np.int64], cell: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Each pair of a family and a cell once."""
    width = int(cell.max(initial=0)) + 1
    pairs = np.unique(family * width + cell)
    return pairs // width, pairs % width


def tabulated(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    count: int,
    attractors: Attractors,
    family: NDArray[np.int64],
) -> FamilyTable:
    """What is known of each family."""
    rows = np.flatnonzero(family != NO_FAMILY)
    each, cell = family[rows], attractors.cell[rows]
    n = int(each.max(initial=QUIET_FAMILY)) + 1
    share = attractors.samples[rows] / count
    here, at = _distinct(each, cell)
    cells = np.bincount(here, minlength=n)
    row, column = np.divmod(at, delta.size)

    def extreme(values: NDArray[np.float64], family: NDArray[np.int64]) -> tuple[NDArray[np.float64], ...]:
        low, high = np.full(n, np.inf), np.full(n, -np.inf)
        np.minimum.at(low, family, values)
        np.maximum.at(high, family, values)
        return tuple(np.where(np.isfinite(x), x, np.nan) for x in (low, high))

    first = np.full(n, -1)
    first[each[::-1]] = rows[::-1]  # a row of each
    label = (np.where(first >= 0, x[first], 0) for x in attractors[2:5])
    kind = np.where(first >= 0, attractors.kind[first], QUIET)
    best = np.full(n, -1)
    order = np.lexsort((-np.arange(rows.size), share))  # the first of equal ones comes last, and stays
    best[each[order]] = order
    place = np.where(best >= 0, cell[best], 0)
    known = np.flatnonzero(~np.isnan(attractors.first[rows]))
    columns = (
        kind,
        *label,
        cells,
        np.bincount(each, attractors.samples[rows] == 0, n).astype(np.int64),
        *extreme(delta[column], here),
        *extreme(epsilon[row], here),
        np.where(best >= 0, share[best], 0.0),
        np.bincount(each, share, n) / np.maximum(cells, 1),
        np.where(best >= 0, delta[place % delta.size], np.nan),
        np.where(best >= 0, epsilon[place // delta.size], np.nan),
        extreme(attractors.first[rows][known], each[known])[1],
        np.bincount(each, minlength=n) > cells,
    )
    return FamilyTable._make(columns)
