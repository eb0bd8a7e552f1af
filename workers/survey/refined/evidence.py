"""What is known of the cells of a tile while it is refined: their regions, samples, and the orbits that exist."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import rattle
from rattle import Attractors
from rattle.attractors.table import CHAOTIC, PERIODIC, QUIET, UNDECIDED
from rattle.families.join import continued, in_order, together
from rattle.families.pieces import no_attractors
from rattle.families.spread import Linked, Rectangle
from workers.survey.refined.asked import BLOCK
from workers.survey.refined.blocks import Blocks, Leaves, Square
from workers.survey.values.cells import Cells

#: What samples go to that has no orbit which could be continued.
SEEN = (QUIET, CHAOTIC, UNDECIDED)
FEW = 12  # samples: where one cell has none and another so many, they differ
SURELY = 1e-3  # how seldom a cell's samples miss by chance what others have


class Existing(NamedTuple):
    """The stable periodic orbits that exist in a block: continued from its computed cells into all of it.

    orbits, n: as `continued` returns them. known: those that the samples of their cell know, the first ones. samples
    (known,): that go to them. code (rows, columns): equal where the same labels exist.
    """

    orbits: Linked
    n: int
    samples: np.ndarray
    code: np.ndarray

    @property
    def known(self) -> int:
        """Orbits that the samples of their cell know."""
        return self.samples.size


class Evidence:
    """Cells of the frame of some blocks, computed when they are asked for.

    cells: of the frame. sampled: whether attractors are compared; regions: whether regions are.
    """

    def __init__(self, blocks: Blocks, cells: Cells, sampled: bool, regions: bool) -> None:
        self.blocks, self.cells = blocks, cells
        self.sampled, self.regions = sampled, regions
        n = blocks.n_cells
        self.known = np.zeros(n, bool)
        self.region = np.zeros(n, np.int8)
        self.samples = np.zeros((len(SEEN), n))
        self.table = no_attractors()
        self.existing: dict[int, Existing] = {}
        self._code = np.zeros((blocks.corners[0].size, BLOCK + 1, BLOCK + 1), np.uint64)

    def compute(self, cells: np.ndarray) -> None:
        """Compute those of some cells that are not, and what exists in the blocks that they are inside of."""
        cells = cells[~self.known[cells]]
        if not cells.size:
            return
        row, column = np.divmod(cells, self.blocks.shape[1])
        delta, epsilon = self.cells.delta[column], self.cells.epsilon[row]
        model, own = self.cells.model, self.cells
        self.known[cells] = True
        if self.regions:
            self.region[cells] = rattle.classify_regions(model.period_one(delta, epsilon))
        if not self.sampled:
            return
        sample = own.count, own.v_max, own.seed, own.budget, own.tau, own.v_min
        found = model.attractors_of(delta, epsilon, *sample)
        found = found._replace(cell=cells[found.cell])
        for which, kind in enumerate(SEEN):
            np.add.at(self.samples[which], found.cell[found.kind == kind], found.samples[found.kind == kind])
        table = together(self.table, found)
        order = in_order(table)
        self.table = Attractors._make(x[order] for x in table)
        self._continue(np.unique(found.cell[found.kind == PERIODIC]))

    def _continue(self, cells: np.ndarray) -> None:
        """Continue the orbits of the blocks that have these cells in all of them."""
        columns = self.blocks.shape[1]
        row, column = np.divmod(cells, columns)
        periodic = Attractors._make(x[self.table.kind == PERIODIC] for x in self.table)
        its_row, its_column = np.divmod(periodic.cell, columns)
        for block, corner in enumerate(zip(*self.blocks.corners, *self.blocks.last, strict=True)):
            top, left, height, width = (int(x) for x in corner)
            if not ((top <= row) & (row <= top + height) & (left <= column) & (column <= left + width)).any():
                continue
            here = (top <= its_row) & (its_row <= top + height) & (left <= its_column) & (its_column <= left + width)
            mine = Attractors._make(x[here] for x in periodic)
            mine = mine._replace(cell=(its_row[here] - top) * (width + 1) + its_column[here] - left)
            self._set(block, mine, (height + 1, width + 1), self._plane(top, left, height, width))

    def _plane(self, top: int, left: int, height: int, width: int) -> Any:
        delta, epsilon = self.cells.delta, self.cells.epsilon
        return self.cells.model.cells(delta[left : left + width + 1], epsilon[top : top + height + 1])

    def _set(self, block: int, table: Attractors, shape: tuple[int, int], cells: Any) -> None:
        orbits, n = continued(table, shape[1], Rectangle(0, shape[0], 0, shape[1]), cells)
        code = np.zeros(shape[0] * shape[1], np.uint64)
        label = (x[:n].astype(np.uint64) for x in (orbits.m, orbits.n_plus, orbits.n_minus))
        mixed = np.zeros(n, np.uint64)
        for part in label:
            mixed = scrambled(mixed + part)
        np.add.at(code, orbits.cell[:n], mixed)
        self.existing[block] = Existing(orbits, n, table.samples, code.reshape(shape))
        self._code[block, : shape[0], : shape[1]] = code.reshape(shape)

    def code(self, square: Square) -> np.ndarray:
        """Numbers that are equal where the same orbits exist, in cells of one block."""
        found: np.ndarray = self._code[square.block, square.row, square.column]
        return found

    def uniform(self, leaves: Leaves) -> np.ndarray:
        """Whether the same is known to exist in all cells of leaves (k,), whatever the share of the samples."""
        square = self.blocks.square(leaves)
        cell = self.blocks.cell(square)
        known = square.inside & self.known[cell]
        region = self.region[cell]
        inner = (1, 2)
        same = region.max(inner, where=known, initial=-1) == region.min(inner, where=known, initial=127)
        if self.sampled:
            code = self.code(square)
            same &= ((code == code[:, :1, :1]) | ~square.inside).all(inner)
            same &= ~differ(self.samples[:, cell], known, self.cells.count).any(0)
        return same

    def surprising(self, square: Square, audited: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Which audited cells of leaves have something else than the edges of their leaf tell.

        before: the code of the cells when only the edges were known.
        """
        cell = self.blocks.cell(square)
        edge = square.inside & self.known[cell] & ~audited
        inner = (1, 2)
        region = self.region[cell]
        odd = region != region.max(inner, where=edge, initial=-1)[:, None, None]
        if self.sampled:
            odd |= self.code(square) != before
            seen = self.samples[:, cell]
            share = (seen * edge).sum((2, 3)) / (edge.sum(inner) * self.cells.count)
            share = share[:, :, None, None]
            missed = (1.0 - share) ** self.cells.count < SURELY
            odd |= ((seen > 0) & (share == 0.0) | (seen == 0) & missed).any(0)
        return odd & audited


def differ(seen: np.ndarray, known: np.ndarray, count: int) -> np.ndarray:
    """Whether cells of leaves differ in whether they have something at all, beyond what samples miss by chance.

    seen (…, k, n, n): samples that go to it; known (k, n, n): the cells that were sampled. A cell without any differs
    from one with FEW; and cells without any are too many if so many are not expected of a share that all have.
    """
    inner = (-2, -1)
    seen, cells = seen * known, known.sum(inner)
    none = ((seen == 0) & known).sum(inner)
    share = seen.sum(inner) / (np.maximum(cells, 1) * count)
    expected = cells * (1.0 - share) ** count
    most = seen.max(inner)
    too_many = none > expected + 3.0 * np.sqrt(expected) + 1.0
    found: np.ndarray = (share > 0.0) & (none > 0) & (too_many | (most >= min(FEW, count)))
    return found


def scrambled(number: np.ndarray) -> np.ndarray:
    """Other 64 bits for each, in which none tells of another (splitmix64)."""
    x = number + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    found: np.ndarray = x ^ (x >> np.uint64(31))
    return found
