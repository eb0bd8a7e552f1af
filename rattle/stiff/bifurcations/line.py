"""The equations of one itinerary of the stiff gear on a line in (δ, ε, p), p = 1/√(2κ), for continuation."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem, line_scale, root_between, solution_with_value
from rattle.flight.impact_law import ELASTIC
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic import solve_at_parameters, twins
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.periodic import StiffOrbit, admissible, orbit_of, trace_of

TWICE = 1e-5  # largest distance from a motion of half the period that counts as that motion, at its flip
MOST_BRACKETS = 8


@dataclass(frozen=True)
class MotionsOnLine:
    """The line (δ, ε, p) = origin + s · direction, and the motions of one itinerary on it.

    A motion with c contacts is y = (times, durations, s) (2c + 1,): the times at which contacts begin, and their
    durations in units of p.
    """

    walls: tuple[int, ...]
    m: int
    beta: float
    origin: Array
    direction: Array

    def plane(self, y: NDArray) -> NDArray:
        """Return times, durations, δ, ε and p (…, 2c + 3) of the motions y."""
        return np.concatenate([y[..., :-1], self.origin + y[..., -1:] * self.direction], axis=-1)

    def parameter(self, x: Array) -> Array:
        """Return the y of a motion with unknowns (2c + 3,), the inverse of `plane`."""
        return np.append(x[:-3], (x[-3:] - self.origin) @ self.direction / (self.direction @ self.direction))

    def itinerary(self, y: Array) -> StiffItinerary:
        """Return the itinerary with the stiffness at y."""
        return StiffItinerary(self.walls, self.m, self.beta, float(self.plane(y)[-1]))

    @property
    def problem(self) -> ContinuationProblem:
        """The equations along the line in the unknowns y."""
        any_softness = StiffItinerary(self.walls, self.m, self.beta, 0.0)

        def equations(y: NDArray) -> NDArray:
            x = self.plane(y)
            with np.errstate(
                divide="ignore", invalid="ignore"
            ):  # a flight of duration 0 is singular, and Newton's method refuses it
                return any_softness.residual_at(x[..., :-1], x[..., -1:])

        return ContinuationProblem(equations, scale=line_scale(self.origin, self.direction))

    def is_admissible(self, y: Array) -> bool:
        """Return whether a solution is admissible."""
        x = self.plane(y)
        return bool(x[-1] > 0.0) and admissible(self.itinerary(y), x[:-1])

    def flip(self, y: Array) -> float:
        """Return the trace of the tangent map + 1 + e^(−δm), which is 0 at a flip."""
        x = self.plane(y)
        return trace_of(self.itinerary(y), x[:-1]) + 1.0 + float(ELASTIC.determinant(x[-3], self.m, 1))

    def orbit(self, y: Array) -> StiffOrbit:
        """Return a solution as a `StiffOrbit`."""
        return orbit_of(self.itinerary(y), self.plane(y)[:-1])

    def solved(self, y: Array) -> Array | None:
        """Return the solution near a guess y at the same parameters; None if Newton's method fails."""
        found = solve_at_parameters(self.itinerary(y), self.plane(y)[:-1])
        return None if found is None else np.append(found[:-2], y[-1])

    def twins(self, start: Array, y: Array) -> Array:
        """Return all equivalent unknowns (…, 2c + 1) of `start` near y: from another contact or whole periods later."""
        return twins(StiffItinerary(self.walls, self.m, self.beta, 0.0), start, y)

    def halved(self, y: Array) -> tuple["MotionsOnLine", Array, float] | None:
        """Return the mean of both halves of a motion, as a line and its y, and the largest difference of the halves.

        Returns
        -------
        tuple or None
            None if the second half does not meet the walls in the order of the first.
        """
        half, odd = divmod(len(self.walls), 2)
        if odd or self.m % 2 or self.walls[:half] != self.walls[half:]:
            return None
        halves = y[:-1].reshape(2, 2, half).copy()  # the two halves of the times and of the durations
        halves[0, 1] -= self.m // 2
        line = replace(self, walls=self.walls[:half], m=self.m // 2)
        return line, np.append(halves.mean(axis=1), y[-1]), float(np.max(np.abs(halves[:, 1] - halves[:, 0])))

    def is_twice(self, y: Array) -> bool:
        """Return whether y is a motion of half the period, run through twice."""
        found = self.halved(y)
        return found is not None and found[2] < TWICE

    def flip_near(self, y: Array, width: float) -> Array | None:
        """Return the flip on this line at which a doubled branch ends, from a motion y close to it.

        Returns
        -------
        Array | None
            The y of the flip; None if its parameter s differs from that of the given motion by more than `width`.
        """
        for i in range(MOST_BRACKETS + 1):
            reach = width * 10.0 ** (i - MOST_BRACKETS)
            ends = [solution_with_value(self.problem, y, -1, y[-1] + side * reach) for side in (-1, 1)]
            a, b = ends
            if a is not None and b is not None and self.flip(a) * self.flip(b) < 0.0:
                return root_between(self.problem, a, b, self.flip)
        return None
