"""Find the events on a branch of periodic motions between neighbouring points: saddle-nodes, flips, grazes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import (
    ContinuationProblem,
    last_inside,
    newton_on_curve,
    root_between,
    solution_above_chord,
    tangent_at,
)
from rattle.continuation.conditions import Kind, condition
from rattle.continuation.line import ParameterLine
from rattle.impacting.orbits.equations import Itinerary, smooth_multipliers
from rattle.impacting.orbits.periodic import PeriodicOrbit, admissible, first_failure, orbit_of
from rattle.numerics.complex_step import Array

# largest time difference of the two halves of a motion at which, where the branch turns back, the motion counts as a
# motion of half the period
SAME_HALVES = 0.02
# a test function may have two zeros within a step if its parabola falls below this share of the value at the point
NEARLY = 0.5
FOUND = 1e-3  # distance from an event, as a share of a step, at which Newton's method starts
SAME_PLACE = 0.5  # share of a step; a solution farther than this from its candidate belongs to another event


class Candidate(NamedTuple):
    """A possible event: its position y = (times, p) on the branch, its kind, and a guess of its unknowns (n + 2,)."""

    y: Array
    kind: Kind
    itinerary: Itinerary
    guess: Array
    impact: int | None = None


@dataclass(frozen=True)
class Event:
    """A bifurcation on a branch.

    Attributes
    ----------
    kind : Kind
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

    kind: Kind
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
        """Return both multipliers (2,); at a graze, the multipliers of the motion that misses the wall."""
        return smooth_multipliers(self.itinerary, self.unknowns, self.impact)


def find_events(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> Iterator[Event]:
    """Yield the events between neighbouring solutions y = (times, p) (k, n + 1) of a branch, in order.

    `tangents` are unit vectors along the branch.

    Yields
    ------
    Event
        The next event.
    """
    tests = _tests(itinerary, line, problem)
    values = _values(itinerary, line, points, tangents)
    real = [admissible(itinerary, line.plane(y)) for y in points]
    for k in range(len(points) - 1):
        a, b = points[k], points[k + 1]
        found = []
        for j in np.flatnonzero((values[k] < 0) != (values[k + 1] < 0)):
            kind, impact, test = tests[j]
            y = root_between(problem, a, b, partial(test, b - a), FOUND)
            if y is None and kind is Kind.SADDLE_NODE:  # where two branches cross, no step from a to b converges
                y = 0.5 * (a + b)
            if y is not None:
                found.append(Candidate(y, kind, itinerary, line.plane(y), impact))
        if real[k] != real[k + 1] and not any(at.kind is Kind.GRAZING for at in found):
            found += _touches(itinerary, line, problem, *((a, b) if real[k] else (b, a)))
        near = SAME_PLACE * float(np.max(np.abs(b - a)))
        for candidate in sorted(found, key=lambda at: float(np.linalg.norm(at.y - points[k]))):
            solved = _solved(line, candidate, k, near)
            if solved is not None:
                yield solved


def between_twins(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> list[tuple[int, Array, Array]]:
    """Return solutions between two very close events of one kind that lie within one step of a branch.

    Without such a solution the events are missed, because their test function has the same sign at both ends of the
    step.

    Returns
    -------
    list[tuple[int, Array, Array]]
        (index of the point before, y, tangent) of each solution, by rising index.
    """
    tests, values = _tests(itinerary, line, problem), _values(itinerary, line, points, tangents)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    size, found = np.abs(values), []
    least = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])
    one_sign = (values[1:-1] * values[:-2] > 0) & (values[1:-1] * values[2:] > 0)
    for i, j in np.argwhere(least & one_sign):
        near = slice(i, i + 3)
        bend, slope, value = np.polyfit(length[near] - length[i + 1], values[near, j], 2)
        at = length[i + 1] - slope / (2 * bend) if bend else length[i + 1]
        lowest = value - slope**2 / (4 * bend) if bend else value
        if not length[i] < at < length[i + 2] or lowest / value > NEARLY:
            continue
        k = int(i if at < length[i + 1] else i + 1)
        y = solution_above_chord(problem, points[k], points[k + 1], (at - length[k]) / (length[k + 1] - length[k]))
        if y is not None and tests[j][2](points[k + 1] - points[k], y) * values[k, j] < 0:
            found.append((k, y, tangent_at(problem, y, tangents[k])))
    return found


