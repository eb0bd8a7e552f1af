"""The default ends and the default resolution of the bifurcation diagram through a point."""

from __future__ import annotations

from rattle.continuation import plane_scale
from rattle.models import AnyGear

Pair = tuple[float, float]

#: Default extent of a diagram on either side of the point, by direction, as a multiple of `plane_scale`.
SPANS = {"epsilon": 0.02, "delta": 0.05}
LEAST_SPAN, MOST_SPAN = 1e-7, 0.5  # least and largest extent in δ or ε on either side
STEPS, COUNT = 160, 32  # points of the parameter along a diagram, and initial conditions at each point


def diagram_span(gear: AnyGear, direction: str, either_way: float | None = None) -> Pair:
    """Return the range of δ or ε that the diagram through a point covers: the point ± the extent.

    Its low end is raised to 0 in ε, or to half the point's δ in δ, if the extent would reach lower.

    direction: "epsilon" or "delta". either_way: the extent on each side; None: the default extent.

    Returns
    -------
    Pair
        Low and high end.
    """
    either_way = either_way or SPANS[direction] * plane_scale(gear.delta)
    if direction == "epsilon":
        return max(gear.epsilon - either_way, 0.0), gear.epsilon + either_way
    return max(gear.delta - either_way, gear.delta / 2), gear.delta + either_way


def diagram_ends(
    gear: AnyGear, direction: str, either_way: float | None = None, to: Pair | None = None
) -> tuple[Pair, Pair]:
    """Return the points (δ, ε) where a diagram begins and ends.

    The diagram passes through the gear's point along `direction`, "epsilon" or "delta", and extends `either_way` to
    each side; None means the default extent. If `to` is given, the diagram goes from the gear's point to `to`.

    Returns
    -------
    tuple[Pair, Pair]
        The points (δ, ε) where the diagram begins and where it ends.
    """
    if to is not None:
        return (gear.delta, gear.epsilon), to
    low, high = diagram_span(gear, direction, either_way)
    if direction == "epsilon":
        return (gear.delta, low), (gear.delta, high)
    return (low, gear.epsilon), (high, gear.epsilon)
