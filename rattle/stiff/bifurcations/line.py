"""The equations of the stiff gear's motions with one itinerary, along a line in (δ, ε, p) with p = 1/√(2κ)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem, find_root_between, line_scale, solve_with_fixed_unknown
from rattle.flight.impact_law import ELASTIC
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import equivalent_unknowns, solve_at_parameters
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.periodic import StiffOrbit, is_admissible_solution, orbit_of, trace_of_tangent_map

EQUAL_HALVES = 1e-5  # a motion whose halves differ by less than this counts as two periods of a shorter motion
MOST_BRACKETS = 8  # number of times that the interval around a sought flip is made ten times wider


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

    def full_unknowns(self, y: NDArray) -> NDArray:
        """Return all unknowns (…, 2c + 3) of motions y on the line: times, durations/p, δ, ε and p = 1/√(2κ)."""
        return np.concatenate([y[..., :-1], self.origin + y[..., -1:] * self.direction], axis=-1)

    def line_unknowns(self, x: Array) -> Array:
        """Return the unknowns y on the line for a motion with the unknowns x (2c + 3,) that `full_unknowns` returns."""
        return np.append(x[:-3], (x[-3:] - self.origin) @ self.direction / (self.direction @ self.direction))

    def itinerary(self, y: Array) -> StiffItinerary:
        """Return the itinerary of the motion y, with the softness p of the line's point at which the motion exists."""
        return StiffItinerary(self.walls, self.m, self.beta, float(self.full_unknowns(y)[-1]))

    @property
    def problem(self) -> ContinuationProblem:
        """The continuation problem of the motions on the line, in the unknowns y."""
        any_softness = StiffItinerary(self.walls, self.m, self.beta, 0.0)

        def equations(y: NDArray) -> NDArray:
            x = self.full_unknowns(y)
            with np.errstate(
                divide="ignore", invalid="ignore"
            ):  # if the duration of a flight is 0, the residuals are not finite, and then Newton's method fails
                return any_softness.residual_at(x[..., :-1], x[..., -1:])

        return ContinuationProblem(equations, scale=line_scale(self.origin, self.direction))

    def is_admissible(self, y: Array) -> bool:
        """Return whether a motion y on the line is admissible; False unless its softness p = 1/√(2κ) is positive."""
        x = self.full_unknowns(y)
        return bool(x[-1] > 0.0) and is_admissible_solution(self.itinerary(y), x[:-1])

    def flip_residual(self, y: Array) -> float:
        """Return a number that changes sign at a flip: 1 + e^(−δm) plus the trace of the tangent map over m periods."""
        x = self.full_unknowns(y)
        return trace_of_tangent_map(self.itinerary(y), x[:-1]) + 1.0 + float(ELASTIC.determinant(x[-3], self.m, 1))

    def orbit(self, y: Array) -> StiffOrbit:
        """Return a motion y on the line as a `StiffOrbit`."""
        return orbit_of(self.itinerary(y), self.full_unknowns(y)[:-1])

    def corrected_solution(self, y: Array) -> Array | None:
        """Return the solution near a guess y at the same parameters; None if Newton's method fails."""
        found = solve_at_parameters(self.itinerary(y), self.full_unknowns(y)[:-1])
        return None if found is None else np.append(found[:-2], y[-1])

    def equivalent_unknowns(self, start: Array, y: Array) -> Array:
        """Return arrays of unknowns (k, 2c + 1) that all describe the motion `start`.

        Each array has another contact of the motion as its first contact. The times of an array are shifted by whole
        periods so that its first time is near the first time of y.

        Returns
        -------
        Array
            The unknowns, an array for each contact from which the motion meets the walls in the same order.
        """
        return equivalent_unknowns(StiffItinerary(self.walls, self.m, self.beta, 0.0), start, y)

    def mean_of_halves(self, y: Array) -> tuple["MotionsOnLine", Array, float] | None:
        """Return the mean of both halves of a motion y, as a motion of half the period.

        Returns
        -------
        tuple or None
            The line of the new motion; its unknowns on this line; the largest difference between an unknown of one half
            of y and the same unknown of the other half, with times counted from the beginning of the half. None if the
            halves of y do not meet the same walls.
        """
        half, odd = divmod(len(self.walls), 2)
        if odd or self.m % 2 or self.walls[:half] != self.walls[half:]:
            return None
        halves = y[:-1].reshape(2, 2, half).copy()  # the two halves of the times and of the durations
        halves[0, 1] -= self.m // 2
        line = replace(self, walls=self.walls[:half], m=self.m // 2)
        return line, np.append(halves.mean(axis=1), y[-1]), float(np.max(np.abs(halves[:, 1] - halves[:, 0])))

    def has_equal_halves(self, y: Array) -> bool:
        """Return whether a motion y consists of two equal halves, so that it repeats after m/2 forcing periods."""
        found = self.mean_of_halves(y)
        return found is not None and found[2] < EQUAL_HALVES

    def find_flip_near(self, y: Array, width: float) -> Array | None:
        """Return the flip on this line near a motion y.

        y is half of the last motion of a branch of doubled period, and the branch ends at this flip.

        Returns
        -------
        Array | None
            The unknowns of the flip; None if no flip is within `width` of y in the line's parameter s.
        """
        for i in range(MOST_BRACKETS + 1):
            reach = width * 10.0 ** (i - MOST_BRACKETS)
            ends = [solve_with_fixed_unknown(self.problem, y, -1, y[-1] + side * reach) for side in (-1, 1)]
            a, b = ends
            if a is not None and b is not None and self.flip_residual(a) * self.flip_residual(b) < 0.0:
                return find_root_between(self.problem, a, b, self.flip_residual)
        return None
