"""A rectangle of cells of the (δ, ε) plane, with everything that the model computes for these cells."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import rattle
from rattle.attractors import SampleSpec, SpeedLimit
from rattle.intensity import Intensities
from rattle.models import Model

GRAZING_CURVES = ("G1", "G2")
AUDIT = ("not_audited", "agreed", "disagreed")  # meanings of the codes 0, 1, 2 of the stored variable `audit`
BASIN_RESOLUTION = 100  # states along each axis of the (τ, v) plane; a box of the basin entropy has 5 × 5 states


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells `epsilon` × `delta`. Each property is computed once, when it is first needed.

    The values of a cell follow from its (δ, ε), the model and, for attractors, the number, box and seed of its samples.
    They do not depend on the other cells, so a cell has the same values, bit by bit, in any rectangle.
    """

    delta: np.ndarray  # dampings, shape (n_delta,)
    epsilon: np.ndarray  # eccentricities, shape (n_epsilon,)
    model: Model
    sample_spec: SampleSpec
    is_sampled: bool  # whether attractors are computed
    slots: int  # the largest number of attractors that a cell lists

    @property
    def sample_count(self) -> int:
        """Initial conditions per cell, 0 if no attractors are computed."""
        return self.sample_spec.count if self.is_sampled else 0

    @property
    def v_max(self) -> SpeedLimit:
        """The largest initial speed: a number, or "natural" for the natural speed of each cell."""
        return self.sample_spec.v_max

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of cells along (epsilon, delta)."""
        return len(self.epsilon), len(self.delta)

    @property
    def source_level(self) -> np.ndarray:
        """Fill level of each cell: 0 if the cell is computed, n if it is filled between computed cells 2ⁿ cells apart.

        In this class the value is 0 everywhere, because all cells are computed.
        """
        return np.zeros(self.shape, np.int8)

    @property
    def audit(self) -> np.ndarray:
        """Findings of the audit for each cell, as codes of `AUDIT`; in this class 0, because no cell is filled."""
        return np.zeros(self.shape, np.int8)

    @property
    def audit_leaf(self) -> np.ndarray:
        """Code of the round and leaf of each cell: KINDS times the number of a round, plus the kind of the leaf.

        The round is the last one in which the cell was to be filled. A leaf is a square of cells; `refined/rounds.py`
        defines rounds, kinds and KINDS. In this class the code is 0 everywhere, because no cell is filled.
        """
        return np.zeros(self.shape, np.int8)

    def single_cell(self, i: int, j: int) -> "Cells":
        """Return the cell with the indices i along ε and j along δ alone; none of its properties is computed yet."""
        return replace(self, delta=self.delta[j : j + 1], epsilon=self.epsilon[i : i + 1])

    @cached_property
    def region(self) -> np.ndarray:
        """The region of each cell, an index of `rattle.REGIONS`, int8 of shape (n_epsilon, n_delta)."""
        return rattle.classify_regions(self.period_one_orbits)

    @cached_property
    def period_one_orbits(self) -> rattle.PeriodOne:
        """The orbits A to D of each cell; the shapes of the arrays end in (n_epsilon, n_delta)."""
        return self.model.period_one(self.delta, self.epsilon[:, None])

    @cached_property
    def attractors(self) -> rattle.Attractors:
        """The attractors of all cells, row by row: the same bits as `rattle.attractors_of` returns for each cell."""
        return self.model.attractors_of(self.delta, self.epsilon[:, None], self.sample_spec)

    @cached_property
    def intensities(self) -> Intensities:
        """The intensities of all attractors (how hard they rattle), in the order of `attractors`."""
        return self.model.intensities_of(self.delta, self.epsilon[:, None], self.attractors)

    @cached_property
    def sampled_speed(self) -> np.ndarray:
        """The largest initial speed of the samples of each cell, shape (n_epsilon, n_delta)."""
        return self.sample_spec.highest_speeds(self.model.parameters_at(self.delta, self.epsilon[:, None]))

    @cached_property
    def boundary_distance(self) -> rattle.BoundaryDistance:
        """The least impact speeds that end quiet running, and their phases; arrays of shape (n_epsilon, n_delta)."""
        return rattle.boundary_distances(self.delta, self.epsilon[:, None], self.model.beta, self.v_max)

    @cached_property
    def becomes_quiet_late(self) -> np.ndarray:
        """Flags (n_epsilon, n_delta) of cells where motion becomes quiet so late that it may look chaotic before."""
        return self.model.becomes_quiet_late(self.delta, self.epsilon[:, None])

    @cached_property
    def basin_entropy(self) -> np.ndarray:
        """The mean basin entropy of all boxes, and of the boxes at basin boundaries, shape (2, n_epsilon, n_delta).

        A box is a square of 5 × 5 states of the (τ, v) plane. The values of a cell are NaN if a state of this plane is
        undecided, or if ε is so near the quiet limit that states could be undecided.
        """
        found = np.full((2, *self.shape), np.nan)
        for (i, j), late in np.ndenumerate(self.becomes_quiet_late):
            if not late:
                point = float(self.delta[j]), float(self.epsilon[i])
                basins = self.model.gear(*point).basins(BASIN_RESOLUTION, self.v_max, "refined")
                found[:, i, j] = rattle.basin_entropy(basins)[:2]
        return found

    @cached_property
    def crisis_side(self) -> np.ndarray:
        """The side of the boundary crisis on which each cell lies, an index of `rattle.CRISIS_SIDES`.

        The shape is (n_epsilon, n_delta).
        """
        return rattle.crisis_side(self.delta, self.epsilon[:, None], self.model.beta)

    @cached_property
    def grazing_points(self) -> tuple[rattle.GrazingPoints, ...]:
        """The grazing curves G1 and G2 at each δ of the rectangle."""
        return tuple(rattle.grazing(curve, self.delta, self.model.beta) for curve in GRAZING_CURVES)

    @cached_property
    def robust_chaos(self) -> np.ndarray:
        """Flags (n_delta,): δ is in the interval where chaos is robust; all False if this β has no such interval."""
        try:
            low, high = rattle.robust_chaos_interval(self.model.beta)
        except rattle.RattleError:
            return np.zeros(len(self.delta), dtype=bool)
        return (low < self.delta) & (self.delta < high)
