"""Compute the variables of a refined tile: computed cells have their own values, other cells have filled values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.crossings import CurveCrossings
from gear_rattle.workers.survey.refined.audit import random_numbers_of_cells
from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import ComputedCells
from gear_rattle.workers.survey.refined.rounds import AuditRound
from gear_rattle.workers.survey.refined.shares import fill_leaves
from gear_rattle.workers.survey.refined.tree import RefinementTree, crossed_edges
from gear_rattle.workers.survey.values.cells import Cells
from gear_rattle.workers.survey.values.evaluate import arrange_in_slots, kind_fraction_evaluator
from gear_rattle.workers.survey.values.schema import SAMPLED, Group, Quantity
from rattle import Attractors, wilson_interval
from rattle.attractors import CHAOTIC, QUIET
from rattle.families import argsort_attractors, concat_tables

#: Variables that are computed from the trajectory of a chaotic attractor, which a filled cell does not have.
TRAJECTORY_VARIABLES = ("lyapunov_max", "sum_rule_error", "impulse_balance_error")


@dataclass(frozen=True, eq=False)
class RefinedCells(Cells):
    """The cells of a refined tile, computed or filled.

    table: the attractors of all cells, row by row. added_width (attractors,): the uncertainty that filling adds to each
    basin fraction (see `FilledCellAttractors`), 0 in a computed cell. regions, source_level, audit, audit_leaf: the
    values of the stored variables region, source_level, audit and audit_leaf.
    """

    table: Attractors = None  # type: ignore[assignment]  # a field after fields with defaults needs a default
    added_width: np.ndarray = None  # type: ignore[assignment]
    regions: np.ndarray = None  # type: ignore[assignment]
    source_level: np.ndarray = None  # type: ignore[assignment]
    audit: np.ndarray = None  # type: ignore[assignment]
    audit_leaf: np.ndarray = None  # type: ignore[assignment]

    @cached_property
    def attractors(self) -> Attractors:
        """The attractors of all cells, row by row."""
        return self.table

    @cached_property
    def region(self) -> np.ndarray:
        """The regions of all cells. A filled cell has the region of the computed cells around it."""
        return self.regions

    @property
    def filled_cell_flags(self) -> np.ndarray:
        """Flags of the cells that were not computed."""
        found: np.ndarray = self.source_level > 0
        return found

    def values_of(self, quantity: Quantity) -> np.ndarray:
        """Return the values of a variable in all cells.

        The upper ends of basin fractions, and the half-widths of the quiet fraction (`fraction_error`), include the
        uncertainty that filling adds. TRAJECTORY_VARIABLES are NaN in filled cells with a chaotic attractor.

        Returns
        -------
        np.ndarray
            Shape (…, n_epsilon, n_delta).
        """
        if quantity.name == "attractor_fraction_upper":
            return arrange_in_slots(
                self, np.minimum(self._fraction_upper_bound + self.added_width, 1.0), np.nan, quantity.dtype
            )
        if quantity.name == "fraction_error":
            return self._fraction_error
        if quantity.name in TRAJECTORY_VARIABLES:
            values = np.asarray(quantity.evaluate(self._cells_with_trajectories))
            return np.where(self._cells_with_unfollowed_chaos, np.nan, values)
        return np.asarray(quantity.evaluate(self))

    @cached_property
    def _fraction_upper_bound(self) -> np.ndarray:
        """Upper end of the 95 % Wilson interval of each basin fraction, without the uncertainty that filling adds."""
        return wilson_interval(self.table.samples, self.sample_count)[1]

    @cached_property
    def _fraction_error(self) -> np.ndarray:
        """Half the width of the 95 % interval of each cell's quiet fraction, with the uncertainty that filling adds."""
        won = kind_fraction_evaluator("quiet")(self) * self.sample_count
        low, high = wilson_interval(
            np.where(self.filled_cell_flags, np.minimum(won, self.sample_count), np.rint(won)), self.sample_count
        )
        quiet = self.table.kind == QUIET
        added = np.bincount(self.table.cell[quiet], self.added_width[quiet], self.source_level.size).reshape(self.shape)
        return (high - low) / 2 + added

    @cached_property
    def _attractors_without_trajectory(self) -> np.ndarray:
        """Flags (attractors,) of attractors without a computed trajectory: the chaotic attractors of filled cells."""
        found: np.ndarray = self.filled_cell_flags.ravel()[self.table.cell] & (self.table.kind == CHAOTIC)
        return found

    @cached_property
    def _cells_with_unfollowed_chaos(self) -> np.ndarray:
        """Flags (n_epsilon, n_delta) of filled cells with a chaotic attractor, for which no trajectory was computed."""
        cells = self.table.cell[self._attractors_without_trajectory]
        return np.bincount(cells, minlength=self.source_level.size).reshape(self.shape) > 0

    @cached_property
    def _cells_with_trajectories(self) -> RefinedCells:
        """A copy of these cells without the chaotic attractors of filled cells, which have no computed trajectory."""
        rows = ~self._attractors_without_trajectory
        return replace(self, table=self.table.take(rows), added_width=self.added_width[rows])


