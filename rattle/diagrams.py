"""One-parameter bifurcation diagrams along any segment of the (δ, ε) plane: branches, their events, and the attractors
that sweeps forward and backward see (paper, Figures 5 and 9).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors import PERIODIC, Attractors, attractors_of
from rattle.branch_search import Search, Segment
from rattle.branches import Branch
from rattle.errors import RattleError, require, require_integer, require_number, require_pair
from rattle.events import Event
from rattle.flight import wrapped
from rattle.orbits import NAMES, period_one
from rattle.periodic import PeriodicOrbit, at_parameters, follow_impacts, orbit_of
from rattle.sweeps import Known, Points, Sweeps

LEAST_LENGTH = 1e-6
MOST_STEPS = 20_000
LARGEST_PERIOD, MOST_BRANCHES = 64, 1000
CHAOTIC_POINTS = 200
CHECKED = 10  # one in so many steps of an attractor that seems to stay on its branch
JUMP = 0.05  # in phase or speed between steps
SAME_ORBIT = 1e-6
ROUNDS = 3  # of branches that lead to attractors and back
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """A stable part of branch number `branch`, between positions low and high."""

    branch: int
    low: float
    high: float


@dataclass(frozen=True)
class Diagram:
    """A bifurcation diagram from start to end, both (δ, ε), at half-backlash beta (dimensionless).

    position, delta, epsilon (n,): the steps, position as the fraction of the way. branches: A to D and all other
    P(m, n₊, n₋) that were found, each once, with stable and admissible parts flagged; events: all that happen on them,
    each once. points: the attractors followed forward and backward. sampled: what a sample of initial conditions finds
    at each step, quiet motion too (cell is the step). small: stable parts that no sample found, for their basins are
    small or they fit between two steps. left_out: labels met but not followed as branches, beyond the limits.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    beta: float
    position: Array
    delta: Array
    epsilon: Array
    branches: tuple[Branch, ...]
    events: tuple[Event, ...]
    points: Points
    sampled: Attractors
    small: tuple[Piece, ...]
    left_out: tuple[tuple[int, int, int], ...]

    def positions(self, of: Branch | Event) -> Array:
        """Where the points of a branch (k,), or an event (), are on the way from start to end."""
        return Segment(np.array(self.start), np.array(self.end)).position(of.delta, of.epsilon)


def diagram(
    start: ArrayLike,
    end: ArrayLike,
    beta: float = 0.6,
    steps: int = 400,
    count: int = 64,
    v_max: float = 7.0,
    impacts: int = 8,
    most: int = 100,
    seed: int = 0,
) -> Diagram:
    """The bifurcation diagram along the segment from start to end, both (δ, ε) with δ > 0 and ε ≥ 0.

    steps: intervals between the parameter values of the sweeps. count, v_max, seed: the sample at each of them, as in
    `Gear.attractors`. impacts: branches have at most so many per period, on both walls; most: and so many branches
    there are at most; what is beyond is named in left_out. Deterministic. Raises ParameterError.
    """
    segment = Segment(*(_end(name, value) for name, value in (("start", start), ("end", end))))
    length = float(np.hypot(*segment.direction))
    require(length > LEAST_LENGTH, f"start and end must be further apart than {LEAST_LENGTH:g}, they are {length:g}")
    beta = require_number("beta", beta, positive=True)
    steps = require_integer("steps", steps, 1, MOST_STEPS)
    impacts = require_integer("impacts", impacts, 1, LARGEST_PERIOD)
    most = require_integer("most", most, 1, MOST_BRANCHES)
    position = np.linspace(0.0, 1.0, steps + 1)
    delta, epsilon = segment.at(position)
    sampled = attractors_of(delta, epsilon, beta, count, v_max, seed)
    sweeps, search = Sweeps(delta, epsilon, np.full_like(delta, beta), sampled), Search(segment, impacts, most)
    for orbit in _period_one(delta, epsilon, beta):
        search.add(orbit)
    small: list[Piece] = []
    for _ in range(ROUNDS):
        sweeps.run()
        for orbit in _seen(sweeps, delta, epsilon, beta, search):
            search.add(orbit)
        small, new = _unseen(sweeps, search, position)
        if not new:
            break
    branches = [found for found in search.branches if found.admissible.any()]
    number = {id(found): i for i, found in enumerate(branches)}
    small = [Piece(number[id(search.branches[at.branch])], at.low, at.high) for at in small]
    return Diagram(
        (float(segment.start[0]), float(segment.start[1])),
        (float(segment.end[0]), float(segment.end[1])),
        beta,
        position,
        delta,
        epsilon,
        tuple(branches),
        tuple(sorted(search.events, key=lambda event: float(segment.position(event.delta, event.epsilon)))),
        sweeps.points(position, CHAOTIC_POINTS),
        sampled,
        tuple(small),
        tuple(sorted(search.left_out)),
    )


def names(branch: Branch) -> tuple[str, ...]:
    """A, B, C or D for every point of a period-one branch, "" for the points of any other.

    A and B are the saddles with a multiplier above 1; at saddle-nodes they become C and D.
    """
    pair = {(1, 1, 0): "CA", (1, 1, 1): "BD"}.get(branch.label)
    if pair is None:
        return ("",) * len(branch)
    unknowns = np.column_stack([branch.times, branch.delta, branch.epsilon])
    index = np.linalg.det(branch.itinerary.jacobian(unknowns))  # 0 at saddle-nodes, finite at grazes
    return tuple(pair[int(above)] for above in index > 0.0)


