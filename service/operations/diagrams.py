"""The default ends and the resolution of a point's diagram."""

from __future__ import annotations

from rattle.continuation import plane_scale
from rattle.models import AnyGear

Pair = tuple[float, float]

SPANS = {"epsilon": 0.02, "delta": 0.05}  # default on either side, relative to the scale of the plane
LEAST_SPAN, MOST_SPAN = 1e-7, 0.5  # allowed range of δ or ε on either side
STEPS, COUNT = 160, 32  # points of the parameter, and initial conditions


def diagram_span(gear: AnyGear, direction: str, either_way: float | None = None) -> Pair:
    """Return the range of δ or ε about a point, inside the plane, with so much on either side."""
    either_way = either_way or SPANS[direction] * plane_scale(gear.delta)
    if direction == "epsilon":
        return max(gear.epsilon - either_way, 0.0), gear.epsilon + either_way
    return max(gear.delta - either_way, gear.delta / 2), gear.delta + either_way


def diagram_ends(
    gear: AnyGear, direction: str, either_way: float | None = None, to: Pair | None = None
) -> tuple[Pair, Pair]:
    """Return the points (δ, ε) where a diagram begins and ends.

    It passes through the point along "epsilon" or "delta", or goes from the point to another one.

    Returns
    -------
    tuple[Pair, Pair]
        Begin and end.
    """
    if to is not None:
        return (gear.delta, gear.epsilon), to
    low, high = diagram_span(gear, direction, either_way)
    if direction == "epsilon":
        return (gear.delta, low), (gear.delta, high)
    return (low, gear.epsilon), (high, gear.epsilon)
