"""Trace a curve of the registry through the (δ, ε) plane."""

import numpy as np

from rattle.continuation.arclength import ContinuationProblem
from rattle.continuation.conditions import equations_of_bifurcation, scale_of_unknowns
from rattle.continuation.curve_continuation import (
    POINTS_ACROSS,
    QUIET_LIMIT,
    Curve,
    MotionAtCurvePoint,
    PlaneWindow,
    evenly_spaced_numbers_between,
    require_window_range,
    trace_curve_of_problem,
    trace_quiet_limit,
)
from rattle.errors import RattleError, require, require_integer, require_number, require_one_of
from rattle.flight.forcing import Forcing, phase_of_least_force
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.bifurcations.registry import CURVES, NAMES, CurveDefinition
from rattle.impacting.orbits.equations import Itinerary, multipliers_without_graze
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.periodic import reason_for_virtual_motion
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import unknowns_counted_from_impact

MOST_ACROSS = 1000  # largest allowed number of points of a curve across a window
# starting points of a curve are also searched at two dampings close to each codimension-two point: 1 ± this number
# times the δ of the point
NEIGHBOUR_DISTANCE = 1e-7
REACH = 8.0  # every curve has points at dampings below this multiple of β; COD22 is near δ = 4β/π
# a window must reach above this damping: below it the impact times of different motions differ by less than rounding
LEAST_DELTA = 1e-5
SAME_POINT = 1e-6  # largest relative difference of equal points, in δ and in ε
ALL_EPSILON = (0.0, 1.0)


def trace(
    name: str,
    beta: float = 0.6,
    delta: tuple[float, float] = (0.3, 1.2),
    epsilon: tuple[float, float] = ALL_EPSILON,
) -> Curve:
    """Return the bifurcation curve `name` of the period-one motions inside a window of the (δ, ε) plane.

    The curve is followed by pseudo-arclength continuation of the impact equations with the curve's condition. Its
    points solve these equations to rounding.

    Parameters
    ----------
    name : str
        One of `NAMES`, see `describe`.
    delta, epsilon : tuple[float, float]
        (low, high) of the window, dimensionless.

    Returns
    -------
    Curve
        The pieces of the curve inside the window, each from end to end.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If rounding prevents the curve from being followed.
    """
    require_one_of("name", name, NAMES)
    beta = require_number("beta", beta, positive=True)
    window = PlaneWindow(require_window_range("delta", delta, positive=True), require_window_range("epsilon", epsilon))
    require(window.delta[1] >= LEAST_DELTA, f"delta must reach above {LEAST_DELTA:g}, got {delta!r}")
    dampings = _dampings_to_search(window, beta)
    try:
        return (
            _trace_quiet_limit(beta, window, dampings)
            if name == QUIET_LIMIT
            else _trace_registered_curve(name, beta, window, dampings)
        )
    except np.linalg.LinAlgError as error:
        raise RattleError(
            f"{name} cannot be followed at beta = {beta:g} with {window} ({error}): choose another window"
        ) from error


def _trace_registered_curve(name: str, beta: float, window: PlaneWindow, dampings: Array) -> Curve:
    """Return a curve of the registry in a window. Its starting points are searched at these dampings."""
    definition = CURVES[name]
    itinerary = definition.itinerary(beta)
    return trace_curve_of_problem(
        name,
        beta,
        equations_of_bifurcation(itinerary, definition.kind, definition.impact),
        (x for d in dampings for x in definition.starting_points_at(float(d), beta)),
        window,
        lambda x: _reason_not_on_curve(definition, itinerary, x),
        lambda x: motion_at_curve_point(itinerary, x, definition.impact),
        lambda x, reason: _prepend_point_name_to_reason(name, x, reason, beta),
    )


def _dampings_to_search(window: PlaneWindow, beta: float) -> Array:
    """Return the dampings at which a curve is searched: over the window, at its edges, and near the ends of curves."""
    low, high = window.delta
    ends = [point.delta * (1.0 + side * NEIGHBOUR_DISTANCE) for point in codimension_two(beta) for side in (-1.0, 1.0)]
    inside = [delta for delta in ends if low < delta < high]
    spread = evenly_spaced_numbers_between(low, high)
    if low < REACH * beta < high - low:  # in a wide window equal spacing would miss the curves
        spread = np.concatenate([evenly_spaced_numbers_between(low, REACH * beta), spread])
    return np.array([*spread, low, high, *inside])


