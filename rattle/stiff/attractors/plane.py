"""The plane of states (τ, v) of the stiff gear, as `rattle.attractors.basins` asks for it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.basins import budget_of
from rattle.attractors.cell_map import Box, cell_of
from rattle.flight.law import speed_unit
from rattle.numerics.complex_step import Array
from rattle.numerics.sampling import initial_conditions
from rattle.stiff.attractors.classifier import StiffClassifier, classify
from rattle.stiff.map.iterate import returned

NEVER = 0.0  # no speed above 0 is sure to become quiet: contact tells


class StiffPlane(NamedTuple):
    """See `rattle.attractors.basins.Plane`."""

    delta: float
    epsilon: float
    beta: float
    kappa: float

    @property
    def unit(self) -> float:
        """See `Plane`."""
        return float(speed_unit(self.delta, self.epsilon, self.beta))

    def classify(self, tau: Array, v: Array) -> StiffClassifier:
        """See `rattle.attractors.basins.Plane`."""
        delta, epsilon, beta, kappa = (np.array([x]) for x in self)
        return classify(delta, epsilon, beta, kappa, tau[None].copy(), v[None].copy(), budget_of(self.delta, tau.size))

    def iterated(self, tau: Array, v: Array, returns: int) -> tuple[Array, Array, NDArray[np.bool_]]:
        """See `rattle.attractors.basins.Plane`."""
        tau, v, quiet = tau.copy(), v.copy(), np.zeros(tau.size, np.int8)
        counts = (np.zeros(tau.size, np.int64) for _ in range(2))
        returned(tau, v, np.full(tau.size, float(returns)), *(np.full(tau.size, x) for x in self), quiet, *counts)
        return tau, v, quiet > 0

    def cell_of(self, tau: Array, v: Array, n: int, box: Box) -> NDArray[np.int64]:
        """See `rattle.attractors.basins.Plane`."""
        cell = np.empty(tau.size, np.int64)
        cell_of(tau, v, n, box, self.delta, self.epsilon, NEVER, cell)
        return cell

    def sample(self, count: int, v_max: float) -> tuple[Array, Array]:
        """See `rattle.attractors.basins.Plane`."""
        delta, epsilon, beta = (np.array([x]) for x in self[:3])
        tau, v = initial_conditions(delta, epsilon, beta, count, v_max, 0)
        return tau[0], v[0]
