"""Divide leaves (squares of cells) until the cells on their edges agree, and audit a share of the cells to fill."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gear_rattle.workers.survey.crossings import CurveCrossings
from gear_rattle.workers.survey.refined.asked import BLOCK
from gear_rattle.workers.survey.refined.audit import AUDITED, DISAGREED
from gear_rattle.workers.survey.refined.blocks import Blocks, LeafCells, Leaves, concatenate_leaves
from gear_rattle.workers.survey.refined.evidence import ComputedCells
from gear_rattle.workers.survey.refined.rounds import CHAOTIC, KINDS, AuditRound


@dataclass(eq=False)
class RefinementTree:
    """The leaves (squares of cells) of a tile.

    evidence: the computed cells of the tile. crossed: two arrays (rows, columns) of flags, which say whether a curve
    passes between a cell of the frame (see `Blocks`) and the next cell along δ (first array) or ε (second array).
    random_numbers (cells,): a random number for each cell, which decides the round that audits it. rounds: the rounds
    of audits. audit_findings (cells,): the finding of the audit, 0 (not audited), AUDITED or DISAGREED. leaf_codes
    (cells,): KINDS times the number of the last round in which the cell was to be filled, plus the kind of the cell's
    leaf. leaves_to_fill: the leaves that are not divided further, in which all cells that are not computed will be
    filled.
    """

    evidence: ComputedCells
    crossed: tuple[np.ndarray, np.ndarray]
    random_numbers: np.ndarray
    rounds: Sequence[AuditRound]
    audit_findings: np.ndarray = field(init=False)
    leaf_codes: np.ndarray = field(init=False)
    leaves_to_fill: list[Leaves] = field(init=False, default_factory=list)
    _round_number: int = field(init=False, default=0)
    _current_round: AuditRound = field(init=False)
    _cells_to_audit: np.ndarray = field(init=False)  # (cells,): flags of the cells to audit in this round

    def __post_init__(self) -> None:
        """Fill `audit_findings` and `leaf_codes` with 0, and choose the cells that the first round audits."""
        self.audit_findings, self.leaf_codes = np.zeros((2, self.blocks.n_cells), np.int8)
        self._current_round = self.rounds[0]
        self._cells_to_audit = self.random_numbers < self._current_round.draw_limit

    @property
    def blocks(self) -> Blocks:
        """The blocks of the tile; each block is divided into leaves."""
        return self.evidence.blocks

    def compute_cells(self) -> None:
        """Compute cells and divide leaves, round by round, until the leaves in `leaves_to_fill` can be filled.

        The method changes `leaves_to_fill`, `audit_findings` and `leaf_codes`.
        """
        self._divide_until_uniform([self.blocks.undivided_leaves()])
        for number, (before, now) in enumerate(pairwise(self.rounds), start=1):
            # From here on `_are_leaves_uniform` returns False for leaves of which this round computes all cells.
            self._current_round = now
            self._divide_until_uniform(self._divide_failing_leaves(self._are_leaves_uniform))
            self._round_number = number
            self._cells_to_audit = (before.draw_limit <= self.random_numbers) & (self.random_numbers < now.draw_limit)
            self._divide_until_uniform(self._divide_failing_leaves(self._audit_leaves))

    def _divide_until_uniform(self, waiting: list[Leaves]) -> None:
        """Compute the edge cells of new leaves, and divide leaves until all leaves in `leaves_to_fill` are uniform.

        waiting: the new leaves, whose edge cells may not be computed yet. A new orbit is continued to all cells of its
        block. Therefore a leaf that was found uniform may later have cells that differ; such a leaf is divided too.
        """
        while True:
            self._compute_and_divide_leaves(waiting)
            if not (waiting := self._divide_failing_leaves(self._are_leaves_uniform)):
                break

    def _divide_failing_leaves(self, judge: Callable[[Leaves], np.ndarray]) -> list[Leaves]:
        """Keep the leaves of `leaves_to_fill` that pass the test `judge`; return the quarters of all other leaves."""
        kept, others = list[Leaves](), list[Leaves]()
        for leaves in self.leaves_to_fill:
            same = judge(leaves)
            kept.append(leaves.select(same))
            if not same.all():
                others.append(self.blocks.divide_leaves(leaves.select(~same)))
        self.leaves_to_fill = [leaves for leaves in kept if leaves.block.size]
        return others

    def _compute_and_divide_leaves(self, waiting: list[Leaves]) -> None:
        """Compute the edge cells of new leaves, from the largest leaves to the smallest.

        Leaves that are uniform and pass the audit are added to `leaves_to_fill`; the other leaves are divided. waiting:
        the new leaves, whose edge cells may not be computed yet.
        """
        size = BLOCK
        while size:
            now = [leaves for leaves in waiting if leaves.size == size and leaves.block.size]
            if now:
                leaves = concatenate_leaves(now)
                self.evidence.compute(self.blocks.edge_cells(leaves))
                if size > 1:
                    same = self._are_leaves_uniform(leaves)
                    same[same] = self._audit_leaves(leaves.select(same))
                    self.leaves_to_fill.append(leaves.select(same))
                    waiting = [*waiting, self.blocks.divide_leaves(leaves.select(~same))]
            size //= 2

    def _are_leaves_uniform(self, leaves: Leaves) -> np.ndarray:
        """Return for each leaf whether its computed cells agree and no curve crosses it.

        Returns
        -------
        np.ndarray
            Flags (k,); False also for a leaf of which this round computes all cells.
        """
        found = self.evidence.are_leaves_uniform(leaves) & ~self._are_crossed_by_curves(
            self.blocks.cells_of_leaves(leaves)
        )
        if max(self._current_round.regular_leaf_size, self._current_round.chaotic_leaf_size) >= leaves.size:
            limit = np.where(
                self.evidence.flag_leaves_with_chaos(leaves),
                self._current_round.chaotic_leaf_size,
                self._current_round.regular_leaf_size,
            )
            found &= limit < leaves.size
        return found

    def _are_crossed_by_curves(self, square: LeafCells) -> np.ndarray:
        """Return for each leaf whether a curve passes between two of its cells."""
        cell, inside = self.blocks.cell_numbers(square), square.inside
        right, down = (crossed.ravel()[cell] for crossed in self.crossed)
        along_delta = right[:, :, :-1] & inside[:, :, 1:]
        along_epsilon = down[:, :-1] & inside[:, 1:]
        found: np.ndarray = along_delta.any((1, 2)) | along_epsilon.any((1, 2))
        return found

    def _audit_leaves(self, leaves: Leaves) -> np.ndarray:
        """Compute the cells of leaves audited in this round. Return for each leaf (k,) whether it is still uniform."""
        square = self.blocks.cells_of_leaves(leaves)
        cell = self.blocks.cell_numbers(square)
        empty = square.inside & ~self.evidence.is_computed[cell]
        self._record_leaf_kinds(leaves, cell, empty)
        audited = empty & self._cells_to_audit[cell]
        if not audited.any():
            return np.ones(leaves.block.size, bool)
        before = self.evidence.label_hashes(square)
        self.evidence.compute(self.blocks.sort_without_repetitions(cell[audited]))
        odd = self.evidence.flag_disagreeing_cells(square, audited, before)
        self.audit_findings[cell[audited]] = AUDITED
        self.audit_findings[cell[odd]] = DISAGREED
        return self._are_leaves_uniform(leaves)

    def _record_leaf_kinds(self, leaves: Leaves, cell: np.ndarray, empty: np.ndarray) -> None:
        """Write the codes of `self.leaf_codes` (round and kind of leaf) for the cells of leaves to be filled.

        A cell keeps the first code that it gets in a round. cell: the numbers of the leaves' cells. empty: flags of the
        cells that are not computed, and so are to be filled.
        """
        first = KINDS * self._round_number
        fresh = empty & (self.leaf_codes[cell] < max(first, 1))
        kind = first + CHAOTIC * self.evidence.flag_leaves_with_chaos(leaves) + leaves.size.bit_length() - 1
        self.leaf_codes[cell[fresh]] = np.broadcast_to(kind[:, None, None], cell.shape)[fresh]


def crossed_edges(blocks: Blocks, crossings: Sequence[CurveCrossings]) -> tuple[np.ndarray, np.ndarray]:
    """Return where curves pass between neighbouring cells of the frame (see `Blocks`).

    Returns
    -------
    tuple[np.ndarray, np.ndarray]
        Flags (rows, columns): a curve passes between the cell and the next cell along δ; the same along ε.
    """
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