class FillingPlan(NamedTuple):
    """Options for refining a tile.

    rounds: the rounds of audits. quantities: the requested groups of variables, which decide whether regions or
    attractors of cells are compared. crossings: for each bifurcation curve, the pairs of cells between which the curve
    passes. seed: the seed of the random numbers that choose the audited cells.
    """

    rounds: Sequence[AuditRound]
    quantities: tuple[Group, ...]
    crossings: Sequence[CurveCrossings]
    seed: int


def refine_cells(whole: Cells, rows: slice, columns: slice, plan: FillingPlan) -> RefinedCells:
    """Refine the cells rows × columns of the grid `whole`: compute some cells, and fill the others.

    The values of a cell depend only on its block, and not on the tile.

    Returns
    -------
    RefinedCells
        The cells, computed or filled.
    """
    blocks = Blocks(rows, columns, whole.shape)
    frame = replace(whole, epsilon=whole.epsilon[blocks.frame[0]], delta=whole.delta[blocks.frame[1]])
    compares_attractors = bool(SAMPLED.intersection(plan.quantities))
    evidence = ComputedCells(blocks, frame, compares_attractors, Group.REGION in plan.quantities)
    tree = RefinementTree(
        evidence, crossed_edges(blocks, plan.crossings), random_numbers_of_cells(blocks, plan.seed), plan.rounds
    )
    tree.compute_cells()
    level, added_width, table = np.zeros(blocks.n_cells, np.int8), np.zeros(evidence.table.cell.size), evidence.table
    for leaves in tree.leaves_to_fill:
        square = blocks.cells_of_leaves(leaves)
        cell = blocks.cell_numbers(square)
        empty = square.inside & ~evidence.is_computed[cell]
        level[cell[empty]] = leaves.size.bit_length() - 1
        evidence.region[cell[empty]] = np.broadcast_to(evidence.region[cell[:, :1, :1]], cell.shape)[empty]
        if compares_attractors:
            more = fill_leaves(evidence, leaves)
            table, added_width = concat_tables(table, more.table), np.append(added_width, more.added_width)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    row, column = np.divmod(table.cell, blocks.shape[1])
    mine = (row < height) & (column < width)
    table = table.replace(cell=row * width + column)
    order = np.flatnonzero(mine)[argsort_attractors(table.take(mine))]

    def remove_added_edges(values: np.ndarray) -> np.ndarray:
        """Return values of the frame's cells as a plane (rows, columns) without the frame's added row and column."""
        return values.reshape(blocks.shape)[:height, :width]

    return RefinedCells(
        **{name: getattr(whole, name) for name in Cells.__dataclass_fields__}
        | {
            "delta": whole.delta[columns],
            "epsilon": whole.epsilon[rows],
        },
        table=table.take(order),
        added_width=added_width[order],
        regions=remove_added_edges(evidence.region),
        source_level=remove_added_edges(level),
        audit=remove_added_edges(tree.audit_findings),
        audit_leaf=remove_added_edges(tree.leaf_codes),
    )
