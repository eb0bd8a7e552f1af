"""Follow branches of any periodic motion along a line in the (δ, ε) plane, through folds and grazes.

The unknowns are the times of the impacts, in which a graze is a regular point. Beyond a graze the branch continues with
virtual motions, which would have to pass a wall or start from behind it. `admissible` is False at their points.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from rattle.continuation.arclength import (
    CLOSED,
    BoundsOfUnknown,
    CurveFollower,
    OneWayPath,
    make_longest_step_function,
    plane_scale,
    solve_on_curve,
)
from rattle.continuation.conditions import EventKind
from rattle.continuation.followed import FollowedBranch, start_of_doubled_branch
from rattle.continuation.line import (
    FIRST_OF_DOUBLED,
    HALF_PERIOD,
    MOST_POINTS,
    POINTS_ACROSS,
    Parameter,
    ParameterLine,
    Span,
    parameter_line_through,
)
from rattle.errors import RattleError, require, require_number
from rattle.impacting.bifurcations.events import (
    Event,
    find_events,
    find_flip_of_doubled_branch,
    points_between_close_events,
    repeats_first_half,
)
from rattle.impacting.bifurcations.registry import curve_name_of_event
from rattle.impacting.orbits.equations import Itinerary, equations_on_line
from rattle.impacting.orbits.periodic import PeriodicOrbit, orbit_of, to_periodic_orbit
from rattle.numerics.complex_step import Array
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.orbits.periodic_motions import equivalent_unknowns, solve_at_parameters

LONGEST = 0.05  # longest continuation step, in the Euclidean norm of times and parameter
FEW_POINTS = 6  # least number of points of the branch that `continue_to` follows
SHORTEST_FLIGHT = 1e-6  # shortest flight, in forcing periods; if a flight is shorter, two impacts have become one
# A branch of doubled period ends at its flip, where the second half of the motion repeats the first. The branch counts
# as ended if the impact times in the second half, minus half the period, differ from those in the first half by less
# than this. Any closer to the flip, rounding decides the direction of the branch.
HALF_TOLERANCE = 1e-5
SAME_PLACE = 1e-9  # largest distance of equal points in the (δ, ε) plane, relative to `plane_scale`
SAME_MOTION = 1e-6  # largest difference between the impact times of equal motions, in forcing periods


@dataclass(frozen=True, repr=False)
class Branch(FollowedBranch):
    """A branch of periodic motions of the impacting gear along a line, with the fields of `FollowedBranch`.

    unknowns (k, n + 2): for each of k points the n impact times, as in `PeriodicOrbit`, then δ and ε.
    """

    itinerary: Itinerary
    events: tuple[Event, ...]

    @property
    def times(self) -> Array:
        """The times (k, n) at which the motions meet the walls, in forcing periods, the first in [0, 1)."""
        return self.unknowns[:, : self.itinerary.n]

    @property
    def departures(self) -> Array:
        """The times (k, n) at which the motions leave the walls; these are also the times of the impacts."""
        return self.times

    @property
    def added(self) -> dict[str, Array]:
        """Parameters besides δ, ε and β: the impacting gear has none."""
        return {}

    @property
    def unwrapped_times(self) -> Array:
        """Times (k, n) of the impacts, which change continuously along the branch, so that they may leave [0, m)."""
        return self.times - self.times[:, :1] + np.unwrap(self.times[:, 0], period=1.0)[:, None]

    @property
    def names(self) -> tuple[str, ...]:
        """A, B, C or D for each point of a period-one branch, "" for the points of other branches.

        A and B are the saddles with a multiplier above 1. At a saddle-node A turns into C, and B into D.
        """
        pair = {(1, 1, 0): "CA", (1, 1, 1): "BD"}.get(self.label)
        if pair is None:
            return ("",) * len(self)
        # the sign of det J(1) tells A from C and B from D: it changes at saddle-nodes, and det J(1) is finite at grazes
        index = np.linalg.det(self.itinerary.jacobian(self.unknowns))
        return tuple(pair[int(above)] for above in index > 0.0)

    def curve_of(self, event: Event) -> str | None:
        """Return the name of the curve of `rattle.curves` on which an event lies; None if it lies on no such curve."""
        return curve_name_of_event(event)

    def orbit(self, index: int) -> PeriodicOrbit:
        """Return the motion at point number `index`."""
        return orbit_of(*self.motion(index))


def branch(
    orbit: PeriodicOrbit | Orbit, parameter: Parameter = "epsilon", span: Span = None, resolution: int = POINTS_ACROSS
) -> Branch:
    """Return the branch of a periodic motion as one parameter changes, in both directions from the motion.

    The branch continues beyond grazes, where the motion is virtual.

    Parameters
    ----------
    orbit : PeriodicOrbit | Orbit
        The periodic motion, from `Gear.orbits`, `Gear.orbit` or `periodic_orbit`.
    parameter : "epsilon", "delta" or (dδ, dε)
        The parameter to change, or a direction in the plane.
    span : tuple[float, float], optional
        (low, high) of the parameter, by default 0.02 on either side of the orbit (below δ = 0.25 less, in proportion to
        δ). If `parameter` is a direction, the span is the range of its multiples, by default −1 to 1.
    resolution : int
        Least number of points over the span.

    Returns
    -------
    Branch
        Points in order along the branch, with the events between them.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the orbit does not solve the impact equations.
    """
    orbit = to_periodic_orbit(orbit)
    line = parameter_line_through(orbit.delta, orbit.epsilon, parameter, span, resolution)
    start = np.append(orbit.times, 0.0)
    fixed = np.append(np.zeros(orbit.times.size), 1.0)
    solved = solve_on_curve(equations_on_line(orbit.itinerary, line.origin, line.direction), start, fixed)
    if solved is None:
        raise RattleError("the orbit does not solve the impact equations: get an orbit from periodic_orbit")
    return _follow_branch_both_ways(orbit.itinerary, line, solved[0])


def doubled(
    event: Event, parameter: Parameter = "epsilon", span: Span = None, resolution: int = POINTS_ACROSS
) -> Branch:
    """Return the branch of period-doubled motions that begins at a flip (PD).

    Other arguments and errors are those of `branch`.

    Returns
    -------
    Branch
        The branch, which begins at the flip.

    Raises
    ------
    RattleError
        If the event is not a flip.
    """
    require(isinstance(event, Event), f"event must be an Event of a branch, got {type(event).__name__}")
    if event.kind is not EventKind.FLIP:
        raise RattleError(f"event must be a flip (PD), where the period doubles, got {event.kind}")
    line = parameter_line_through(event.delta, event.epsilon, parameter, span, resolution)
    itinerary = event.itinerary.with_doubled_period()
    start = start_of_doubled_branch(event.itinerary, event.unknowns)
    path = _make_branch_follower(itinerary, line).follow(*start, MOST_POINTS, FIRST_OF_DOUBLED)
    return _build_branch(itinerary, line, path.points, path.tangents, 0, ("flip", _reason_of_end(itinerary, path)))


def beyond(event: Event, parameter: Parameter = "epsilon", span: Span = None) -> tuple[Branch, Branch]:
    """Return the two branches that meet at a graze (GR).

    Other arguments and errors are those of `branch`.

    Returns
    -------
    tuple[Branch, Branch]
        The branch of motions that miss the wall, and the branch of motions that touch the wall.

    Raises
    ------
    RattleError
        If the event is not a graze.
    """
    require(isinstance(event, Event), f"event must be an Event of a branch, got {type(event).__name__}")
    if event.impact is None:
        raise RattleError(f"event must be a graze (GR), where motions of different itineraries meet, got {event.kind}")
    line = parameter_line_through(event.delta, event.epsilon, parameter, span)
    misses, touches = np.delete(event.unknowns, event.impact)[:-2], event.unknowns[:-2]
    return (
        _follow_branch_both_ways(event.itinerary.without_impact(event.impact), line, np.append(misses, 0.0)),
        _follow_branch_both_ways(event.itinerary, line, np.append(touches, 0.0)),
    )


def branch_through(itinerary: Itinerary, x: Array, parameter: Parameter, span: Span, resolution: int) -> Branch:
    """Return the branch of motions that contains a solution x = (n times, δ, ε), followed in both directions.

    Other arguments and errors are those of `branch`.

    Returns
    -------
    Branch
        Points in order along the branch.
    """
    line = parameter_line_through(float(x[-2]), float(x[-1]), parameter, span, resolution)
    return _follow_branch_both_ways(itinerary, line, np.append(x[:-2], 0.0))


def continue_to(orbit: PeriodicOrbit | Orbit, delta: float, epsilon: float) -> PeriodicOrbit | Event | None:
    """Follow a motion along the straight line to other parameters.

    The line is not followed if Newton's method finds the motion at the other parameters at once, with equal stability,
    and leads from there back to the given motion.

    Returns
    -------
    PeriodicOrbit | Event | None
        The motion at the other parameters, or the first event at which the motion ceases to exist or changes
        stability. None if neither is found.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the orbit does not solve the impact equations.
    """
    orbit = to_periodic_orbit(orbit)
    delta, epsilon = require_number("delta", delta, positive=True), require_number("epsilon", epsilon)
    there = solve_at_parameters(orbit.itinerary, np.append(orbit.times, [delta, epsilon]))
    if there is not None and np.max(np.abs(there[:-2] - orbit.times)) < LONGEST:
        found = orbit_of(orbit.itinerary, there)
        if found.admissible and found.stable == orbit.stable and _does_newton_return_to_orbit(found, orbit):
            return found
    here = branch(orbit, (delta - orbit.delta, epsilon - orbit.epsilon), (0.0, 1.0), FEW_POINTS)
    for event in here.events:
        before, after = ((here.admissible[i], here.stable[i]) for i in (event.after, event.after + 1))
        turns = event.kind is EventKind.SADDLE_NODE or event.itinerary.m < here.itinerary.m
        if event.after >= here.start and (turns or before != after):
            return event
    arrived = np.allclose([here.delta[-1], here.epsilon[-1]], [delta, epsilon], rtol=1e-12, atol=0)
    return here.orbit(-1) if arrived else None


def _does_newton_return_to_orbit(found: PeriodicOrbit, orbit: PeriodicOrbit) -> bool:
    """Return whether Newton's method leads from `found` back to `orbit`; next to a fold it may lead elsewhere."""
    back = solve_at_parameters(orbit.itinerary, np.append(found.times, [orbit.delta, orbit.epsilon]))
    return back is not None and bool(np.max(np.abs(back[:-2] - orbit.times)) < SAME_MOTION)


