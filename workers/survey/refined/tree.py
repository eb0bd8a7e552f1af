"""Leaves are halved until what is known on their edges is uniform, and a share of what is then filled is audited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from workers.survey.crossings import Crossings
from workers.survey.refined.asked import BLOCK
from workers.survey.refined.audit import AUDITED, DISAGREED
from workers.survey.refined.blocks import Blocks, Leaves, Square, together
from workers.survey.refined.evidence import Evidence


@dataclass(eq=False)
class Tree:
    """The leaves of a tile.

    passed (rows, columns), twice: whether a curve passes between a cell of the frame and the next one along δ, along ε.
    chosen (cells,): the cells that are audited when they are to be filled.
    """

    evidence: Evidence
    passed: tuple[np.ndarray, np.ndarray]
    chosen: np.ndarray
    audit: np.ndarray = field(init=False)
    filled: list[Leaves] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.audit = np.zeros(self.blocks.n_cells, np.int8)

    @property
    def blocks(self) -> Blocks:
        """Of these leaves."""
        return self.evidence.blocks

    def grow(self) -> None:
        """Compute what has to be; `filled` has the leaves whose other cells can be filled.

        An orbit that is found late may end in a leaf that was uniform before: then that one is halved too.
        """
        waiting = [self.blocks.whole()]
        while waiting:
            self._down(waiting)
            waiting = []
            kept: list[Leaves] = []
            for leaves in self.filled:
                same = self._uniform(leaves)
                kept.append(leaves.of(same))
                if not same.all():
                    waiting.append(self.blocks.halves(leaves.of(~same)))
            self.filled = [leaves for leaves in kept if leaves.block.size]

    def _down(self, waiting: list[Leaves]) -> None:
        size = BLOCK
        while size:
            now = [leaves for leaves in waiting if leaves.size == size and leaves.block.size]
            if now:
                leaves = together(now)
                self.evidence.compute(self.blocks.edges(leaves))
                if size > 1:
                    same = self._uniform(leaves)
                    same[same] = self._holds(leaves.of(same))
                    self.filled.append(leaves.of(same))
                    waiting = [*waiting, self.blocks.halves(leaves.of(~same))]
            size //= 2

    def _uniform(self, leaves: Leaves) -> np.ndarray:
        return self.evidence.uniform(leaves) & ~self._crossed(self.blocks.square(leaves))

    def _crossed(self, square: Square) -> np.ndarray:
        cell, inside = self.blocks.cell(square), square.inside
        right, down = (passed.ravel()[cell] for passed in self.passed)
        along_delta = right[:, :, :-1] & inside[:, :, 1:]
        along_epsilon = down[:, :-1] & inside[:, 1:]
        found: np.ndarray = along_delta.any((1, 2)) | along_epsilon.any((1, 2))
        return found

    def _holds(self, leaves: Leaves) -> np.ndarray:
        """Audit leaves that are to be filled: whether they are uniform still."""
        square = self.blocks.square(leaves)
        cell = self.blocks.cell(square)
        audited = square.inside & self.chosen[cell] & ~self.evidence.known[cell]
        if not audited.any():
            return np.ones(leaves.block.size, bool)
        before = self.evidence.code(square)
        self.evidence.compute(self.blocks.each_once(cell[audited]))
        odd = self.evidence.surprising(square, audited, before)
        self.audit[cell[audited]] = AUDITED
        self.audit[cell[odd]] = DISAGREED
        return self._uniform(leaves)


def passed(blocks: Blocks, crossings: Sequence[Crossings]) -> tuple[np.ndarray, np.ndarray]:
    """Whether one of the curves passes between a cell of the frame and the next one, along δ and along ε."""
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
