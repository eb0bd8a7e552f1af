"""Find all branches of periodic motions along a segment that flips and grazes connect with given motions, each once.

The search follows the branch of each given motion. At a flip it goes on to the branch of doubled period, and from the
start of a branch of doubled period back to the branch that has the flip. At a graze it goes on to the branch of the
motion with or without the grazing impact. A motion is on a known branch if it is a solution between two points of that
branch.
"""

import heapq
from collections.abc import Iterator
from itertools import count
from typing import Any

import numpy as np

from rattle.continuation.arclength import LARGEST_TURN, plane_scale, solve_normal_to_chord
from rattle.continuation.conditions import EventKind
from rattle.continuation.motions import Motion, MotionsOnSegment
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import Equations, PeriodicMotion, unknowns_counted_from_impact

#: Largest difference in an unknown between solutions that count as the same motion.
SAME_MOTION = 1e-7
#: Largest difference in a parameter between solutions that count as the same motion, in units of `plane_scale`.
SAME_PLACE = 1e-8


def motion_from_impact(motion: Motion, first: int) -> Motion:
    """Return a motion that begins at impact number `first`; all times are shifted so that it begins in [0, 1)."""
    itinerary, x = motion
    x = unknowns_counted_from_impact(itinerary, x, first)
    x[: len(itinerary.walls)] -= np.floor(x[0])
    return itinerary.with_first_impact(first), x


def is_same_motion(one: Motion, other: Motion) -> bool:
    """Return whether two solutions are the same motion at the same parameters; they may begin at different impacts."""
    (a, x), (b, y) = one, other
    apart = np.max(np.abs(x[a.n :] - y[b.n :]))
    if (a.m, sorted(a.walls)) != (b.m, sorted(b.walls)) or apart > SAME_PLACE * plane_scale(x[a.n]):
        return False
    return any(
        np.max(np.abs(twin[: a.n] - x[: a.n])) < SAME_MOTION for twin in _unknowns_with_same_wall_order(other, a, x[0])
    )


def _unknowns_with_same_wall_order(motion: Motion, like: Equations, phase: float) -> Iterator[Array]:
    """Yield the unknowns of a motion for each choice of first impact that gives the same order of walls as `like`.

    Yields
    ------
    Array
        The unknowns, with all times shifted by whole forcing periods so that the first time is nearest to `phase`.
    """
    impacts = len(motion[0].walls)
    for first in range(impacts):
        itinerary, x = motion_from_impact(motion, first)
        if itinerary.walls == like.walls:
            x[:impacts] += np.rint(phase - x[0])
            yield x


