"""Families of attractors over a grid of cells, and what is known of each."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.families.sums import QUIET_FAMILY, Sums, numbers_of


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
    attractors: AttractorTable
    entered: NDArray[np.bool_]
    family: NDArray[np.int64]
    table: FamilyTable

    def fractions(self, number: int) -> NDArray[np.float64]:
        """Return the share of the samples that a family wins, (m, n); NaN where it is not."""
        rows, shape = self.family == number, (self.epsilon.size, self.delta.size)
        cell, samples = self.attractors.cell, self.attractors.samples
        n_cells = shape[0] * shape[1]
        won = np.bincount(cell[rows], samples[rows], n_cells)
        there = np.bincount(cell[rows], minlength=n_cells) > 0
        return np.where(there, won / self.count, np.nan).reshape(shape)


def tabulate_families(delta: NDArray[np.float64], epsilon: NDArray[np.float64], count: int, sums: Sums) -> FamilyTable:
    """Return the table of families of cells `epsilon` (m,) × `delta` (n,) with `count` samples each.

    It is made from the sums of all cells.

    Returns
    -------
    FamilyTable
        A row for each family.
    """
    family = numbers_of(sums)[sums.component]
    n = int(family.max(initial=QUIET_FAMILY)) + 1

    def of(values: NDArray[Any], nothing: float = 0) -> NDArray[Any]:
        column = np.full(n, nothing, values.dtype)
        column[family] = values
        return column

    def between(
        axis: NDArray[np.float64], one: NDArray[np.int64], other: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        low, high = np.minimum(axis[one], axis[other]), np.maximum(axis[one], axis[other])
        return of(low, np.nan), of(high, np.nan)

    row, column = np.divmod(sums.at, delta.size)
    exponent = np.where(np.isfinite(sums.exponent), sums.exponent, np.nan)
    return FamilyTable(
        of(sums.kind, Outcome.QUIET),
        of(sums.m),
        of(sums.n_plus),
        of(sums.n_minus),
        of(sums.cells),
        of(sums.unsampled),
        *between(delta, sums.left, sums.right),
        *between(epsilon, sums.top, sums.bottom),
        of(sums.most / count),
        of(sums.samples / (count * np.maximum(sums.cells, 1))),
        of(delta[column], np.nan),
        of(epsilon[row], np.nan),
        of(exponent, np.nan),
        of(sums.rows > sums.cells),
    )
