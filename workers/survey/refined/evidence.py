"""Collect the regions, samples and continued orbits of a tile's cells while the tile is refined."""

from __future__ import annotations

import numpy as np

import rattle
from gear_rattle.workers.survey.refined.asked import BLOCK
from gear_rattle.workers.survey.refined.blocks import Blocks, LeafCells, Leaves
from gear_rattle.workers.survey.values.cells import Cells
from rattle import Attractors
from rattle.attractors import CHAOTIC, PERIODIC, QUIET, UNDECIDED
from rattle.families import GridPiece, argsort_attractors, concat_tables, no_attractors

#: Kinds of motion (undecided counts as one) that only samples show, because continuation follows periodic orbits only.
SAMPLED_KINDS = (QUIET, CHAOTIC, UNDECIDED)
#: Two cells certainly differ if at least this many samples of one cell, and no sample of the other, go to a motion.
CERTAIN_SAMPLES = 12
#: Closed forms are computed for at most this many cells at once, sorted by column, because a column shares constants.
CELLS_AT_ONCE = 65_536
#: The samples of an audited cell may by chance miss a motion that the edges of the cell's leaf have. The cell counts as
#: wrong because of a missing motion only if the probability of missing it by chance is below CHANCE_LIMIT.
CHANCE_LIMIT = 1e-3


