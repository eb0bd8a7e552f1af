"""A block of cells of the (δ, ε) plane, and what the model says about it."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import rattle
from rattle.attractors import SampleSpec, SpeedLimit
from rattle.intensity import Intensities
from rattle.models import Model

GRAZING_CURVES = ("G1", "G2")
AUDIT = ("not_audited", "agreed", "disagreed")
BASIN_RESOLUTION = 100  # cells a side of the (τ, v) plane, in boxes of 5 × 5 for the entropy


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells `epsilon` × `delta`; what is asked of them is evaluated once, when first asked for.

    No cell knows its block: every value follows from (δ, ε), the model and, for attractors, the sample's count, box and
    seed, so the same cell holds the same bits in any block.
    """

    delta: np.ndarray  # (n_delta,)
    epsilon: np.ndarray  # (n_epsilon,)
    model: Model
    sample: SampleSpec
    is_sampled: bool  # whether attractors are asked for
    slots: int  # attractors that are listed

    @property
    def count(self) -> int:
        """Initial conditions per cell, 0 where no attractors are asked for."""
        return self.sample.count if self.is_sampled else 0

    @property
    def v_max(self) -> SpeedLimit:
        """The largest speed of the sample."""
        return self.sample.v_max

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along (epsilon, delta)."""
        return len(self.epsilon), len(self.delta)

    @property
    def source_level(self) -> np.ndarray:
        """How coarse the computation was that each cell has its values from, 0 where it is its own."""
        return np.zeros(self.shape, np.int8)

    @property
    def audit(self) -> np.ndarray:
        """Findings of the audit for each filled cell: codes of `AUDIT`."""
        return np.zeros(self.shape, np.int8)

    @property
    def audit_leaf(self) -> np.ndarray:
        """Round of audits and kind of leaf of each cell that was to be filled."""
        return np.zeros(self.shape, np.int8)

    def one(self, i: int, j: int) -> "Cells":
        """Return the cell at (i_epsilon, i_delta), with nothing evaluated."""
        return replace(self, delta=self.delta[j : j + 1], epsilon=self.epsilon[i : i + 1])

    @cached_property
    def region(self) -> np.ndarray:
        """Regions I to V as int8, shape (n_epsilon, n_delta)."""
        return rattle.classify_regions(self.period_one)

    @cached_property
    def period_one(self) -> rattle.PeriodOne:
        """The orbits A to D; shapes end in (n_epsilon, n_delta)."""
        return self.model.period_one(self.delta, self.epsilon[:, None])

    @cached_property
    def attractors(self) -> rattle.Attractors:
        """The attractors of all cells, row by row: each cell's are those of the gear at its point, to the bit."""
        return self.model.attractors_of(self.delta, self.epsilon[:, None], self.sample)

    @cached_property
    def intensities(self) -> Intensities:
        """How hard these attractors rattle, row by row."""
        return self.model.intensities_of(self.delta, self.epsilon[:, None], self.attractors)

    @cached_property
    def sampled_speed(self) -> np.ndarray:
        """The largest speed of the sample, shape (n_epsilon, n_delta)."""
        return self.sample.highest(self.model.at(self.delta, self.epsilon[:, None]))

    @cached_property
    def boundary_distance(self) -> rattle.BoundaryDistance:
        """Least speeds from which quiet motion is lost, with phases, shapes (n_epsilon, n_delta)."""
        return rattle.boundary_distances(self.delta, self.epsilon[:, None], self.model.beta, self.v_max)

    @cached_property
    def rests_late(self) -> np.ndarray:
        """True where quiet motion takes too many impacts to be told from chaos, shape (n_epsilon, n_delta)."""
        return self.model.rests_late(self.delta, self.epsilon[:, None])

    @cached_property
    def basin_entropy(self) -> np.ndarray:
        """Entropy per box of all boxes and of those at boundaries, shape (2, n_epsilon, n_delta).

        NaN where a cell of the (τ, v) plane is undecided, or may be so near the quiet limit.
        """
        found = np.full((2, *self.shape), np.nan)
        for (i, j), late in np.ndenumerate(self.rests_late):
            if not late:
                point = float(self.delta[j]), float(self.epsilon[i])
                basins = self.model.gear(*point).basins(BASIN_RESOLUTION, self.v_max, "refined")
                found[:, i, j] = rattle.basin_entropy(basins)[:2]
        return found

    @cached_property
    def crisis_side(self) -> np.ndarray:
        """Indices of `rattle.CRISIS_SIDES`, shape (n_epsilon, n_delta)."""
        return rattle.crisis_side(self.delta, self.epsilon[:, None], self.model.beta)

    @cached_property
    def grazing(self) -> tuple[rattle.Grazing, ...]:
        """The grazing curves G1 and G2 at each δ of the block."""
        return tuple(rattle.grazing(curve, self.delta, self.model.beta) for curve in GRAZING_CURVES)

    @cached_property
    def robust_chaos(self) -> np.ndarray:
        """True where a δ lies inside the robust-chaos interval, which not every β has."""
        try:
            low, high = rattle.robust_chaos_interval(self.model.beta)
        except rattle.RattleError:
            return np.zeros(len(self.delta), dtype=bool)
        return (low < self.delta) & (self.delta < high)
