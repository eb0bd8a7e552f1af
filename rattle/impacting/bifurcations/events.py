"""Find the saddle-nodes, flips and grazes between neighbouring points of a branch of periodic motions.

A test function changes its sign along the branch at the events of one kind.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import (
    ContinuationProblem,
    bracket_admissible_edge,
    find_root_between,
    solve_normal_to_chord,
    solve_on_curve,
    tangent_at,
)
from rattle.continuation.conditions import EventKind, equations_of_bifurcation
from rattle.continuation.line import ParameterLine
from rattle.impacting.orbits.equations import Itinerary, multipliers_without_graze
from rattle.impacting.orbits.periodic import PeriodicOrbit, find_impossible_flight, is_admissible, orbit_of
from rattle.numerics.complex_step import Array

# the two halves of a motion count as equal if the impact times in the second half, minus half the period, differ from
# those in the first half by less than this. The motion then repeats a motion of half its period. If a branch turns back
# at such a motion, the flip of the shorter motion must lie within this distance, in δ and in ε, of the turning point.
SAME_HALVES = 0.02
# a test function is checked for two zeros within a step if the parabola through three points falls below this share of
# the value at the middle point
DIP_SHARE = 0.5
NEWTON_START = 1e-3  # distance from an event, as a share of a step, at which Newton's method starts
SAME_PLACE = 0.5  # largest distance, as a share of a step, between a candidate and the event that it leads to


class EventCandidate(NamedTuple):
    """A possible event of a branch.

    y is the point of the branch near the event: the motion's times, and p, the position on the line of parameters.
    `guess` (n + 2,) holds guesses of the event's times, δ and ε. `grazing_impact` is the number of the impact that
    grazes, None for a saddle-node or a flip.
    """

    branch_point: Array
    kind: EventKind
    itinerary: Itinerary
    guess: Array
    grazing_impact: int | None = None


@dataclass(frozen=True)
class Event:
    """An event on a branch of the impacting gear: a saddle-node, a flip or a graze.

    Attributes
    ----------
    kind : EventKind
        SN (saddle-node), PD (flip) or GR (graze).
    unknowns : ndarray, (n + 2,)
        Times, δ and ε of the motion at the event.
    impact : int or None
        Number of the impact that has speed 0 at a graze; one of the two motions that meet there does not make this
        impact. None at other events.
    admissible : bool
        Whether the motion is admissible.
    after : int
        Index of the last point of the branch before the event.
    """

    kind: EventKind
    itinerary: Itinerary
    unknowns: Array
    impact: int | None
    admissible: bool
    after: int

    @property
    def delta(self) -> float:
        """Damping of the event."""
        return float(self.unknowns[-2])

    @property
    def epsilon(self) -> float:
        """Eccentricity of the event."""
        return float(self.unknowns[-1])

    @property
    def parameters(self) -> Array:
        """δ and ε (2,) of the event."""
        return self.unknowns[-2:]

    @property
    def orbit(self) -> PeriodicOrbit:
        """Motion of the event, beginning with an impact on Σ⁺."""
        return orbit_of(self.itinerary, self.unknowns)

    @property
    def wall(self) -> int | None:
        """Wall that is grazed, +1 or −1; None if the event is not a graze."""
        return None if self.impact is None else self.itinerary.walls[self.impact]

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Both Floquet multipliers (2,); at a graze, those of the motion that misses the wall."""
        return multipliers_without_graze(self.itinerary, self.unknowns, self.impact)


