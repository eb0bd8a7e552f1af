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

SAME_HALVES = 0.02  # a motion this close to one of half the period, where its branch turns, is that one there
NEARLY = 0.5  # of its value: a parabola that comes so much nearer to 0 is looked at
FOUND = 1e-3  # of a step: near enough to solve from
SAME_PLACE = 0.5  # of a step: farther than this from where it was found, a solution is another one


class Candidate(NamedTuple):
    """Candidate of an event on a branch: at y = (times, p), with a guess of its unknowns (n + 2,)."""

    y: Array
    kind: Kind
    itinerary: Itinerary
    guess: Array
    impact: int | None = None


@dataclass(frozen=True)
class Event:
    """A bifurcation on a branch.

    kind: SN, PD or GR. unknowns (n + 2,): times, δ, ε of the motion there, of this itinerary; for GR the impact number
    `impact` has speed 0, and one of the two motions that meet does not make it. admissible: the motion happens. after:
    number of the branch's point before it.
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
        """δ and ε (2,)."""
        return self.unknowns[-2:]

    @property
    def orbit(self) -> PeriodicOrbit:
        """The motion of the event, which begins with an impact on Σ⁺."""
        return orbit_of(self.itinerary, self.unknowns)

    @property
    def wall(self) -> int | None:
        """The wall that is grazed, if one is."""
        return None if self.impact is None else self.itinerary.walls[self.impact]

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Return both multipliers (2,); at a graze those of the motion that misses the wall."""
        return smooth_multipliers(self.itinerary, self.unknowns, self.impact)


def find_events(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> Iterator[Event]:
    """Yield the events between neighbouring solutions y = (times, p) (k, n + 1) of a branch, in order.

    The tangents are unit vectors.

    Yields
    ------
    Event
        An event.
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
            if y is None and kind is Kind.SADDLE_NODE:  # two branches cross: no step between them converges
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
    """Return solutions to put between points, each (after which, y, tangent).

    There a test function that has one sign at both its neighbours has the other, for two events are so near that one
    step passed both.

    Returns
    -------
    list[tuple[int, Array, Array]]
        By rising number of the point after which they come.
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
    """Return the test functions, in the order of `_tests`, at solutions."""
    departures = np.array([itinerary.flights(line.plane(y)).w0 for y in points])
    flips = [_flip(itinerary, line, y) for y in points]
    return np.column_stack([tangents[:, -1], flips, departures])


Test = Callable[[Array, Array], float]  # of the branch's direction and a solution; it changes sign at an event


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
    """Return det J(−1), rows of length 1."""
    matrix = itinerary.jacobian(line.plane(y), -1.0)
    return float(np.linalg.det(matrix / np.linalg.norm(matrix, axis=1, keepdims=True)))


def _touches(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, inside: Array, outside: Array
) -> list[Candidate]:
    """Return candidates where a flight first touches a wall: a graze of the itinerary with that impact more."""
    edge, beyond = last_inside(problem, inside, outside, lambda y: admissible(itinerary, line.plane(y)))
    failure = first_failure(itinerary, line.plane(beyond))
    if failure is None or failure[1] == 0:
        return []
    departure, wall, time = failure
    guess = np.insert(line.plane(edge), departure + 1, time)
    return [Candidate(edge, Kind.GRAZING, itinerary.with_impact(departure + 1, wall), guess, departure + 1)]


def _solved(line: ParameterLine, candidate: Candidate, after: int, near: float) -> Event | None:
    """Return the event near a candidate, on the line, or None where there is none.

    Where a branch turns back as a motion twice over, it leaves that motion of half the period at its flip.

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
    """Return whether the times that y (≥ n,) begins with are those of one motion of half the period, twice over."""
    n, m = itinerary.n // 2, itinerary.m // 2
    if itinerary.n != 2 * n or itinerary.m != 2 * m or itinerary.walls[:n] != itinerary.walls[n:]:
        return False
    return bool(np.max(np.abs(y[n : 2 * n] - y[:n] - m)) < tolerance)


def origin_of_doubling(itinerary: Itinerary, line: ParameterLine, y: Array, after: int) -> Event | None:
    """Return the flip of the motion of half the period at which a branch near it, at y, begins; or None."""
    return _solved(line, Candidate(y, Kind.SADDLE_NODE, itinerary, line.plane(y)), after, SAME_HALVES)


def _halved(itinerary: Itinerary, x: Array) -> tuple[Itinerary, Array] | None:
    """Itinerary and unknowns of half the motion, if it is nearly one motion twice over."""
    if not is_twice(itinerary, x, SAME_HALVES):
        return None
    n, m = itinerary.n // 2, itinerary.m // 2
    times = 0.5 * (x[:n] + x[n : 2 * n] - m)
    return itinerary.divided(2), np.concatenate([times, x[2 * n :]])
