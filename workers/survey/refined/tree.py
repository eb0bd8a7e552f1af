"""Divide leaves (squares of cells) until the cells on their edges agree, and audit a share of the cells to fill."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gear_rattle.workers.survey.crossings import Crossings
from gear_rattle.workers.survey.refined.asked import BLOCK
from gear_rattle.workers.survey.refined.audit import AUDITED, DISAGREED
from gear_rattle.workers.survey.refined.blocks import Blocks, Leaves, Square, cells_together
from gear_rattle.workers.survey.refined.evidence import Evidence
from gear_rattle.workers.survey.refined.rounds import CHAOTIC, KINDS, Round


@dataclass(eq=False)
class Tree:
    """The leaves of a tile.

    evidence: everything known about the tile's cells. passed: two arrays (rows, columns) of flags, which say whether a
    curve passes between a cell of the frame and the next cell along δ (first array) or along ε (second array).
    draws (cells,): a random number for each cell, which decides the round that audits it. rounds: the rounds of audits.
    audit (cells,): 0, AUDITED or DISAGREED. leaf (cells,): KINDS times the number of the last round in which the cell
    was to be filled, plus the kind of the cell's leaf. filled: the leaves to fill.
    """

    evidence: Evidence
    passed: tuple[np.ndarray, np.ndarray]
    draws: np.ndarray
    rounds: Sequence[Round]
    audit: np.ndarray = field(init=False)
    leaf: np.ndarray = field(init=False)
    filled: list[Leaves] = field(init=False, default_factory=list)
    _number: int = field(init=False, default=0)
    _now: Round = field(init=False)
    _chosen: np.ndarray = field(init=False)  # (cells,): flags of the cells to audit in this round

    def __post_init__(self) -> None:
        """Set the arrays of the first round."""
        self.audit, self.leaf = np.zeros((2, self.blocks.n_cells), np.int8)
        self._now = self.rounds[0]
        self._chosen = self.draws < self._now.drawn

    @property
    def blocks(self) -> Blocks:
        """The blocks of the leaves."""
        return self.evidence.blocks

    def grow(self) -> None:
        """Compute the necessary cells, round by round. After that the other cells of the leaves `filled` can be filled.

        The method changes `filled`, `audit` and `leaf`.
        """
        self._refine([self.blocks.whole()])
        for number, (before, now) in enumerate(pairwise(self.rounds), start=1):
            self._now = now  # a round first computes all cells of some leaves, and then audits others
            self._refine(self._judged(self._uniform))
            self._number = number
            self._chosen = (before.drawn <= self.draws) & (self.draws < now.drawn)
            self._refine(self._judged(self._holds))

    def _refine(self, waiting: list[Leaves]) -> None:
        """Compute the edges of leaves, and divide leaves that are not uniform, until no more leaves are divided.

        An orbit that is found late is continued to all cells of its block. A leaf that was uniform may then be uniform
        no longer; such a leaf is divided too.
        """
        while True:
            self._down(waiting)
            if not (waiting := self._judged(self._uniform)):
                break

    def _judged(self, judge: Callable[[Leaves], np.ndarray]) -> list[Leaves]:
        """Keep those leaves of `filled` that pass a test, and return the quarters of the others."""
        kept, others = list[Leaves](), list[Leaves]()
        for leaves in self.filled:
            same = judge(leaves)
            kept.append(leaves.of(same))
            if not same.all():
                others.append(self.blocks.halves(leaves.of(~same)))
        self.filled = [leaves for leaves in kept if leaves.block.size]
        return others

    def _down(self, waiting: list[Leaves]) -> None:
        size = BLOCK
        while size:
            now = [leaves for leaves in waiting if leaves.size == size and leaves.block.size]
            if now:
                leaves = cells_together(now)
                self.evidence.compute(self.blocks.edges(leaves))
                if size > 1:
                    same = self._uniform(leaves)
                    same[same] = self._holds(leaves.of(same))
                    self.filled.append(leaves.of(same))
                    waiting = [*waiting, self.blocks.halves(leaves.of(~same))]
            size //= 2

    def _uniform(self, leaves: Leaves) -> np.ndarray:
        found = self.evidence.uniform(leaves) & ~self._crossed(self.blocks.square(leaves))
        if max(self._now.regular, self._now.chaotic) >= leaves.size:
            limit = np.where(self.evidence.chaotic(leaves), self._now.chaotic, self._now.regular)
            found &= limit < leaves.size
        return found

    def _crossed(self, square: Square) -> np.ndarray:
        cell, inside = self.blocks.cell(square), square.inside
        right, down = (passed.ravel()[cell] for passed in self.passed)
        along_delta = right[:, :, :-1] & inside[:, :, 1:]
        along_epsilon = down[:, :-1] & inside[:, 1:]
        found: np.ndarray = along_delta.any((1, 2)) | along_epsilon.any((1, 2))
        return found

    def _holds(self, leaves: Leaves) -> np.ndarray:
        """Audit the chosen cells of leaves to fill, and return for each leaf whether it is still uniform."""
        square = self.blocks.square(leaves)
        cell = self.blocks.cell(square)
        empty = square.inside & ~self.evidence.known[cell]
        self._note(leaves, cell, empty)
        audited = empty & self._chosen[cell]
        if not audited.any():
            return np.ones(leaves.block.size, bool)
        before = self.evidence.code(square)
        self.evidence.compute(self.blocks.each_once(cell[audited]))
        odd = self.evidence.surprising(square, audited, before)
        self.audit[cell[audited]] = AUDITED
        self.audit[cell[odd]] = DISAGREED
        return self._uniform(leaves)

    def _note(self, leaves: Leaves, cell: np.ndarray, empty: np.ndarray) -> None:
        """Record the kind of the leaf of each cell that is to be filled, unless this round has recorded it before."""
        first = KINDS * self._number
        fresh = empty & (self.leaf[cell] < max(first, 1))
        kind = first + CHAOTIC * self.evidence.chaotic(leaves) + leaves.size.bit_length() - 1
        self.leaf[cell[fresh]] = np.broadcast_to(kind[:, None, None], cell.shape)[fresh]


def passed(blocks: Blocks, crossings: Sequence[Crossings]) -> tuple[np.ndarray, np.ndarray]:
    """Return for each cell of the frame whether a curve passes between it and the next cell along δ, and along ε."""
    rows, columns = blocks.frame
    found = []
    for along in range(2):
        here = np.zeros(blocks.shape, bool)
        for crossing in crossings:
            first, end = np.searchsorted(crossing[along], (rows.start * blocks.grid[1], rows.stop * blocks.grid[1]))
            row, column = np.divmod(crossing[along][first:end], blocks.grid[1])
            inside = (columns.start <= column) & (column < columns.stop)
            here[row[inside] - rows.start, column[inside] - columns.start] = True
        found.append(here)
    return found[0], found[1]
