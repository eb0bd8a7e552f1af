"""Lines in the (δ, ε) plane along which motions are followed."""

from dataclasses import dataclass

import numpy as np

from rattle.continuation.arclength import plane_scale
from rattle.errors import require, require_integer, require_pair
from rattle.numerics.complex_step import Array

#: Default of `ParameterLine.resolution`.
POINTS_ACROSS = 50
#: Length of the first step along a doubled branch. It is short, because the difference of the doubled orbit from the
#: orbit at the flip grows as the square root of the distance from the flip.
FIRST_OF_DOUBLED = 1e-4
#: Largest number of points of a branch on either side of the orbit from which it is followed; also the largest allowed
#: `ParameterLine.resolution`.
MOST_POINTS = 1000
HALF_PERIOD = "the period halves: a flip"
#: Least damping on a line, relative to the damping of the orbit.
LEAST_DAMPING = 1e-3
#: Default range of the parameter on either side of the orbit, in units of `plane_scale`.
NEAR = 0.02
DIRECTIONS = {"delta": (1.0, 0.0), "epsilon": (0.0, 1.0)}
Parameter = str | tuple[float, float]
Span = tuple[float, float] | None


@dataclass(frozen=True)
class ParameterLine:
    """A line (δ, ε) = origin + p · direction, with p in `span`.

    resolution: the least number of points of a branch that passes over the whole span.
    """

    origin: Array
    direction: Array
    span: tuple[float, float]
    resolution: int

    def unknowns_at(self, y: Array) -> Array:
        """Return the unknowns (n + 2,), which are n times, δ and ε, at y = (times, p)."""
        return np.concatenate([y[:-1], self.origin + y[-1] * self.direction])

    def line_normal(self, n: int) -> Array:
        """Return the normal (n + 2,) of the hyperplane of all unknowns (n times, δ, ε) whose (δ, ε) is on the line."""
        return np.concatenate([np.zeros(n), [-self.direction[1], self.direction[0]]])


def parameter_line_through(
    delta: float, epsilon: float, parameter: Parameter, span: Span, resolution: int = POINTS_ACROSS
) -> ParameterLine:
    """Return the line through (δ, ε) along which `rattle.branch` follows an orbit.

    parameter, span and resolution are the arguments of `rattle.branch`.

    Returns
    -------
    ParameterLine
        The line. Its span is cut off where ε falls to 0, or δ to LEAST_DAMPING times that of the orbit.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    origin = np.array([delta, epsilon])
    resolution = require_integer("resolution", resolution, 1, MOST_POINTS)
    if isinstance(parameter, str):
        require(
            parameter in DIRECTIONS, f"parameter must be 'delta', 'epsilon' or a direction (dδ, dε), got {parameter!r}"
        )
        direction = np.array(DIRECTIONS[parameter])
        ends = (
            np.array([-NEAR, NEAR]) * plane_scale(delta)
            if span is None
            else require_pair("span", span) - origin @ direction
        )
    else:
        direction = np.array(require_pair("parameter, if not delta or epsilon,", parameter))
        require(bool(direction.any()), "parameter, if it is a direction, must be a pair (dδ, dε) other than (0, 0)")
        ends = np.array([-1.0, 1.0] if span is None else require_pair("span", span))
    low, high = float(ends[0]), float(ends[1])
    value = f"{parameter} = {origin @ direction:g}" if isinstance(parameter, str) else "0"
    require(
        low <= 0.0 <= high and low < high,
        f"span must be (low, high) with low below high and {value}, that of the orbit, between them, got {span!r}",
    )
    for rate, below in zip(direction, ((LEAST_DAMPING - 1.0) * delta, -epsilon), strict=True):
        if rate > 0.0:
            low = max(low, below / rate)
        elif rate < 0.0:
            high = min(high, below / rate)
    return ParameterLine(origin, direction, (low, high), resolution)