def _end(name: str, value: ArrayLike) -> Array:
    delta, epsilon = require_pair(name, value)
    return np.array([require_number(f"δ of {name}", delta, positive=True), require_number(f"ε of {name}", epsilon)])


def _runs(steps: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rising numbers cut where they are not consecutive."""
    return np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if steps.size else []


def _period_one(delta: Array, epsilon: Array, beta: float) -> Iterator[PeriodicOrbit]:
    """A to D: one of each wherever they begin or end to exist."""
    found = period_one(delta, epsilon, beta)
    for i in range(len(NAMES)):
        for run in _runs(np.flatnonzero(found.exists[i])):
            k = run[run.size // 2]
            yield from _orbit(delta[k], epsilon[k], beta, float(found.tau[i, k]), float(found.v[i, k]), 1)


def _orbit(delta: float, epsilon: float, beta: float, tau: float, v: float, n_plus: int) -> Iterator[PeriodicOrbit]:
    """The periodic motion of a state that is on it, if rounding lets it be one."""
    try:
        itinerary, x = follow_impacts(float(delta), float(epsilon), beta, tau, v, n_plus)
    except RattleError:
        return
    solved = at_parameters(itinerary, x)
    if solved is not None:
        yield orbit_of(itinerary, solved)


def _seen(sweeps: Sweeps, delta: Array, epsilon: Array, beta: float, search: Search) -> Iterator[PeriodicOrbit]:
    """Periodic attractors of the sweeps: all that are short enough, some where they go on from step to step."""
    last: dict[tuple[int, int, int], list[tuple[int, Known]]] = {}
    for step, here in enumerate(sweeps.known):
        now: dict[tuple[int, int, int], list[tuple[int, Known]]] = {}
        for known in here:
            if known.kind != PERIODIC:
                continue
            m, n_plus, n_minus = known.label
            if n_plus + n_minus > search.impacts:
                search.left_out.add((m, n_plus, n_minus))
                continue
            near = [age for age, before in last.get(known.label, []) if _close(known, before)]
            age = near[0] + 1 if near else 0
            now.setdefault(known.label, []).append((age, known))
            if age % CHECKED == 0:
                yield from _orbit(delta[step], epsilon[step], beta, known.tau, known.v, n_plus)
        last = now


def _close(one: Known, other: Known) -> bool:
    return abs(wrapped(one.tau - other.tau)) < JUMP and abs(one.v - other.v) < JUMP


def _unseen(sweeps: Sweeps, search: Search, position: Array) -> tuple[list[Piece], bool]:
    """The stable parts of branches that no sample found, and whether the sweeps missed one of their motions at a step;
    they know it from here on.
    """
    small, new = [], False
    for piece, inside, tau, v in _stable_pieces(search, position):
        sampled = False
        for step, phases, speeds in zip(inside, tau, v, strict=True):
            label = search.branches[piece.branch].label
            match = _nearest(sweeps.known[step], label, phases, speeds, JUMP)
            if match is None:
                orbit = search.stable_orbit(piece.branch, float(position[step]))
                if orbit is None:
                    continue
                upper = np.array(orbit.walls) > 0
                match = _nearest(sweeps.known[step], label, orbit.times[upper], orbit.speeds[upper], SAME_ORBIT)
                if match is None:
                    sweeps.known[step].append(Known(PERIODIC, label, orbit.tau, orbit.v, sampled=False))
                    new = True
            sampled |= match is not None and match.sampled
        if not sampled:
            small.append(piece)
    return small, new


def _stable_pieces(search: Search, position: Array) -> Iterator[tuple[Piece, NDArray[np.int64], Array, Array]]:
    """Stable parts of branches with the steps inside, and about where their impacts on Σ⁺ are there (steps, n_plus)."""
    for i, found in enumerate(search.branches):
        upper = np.flatnonzero(np.array(found.itinerary.walls) > 0)
        at, times = search.paths[i][:, -1], search.paths[i][:, :-1]
        events = {event.after: float(search.segment.position(event.delta, event.epsilon)) for event in found.events}
        for run in _runs(np.flatnonzero(found.stable)):
            low, high = sorted((events.get(int(run[0]) - 1, float(at[run[0]])), events.get(int(run[-1]), at[run[-1]])))
            inside = np.flatnonzero((position >= low) & (position <= high))
            order = run[np.argsort(at[run])]
            tau, v = (
                np.array([np.interp(position[inside], at[order], x[order, j]) for j in upper]).T
                for x in (times, found.speeds)
            )
            yield Piece(i, low, float(high)), inside, tau, v


def _nearest(known: list[Known], label: tuple[int, int, int], tau: Array, v: Array, within: float) -> Known | None:
    """The attractor with this label that has a state so near to one of the impacts (n_plus,)."""
    for each in known:
        near = np.abs(wrapped(tau - each.tau)) + np.abs(v - each.v)
        if each.kind == PERIODIC and each.label == label and near.min() < within:
            return each
    return None