class ComputedCells:
    """The computed cells of a frame (see `Blocks`). They decide which leaves are divided. `compute` adds cells.

    compares_attractors: whether cells are sampled; two cells with different attractors then count as different.
    compares_regions: whether regions are computed; two cells in different regions then count as different.
    """

    def __init__(self, blocks: Blocks, cells: Cells, compares_attractors: bool, compares_regions: bool) -> None:
        self.blocks, self.cells = blocks, cells
        self.compares_attractors, self.compares_regions = compares_attractors, compares_regions
        n = blocks.n_cells
        self.is_computed = np.zeros(n, bool)
        self.region = np.zeros(n, np.int8)
        self.samples = np.zeros((len(SAMPLED_KINDS), n))
        self.table = no_attractors()
        self.orbits_by_block: dict[
            int, GridPiece
        ] = {}  # {number of a block: its periodic orbits, continued to all cells}
        self._code = np.zeros((blocks.block_origins[0].size, BLOCK + 1, BLOCK + 1), np.uint64)

    def compute(self, cells: np.ndarray) -> None:
        """Compute cells, except cells computed earlier, and continue their orbits to all cells of their blocks.

        cells: the numbers of the cells.
        """
        cells = cells[~self.is_computed[cells]]
        if not cells.size:
            return
        row, column = np.divmod(cells, self.blocks.shape[1])
        delta, epsilon = self.cells.delta[column], self.cells.epsilon[row]
        model, own = self.cells.model, self.cells
        self.is_computed[cells] = True
        if self.compares_regions:
            for part in np.array_split(np.argsort(column, kind="stable"), 1 + cells.size // CELLS_AT_ONCE):
                self.region[cells[part]] = rattle.classify_regions(model.period_one(delta[part], epsilon[part]))
        if not self.compares_attractors:
            return
        found = model.attractors_of(delta, epsilon, own.sample_spec)
        found = found.replace(cell=cells[found.cell])
        for which, kind in enumerate(SAMPLED_KINDS):
            np.add.at(self.samples[which], found.cell[found.kind == kind], found.samples[found.kind == kind])
        table = concat_tables(self.table, found)
        order = argsort_attractors(table)
        self.table = table.take(order)
        self._continue_orbits(found.take(found.kind == PERIODIC))

    def _continue_orbits(self, periodic: Attractors) -> None:
        """Continue the periodic orbits of computed cells to all cells of their blocks."""
        row, column = np.divmod(periodic.cell, self.blocks.shape[1])
        for block, corner in enumerate(zip(*self.blocks.block_origins, *self.blocks.last_indices, strict=True)):
            top, left, height, width = (int(x) for x in corner)
            here = (top <= row) & (row <= top + height) & (left <= column) & (column <= left + width)
            if not here.any():
                continue
            mine = periodic.take(here)
            mine = mine.replace(cell=(row[here] - top) * (width + 1) + column[here] - left)
            piece = self.orbits_by_block.get(block) or self._create_empty_grid_piece(top, left, height, width)
            piece.add_attractors(mine)
            self.orbits_by_block[block] = piece
            self._code[block, : height + 1, : width + 1] = hash_labels_of_cells(piece)

    def _create_empty_grid_piece(self, top: int, left: int, height: int, width: int) -> GridPiece:
        delta, epsilon = self.cells.delta, self.cells.epsilon
        cells = self.cells.model.cells_for_orbit_kernels(
            delta[left : left + width + 1], epsilon[top : top + height + 1]
        )
        return GridPiece((height + 1, width + 1), cells)

    def label_hashes(self, square: LeafCells) -> np.ndarray:
        """Return a number for each cell; cells of a block have the same number if their orbits have the same labels."""
        found: np.ndarray = self._code[square.block, square.row, square.column]
        return found

    def are_leaves_uniform(self, leaves: Leaves) -> np.ndarray:
        """Return for each leaf (k,) whether its computed cells have the same motions. Basin fractions may differ."""
        square = self.blocks.cells_of_leaves(leaves)
        cell = self.blocks.cell_numbers(square)
        known = square.inside & self.is_computed[cell]
        region = self.region[cell]
        inner = (1, 2)
        same = region.max(inner, where=known, initial=-1) == region.min(inner, where=known, initial=127)
        if self.compares_attractors:
            code = self.label_hashes(square)
            same &= ((code == code[:, :1, :1]) | ~square.inside).all(inner)
            same &= ~flag_leaves_with_differing_cells(self.samples[:, cell], known, self.cells.sample_count).any(0)
        return same

    def flag_leaves_with_chaos(self, leaves: Leaves) -> np.ndarray:
        """Return for each leaf (k,) whether a computed cell has chaotic or undecided samples."""
        if not self.compares_attractors:
            return np.zeros(leaves.block.size, bool)
        square = self.blocks.cells_of_leaves(leaves)
        cell = self.blocks.cell_numbers(square)
        wild = (self.samples[SAMPLED_KINDS.index(CHAOTIC)] > 0) | (self.samples[SAMPLED_KINDS.index(UNDECIDED)] > 0)
        found: np.ndarray = (square.inside & wild[cell]).any((1, 2))
        return found

    def flag_disagreeing_cells(self, square: LeafCells, audited: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return flags of the audited cells whose motions differ from the motions on the edges of their leaf.

        Parameters
        ----------
        square : LeafCells
            The cells of the leaves.
        audited : np.ndarray
            Flags of the audited cells, in the shape of the square.
        before : np.ndarray
            The codes that `label_hashes` returned before the audit. They change if the audit finds further orbits.

        Returns
        -------
        np.ndarray
            Flags in the shape of the square.
        """
        cell = self.blocks.cell_numbers(square)
        edge = square.inside & self.is_computed[cell] & ~audited
        inner = (1, 2)
        region = self.region[cell]
        odd = region != region.max(inner, where=edge, initial=-1)[:, None, None]
        if self.compares_attractors:
            odd |= self.label_hashes(square) != before
            seen = self.samples[:, cell]
            share = (seen * edge).sum((2, 3)) / (edge.sum(inner) * self.cells.sample_count)
            share = share[:, :, None, None]
            missed = (1.0 - share) ** self.cells.sample_count < CHANCE_LIMIT
            odd |= ((seen > 0) & (share == 0.0) | (seen == 0) & missed).any(0)
        return odd & audited


def flag_leaves_with_differing_cells(samples: np.ndarray, known: np.ndarray, count: int) -> np.ndarray:
    """Return for each leaf (k,) whether only some of its cells have a motion.

    samples (…, k, n, n): how many samples of each cell go to the motion. known (k, n, n): flags of the sampled cells.
    count: the number of samples of a cell. If no sample of a cell goes to the motion, the cell lacks the motion, or its
    samples miss the motion by chance. The flag of a leaf with such cells is set if at least CERTAIN_SAMPLES samples (or
    all samples) of another cell go to the motion, or if more cells lack it than is likely with equal basin fractions.

    Returns
    -------
    np.ndarray
        Flags, shape (…, k).
    """
    inner = (-2, -1)
    seen, cells = samples * known, known.sum(inner)
    none = ((seen == 0) & known).sum(inner)
    share = seen.sum(inner) / (np.maximum(cells, 1) * count)
    expected = cells * (1.0 - share) ** count
    most = seen.max(inner)
    too_many = none > expected + 3.0 * np.sqrt(expected) + 1.0
    found: np.ndarray = (share > 0.0) & (none > 0) & (too_many | (most >= min(CERTAIN_SAMPLES, count)))
    return found


def hash_labels_of_cells(piece: GridPiece) -> np.ndarray:
    """Return a number for each cell (rows, columns); it is the same for cells whose orbits have the same labels."""
    found, orbits, n = np.zeros(piece.shape, np.uint64), piece.orbits, piece.n
    mixed = np.zeros(n, np.uint64)
    for part in (orbits.m, orbits.n_plus, orbits.n_minus):
        mixed = splitmix64(mixed + part[:n].astype(np.uint64))
    np.add.at(found.reshape(-1), orbits.cell[:n], mixed)
    return found


def splitmix64(number: np.ndarray) -> np.ndarray:
    """Return 64 pseudo-random bits for each number, by the function splitmix64."""
    x = number + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    found: np.ndarray = x ^ (x >> np.uint64(31))
    return found