def bifurcation_curve(
    event: Event,
    delta: tuple[float, float] = (0.3, 1.2),
    epsilon: tuple[float, float] = ALL_EPSILON,
    resolution: int = POINTS_ACROSS,
) -> Curve:
    """Return the saddle-node, flip or grazing curve through an event of a branch, inside a window of the plane.

    The branch (`rattle.branch`) may be of any periodic motion. The curve of an admissible event ends where its motion
    becomes virtual; the curve of a virtual event continues through virtual motions. Its points solve the equations to
    rounding, and there are at least `resolution` points across the window. At a graze tau and v describe the motion
    that touches the wall.

    Returns
    -------
    Curve
        The pieces of the curve inside the window, each from end to end.

    Raises
    ------
    ParameterError
        If an argument is outside its domain, or the window does not contain the event.
    """
    require(isinstance(event, Event), f"event must be an Event of a branch, got {type(event).__name__}")
    resolution = require_integer("resolution", resolution, 1, MOST_ACROSS)
    window = PlaneWindow(
        require_window_range("delta", delta, positive=True), require_window_range("epsilon", epsilon), resolution
    )
    require(
        window.reason_outside_window(event.unknowns) is None,
        f"the window of delta and epsilon must contain the event at ({event.delta}, {event.epsilon})",
    )
    itinerary, x, impact = _rotate_to_sigma_plus(event)
    m, n_plus, n_minus = itinerary.label
    return trace_curve_of_problem(
        f"{'' if event.admissible else 'virtual '}{event.kind} of P({m},{n_plus},{n_minus})",
        itinerary.beta,
        equations_of_bifurcation(itinerary, event.kind, impact),
        [x],
        window,
        lambda y: reason_for_virtual_motion(itinerary, y, impact) if event.admissible else None,
        lambda y: motion_at_curve_point(itinerary, y, impact),
        lambda _, reason: reason,
    )


def _rotate_to_sigma_plus(event: Event) -> tuple[Itinerary, Array, int | None]:
    """Return itinerary, unknowns and grazing impact of an event, counted from an impact on Σ⁺ that does not graze."""
    itinerary = event.itinerary
    begin = next((i for i, wall in enumerate(itinerary.walls) if wall > 0 and i != event.impact), 0)
    impact = None if event.impact is None else (event.impact - begin) % itinerary.n
    return itinerary.with_first_impact(begin), unknowns_counted_from_impact(itinerary, event.unknowns, begin), impact


def _reason_not_on_curve(definition: CurveDefinition, itinerary: Itinerary, x: Array) -> str | None:
    """Return the reason why a solution is not on a curve, None if it is on the curve."""
    return definition.reason_not_on_curve(x) or reason_for_virtual_motion(itinerary, x, definition.impact)


def motion_at_curve_point(itinerary: Itinerary, x: Array, grazed: int | None = None) -> MotionAtCurvePoint:
    """Return phase, speed and multipliers of a solution x; at a graze, multipliers without the grazing impact."""
    tau = float(x[0] - np.floor(x[0]))
    return MotionAtCurvePoint(tau, float(-itinerary.flights(x).w0[0]), multipliers_without_graze(itinerary, x, grazed))


def _prepend_point_name_to_reason(name: str, x: Array, reason: str, beta: float) -> str:
    """Return the reason why a curve ends at x, preceded by a codimension-two point's name if x is at this point."""
    off = {
        point.name: max(abs(x[-2] / point.delta - 1.0), abs(x[-1] / point.epsilon - 1.0))
        for point in codimension_two(beta)
        if name in point.curves
    }
    nearest = min(off, key=lambda point: off[point], default="")
    return f"{nearest}: {reason}" if nearest and off[nearest] < SAME_POINT else reason


def _trace_quiet_limit(beta: float, window: PlaneWindow, dampings: Array) -> Curve:
    """Return the curve `quiet_limit`, on which the minimum of the contact force on Σ⁺ is 0.

    The unknowns are x = (phase, δ, ε). The equations are that the force and its time derivative vanish.

    Returns
    -------
    Curve
        The pieces of `quiet_limit` inside the window.
    """

    def equations(x: Array) -> Array:
        return Forcing(x[..., 2]).quiet_limit_residuals(x[..., 0], x[..., 1])

    guesses = (np.array([phase_of_least_force(float(d)), d, float(quiet_limit(d))]) for d in dampings)
    return trace_quiet_limit(beta, ContinuationProblem(equations, scale=scale_of_unknowns), guesses, window)
