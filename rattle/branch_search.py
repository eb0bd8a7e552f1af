"""All branches of periodic motions along a segment of the (δ, ε) plane that lead to one another, each once.

From every motion given, its branch; from every flip of it the doubled branch, and back; from every graze the branch of
the motion with that impact or without it. A motion is on a known branch if it is a solution between two of its points.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from rattle.arclength import LARGEST_TURN, between
from rattle.bifurcations import Kind, along
from rattle.branches import Branch, doubled, through
from rattle.events import Event
from rattle.impact_equations import Array, Itinerary
from rattle.periodic import PeriodicOrbit, at_parameters, orbit_of

SAME_MOTION = 1e-7  # in the times of the impacts
SAME_PLACE = 1e-8  # of a segment
POINTS_ACROSS = 60  # a segment, at least


@dataclass(frozen=True)
class Segment:
    """From start to end, both (δ, ε); a position on it is a fraction of the way."""

    start: Array
    end: Array

    @property
    def direction(self) -> Array:
        """End less start."""
        return self.end - self.start

    def at(self, position: NDArray[np.float64]) -> tuple[Array, Array]:
        """(δ, ε) at these positions, the ends exactly."""
        delta, epsilon = (a + np.asarray(position) * (b - a) for a, b in zip(self.start, self.end, strict=True))
        return delta, np.maximum(epsilon, 0.0)

    def position(self, delta: Array | float, epsilon: Array | float) -> Array:
        """Where points of the segment are."""
        rate = self.direction
        across = (delta - self.start[0]) * rate[0] + (epsilon - self.start[1]) * rate[1]
        return np.asarray(across / (rate @ rate), np.float64)


def rotated(itinerary: Itinerary, times: Array, first: int) -> tuple[Itinerary, Array]:
    """The same motion, begun at impact number `first`."""
    walls = itinerary.walls[first:] + itinerary.walls[:first]
    times = np.concatenate([times[first:], times[:first] + itinerary.m])
    return Itinerary(walls, itinerary.m, itinerary.beta), times - np.floor(times[0])


def same_motion(one: tuple[Itinerary, Array], other: tuple[Itinerary, Array]) -> bool:
    """Whether two solutions (itinerary, unknowns) are one motion at one point, whichever impacts they begin at."""
    (a, x), (b, y) = one, other
    if (a.m, sorted(a.walls)) != (b.m, sorted(b.walls)) or np.max(np.abs(x[-2:] - y[-2:])) > SAME_PLACE:
        return False
    return any(np.max(np.abs(twin[:-2] - x[:-2])) < SAME_MOTION for twin in _twins(b, y, a, x[0]))


def _twins(itinerary: Itinerary, x: Array, like: Itinerary, phase: float) -> Iterator[Array]:
    """The ways to write x (n + 2,) with the walls of `like`, begun near this time."""
    for first in range(itinerary.n):
        turned, times = rotated(itinerary, x[:-2], first)
        if turned.walls == like.walls:
            yield np.append(times + np.rint(phase - times[0]), x[-2:])


class Search:
    """Branches found so far, and what is still to be looked at."""

    def __init__(self, segment: Segment, impacts: int, most: int) -> None:
        """Keep motions of at most so many impacts per period, and at most so many branches."""
        self.segment, self.impacts, self.most = segment, impacts, most
        self.branches: list[Branch] = []
        self.events: list[Event] = []
        self.left_out: set[tuple[int, int, int]] = set()
        self.paths: list[Array] = []  # (times, position) of every branch, times unfolded
        self._queue: list[tuple[int, int, Event]] = []
        self._order = count()

    def add(self, orbit: PeriodicOrbit) -> None:
        """The branch through a motion, and all that it leads to."""
        self._follow(orbit.itinerary, orbit.unknowns)
        while self._queue:
            _, _, event = heapq.heappop(self._queue)
            for neighbour, unknowns in _neighbours(event):
                self._follow(neighbour, unknowns)
            if event.kind is Kind.FLIP:
                self._double(event)

    def index(self, itinerary: Itinerary, x: Array) -> int | None:
        """The number of the branch that the motion of x is on."""
        return next((i for i in range(len(self.branches)) if self._lies_on(i, itinerary, x)), None)

    def stable_orbit(self, i: int, position: float) -> PeriodicOrbit | None:
        """The stable motion of branch number i at a position."""
        path, stable = self.paths[i], self.branches[i].stable
        d = path[:, -1] - position
        for k in np.flatnonzero((stable[:-1] | stable[1:]) & (d[:-1] * d[1:] <= 0.0)):
            share = d[k] / (d[k] - d[k + 1]) if d[k] != d[k + 1] else 0.0
            times = path[k, :-1] + share * (path[k + 1, :-1] - path[k, :-1])
            itinerary = self.branches[i].itinerary
            found = at_parameters(itinerary, np.append(times, self.segment.at(np.array(position))))
            orbit = orbit_of(itinerary, found) if found is not None else None
            if orbit is not None and orbit.stable:
                return orbit
        return None

    def _lies_on(self, i: int, itinerary: Itinerary, x: Array) -> bool:
        like, path = self.branches[i].itinerary, self.paths[i]
        if itinerary.n != like.n or itinerary.m != like.m or len(path) < 2:
            return False
        a, chord = path[:-1], np.diff(path, axis=0)
        length = np.sum(chord**2, axis=1)
        problem = along(like, self.segment.start, self.segment.direction)
        position = float(self.segment.position(x[-2], x[-1]))
        for twin in _twins(itinerary, x, like, 0.0):
            y = np.tile(np.append(twin[:-2], position), (len(a), 1))
            y[:, :-1] += np.rint(a[:, :1] - y[:, :1])
            share = np.sum((y - a) * chord, axis=1) / length
            off = np.max(np.abs(y - a - share[:, None] * chord), axis=1)
            largest = np.maximum(LARGEST_TURN * np.max(np.abs(chord), axis=1), SAME_MOTION)
            for k in np.flatnonzero((share > -0.01) & (share < 1.01) & (off < largest)):
                found = between(problem, a[k], a[k] + chord[k], float(share[k]))
                if found is not None and np.max(np.abs(found - y[k])) < SAME_MOTION:
                    return True
        return False

    def _span(self, x: Array) -> tuple[float, float]:
        position = float(np.clip(self.segment.position(x[-2], x[-1]), 0.0, 1.0))
        return -position, 1.0 - position

    def _allowed(self, itinerary: Itinerary) -> bool:
        allowed = itinerary.n <= self.impacts and len(self.branches) < self.most
        if not allowed:
            self.left_out.add((itinerary.m, itinerary.walls.count(1), itinerary.walls.count(-1)))
        return allowed

    def _follow(self, itinerary: Itinerary, x: Array) -> None:
        if 1 not in itinerary.walls:  # never on Σ⁺: Π does not see it
            return
        itinerary, times = rotated(itinerary, x[:-2], itinerary.walls.index(1))
        x = np.append(times, x[-2:])
        if self.index(itinerary, x) is None and self._allowed(itinerary):
            rate = self.segment.direction
            self._keep(through(itinerary, x, (float(rate[0]), float(rate[1])), self._span(x), POINTS_ACROSS))

    def _double(self, event: Event) -> None:
        if not self._allowed(event.itinerary.doubled()):
            return
        rate = self.segment.direction
        found = doubled(event, (float(rate[0]), float(rate[1])), self._span(event.unknowns), POINTS_ACROSS)
        middle = found.orbit(len(found) // 2)
        if len(found) > 2 and self.index(middle.itinerary, middle.unknowns) is None:
            self._keep(found)

    def _keep(self, found: Branch) -> None:
        self.branches.append(found)
        times = found.times - found.times[:, :1] + np.unwrap(found.times[:, 0], period=1.0)[:, None]
        self.paths.append(np.column_stack([times, self.segment.position(found.delta, found.epsilon)]))
        for event in found.events:
            motion = event.itinerary, event.unknowns
            if not event.admissible:
                continue
            known = (each for each in self.events if each.kind is event.kind)
            if not any(same_motion(motion, (each.itinerary, each.unknowns)) for each in known):
                self.events.append(event)
                heapq.heappush(self._queue, (event.itinerary.n, next(self._order), event))


def _neighbours(event: Event) -> Iterator[tuple[Itinerary, Array]]:
    """The motions (itinerary, unknowns) whose branches pass an event."""
    yield event.itinerary, event.unknowns
    if event.impact is not None:
        yield event.itinerary.without(event.impact), np.delete(event.unknowns, event.impact)
