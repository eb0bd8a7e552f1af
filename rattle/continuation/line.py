"""Lines in the (δ, ε) plane along which motions are followed."""

from dataclasses import dataclass

import numpy as np

from rattle.continuation.arclength import plane_scale
from rattle.errors import require, require_integer, require_pair
from rattle.numerics.complex_step import Array

POINTS_ACROSS = 50  # at least, over the span
FIRST_OF_DOUBLED = 1e-4  # its size grows as the root of the distance from the flip
MOST_POINTS = 1000
HALF_PERIOD = "the period halves: a flip"
LEAST_DAMPING = 1e-3  # of the orbit's, to which a line may go
NEAR = 0.02  # span by default, either way, of the scale of the plane
DIRECTIONS = {"delta": (1.0, 0.0), "epsilon": (0.0, 1.0)}
Parameter = str | tuple[float, float]
Span = tuple[float, float] | None


@dataclass(frozen=True)
class ParameterLine:
    """(δ, ε) = origin + p direction, p in span, with so many points over it at least."""

    origin: Array
    direction: Array
    span: tuple[float, float]
    resolution: int

    def plane(self, y: Array) -> Array:
        """Return the unknowns (n + 2,) at y = (times, p)."""
        return np.concatenate([y[:-1], self.origin + y[-1] * self.direction])

    def across(self, n: int) -> Array:
        """Return the constraint (n + 2,) that keeps a solution on the line."""
        return np.concatenate([np.zeros(n), [-self.direction[1], self.direction[0]]])


def line_through(
    delta: float, epsilon: float, parameter: Parameter, span: Span, resolution: int = POINTS_ACROSS
) -> ParameterLine:
    """Return the line through a point that these arguments of `branch` mean, where δ is positive and ε not negative."""
    origin = np.array([delta, epsilon])
    resolution = require_integer("resolution", resolution, 1, MOST_POINTS)
    if isinstance(parameter, str):
        require(parameter in DIRECTIONS, f"parameter must be delta, epsilon or a direction, got {parameter!r}")
        direction = np.array(DIRECTIONS[parameter])
        ends = (
            np.array([-NEAR, NEAR]) * plane_scale(delta)
            if span is None
            else require_pair("span", span) - origin @ direction
        )
    else:
        direction = np.array(require_pair("parameter, if not delta or epsilon,", parameter))
        require(bool(direction.any()), "a direction is a pair (dδ, dε) other than (0, 0)")
        ends = np.array([-1.0, 1.0] if span is None else require_pair("span", span))
    low, high = float(ends[0]), float(ends[1])
    require(low <= 0.0 <= high and low < high, f"span must be (low, high) around the orbit, got {span!r}")
    for rate, below in zip(direction, ((LEAST_DAMPING - 1.0) * delta, -epsilon), strict=True):
        if rate > 0.0:
            low = max(low, below / rate)
        elif rate < 0.0:
            high = min(high, below / rate)
    return ParameterLine(origin, direction, (low, high), resolution)