def find_events(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> Iterator[Event]:
    """Yield the events of a branch in order, from k neighbouring solutions on the branch.

    points: the solutions (k, n + 1), each with n times and p, the position on the line of parameters. tangents: the
    unit tangents (k, n + 1) of the branch.

    Yields
    ------
    Event
        The next event.
    """
    tests = _event_test_functions(itinerary, line, problem)
    values = _values_of_test_functions(itinerary, line, points, tangents)
    real = [is_admissible(itinerary, line.unknowns_at(y)) for y in points]
    for k in range(len(points) - 1):
        a, b = points[k], points[k + 1]
        found = []
        for j in np.flatnonzero((values[k] < 0) != (values[k + 1] < 0)):
            kind, impact, test = tests[j]
            y = find_root_between(problem, a, b, partial(test, b - a), NEWTON_START)
            # where branches cross, Newton's method fails; the candidate is then the middle of the step
            if y is None and kind is EventKind.SADDLE_NODE:
                y = 0.5 * (a + b)
            if y is not None:
                found.append(EventCandidate(y, kind, itinerary, line.unknowns_at(y), impact))
        if real[k] != real[k + 1] and not any(at.kind is EventKind.GRAZING for at in found):
            found += _find_touch_candidates(itinerary, line, problem, *((a, b) if real[k] else (b, a)))
        near = SAME_PLACE * float(np.max(np.abs(b - a)))
        for candidate in sorted(found, key=lambda at: float(np.linalg.norm(at.branch_point - points[k]))):
            solved = _solve_event(line, candidate, k, near)
            if solved is not None:
                yield solved


def points_between_close_events(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> list[tuple[int, Array, Array]]:
    """Return further points of a branch, one between each two events of one kind that lie within one step.

    Without such a point both events are missed, because their test function has the same sign at both ends of the step.

    Returns
    -------
    list[tuple[int, Array, Array]]
        For each further point the index of the point before it, its times and position on the line (n + 1,), and the
        tangent; by rising index.
    """
    tests, values = (
        _event_test_functions(itinerary, line, problem),
        _values_of_test_functions(itinerary, line, points, tangents),
    )
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    size, found = np.abs(values), []
    least = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])
    one_sign = (values[1:-1] * values[:-2] > 0) & (values[1:-1] * values[2:] > 0)
    for i, j in np.argwhere(least & one_sign):
        near = slice(i, i + 3)
        bend, slope, value = np.polyfit(length[near] - length[i + 1], values[near, j], 2)
        at = length[i + 1] - slope / (2 * bend) if bend else length[i + 1]
        lowest = value - slope**2 / (4 * bend) if bend else value
        if not length[i] < at < length[i + 2] or lowest / value > DIP_SHARE:
            continue
        k = int(i if at < length[i + 1] else i + 1)
        y = solve_normal_to_chord(problem, points[k], points[k + 1], (at - length[k]) / (length[k + 1] - length[k]))
        if y is not None and tests[j][2](points[k + 1] - points[k], y) * values[k, j] < 0:
            found.append((k, y, tangent_at(problem, y, tangents[k])))
    return found


def _values_of_test_functions(itinerary: Itinerary, line: ParameterLine, points: Array, tangents: Array) -> Array:
    """Return the values (k, tests) of the test functions at k solutions, in the order of `_event_test_functions`."""
    departures = np.array([itinerary.flights(line.unknowns_at(y)).w0 for y in points])
    flips = [_scaled_flip_determinant(itinerary, line, y) for y in points]
    return np.column_stack([tangents[:, -1], flips, departures])


# a test function: it takes the direction of the branch and a solution, and changes sign at every event
# of one kind
Test = Callable[[Array, Array], float]


def _event_test_functions(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem
) -> list[tuple[EventKind, int | None, Test]]:
    """Return (kind, number of the grazing impact or None, test function) for every event that a branch may have."""

    def build_graze_test(impact: int) -> Test:
        return lambda _, y: float(itinerary.flights(line.unknowns_at(y)).w0[impact])

    return [
        (EventKind.SADDLE_NODE, None, lambda along, y: float(tangent_at(problem, y, along)[-1])),
        (EventKind.FLIP, None, lambda _, y: _scaled_flip_determinant(itinerary, line, y)),
        *((EventKind.GRAZING, impact, build_graze_test(impact)) for impact in range(itinerary.n)),
    ]