def _make_branch_follower(itinerary: Itinerary, line: ParameterLine) -> CurveFollower:
    """Return the `CurveFollower` of branches of motions with this itinerary on a line of parameters."""
    problem = equations_on_line(itinerary, line.origin, line.direction)
    longest = make_longest_step_function(line.span, line.resolution, LONGEST)
    bounds = (BoundsOfUnknown(-1, *line.span),)
    return CurveFollower(
        problem,
        bounds,
        lambda y: _reason_of_degeneracy(itinerary, y) is None,
        longest,
        partial(equivalent_unknowns, itinerary),
    )


def _reason_of_degeneracy(itinerary: Itinerary, y: Array) -> str | None:
    """Return why a branch ends at a motion with impact times y[:-1]: impacts merge, or the period halves; else None."""
    if np.min(np.diff(np.append(y[:-1], y[0] + itinerary.m))) < SHORTEST_FLIGHT:
        return "two impacts become one"
    return HALF_PERIOD if repeats_first_half(itinerary, y, HALF_TOLERANCE) else None


def _follow_branch_both_ways(itinerary: Itinerary, line: ParameterLine, start: Array) -> Branch:
    """Return the branch through `start` = (times, position p on the line), ordered so that p rises at `start`."""
    followed = _make_branch_follower(itinerary, line).follow_both_ways(start, -1, MOST_POINTS)
    ends = (CLOSED, CLOSED)
    if followed.paths is not None:
        ends = _reason_of_end(itinerary, followed.paths[0]), _reason_of_end(itinerary, followed.paths[1])
    return _build_branch(itinerary, line, followed.points, followed.tangents, followed.start, ends)