class BranchSearch:
    """A search for branches: the branches found so far, their events, and a queue of events to examine.

    branches: the branches found so far. events: the admissible events on these branches.
    paths: for each branch an array with a row for each of its points: the motion's unknowns, then the position on the
    segment. From row to row the times change continuously: they do not jump by 1 where a phase passes 0.
    left_out: the labels of motions that exceed the limits on impacts or branches.
    """

    def __init__(self, model: MotionsOnSegment, impacts: int, most: int) -> None:
        """Limit the search to motions with at most `impacts` impacts per period, and to `most` branches."""
        self.model, self.impacts, self.most = model, impacts, most
        self.branches: list[Any] = []
        self.events: list[Any] = []
        self.left_out: set[tuple[int, int, int]] = set()
        self.paths: list[Array] = []
        self._queue: list[tuple[int, int, Any]] = []
        self._order = count()

    def add_connected_branches(self, motion: Motion) -> None:
        """Add the branch that contains a motion, and all branches that flips and grazes connect with it."""
        self._add_branch_through(motion)
        while self._queue:
            _, _, event = heapq.heappop(self._queue)
            for neighbour in self.model.motions_at_event(event):
                self._add_branch_through(neighbour)
            if event.kind is EventKind.FLIP:
                self._add_doubled_branch(event)

    def known_branch_index(self, motion: Motion) -> int | None:
        """Return the index in `branches` of the branch that contains a motion; None if no known branch does."""
        return next((i for i in range(len(self.branches)) if self._is_on_branch(i, motion)), None)

    def find_stable_motion(self, i: int, position: float) -> PeriodicMotion | None:
        """Return the stable motion of branch number i at a position along the segment; None if there is none."""
        path, stable = self.paths[i], self.branches[i].stable
        d = path[:, -1] - position
        for k in np.flatnonzero((stable[:-1] | stable[1:]) & (d[:-1] * d[1:] <= 0.0)):
            share = d[k] / (d[k] - d[k + 1]) if d[k] != d[k + 1] else 0.0
            guess = path[k, :-1] + share * (path[k + 1, :-1] - path[k, :-1])
            orbit = self.model.solve_motion(self.branches[i].itinerary, np.append(guess, position))
            if orbit is not None and orbit.stable:
                return orbit
        return None

    def _is_on_branch(self, i: int, motion: Motion) -> bool:
        """Return whether a motion is on branch number i."""
        itinerary, x = motion
        like, path = self.branches[i].itinerary, self.paths[i]
        if itinerary.n != like.n or itinerary.m != like.m or len(path) < 2:
            return False
        a, chord, impacts = path[:-1], np.diff(path, axis=0), len(itinerary.walls)
        length = np.sum(chord**2, axis=1)
        problem = self.model.equations_along_segment(like)
        position = float(self.model.segment.position(x[itinerary.n :]))
        for twin in _unknowns_with_same_wall_order(motion, like, 0.0):
            y = np.tile(np.append(twin[: itinerary.n], position), (len(a), 1))
            y[:, :impacts] += np.rint(a[:, :1] - y[:, :1])
            share = np.sum((y - a) * chord, axis=1) / length
            off = np.max(np.abs(y - a - share[:, None] * chord), axis=1)
            largest = np.maximum(LARGEST_TURN * np.max(np.abs(chord), axis=1), SAME_MOTION)
            for k in np.flatnonzero((share > -0.01) & (share < 1.01) & (off < largest)):
                found = solve_normal_to_chord(problem, a[k], a[k] + chord[k], float(share[k]))
                if found is not None and np.max(np.abs(found - y[k])) < SAME_MOTION:
                    return True
        return False

    def _span_around(self, parameters: Array) -> tuple[float, float]:
        """Return the positions of the segment's ends relative to the position of a point with these parameters."""
        position = float(np.clip(self.model.segment.position(parameters), 0.0, 1.0))
        return -position, 1.0 - position

    def _check_limits_or_leave_out(self, itinerary: Equations) -> bool:
        """Return whether a new branch with this itinerary is within the limits; if not, add its label to `left_out`."""
        allowed = len(itinerary.walls) <= self.impacts and len(self.branches) < self.most
        if not allowed:
            self.left_out.add(itinerary.label)
        return allowed

    def _add_branch_through(self, motion: Motion) -> None:
        """Add the branch that contains a motion, unless it is known, exceeds the limits or never meets Σ⁺."""
        if 1 not in motion[0].walls:  # the motion never meets Σ⁺, so it is not an orbit of the impact map Π
            return
        itinerary, x = motion_from_impact(motion, motion[0].walls.index(1))
        if self.known_branch_index((itinerary, x)) is None and self._check_limits_or_leave_out(itinerary):
            self._add_branch(self.model.follow_branch((itinerary, x), self._span_around(x[itinerary.n :])))

    def _add_doubled_branch(self, event: Any) -> None:
        """Add the doubled branch that starts at a flip, unless it is known or exceeds the limits."""
        if not self._check_limits_or_leave_out(event.itinerary.with_doubled_period()):
            return
        found = self.model.follow_doubled_branch(event, self._span_around(event.unknowns[event.itinerary.n :]))
        if len(found) > 2 and self.known_branch_index(found.motion(len(found) // 2)) is None:
            self._add_branch(found)

    def _add_branch(self, found: Any) -> None:
        """Add a branch to the known branches, and put its new admissible events into the queue."""
        self.branches.append(found)
        self.paths.append(np.column_stack([found.unwrapped_times, self.model.segment.position(found.parameters)]))
        for event in self.model.events_of(found):
            motion = event.itinerary, event.unknowns
            if not event.admissible:
                continue
            known = (each for each in self.events if each.kind is event.kind)
            if not any(is_same_motion(motion, (each.itinerary, each.unknowns)) for each in known):
                self.events.append(event)
                heapq.heappush(self._queue, (len(event.itinerary.walls), next(self._order), event))
