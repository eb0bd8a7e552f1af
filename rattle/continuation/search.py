"""Search for all branches of periodic motions along a segment that are connected by flips and grazes, each once.

The search follows the branch of each given motion. At a flip it goes on to the doubled branch; from a doubled branch it
goes on to the branch at whose flip it starts. At a graze it goes on to the branch of the motion with or without the
grazing impact. A motion is on a known branch if it is a solution between two points of that branch.
"""

import heapq
from collections.abc import Iterator
from itertools import count
from typing import Any

import numpy as np

from rattle.continuation.arclength import LARGEST_TURN, plane_scale, solution_above_chord
from rattle.continuation.conditions import Kind
from rattle.continuation.motions import Motion, Motions
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic import Equations, Periodic, begun_at

#: Largest difference in an unknown between solutions that count as the same motion.
SAME_MOTION = 1e-7
#: Largest difference in a parameter between solutions that count as the same motion, in units of `plane_scale`.
SAME_PLACE = 1e-8


def begun_at_impact(motion: Motion, first: int) -> Motion:
    """Return a motion in the form that begins at impact number `first`, with the time of this impact in [0, 1)."""
    itinerary, x = motion
    x = begun_at(itinerary, x, first)
    x[: len(itinerary.walls)] -= np.floor(x[0])
    return itinerary.begun_at(first), x


def same_motion(one: Motion, other: Motion) -> bool:
    """Return whether two solutions are the same motion at the same parameters; they may begin at different impacts."""
    (a, x), (b, y) = one, other
    apart = np.max(np.abs(x[a.n :] - y[b.n :]))
    if (a.m, sorted(a.walls)) != (b.m, sorted(b.walls)) or apart > SAME_PLACE * plane_scale(x[a.n]):
        return False
    return any(np.max(np.abs(twin[: a.n] - x[: a.n])) < SAME_MOTION for twin in _twins(other, a, x[0]))


def _twins(motion: Motion, like: Equations, phase: float) -> Iterator[Array]:
    """Yield all equivalent unknowns of a motion that meet the walls in the order of `like` and begin near `phase`."""
    impacts = len(motion[0].walls)
    for first in range(impacts):
        itinerary, x = begun_at_impact(motion, first)
        if itinerary.walls == like.walls:
            x[:impacts] += np.rint(phase - x[0])
            yield x


class Search:
    """The branches and events found so far, and the queue of events that are not yet examined.

    paths: for each branch its points (unknowns, position), with times that are not folded into one period.
    left_out: the labels of motions that exceed the limits on impacts or branches.
    """

    def __init__(self, model: Motions, impacts: int, most: int) -> None:
        """Limit the search to motions with at most `impacts` impacts per period, and to `most` branches."""
        self.model, self.impacts, self.most = model, impacts, most
        self.branches: list[Any] = []
        self.events: list[Any] = []
        self.left_out: set[tuple[int, int, int]] = set()
        self.paths: list[Array] = []
        self._queue: list[tuple[int, int, Any]] = []
        self._order = count()

    def add(self, motion: Motion) -> None:
        """Add the branch through a motion, and all branches that are connected with it."""
        self._follow(motion)
        while self._queue:
            _, _, event = heapq.heappop(self._queue)
            for neighbour in self.model.beside(event):
                self._follow(neighbour)
            if event.kind is Kind.FLIP:
                self._double(event)

    def index(self, motion: Motion) -> int | None:
        """Return the number of the branch that a motion is on, or None."""
        return next((i for i in range(len(self.branches)) if self._lies_on(i, motion)), None)

    def stable_orbit(self, i: int, position: float) -> Periodic | None:
        """Return the stable motion of branch number i at a position, or None."""
        path, stable = self.paths[i], self.branches[i].stable
        d = path[:, -1] - position
        for k in np.flatnonzero((stable[:-1] | stable[1:]) & (d[:-1] * d[1:] <= 0.0)):
            share = d[k] / (d[k] - d[k + 1]) if d[k] != d[k + 1] else 0.0
            guess = path[k, :-1] + share * (path[k + 1, :-1] - path[k, :-1])
            orbit = self.model.solved(self.branches[i].itinerary, np.append(guess, position))
            if orbit is not None and orbit.stable:
                return orbit
        return None

    def _lies_on(self, i: int, motion: Motion) -> bool:
        """Return whether a motion is on branch number i."""
        itinerary, x = motion
        like, path = self.branches[i].itinerary, self.paths[i]
        if itinerary.n != like.n or itinerary.m != like.m or len(path) < 2:
            return False
        a, chord, impacts = path[:-1], np.diff(path, axis=0), len(itinerary.walls)
        length = np.sum(chord**2, axis=1)
        problem = self.model.problem(like)
        position = float(self.model.segment.position(x[itinerary.n :]))
        for twin in _twins(motion, like, 0.0):
            y = np.tile(np.append(twin[: itinerary.n], position), (len(a), 1))
            y[:, :impacts] += np.rint(a[:, :1] - y[:, :1])
            share = np.sum((y - a) * chord, axis=1) / length
            off = np.max(np.abs(y - a - share[:, None] * chord), axis=1)
            largest = np.maximum(LARGEST_TURN * np.max(np.abs(chord), axis=1), SAME_MOTION)
            for k in np.flatnonzero((share > -0.01) & (share < 1.01) & (off < largest)):
                found = solution_above_chord(problem, a[k], a[k] + chord[k], float(share[k]))
                if found is not None and np.max(np.abs(found - y[k])) < SAME_MOTION:
                    return True
        return False

    def _span(self, parameters: Array) -> tuple[float, float]:
        """Return the positions of the segment's ends relative to the position of a point with these parameters."""
        position = float(np.clip(self.model.segment.position(parameters), 0.0, 1.0))
        return -position, 1.0 - position

    def _allowed(self, itinerary: Equations) -> bool:
        """Return whether a new branch is within the limits; if not, record its label."""
        allowed = len(itinerary.walls) <= self.impacts and len(self.branches) < self.most
        if not allowed:
            self.left_out.add(itinerary.label)
        return allowed

    def _follow(self, motion: Motion) -> None:
        """Add the branch through a motion, unless it is known."""
        if 1 not in motion[0].walls:  # the motion never meets Σ⁺, so it is not an orbit of the impact map Π
            return
        itinerary, x = begun_at_impact(motion, motion[0].walls.index(1))
        if self.index((itinerary, x)) is None and self._allowed(itinerary):
            self._keep(self.model.through((itinerary, x), self._span(x[itinerary.n :])))

    def _double(self, event: Any) -> None:
        """Add the doubled branch that starts at a flip, unless it is known."""
        if not self._allowed(event.itinerary.doubled()):
            return
        found = self.model.doubled(event, self._span(event.unknowns[event.itinerary.n :]))
        if len(found) > 2 and self.index(found.motion(len(found) // 2)) is None:
            self._keep(found)

    def _keep(self, found: Any) -> None:
        """Keep a branch, and put its new admissible events into the queue."""
        self.branches.append(found)
        self.paths.append(np.column_stack([found.unfolded, self.model.segment.position(found.parameters)]))
        for event in self.model.events(found):
            motion = event.itinerary, event.unknowns
            if not event.admissible:
                continue
            known = (each for each in self.events if each.kind is event.kind)
            if not any(same_motion(motion, (each.itinerary, each.unknowns)) for each in known):
                self.events.append(event)
                heapq.heappush(self._queue, (len(event.itinerary.walls), next(self._order), event))
