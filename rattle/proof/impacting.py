"""A periodic motion of the impacting gear in ball arithmetic: the unknowns are the times of its impacts.

The equations are those of `rattle.impacting.orbits.equations` (Lemma 1 of docs/proofs.md). The times of a flight
determine its velocities. An elastic impact reverses the velocity, so at each impact the velocity of departure plus the
velocity of arrival is 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rattle.proof.balls import arb, arb_mat
from rattle.proof.flights import FlightEnclosure, ModelPoint, enclose_flight, require_first_impact

#: Name of this model in certificates.
MODEL = "impacting"


@dataclass(frozen=True)
class ImpactEnclosures:
    """The flights (n,) between given times (n,) of impacts; flight i starts at impact i on walls[i]."""

    walls: tuple[int, ...]
    flights: list[FlightEnclosure]

    @property
    def residual(self) -> list[arb]:
        """R (n,): at each impact the velocity of departure plus the velocity of arrival."""
        return [here.w0 + self.flights[i - 1].w1 for i, here in enumerate(self.flights)]

    @property
    def jacobian(self) -> arb_mat:
        """The Jacobian ∂R/∂t (n, n) of the residual with respect to the times of the impacts."""
        n = len(self.flights)
        matrix = [[arb(0)] * n for _ in range(n)]
        for i, here in enumerate(self.flights):
            after = (i + 1) % n
            matrix[i][i] += here.w0_t0
            matrix[i][after] += here.w0_t1
            matrix[after][i] += here.w1_t0
            matrix[after][after] += here.w1_t1
        return arb_mat(matrix)

    @property
    def speeds(self) -> list[arb]:
        """The speeds (n,) after the impacts."""
        return [-wall * each.w0 for wall, each in zip(self.walls, self.flights, strict=True)]

    @property
    def trace(self) -> arb:
        """The trace of the product of the tangent maps of all flights in the variables (t, w²/2).

        The tangent map of a flight of duration T has the determinant e^(−δT).
        """
        product = arb_mat([[1, 0], [0, 1]])
        for each in self.flights:
            # dw0 = w0_t0 dt0 + w0_t1 dt1 determines dt1; then dw1 = w1_t0 dt0 + w1_t1 dt1
            t_t, t_w = -each.w0_t0 / each.w0_t1, 1 / each.w0_t1
            w_t, w_w = each.w1_t0 + each.w1_t1 * t_t, each.w1_t1 * t_w
            product = arb_mat([[t_t, t_w / each.w0], [w_t * each.w1, w_w * each.w1 / each.w0]]) * product
        return product.trace()

    def require_admissible(self) -> None:
        """Raise NotProvedError unless the end of every flight is proved to be its first impact."""
        for i, each in enumerate(self.flights):
            target = self.walls[(i + 1) % len(self.walls)]
            require_first_impact(each, self.walls[i], target, f"the flight after impact {i + 1}")


@dataclass(frozen=True)
class ImpactingSystem:
    """The equations of a motion that meets `walls` (n,) in m forcing periods. Its unknowns (n,) are impact times."""

    point: ModelPoint
    walls: tuple[int, ...]
    m: int

    def __call__(self, times: Sequence[arb]) -> ImpactEnclosures:
        """Return the flights between impacts at these times (n,); they form a motion if their residual R is 0."""
        n, turns = len(times), [(2 * time).sin_cos_pi() for time in times]
        flights = [
            enclose_flight(
                self.point, times[i], times[i + 1] if i + 1 < n else times[0] + self.m, turns[i], turns[(i + 1) % n],
                self.point.beta * (self.walls[(i + 1) % n] - self.walls[i]),
            )
            for i in range(n)
        ]  # fmt: skip
        return ImpactEnclosures(self.walls, flights)
