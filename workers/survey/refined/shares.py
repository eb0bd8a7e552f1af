"""Fill cells of leaves with attractors: orbits come from continuation, and basin fractions from computed cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.blocks import Leaves
from gear_rattle.workers.survey.refined.evidence import SAMPLED_KINDS, ComputedCells
from rattle import Attractors
from rattle.attractors import PERIODIC, UNDECIDED
from rattle.families import GridPiece, concat_tables, no_attractors

HALF_WIDTH_95 = 1.96  # half-width of a 95 % interval in standard deviations


class FilledCellAttractors(NamedTuple):
    """The attractors of filled cells.

    table: the attractors. A periodic attractor is an orbit that Newton's method has found in the cell. Any other
    attractor has the state of an attractor of the same kind in the nearest computed cell that has one; its exponents
    are NaN.
    `table.samples` is the basin fraction times the number of samples of a cell, and need not be a whole number.
    added_width: the half-width that filling adds to the 95 % interval of each basin fraction.
    """

    table: Attractors
    added_width: np.ndarray


class OrbitsByBranch(NamedTuple):
    """The n periodic orbits in the cells of a block, grouped into branches.

    grid_piece: the orbits. row, column: the cell of each orbit in the block. label: a number for each orbit, equal for
    orbits with the same label. branch: a number for each orbit, equal for orbits on the same branch. Two orbits in
    neighbouring cells are on the same branch if continuation of either orbit leads to the other orbit.
    """

    grid_piece: GridPiece
    row: np.ndarray
    column: np.ndarray
    label: np.ndarray
    branch: np.ndarray


def fill_leaves(evidence: ComputedCells, leaves: Leaves) -> FilledCellAttractors:
    """Return the attractors for the cells of leaves that were not computed."""
    square = evidence.blocks.cells_of_leaves(leaves)
    cell = evidence.blocks.cell_numbers(square)
    known = square.inside & evidence.is_computed[cell]
    empty = square.inside & ~known
    blocks: dict[int, OrbitsByBranch] = {}
    parts = [FilledCellAttractors(no_attractors(), np.zeros(0))]
    for i in np.flatnonzero(empty.any((1, 2))):
        block, row, column = (int(x[i]) for x in leaves[:3])
        if block in evidence.orbits_by_block and block not in blocks:
            blocks[block] = group_orbits_into_branches(evidence.orbits_by_block[block])
        leaf = _LeafToFill(evidence, cell[i], known[i], empty[i])
        parts += leaf.fill_with_orbits(blocks[block], row, column) if block in blocks else leaf.fill_without_orbits()
    return FilledCellAttractors(
        concat_tables(*(each.table for each in parts)), np.concatenate([each.added_width for each in parts])
    )


def group_orbits_into_branches(existing: GridPiece) -> OrbitsByBranch:
    """Group the orbits of a block into branches: neighbouring orbits that continue into each other are connected."""
    from scipy.sparse import coo_array  # imported here, because it takes an eighth of a second to load
    from scipy.sparse.csgraph import connected_components

    orbits, n = existing.orbits, existing.n
    to = orbits.continuations[:n].astype(np.int64)
    one, side = np.nonzero((to[:, :2] >= 0) & (to[:, :2] < n))
    other = to[one, side]
    back = to[other, side + 2] == one
    graph = coo_array((np.ones(int(back.sum()), np.int8), (one[back], other[back])), (n, n))
    group = connected_components(graph, directed=False)[1]
    labels = np.column_stack([orbits.m[:n], orbits.n_plus[:n], orbits.n_minus[:n]])
    label = np.unique(labels, axis=0, return_inverse=True)[1].ravel()
    row, column = np.divmod(orbits.cell[:n].astype(np.int64), existing.shape[1])
    return OrbitsByBranch(existing, row, column, label, group)


@dataclass(frozen=True, eq=False)
class _LeafToFill:
    """A leaf to fill, with n × n cells.

    cell (n, n): the numbers of the leaf's cells in the frame (see `Blocks`). known (n, n): flags of the computed cells.
    empty (n, n): flags of the cells to fill.
    """

    evidence: ComputedCells
    cell: np.ndarray
    known: np.ndarray
    empty: np.ndarray

    def fill_without_orbits(self) -> list[FilledCellAttractors]:
        """Return the attractors for the empty cells of a leaf whose block has no periodic orbits."""
        fractions, deviations = self._fit_fractions(np.zeros((int(self.known.sum()), 0)))
        return self._fill_sampled_kinds(fractions, deviations)

    def fill_with_orbits(self, branches: OrbitsByBranch, top: int, left: int) -> list[FilledCellAttractors]:
        """Return the attractors for the empty cells of a leaf whose block has periodic orbits.

        branches: the periodic orbits of the leaf's block. top, left: the leaf's first row and column in the block.

        Returns
        -------
        list[FilledCellAttractors]
            The entries of `_fill_sampled_kinds`, and as the last entry the periodic attractors.
        """
        row, column = branches.row - top, branches.column - left
        n = self.cell.shape[0]
        here = np.flatnonzero((row >= 0) & (row < n) & (column >= 0) & (column < n))
        at = row[here], column[here]
        sampled = (branches.grid_piece.samples[here] >= 0) & self.known[at]
        listed, thing = np.unique(branches.label[here[sampled]], return_inverse=True)
        won = branches.grid_piece.samples[here[sampled]]
        order = np.cumsum(self.known.ravel()).reshape(n, n) - 1
        by_label = np.zeros((int(self.known.sum()), listed.size))
        np.add.at(by_label, (order[at][sampled], thing), won)
        fractions, deviations = self._fit_fractions(by_label)
        weight = np.full(int(branches.branch.max(initial=0)) + 1, -1.0)
        weight[branches.branch[here[sampled]]] = 0.0
        np.add.at(weight, branches.branch[here[sampled]], won)
        wanted = self.empty[at] & np.isin(branches.label[here], listed)
        mine = here[wanted]
        thing = np.searchsorted(listed, branches.label[mine])
        place = (np.cumsum(self.empty.ravel()).reshape(n, n) - 1)[row[mine], column[mine]]
        part = _divide_fractions(place * max(listed.size, 1) + thing, weight[branches.branch[mine]])
        there = part >= 0.0
        mine, thing, place, part = mine[there], thing[there], place[there], part[there]
        orbits = branches.grid_piece.orbits
        share = fractions[place, len(SAMPLED_KINDS) + thing] * part
        zeros, real = np.zeros(mine.size, np.int64), np.full(mine.size, np.nan)
        table = Attractors(
            cell=self.cell[self.empty][place],
            kind=np.full(mine.size, PERIODIC),
            m=orbits.m[mine].astype(np.int64),
            n_plus=orbits.n_plus[mine].astype(np.int64),
            n_minus=orbits.n_minus[mine].astype(np.int64),
            samples=share * self.evidence.cells.sample_count,
            tau=orbits.tau[mine],
            v=orbits.v[mine],
            first=orbits.first[mine],
            second=orbits.second[mine],
            error=np.zeros(mine.size),
            impacts=zeros,
            watched=real,
        )
        periodic = FilledCellAttractors(table, HALF_WIDTH_95 * deviations[len(SAMPLED_KINDS) + thing])
        return [*self._fill_sampled_kinds(fractions, deviations), periodic]

    def _fit_fractions(self, orbit_samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit linear functions of (δ, ε) to basin fractions of the computed cells; evaluate them in the empty cells.

        There is a function for each kind in SAMPLED_KINDS, then one for each label of periodic orbits. orbit_samples
        (known cells, labels): how many samples of each computed cell go to orbits with each label. The fitted fractions
        of each cell are scaled so that their sum is 1.

        Returns
        -------
        tuple[np.ndarray, np.ndarray]
            The fractions in the empty cells (empty cells, functions), and a standard deviation for each function
            (functions,): how far the fractions of computed cells are from the function, without sampling noise.
        """
        count = self.evidence.cells.sample_count
        seen = self.evidence.samples[:, self.cell[self.known]].T
        shares = np.column_stack([seen, orbit_samples]) / count
        known, empty = (self._linear_fit_terms(which) for which in (self.known, self.empty))
        fit = np.linalg.solve(known.T @ known, known.T @ shares)
        fitted, filled = (_normalize_fractions(terms @ fit) for terms in (known, empty))
        noise = (fitted * (1.0 - fitted)).mean(axis=0) / count
        return filled, np.sqrt(np.maximum(((shares - fitted) ** 2).mean(axis=0) - noise, 0.0))

    def _linear_fit_terms(self, which: np.ndarray) -> np.ndarray:
        """Return the terms (1, row, column) of a linear fit at the flagged cells, row and column in [−0.5, 0.5]."""
        at = np.argwhere(which) / (self.cell.shape[0] - 1) - 0.5
        return np.column_stack([np.ones(len(at)), at])

    def _fill_sampled_kinds(self, fractions: np.ndarray, deviations: np.ndarray) -> list[FilledCellAttractors]:
        """Return the quiet and chaotic attractors, and the entries of undecided samples, for the empty cells.

        fractions, deviations: the fitted fractions and their standard deviations, as `_fit_fractions` returns them.

        Returns
        -------
        list[FilledCellAttractors]
            One entry for each of these kinds that a computed cell of the leaf has.
        """
        found = []
        for which, kind in enumerate(SAMPLED_KINDS):
            has = self.evidence.samples[which, self.cell] > 0
            if not (has & self.known).any():
                continue
            share = fractions[:, which]
            rows = np.flatnonzero(share > 0.0) if kind == UNDECIDED else np.arange(share.size)
            state = self._nearest_attractors(kind, has & self.known)[rows]
            zeros, unknown = np.zeros(rows.size, np.int64), np.full(rows.size, np.nan)
            table = Attractors(
                cell=self.cell[self.empty][rows],
                kind=np.full(rows.size, kind),
                m=zeros,
                n_plus=zeros,
                n_minus=zeros,
                samples=share[rows] * self.evidence.cells.sample_count,
                tau=self.evidence.table.tau[state],
                v=self.evidence.table.v[state],
                first=unknown,
                second=unknown,
                error=unknown,
                impacts=zeros,
                watched=unknown,
            )
            found.append(FilledCellAttractors(table, np.full(rows.size, HALF_WIDTH_95 * deviations[which])))
        return found

    def _nearest_attractors(self, kind: int, has_kind: np.ndarray) -> np.ndarray:
        """Return for each empty cell the row in `evidence.table` of the nearest attractor of this kind.

        Parameters
        ----------
        has_kind : np.ndarray
            Flags (n, n) of the computed cells with an attractor of this kind.

        Returns
        -------
        np.ndarray
            Rows (empty cells,).
        """
        there, empty = np.argwhere(has_kind), np.argwhere(self.empty)
        apart = ((empty[:, None] - there) ** 2).sum(axis=2)
        cell = self.cell[has_kind][apart.argmin(axis=1)]
        table = self.evidence.table
        rows = np.flatnonzero(table.kind == kind)
        found: np.ndarray = rows[np.searchsorted(table.cell[rows], cell)]
        return found


