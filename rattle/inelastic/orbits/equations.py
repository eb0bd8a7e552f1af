"""A periodic motion with restitution as the times of its impacts: the equations of the elastic gear with another law.

Flights between given times do not depend on what an impact leaves of a speed (`rattle.impacting.orbits.equations`), so
with n impacts R_i = w₀ of flight i + r w₁ of flight i − 1 = 0. A load only changes the unit of length: a gear with
load ℓ at (ε, β) is one without load at (ε, β)/(1 + ℓ), its speeds divided likewise, since Φ'' + δΦ' = δq + e'' + δe' is
linear and q ∝ 1 + ℓ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem
from rattle.flight.impact_law import ImpactLaw, Restitution
from rattle.impacting.orbits.equations import Itinerary


@dataclass(frozen=True)
class InelasticItinerary(Itinerary):
    """Walls that a motion meets, its forcing periods, the half-backlash, and the restitution; there is no load."""

    restitution: float = 1.0

    @property
    def law(self) -> ImpactLaw:  # type: ignore[override]
        """The impact law."""
        return Restitution(restitution=self.restitution)

    def residual(self, x: NDArray) -> NDArray:
        """R (…, n): zero where every impact obeys the impact law."""
        flights = self.flights(x)
        return np.asarray(flights.w0 + self.restitution * np.roll(flights.w1, 1, axis=-1))

    def with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """R and J(λ) = ∂R/∂t (…, n, n) with t_n' = λ t₀'."""
        flights, n, r = self.flights(x), self.n, self.restitution
        residual = flights.w0 + r * np.roll(flights.w1, 1, axis=-1)
        matrix = np.zeros((*residual.shape, n), residual.dtype)
        for i in range(n):
            after, later = (i + 1, 1.0) if i < n - 1 else (0, multiplier)
            matrix[..., i, i] += flights.w0_t0[..., i] + r * flights.w1_t1[..., i - 1]
            matrix[..., i, after] -= flights.pull[..., i] * flights.w1[..., i] * later  # ∂w₀/∂t₁
            matrix[..., after, i] += r * (flights.decay[..., i] * flights.pull[..., i] * flights.w0[..., i] / later)
        return residual, matrix

    def with_graze(self, x: NDArray, impact: int) -> NDArray:
        """R (…, n + 1), and after it the velocity with which an impact is reached."""
        flights = self.flights(x)
        residual = flights.w0 + self.restitution * np.roll(flights.w1, 1, axis=-1)
        return np.concatenate([residual, flights.w1[..., impact - 1, None]], axis=-1)


def without_load(x: NDArray, load: float) -> NDArray:
    """Return unknowns (…, N), ε the last, of the gear without load that moves alike."""
    found = np.array(x)
    found[..., -1] /= 1.0 + load
    return found


def under_load(problem: ContinuationProblem, load: float) -> ContinuationProblem:
    """Return the problem of a gear with load, from that of the gear without load that moves alike."""
    if load == 0.0:
        return problem
    return ContinuationProblem(
        lambda x: problem.equations(without_load(x, load)),
        lambda x: problem.prepare(without_load(x, load)),
        problem.scale,
    )
