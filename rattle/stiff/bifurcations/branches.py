"""Branches of periodic motions of the stiff gear along lines in δ, ε and κ^(−1/2): saddle-nodes, flips and grazes.

All motions of a branch have the same itinerary. At a graze the motion continues smoothly with one contact more or less,
so the branch ends there, and another branch begins.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rattle.continuation.arclength import (
    CLOSED,
    BoundsOfUnknown,
    ContinuationProblem,
    CurveFollower,
    OneWayPath,
    find_root_between,
    make_longest_step_function,
    tangent_at,
)
from rattle.continuation.conditions import EventKind, equations_of_bifurcation
from rattle.continuation.followed import start_of_doubled_branch
from rattle.continuation.line import FIRST_OF_DOUBLED, HALF_PERIOD, Parameter, parameter_line_through
from rattle.errors import RattleError, require, require_integer, require_pair
from rattle.numerics.complex_step import Array
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.stiff.bifurcations.grazes import VANISHING, Graze, find_graze_at_branch_end
from rattle.stiff.bifurcations.line import EQUAL_HALVES, MotionsOnLine
from rattle.stiff.bifurcations.records import StiffBranch, StiffEvent, unknowns_of_stiff_orbit
from rattle.stiff.orbits.periodic import (
    LONGEST_STEP,
    StiffOrbit,
    convert_to_stiff_orbit,
    is_admissible_solution,
    softness,
)

__all__ = ["StiffBranch", "StiffEvent", "period_doubled_branch", "stiff_branch", "stiff_branch_on_line", "stiff_curve"]

POINTS_ACROSS = 50  # least number of points over the span
MOST_POINTS = 1000
# A branch of doubled period becomes singular at its flip. If such a branch stops, and the halves of its last motion
# differ by less than this in the unknowns, a flip is sought there.
NEARLY_TWICE = 1e-2
FLIP_WITHIN = 1e-3  # largest distance between a doubled branch's last motion and its flip, as a share of the span
LEAST_FLIGHT = 1e-6  # duration, in forcing periods, below which a flight counts as vanished
LOST = "is lost"  # words for the end of a branch at a graze where a contact vanishes


def stiff_branch(
    orbit: StiffOrbit | Orbit,
    parameter: Parameter = "epsilon",
    span: tuple[float, float] | None = None,
    resolution: int = POINTS_ACROSS,
) -> StiffBranch:
    """Return the branch of a periodic motion in one parameter, in both directions, as far as motions are admissible.

    Parameters
    ----------
    orbit : StiffOrbit or Orbit
        The motion from which the branch is followed.
    parameter : str or (dδ, dε)
        The parameter to change, "epsilon", "delta" or "kappa", or a direction in the (δ, ε) plane.
    span : tuple[float, float] | None
        (low, high) of the parameter around the orbit; by default κ/10 to 10κ for "kappa", and as in `rattle.branch` for
        "epsilon" and "delta". For a direction, the range of its multiples, by default −1 to 1.
    resolution : int
        Least number of points over the span.

    Returns
    -------
    StiffBranch
        Points in order along the branch, with the events between them.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the motion is virtual at its parameters.
    """
    orbit = convert_to_stiff_orbit(orbit)
    resolution = require_integer("resolution", resolution, 1, MOST_POINTS)
    here = unknowns_of_stiff_orbit(orbit)
    if parameter == "kappa":
        ends = np.array((orbit.kappa / 10, orbit.kappa * 10) if span is None else require_pair("span", span))
        require(
            0.0 < ends[0] <= orbit.kappa <= ends[1],
            f"span must be (low, high) with low above 0 and kappa = {orbit.kappa:g} of the orbit between them, "
            f"got {span!r}",
        )
        direction, ends = np.eye(3)[-1], np.array([softness(x) for x in ends[::-1]]) - here[-1]
    else:
        plane = parameter_line_through(orbit.delta, orbit.epsilon, parameter, span, resolution)
        direction, ends = np.append(plane.direction, 0.0), np.array(plane.span)
    require(ends[0] < ends[1], f"span must be (low, high) with low below high, around the orbit, got {span!r}")
    line = MotionsOnLine(orbit.walls, orbit.m, orbit.beta, here[-3:], direction)
    return stiff_branch_on_line(line, np.append(here[:-3], 0.0), (float(ends[0]), float(ends[1])), resolution)


def _create_stiff_branch_follower(line: MotionsOnLine, span: tuple[float, float], resolution: int) -> CurveFollower:
    def is_on_branch(y: Array) -> bool:
        return line.is_admissible(y) and not line.has_equal_halves(y)

    longest = make_longest_step_function(span, resolution, LONGEST_STEP)
    return CurveFollower(line.problem, (BoundsOfUnknown(-1, *span),), is_on_branch, longest, line.equivalent_unknowns)


def stiff_branch_on_line(line: MotionsOnLine, start: Array, span: tuple[float, float], resolution: int) -> StiffBranch:
    """Return the branch through the motion `start` on a line, followed in both directions while it stays in `span`."""
    if not line.is_admissible(start):
        raise RattleError("the motion is virtual at its parameters: give a motion from rattle.stiff.stiff_orbit")
    followed = _create_stiff_branch_follower(line, span, resolution).follow_both_ways(start, -1, MOST_POINTS)
    ends = (_BranchEnd(CLOSED), _BranchEnd(CLOSED))
    if followed.paths is not None:
        ends = _end_of_path(line, followed.paths[0], span), _end_of_path(line, followed.paths[1], span)
    return _branch_of_points(line, followed.points, followed.tangents, followed.start, ends)


def period_doubled_branch(
    event: StiffEvent, direction: Array, span: tuple[float, float], resolution: int
) -> StiffBranch:
    """Return the branch of motions of twice the period that begins at a flip.

    Parameters change along `direction`, in (δ, ε, 1/√(2κ)). span: (low, high), the multiples of the direction between
    which the branch is followed, 0 at the flip.

    Returns
    -------
    StiffBranch
        The branch, with the flip as its first point.
    """
    itinerary = event.itinerary.with_doubled_period()
    line = MotionsOnLine(itinerary.walls, itinerary.m, itinerary.beta, event.parameters, direction)
    start = start_of_doubled_branch(event.itinerary, event.unknowns)
    path = _create_stiff_branch_follower(line, span, resolution).follow(*start, MOST_POINTS, FIRST_OF_DOUBLED)
    tangents = path.tangents.copy()
    # a doubled branch turns back in the parameter at its first point, the flip; the next point's tangent replaces the
    # first one, so that this turn does not count as a saddle-node
    tangents[0] = tangents[min(1, len(tangents) - 1)]
    return _branch_of_points(line, path.points, tangents, 0, (_BranchEnd("flip"), _end_of_path(line, path, span)))


class _BranchEnd(NamedTuple):
    """The reason in words why a branch ends, and the flip or the graze at which it ends, if any."""

    why: str
    flip: StiffOrbit | None = None
    graze: Graze | None = None


def _end_of_path(line: MotionsOnLine, path: OneWayPath, span: tuple[float, float]) -> _BranchEnd:
    """Return why a path ends, in words, with the flip or graze at its end if there is one."""
    last, c = path.points[-1], len(line.walls)
    if path.first_point_outside is not None and not span[0] <= path.first_point_outside[-1] <= span[1]:
        return _BranchEnd("span")
    half = line.mean_of_halves(last)
    if half is not None and half[2] < (NEARLY_TWICE if path.first_point_outside is None else 2 * EQUAL_HALVES):
        flip = half[0].find_flip_near(half[1], FLIP_WITHIN * (span[1] - span[0]))
        if flip is not None:
            return _BranchEnd(HALF_PERIOD, flip=half[0].orbit(flip))
    if path.first_point_outside is None:
        return _BranchEnd(
            "the branch has its largest number of points"
            if len(path.points) >= MOST_POINTS
            else "the equations become singular"
        )
    if c == 1 and line.m - line.itinerary(last).softness * last[1] < LEAST_FLIGHT:
        return _BranchEnd("the motion becomes quiet")
    shortest = int(np.argmin(last[c : 2 * c]))
    grazes = last[c + shortest] < VANISHING
    why = f"contact {shortest} with {_wall_name(line.walls[shortest])} {LOST}" if grazes else "a contact is made"
    return _BranchEnd(f"graze: {why}", graze=find_graze_at_branch_end(line, last, path.tangents[-1]))


def _wall_name(wall: int) -> str:
    return "Σ⁺" if wall > 0 else "Σ⁻"


def _branch_of_points(
    line: MotionsOnLine, points: Array, tangents: Array, start: int, ends: tuple[_BranchEnd, _BranchEnd]
) -> StiffBranch:
    """Return a branch with its events, from its points (k, 2c + 1) and their tangents. Saddle-nodes become points too.

    start: the index of the point from which the branch was followed. ends: the branch's ends, first and last.

    Returns
    -------
    StiffBranch
        The branch with its saddle-nodes, flips and grazes.
    """
    problem = line.problem
    folds = np.flatnonzero((tangents[:-1, -1] < 0) != (tangents[1:, -1] < 0))
    marked: list[int] = []
    for k in folds[::-1].tolist():
        a, b = points[k], points[k + 1]
        y = find_root_between(problem, a, b, _fold_function(problem, a, b))
        if y is None:
            continue
        if np.array_equal(y, a) or np.array_equal(y, b):
            marked = [k + int(np.array_equal(y, b)), *marked]
            continue
        points = np.insert(points, k + 1, y, axis=0)
        start += int(k < start)
        marked = [k + 1, *(i + 1 for i in marked)]
    flips = np.array([line.flip_residual(y) for y in points])
    events = [StiffEvent(EventKind.SADDLE_NODE, line.orbit(points[i]), i) for i in marked]
    for i in np.flatnonzero((flips[:-1] < 0) != (flips[1:] < 0)).tolist():
        y = find_root_between(problem, points[i], points[i + 1], line.flip_residual)
        if y is not None:
            events.append(StiffEvent(EventKind.FLIP, line.orbit(y), i))
    grazes = []
    for end, i in zip(ends, (0, len(points) - 1), strict=True):
        if end.flip is not None:
            events.append(StiffEvent(EventKind.FLIP, end.flip, i))
        if end.graze is not None:
            (here, y), beyond = end.graze
            grazes.append(
                StiffEvent(EventKind.GRAZING, here.orbit(y), i, None if beyond is None else beyond[0].orbit(beyond[1]))
            )
    multipliers = np.array([line.orbit(y).multipliers for y in points]).T
    stable = np.abs(multipliers[0]) < 1.0
    for k in marked:  # a saddle-node counts as stable if the motions on one side of it are stable
        stable[k] = stable[max(k - 1, 0)] or stable[k + 1]
    itinerary, unknowns = line.itinerary(points[0]), np.array([line.full_unknowns(y) for y in points])
    flights = itinerary.flights(unknowns[:, :-1], unknowns[:, -1:])
    return StiffBranch(
        itinerary,
        unknowns,
        np.asarray(-itinerary.signs * flights.w0, np.float64),
        multipliers,
        stable,
        np.ones(len(points), np.bool_),
        start,
        tuple(sorted(events, key=lambda event: event.point)),
        (ends[0].why, ends[1].why),
        tuple(grazes),
    )


def _fold_function(problem: ContinuationProblem, a: Array, b: Array) -> Callable[[Array], float]:
    """Return the function that is 0 at a fold between the points a and b of a branch.

    Returns
    -------
    callable
        It returns the parameter's component of the branch's tangent at a solution y between a and b.
    """
    return lambda y: float(tangent_at(problem, y, b - a)[-1])


def stiff_curve(
    event: StiffEvent, delta: tuple[float, float], epsilon: tuple[float, float], resolution: int = 60
) -> Array:
    """Return the saddle-node or flip curve through an event at fixed κ.

    The curve is followed while the motion is admissible and inside the window of δ and ε (low, high), with at least
    `resolution` points across the window.

    Returns
    -------
    Array
        (k, 2c + 2): times of the c contacts, their durations multiplied by √(2κ), then δ and ε.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the event is neither a saddle-node nor a flip, or no point of its curve is in the window.
    """
    require(isinstance(event, StiffEvent), f"event must be a StiffEvent, got {type(event).__name__}")
    from rattle.continuation.curve_continuation import PlaneWindow, trace_pieces_in_window

    window = PlaneWindow(require_pair("delta", delta), require_pair("epsilon", epsilon), resolution)
    itinerary = event.orbit.itinerary

    def reason_to_leave(x: Array) -> str | None:
        return None if is_admissible_solution(itinerary, x) else "the motion is virtual"

    found = trace_pieces_in_window(
        equations_of_bifurcation(itinerary, event.kind),
        [event.orbit.unknowns],
        window,
        reason_to_leave,
        itinerary.n_contacts,
    )
    if not found:
        raise RattleError(
            "no curve of the event was found in the window: give a saddle-node or a flip, with ranges of delta and "
            "epsilon that contain it"
        )
    return found[0].points