def _normalize_fractions(fractions: np.ndarray) -> np.ndarray:
    """Replace negative fractions by 0, and scale the fractions of each cell (cells, fractions) to the sum 1."""
    found = np.maximum(fractions, 0.0)
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _divide_fractions(fraction: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Divide each basin fraction among the orbits that have one label in one cell, in proportion to their weights.

    fraction (k,): the index of the basin fraction that each orbit shares. weight (k,): the number of samples of
    computed cells that go to each orbit's branch; negative if no computed cell has the branch. An orbit with a negative
    weight gets no part if another orbit of the same fraction has a weight of 0 or more. If no orbit of a fraction has a
    positive weight, all orbits that this rule does not exclude get equal parts.

    Returns
    -------
    np.ndarray
        Parts (k,) from 0 to 1; −1 for orbits that get no part.
    """
    if not fraction.size:
        return np.zeros(0)
    named = np.bincount(fraction, weight >= 0.0)[fraction] > 0
    mine = np.where(named, np.maximum(weight, 0.0), 1.0)
    alone = named & (weight < 0.0)
    sums = np.bincount(fraction, mine)[fraction]
    many = np.bincount(fraction, ~alone)[fraction]
    part = np.where(sums > 0.0, mine / np.where(sums > 0.0, sums, 1.0), 1.0 / np.maximum(many, 1.0))
    return np.where(alone, -1.0, part)