def _scaled_flip_determinant(itinerary: Itinerary, line: ParameterLine, y: Array) -> float:
    """Return the determinant of the Jacobian J(−1), with its rows scaled to length 1. It vanishes at a flip."""
    matrix = itinerary.jacobian(line.unknowns_at(y), -1.0)
    return float(np.linalg.det(matrix / np.linalg.norm(matrix, axis=1, keepdims=True)))


def _find_touch_candidates(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, inside: Array, outside: Array
) -> list[EventCandidate]:
    """Return the candidate for a graze between an admissible point and a virtual point, in a list that may be empty.

    Between the points `inside` (admissible) and `outside` (virtual) a flight begins to touch a wall on its way. This
    touch is one more impact of the candidate's itinerary.

    Returns
    -------
    list[EventCandidate]
        At most one candidate.
    """
    edge, beyond = bracket_admissible_edge(
        problem, inside, outside, lambda y: is_admissible(itinerary, line.unknowns_at(y))
    )
    failure = find_impossible_flight(itinerary, line.unknowns_at(beyond))
    if failure is None or failure[1] == 0:
        return []
    departure, wall, time = failure
    guess = np.insert(line.unknowns_at(edge), departure + 1, time)
    return [
        EventCandidate(edge, EventKind.GRAZING, itinerary.with_added_impact(departure + 1, wall), guess, departure + 1)
    ]


def _solve_event(line: ParameterLine, candidate: EventCandidate, after: int, near: float) -> Event | None:
    """Return the event near a candidate, or None if Newton's method finds none closer than `near` in δ and ε.

    If the branch turns back at a motion that repeats a motion of half its period, the event is the flip of this shorter
    motion. after: the index of the last point of the branch before the event.

    Returns
    -------
    Event | None
        The event, or None.
    """
    _, kind, itinerary, guess, impact = candidate
    half = _guess_half_period_motion(itinerary, guess) if kind is EventKind.SADDLE_NODE else None
    if half is not None:
        kind, (itinerary, guess) = EventKind.FLIP, half
    found = solve_on_curve(equations_of_bifurcation(itinerary, kind, impact), guess, line.line_normal(itinerary.n))
    if found is None or np.max(np.abs((found[0] - guess)[-2:])) > near:
        return None
    return Event(kind, itinerary, found[0], impact, is_admissible(itinerary, found[0], impact), after)


def repeats_first_half(itinerary: Itinerary, y: Array, tolerance: float) -> bool:
    """Return whether the second half of the motion y repeats its first half, up to `tolerance` in each time."""
    n, m = itinerary.n // 2, itinerary.m // 2
    if itinerary.n != 2 * n or itinerary.m != 2 * m or itinerary.walls[:n] != itinerary.walls[n:]:
        return False
    return bool(np.max(np.abs(y[n : 2 * n] - y[:n] - m)) < tolerance)


def find_flip_of_doubled_branch(itinerary: Itinerary, line: ParameterLine, y: Array, after: int) -> Event | None:
    """Return the flip at which a branch of doubled period begins; None if Newton's method finds no flip.

    y: the point at the end of the branch, next to the flip. after: the number of the last point of the branch before
    the flip.

    Returns
    -------
    Event | None
        The flip, or None.
    """
    return _solve_event(
        line, EventCandidate(y, EventKind.SADDLE_NODE, itinerary, line.unknowns_at(y)), after, SAME_HALVES
    )


def _guess_half_period_motion(itinerary: Itinerary, x: Array) -> tuple[Itinerary, Array] | None:
    """Return a motion of half the period of the motion x, a guess for Newton's method, if both halves of x are similar.

    Returns
    -------
    tuple[Itinerary, Array] | None
        The itinerary, and the unknowns with the mean times of both halves; None if times differ by SAME_HALVES or more.
    """
    if not repeats_first_half(itinerary, x, SAME_HALVES):
        return None
    n, m = itinerary.n // 2, itinerary.m // 2
    times = 0.5 * (x[:n] + x[n : 2 * n] - m)
    return itinerary.with_divided_period(2), np.concatenate([times, x[2 * n :]])