def _values(itinerary: Itinerary, line: ParameterLine, points: Array, tangents: Array) -> Array:
    """Return the values (k, tests) of the test functions, in the order of `_tests`, at the solutions `points`."""
    departures = np.array([itinerary.flights(line.plane(y)).w0 for y in points])
    flips = [_flip(itinerary, line, y) for y in points]
    return np.column_stack([tangents[:, -1], flips, departures])


# a test function: it takes the direction of the branch and a solution, and changes sign at an event of its kind
Test = Callable[[Array, Array], float]


def _tests(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem
) -> list[tuple[Kind, int | None, Test]]:
    def graze(impact: int) -> Test:
        return lambda _, y: float(itinerary.flights(line.plane(y)).w0[impact])

    return [
        (Kind.SADDLE_NODE, None, lambda along, y: float(tangent_at(problem, y, along)[-1])),
        (Kind.FLIP, None, lambda _, y: _flip(itinerary, line, y)),
        *((Kind.GRAZING, impact, graze(impact)) for impact in range(itinerary.n)),
    ]


def _flip(itinerary: Itinerary, line: ParameterLine, y: Array) -> float:
    """Return det J(−1), with the rows of J scaled to length 1. It vanishes at a flip."""
    matrix = itinerary.jacobian(line.plane(y), -1.0)
    return float(np.linalg.det(matrix / np.linalg.norm(matrix, axis=1, keepdims=True)))


def _touches(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, inside: Array, outside: Array
) -> list[Candidate]:
    """Return candidates where a flight first touches a wall, with the touch as one more impact of the itinerary."""
    edge, beyond = last_inside(problem, inside, outside, lambda y: admissible(itinerary, line.plane(y)))
    failure = first_failure(itinerary, line.plane(beyond))
    if failure is None or failure[1] == 0:
        return []
    departure, wall, time = failure
    guess = np.insert(line.plane(edge), departure + 1, time)
    return [Candidate(edge, Kind.GRAZING, itinerary.with_impact(departure + 1, wall), guess, departure + 1)]


def _solved(line: ParameterLine, candidate: Candidate, after: int, near: float) -> Event | None:
    """Return the event near a candidate, or None if Newton's method finds none within `near` of it on the line.

    Where a branch turns back and its motion repeats a motion of half the period, the event is the flip of this shorter
    motion.

    Returns
    -------
    Event | None
        The event, or None.
    """
    _, kind, itinerary, guess, impact = candidate
    half = _halved(itinerary, guess) if kind is Kind.SADDLE_NODE else None
    if half is not None:
        kind, (itinerary, guess) = Kind.FLIP, half
    found = newton_on_curve(condition(itinerary, kind, impact), guess, line.across(itinerary.n))
    if found is None or np.max(np.abs((found[0] - guess)[-2:])) > near:
        return None
    return Event(kind, itinerary, found[0], impact, admissible(itinerary, found[0], impact), after)


def is_twice(itinerary: Itinerary, y: Array, tolerance: float) -> bool:
    """Return whether the motion with the times y[:n] repeats a motion of half its period, to `tolerance`."""
    n, m = itinerary.n // 2, itinerary.m // 2
    if itinerary.n != 2 * n or itinerary.m != 2 * m or itinerary.walls[:n] != itinerary.walls[n:]:
        return False
    return bool(np.max(np.abs(y[n : 2 * n] - y[:n] - m)) < tolerance)


def origin_of_doubling(itinerary: Itinerary, line: ParameterLine, y: Array, after: int) -> Event | None:
    """Return the flip at which a branch of doubled period begins, near its point y; None if there is no flip."""
    return _solved(line, Candidate(y, Kind.SADDLE_NODE, itinerary, line.plane(y)), after, SAME_HALVES)


def _halved(itinerary: Itinerary, x: Array) -> tuple[Itinerary, Array] | None:
    """Return itinerary and unknowns of the motion of half the period that x nearly repeats; None if there is none."""
    if not is_twice(itinerary, x, SAME_HALVES):
        return None
    n, m = itinerary.n // 2, itinerary.m // 2
    times = 0.5 * (x[:n] + x[n : 2 * n] - m)
    return itinerary.divided(2), np.concatenate([times, x[2 * n :]])
