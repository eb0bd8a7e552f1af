"""Follow the period-doubling cascade of a motion."""

import numpy as np

from rattle.continuation.conditions import EventKind
from rattle.continuation.line import Parameter, Span, parameter_line_through
from rattle.errors import require_integer
from rattle.impacting.bifurcations.branches import Branch, branch, doubled
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.orbits.periodic import PeriodicOrbit

MOST_DOUBLINGS = 8  # largest allowed number of doublings; each doubling takes about six times as long as the one before


def cascade(
    orbit: PeriodicOrbit, parameter: Parameter = "epsilon", span: Span = None, doublings: int = 6
) -> tuple[Event, ...]:
    """Return the period-doubling cascade of a stable motion as the parameter grows.

    The cascade holds the flip at which the motion loses stability, then the flip of the doubled motion and so on. It
    ends after `doublings` flips, or at the graze or saddle-node that ends a stable branch. Other arguments and errors
    are those of `branch`.

    Returns
    -------
    tuple[Event, ...]
        The events, in order.
    """
    doublings = require_integer("doublings", doublings, 1, MOST_DOUBLINGS)
    here, found = branch(orbit, parameter, span), list[Event]()
    last = orbit.delta, orbit.epsilon
    while True:
        event = _find_loss_of_stability(here)
        if event is not None:
            found.append(event)
        if event is None or event.kind is not EventKind.FLIP or len(found) >= doublings:
            return tuple(found)
        gap = np.hypot(event.delta - last[0], event.epsilon - last[1])
        last = event.delta, event.epsilon
        here = doubled(event, *_direction_and_span_near(event, parameter, span, 2 * gap if len(found) > 1 else np.inf))


def _direction_and_span_near(
    event: Event, parameter: Parameter, span: Span, reach: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the direction of a line of parameters through an event, and its span within `reach` of the event."""
    line = parameter_line_through(event.delta, event.epsilon, parameter, span)
    reach /= float(np.hypot(*line.direction))
    low, high = max(line.span[0], -reach), min(line.span[1], reach)
    return (float(line.direction[0]), float(line.direction[1])), (low, high)


def _find_loss_of_stability(branch: Branch) -> Event | None:
    """Return the first event after a branch's start at which the motion loses stability; None if there is none."""
    stable = [*branch.stable[branch.start :], False]
    if True not in stable:
        return None
    last = branch.start + stable.index(False, stable.index(True)) - 1
    events = [event for event in branch.events if event.after == last]
    return events[0] if events else None
