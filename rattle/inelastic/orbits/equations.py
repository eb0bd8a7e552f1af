"""The equations of a periodic motion with restitution: those of the elastic gear, with another impact law.

The unknowns are the times of the impacts. Flights between given times do not depend on the impact law
(`rattle.impacting.orbits.equations`). A motion with n impacts therefore solves R_i = (w₀ of flight i) + r (w₁ of flight
i − 1) = 0, where w₀ and w₁ are the velocities at the beginning and the end of a flight. A load ℓ only changes the unit
of length: because Φ'' + δΦ' = δq + e'' + δe' is linear and q ∝ 1 + ℓ, a gear with load ℓ at (ε, β) is equivalent to a
gear without load at (ε, β)/(1 + ℓ), with its speeds divided by 1 + ℓ too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem
from rattle.flight.impact_law import ImpactLaw, RestitutionLaw
from rattle.impacting.orbits.equations import Itinerary


@dataclass(frozen=True)
class InelasticItinerary(Itinerary):
    """The equations of motions that meet given walls in order in m forcing periods, with a restitution but no load."""

    restitution: float = 1.0

    @property
    def law(self) -> ImpactLaw:  # type: ignore[override]
        """The law of impacts with the restitution of this itinerary."""
        return RestitutionLaw(restitution=self.restitution)

    def residual(self, x: NDArray) -> NDArray:
        """Return the residuals (…, n) of motions x, one for each impact: 0 if the impact obeys the law."""
        flights = self.flights(x)
        return np.asarray(flights.w0 + self.restitution * np.roll(flights.w1, 1, axis=-1))

    def evaluate_with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """Return the residuals R (…, n) of motions x, and their Jacobian J(λ) = ∂R/∂t by the n impact times (…, n, n).

        J(λ) is for perturbations that grow by λ = multiplier over the period.

        Returns
        -------
        tuple of ndarray
            R and J(λ).
        """
        flights, n, r = self.flights(x), self.n, self.restitution
        residual = flights.w0 + r * np.roll(flights.w1, 1, axis=-1)
        matrix = np.zeros((*residual.shape, n), residual.dtype)
        for i in range(n):
            after, later = (i + 1, 1.0) if i < n - 1 else (0, multiplier)
            matrix[..., i, i] += flights.w0_t0[..., i] + r * flights.w1_t1[..., i - 1]
            matrix[..., i, after] -= flights.pull[..., i] * flights.w1[..., i] * later  # ∂w₀/∂t₁ = −pull · w₁
            matrix[..., after, i] += r * (flights.decay[..., i] * flights.pull[..., i] * flights.w0[..., i] / later)
        return residual, matrix

    def residual_with_graze(self, x: NDArray, impact: int) -> NDArray:
        """Return (…, n + 1): the residuals of motions x, then the velocity of arrival at impact number `impact`."""
        flights = self.flights(x)
        residual = flights.w0 + self.restitution * np.roll(flights.w1, 1, axis=-1)
        return np.concatenate([residual, flights.w1[..., impact - 1, None]], axis=-1)


def unknowns_without_load(x: NDArray, load: float) -> NDArray:
    """Return the unknowns (…, N), ε last, of the gear without load that is equivalent to a gear with load.

    x (…, N): the unknowns of the gear with load. Times and δ are the same for both gears; ε is divided by 1 + load.

    Returns
    -------
    ndarray, (…, N)
        The unknowns of the gear without load.
    """
    found = np.array(x)
    found[..., -1] /= 1.0 + load
    return found


def add_load_to_problem(problem: ContinuationProblem, load: float) -> ContinuationProblem:
    """Return the continuation problem of a gear with load, from the problem of the equivalent gear without load."""
    if load == 0.0:
        return problem
    return ContinuationProblem(
        lambda x: problem.equations(unknowns_without_load(x, load)),
        lambda x: problem.prepare(unknowns_without_load(x, load)),
        problem.scale,
    )
