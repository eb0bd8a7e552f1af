"""The plane of states (τ, v) of the impacting gear."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.basins import Array, budget_of
from rattle.attractors.cell_map import Box, cell_of
from rattle.attractors.classify import Classifier
from rattle.flight.law import speed_unit
from rattle.impacting.attractors.classifier import classify
from rattle.impacting.map.iterate import iterate
from rattle.impacting.map.quiet import capture_invariant
from rattle.numerics.sampling import initial_conditions


class ImpactingPlane(NamedTuple):
    """The plane of the impacting model."""

    delta: float
    epsilon: float
    beta: float

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """δ, ε, β (1,)."""
        return np.array([self.delta]), np.array([self.epsilon]), np.array([self.beta])

    @property
    def unit(self) -> float:
        """See `Plane`."""
        return float(speed_unit(self.delta, self.epsilon, self.beta))

    def classify(self, tau: Array, v: Array) -> Classifier:
        """See `Plane`."""
        return classify(*self.arrays, tau[None].copy(), v[None].copy(), budget_of(self.delta, tau.size))

    def iterated(self, tau: Array, v: Array, returns: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """See `Plane`; a trajectory that becomes quiet goes on bouncing, and is located there."""
        moved = iterate(self.delta, self.epsilon, tau, v, returns, self.beta)
        return moved.tau, moved.v, np.zeros(tau.size, np.bool_)

    def cell_of(self, tau: Array, v: Array, n: int, box: Box) -> NDArray[np.int64]:
        """See `Plane`."""
        cell = np.empty(tau.size, np.int64)
        cell_of(tau, v, n, box, self.delta, self.epsilon, capture_invariant(*self), cell)
        return cell

    def sample(self, count: int, v_max: float) -> tuple[Array, Array]:
        """See `Plane`."""
        tau, v = initial_conditions(*self.arrays, count, v_max, 0)
        return tau[0], v[0]
