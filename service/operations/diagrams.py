"""The default ends and the default resolution of the bifurcation diagram through a point."""

from __future__ import annotations

from rattle.attractors import ENOUGH_SAMPLES
from rattle.continuation import plane_scale
from rattle.models import AnyGear, model_of_gear

Pair = tuple[float, float]

#: Default extent of a diagram on either side of the point, by direction, as a multiple of `plane_scale`.
SPANS = {"epsilon": 0.02, "delta": 0.05}
LEAST_SPAN, MOST_SPAN = 1e-7, 0.5  # least and largest extent of a diagram, in δ or ε, on either side of the point
COUNT = ENOUGH_SAMPLES  # default number of initial conditions at each value; with fewer, chaos takes longer to test


def default_steps(gear: AnyGear) -> int:
    """Return the default number of intervals of the parameter in a diagram of this gear."""
    return model_of_gear(gear).diagram_steps


def diagram_span(gear: AnyGear, direction: str, extent: float | None = None) -> Pair:
    """Return the range of δ or ε that the diagram through a point covers: the point's value ± `extent`.

    A range of ε does not reach below 0, and a range of δ does not reach below half the point's δ.

    direction: the parameter that varies, "epsilon" or "delta". extent: None for the default extent.

    Returns
    -------
    Pair
        Low and high end.
    """
    extent = extent or SPANS[direction] * plane_scale(gear.delta)
    if direction == "epsilon":
        return max(gear.epsilon - extent, 0.0), gear.epsilon + extent
    return max(gear.delta - extent, gear.delta / 2), gear.delta + extent


def diagram_ends(
    gear: AnyGear, direction: str, extent: float | None = None, to: Pair | None = None
) -> tuple[Pair, Pair]:
    """Return the points (δ, ε) where a diagram begins and ends.

    The diagram passes through the gear's point along `direction`, "epsilon" or "delta", and extends by `extent`
    to each side; None means the default extent. If `to` is given, the diagram goes from the gear's point to `to`.

    Returns
    -------
    tuple[Pair, Pair]
        The points (δ, ε) where the diagram begins and where it ends.
    """
    if to is not None:
        return (gear.delta, gear.epsilon), to
    low, high = diagram_span(gear, direction, extent)
    if direction == "epsilon":
        return (gear.delta, low), (gear.delta, high)
    return (low, gear.epsilon), (high, gear.epsilon)