def _reason_of_end(itinerary: Itinerary, path: OneWayPath) -> str:
    """Return in words why a path ends; "span" means that it reached the end of the span of parameters."""
    if path.first_point_outside is None:
        return (
            "the branch has its largest number of points"
            if len(path.points) >= MOST_POINTS
            else "the equations become singular"
        )
    return _reason_of_degeneracy(itinerary, path.first_point_outside) or "span"


def _is_same_event(one: Event, other: Event) -> bool:
    """Return whether two events have the same kind, the same period and the same parameters."""
    apart = max(abs(one.delta - other.delta), abs(one.epsilon - other.epsilon))
    return (
        one.kind is other.kind and one.itinerary.m == other.itinerary.m and apart < SAME_PLACE * plane_scale(one.delta)
    )


def _build_branch(
    itinerary: Itinerary, line: ParameterLine, points: Array, tangents: Array, start: int, ends: tuple[str, str]
) -> Branch:
    """Return the branch with its events, from k of its points: n impact times and a position on the line each.

    points, tangents (k, n + 1): the points in order, and unit tangents of the branch there. Points between close
    events are added. start: the number of the point from which the branch was followed. ends: the reasons why the
    branch ends at either end.

    Returns
    -------
    Branch
        The branch.
    """
    problem = equations_on_line(itinerary, line.origin, line.direction)
    more = sorted(points_between_close_events(itinerary, line, problem, points, tangents), key=lambda item: -item[0])
    for after, y, tangent in more:
        points, tangents = np.insert(points, after + 1, y, axis=0), np.insert(tangents, after + 1, tangent, axis=0)
        start += after < start
    orbits = [orbit_of(itinerary, line.unknowns_at(y)) for y in points]
    events = list(find_events(itinerary, line, problem, points, tangents))
    for end, at, place in ((ends[0], 0, 0), (ends[1], len(points) - 1, len(events))):
        flip = find_flip_of_doubled_branch(itinerary, line, points[at], max(at - 1, 0)) if end == HALF_PERIOD else None
        if flip is not None and not any(_is_same_event(flip, event) for event in events):
            events.insert(place, flip)
    return Branch(
        itinerary,
        np.array([orbit.unknowns for orbit in orbits]),
        np.array([orbit.speeds for orbit in orbits]),
        np.array([orbit.multipliers for orbit in orbits]).T,
        np.array([orbit.stable for orbit in orbits]),
        np.array([orbit.admissible for orbit in orbits]),
        start,
        tuple(events),
        ends,
    )
