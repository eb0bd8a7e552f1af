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

# largest distance, where a branch turns back, from a motion of half the period that counts as that motion
SAME_HALVES = 0.02
NEARLY = 0.5  # a test function whose parabola falls below this share of its value may have two zeros
FOUND = 1e-3  # share of a step: close enough to start Newton's method
SAME_PLACE = 0.5  # share of a step: a solution farther from its candidate belongs to another event


class Candidate(NamedTuple):
    """A candidate of an event: its place y = (times, p) on the branch, and a guess of its unknowns (n + 2,)."""

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
        Times, δ and ε of the motion at the event. At a graze impact number `impact` has speed 0; one of the two motions
        that meet does not make this impact.
    admissible : bool
        Whether the motion is admissible.
    after : int
        Number of the branch's point before the event.
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
        """Wall that is grazed, or None."""
        return None if self.impact is None else self.itinerary.walls[self.impact]

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Return both multipliers (2,); at a graze those of the motion that misses the wall."""
        return smooth_multipliers(self.itinerary, self.unknowns, self.impact)


def find_events(
    itinerary: Itinerary, line: ParameterLine, problem: ContinuationProblem, points: Array, tangents: Array
) -> Iterator[Event]:
    """Yield the events between neighbouring solutions y = (times, p) (k, n + 1) of a branch, in order.

    `tangents` are unit vectors along the branch.

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
            if y is None and kind is Kind.SADDLE_NODE:  # where two branches cross, no step between them converges
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
    """Return further solutions between points, each (number of the point before, y, tangent).

    At such a solution a test function changes sign twice within one step, because two events are very close.

    Returns
    -------
    list[tuple[int, Array, Array]]
        By rising number of the point before.
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
    """Return the values of the test functions, in the order of `_tests`, at the solutions."""
    departures = np.array([itinerary.flights(line.plane(y)).w0 for y in points])
    flips = [_flip(itinerary, line, y) for y in points]
    return np.column_stack([tangents[:, -1], flips, departures])


# a function of the branch's direction and a solution, which changes sign at an event
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
    """Return det J(−1) with rows scaled to length 1."""
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
    """Return the event near a candidate, or None where there is none on the line.

    A branch that turns back as a motion of half the period leaves that motion at its flip.

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
    """Return whether the times at the beginning of y (≥ n,) repeat those of one motion of half the period."""
    n, m = itinerary.n // 2, itinerary.m // 2
    if itinerary.n != 2 * n or itinerary.m != 2 * m or itinerary.walls[:n] != itinerary.walls[n:]:
        return False
    return bool(np.max(np.abs(y[n : 2 * n] - y[:n] - m)) < tolerance)


def origin_of_doubling(itinerary: Itinerary, line: ParameterLine, y: Array, after: int) -> Event | None:
    """Return the flip of the half-period motion at which a branch begins near y, or None."""
    return _solved(line, Candidate(y, Kind.SADDLE_NODE, itinerary, line.plane(y)), after, SAME_HALVES)


def _halved(itinerary: Itinerary, x: Array) -> tuple[Itinerary, Array] | None:
    """Return itinerary and unknowns of the half-period motion, if the motion nearly repeats one."""
    if not is_twice(itinerary, x, SAME_HALVES):
        return None
    n, m = itinerary.n // 2, itinerary.m // 2
    times = 0.5 * (x[:n] + x[n : 2 * n] - m)
    return itinerary.divided(2), np.concatenate([times, x[2 * n :]])
