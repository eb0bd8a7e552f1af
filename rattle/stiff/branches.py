"""Branches of periodic motions of the stiff gear in δ, ε or κ^(−1/2), and the saddle-nodes and flips on them.

A motion that grazes goes on smoothly with one contact more or less, so a branch of one itinerary ends there.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.arclength import CLOSED, Bound, Follower, Path, Problem, located, tangent_at
from rattle.bifurcations import Kind, condition
from rattle.errors import RattleError, require, require_integer, require_pair
from rattle.impact_equations import Array
from rattle.stiff.equations import StiffItinerary
from rattle.stiff.motion import LONGEST, StiffOrbit, admissible, orbit_of, softness, trace_of

POINTS_ACROSS = 50  # at least, over the span
MOST_POINTS = 1000
LEAST_DAMPING = 1e-3  # of the orbit's, to which a branch may go
LOST = "is lost"  # what ends a branch at a graze
PARAMETERS = ("delta", "epsilon", "kappa")


class StiffEvent(NamedTuple):
    """A saddle-node (SN) or flip (PD) on a branch: the motion there, and the number of the branch's point before it, at
    a saddle-node of the point that it is.
    """

    kind: Kind
    orbit: StiffOrbit
    point: int


@dataclass(frozen=True)
class StiffBranch:
    """A branch of motions with one itinerary in one parameter: its k points in order, each a solution.

    unknowns (k, 2c + 3): times, durations times √(2κ), δ, ε and κ^(−1/2)/√2. multipliers (2, k). start: the point it
    was followed from. events: in the order of the branch. ends: why it ends, at its first and its last point.
    """

    walls: tuple[int, ...]
    m: int
    beta: float
    unknowns: Array
    multipliers: NDArray[np.complex128]
    start: int
    events: tuple[StiffEvent, ...]
    ends: tuple[str, str]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.unknowns)

    @property
    def delta(self) -> Array:
        """Damping (k,)."""
        return self.unknowns[:, -3]

    @property
    def epsilon(self) -> Array:
        """Eccentricity (k,)."""
        return self.unknowns[:, -2]

    @property
    def kappa(self) -> Array:
        """Stiffness (k,)."""
        return np.asarray(0.5 / self.unknowns[:, -1] ** 2)

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether the motion attracts (k,)."""
        return np.abs(self.multipliers[0]) < 1.0

    def orbit(self, index: int) -> StiffOrbit:
        """The motion at one point."""
        x = self.unknowns[index]
        return orbit_of(StiffItinerary(self.walls, self.m, self.beta, float(x[-1])), x[:-1])

    def crossings(self, index: int, value: float) -> list[tuple[int, Array]]:
        """Where the parameter number `index` of the branch (−3, −2, −1: δ, ε, κ^(−1/2)/√2) has this value: the point
        before, and the unknowns (2c + 3,).
        """
        found, at = list[tuple[int, Array]](), self.unknowns[:, index] - value
        line = _Line(self.walls, self.m, self.beta, self.unknowns[0, -3:], _direction(index))
        for k in range(len(self) - 1):
            if (at[k] < 0) != (at[k + 1] < 0):
                a, b = (line.parameter(x) for x in self.unknowns[k : k + 2])
                y = located(line.problem, a, b, lambda y: line.plane(y)[index] - value)
                if y is not None:
                    found.append((k, line.plane(y)))
        return found


@dataclass(frozen=True)
class _Line:
    """(δ, ε, p) = origin + s direction, and the motions of one itinerary on it: y = (times, durations, s)."""

    walls: tuple[int, ...]
    m: int
    beta: float
    origin: Array
    direction: Array

    def plane(self, y: NDArray) -> NDArray:
        """All unknowns (…, 2c + 3) at y."""
        return np.concatenate([y[..., :-1], self.origin + y[..., -1:] * self.direction], axis=-1)

    def parameter(self, x: Array) -> Array:
        """y of unknowns (2c + 3,) on the line."""
        return np.append(x[:-3], (x[-3:] - self.origin) @ self.direction / (self.direction @ self.direction))

    def itinerary(self, y: Array) -> StiffItinerary:
        """The itinerary with the stiffness at y."""
        return StiffItinerary(self.walls, self.m, self.beta, float(self.plane(y)[-1]))

    @property
    def problem(self) -> Problem:
        """The equations along the line."""
        any_softness = StiffItinerary(self.walls, self.m, self.beta, 0.0)

        def equations(y: NDArray) -> NDArray:
            x = self.plane(y)
            return any_softness.residual_at(x[..., :-1], x[..., -1:])

        return Problem(equations)

    def happens(self, y: Array) -> bool:
        """Whether the motion of a solution does."""
        x = self.plane(y)
        return bool(x[-1] > 0.0) and admissible(self.itinerary(y), x[:-1])

    def flip(self, y: Array) -> float:
        """Trace + 1 + e^(−δm), which vanishes at a flip."""
        x = self.plane(y)
        return trace_of(self.itinerary(y), x[:-1]) + 1.0 + float(np.exp(-x[-3] * self.m))


def _direction(index: int) -> Array:
    direction = np.zeros(3)
    direction[index] = 1.0
    return direction


def stiff_branch(
    orbit: StiffOrbit,
    parameter: str = "epsilon",
    span: tuple[float, float] | None = None,
    resolution: int = POINTS_ACROSS,
) -> StiffBranch:
    """The branch of a periodic motion in "epsilon", "delta" or "kappa", both ways from it, while it happens.

    span: (low, high) of the parameter around the orbit, by default 0.02 either way, or κ/10 to 10κ. resolution: points
    over the span, at least. Raises ParameterError, and RattleError if the orbit is no solution.
    """
    require(isinstance(orbit, StiffOrbit), f"orbit must be a StiffOrbit, got {type(orbit).__name__}")
    require(parameter in PARAMETERS, f"parameter must be one of {', '.join(PARAMETERS)}, got {parameter!r}")
    resolution = require_integer("resolution", resolution, 1, MOST_POINTS)
    index = PARAMETERS.index(parameter)
    here = np.array([orbit.delta, orbit.epsilon, softness(orbit.kappa)])
    if parameter == "kappa":
        low, high = (orbit.kappa / 10, orbit.kappa * 10) if span is None else require_pair("span", span)
        require(0.0 < low < high, f"span of kappa must be (low, high) above 0, got {span!r}")
        low, high = softness(high), softness(low)
    else:
        at = float(here[index])
        low, high = (at - 0.02, at + 0.02) if span is None else require_pair("span", span)
        low = max(low, LEAST_DAMPING * at if parameter == "delta" else 0.0)
    require(low <= here[index] <= high and low < high, f"span must be (low, high) around the orbit, got {span!r}")
    line = _Line(orbit.walls, orbit.m, orbit.beta, here, _direction(index))
    return _both_ways(line, np.append(orbit.unknowns[:-2], 0.0), (low - here[index], high - here[index]), resolution)


def _both_ways(line: _Line, start: Array, span: tuple[float, float], resolution: int) -> StiffBranch:
    step = (span[1] - span[0]) / resolution

    def longest(tangent: Array) -> float:
        return min(LONGEST, step / max(abs(float(tangent[-1])), 1e-12))

    if not line.happens(start):
        raise RattleError("the motion does not happen at its own parameters: take it from stiff_orbit or from_limit")
    follower = Follower(line.problem, (Bound(-1, *span),), line.happens, longest)
    rising = np.zeros(start.size)
    rising[-1] = 1.0
    tangent = tangent_at(line.problem, start, rising)
    on = follower.follow(start, tangent, MOST_POINTS)
    if on.closed:
        return _built(line, on.points, on.tangents, 0, (CLOSED, CLOSED))
    back = follower.follow(start, -tangent, MOST_POINTS)
    points = np.concatenate([back.points[:0:-1], on.points])
    tangents = np.concatenate([-back.tangents[:0:-1], on.tangents])
    return _built(line, points, tangents, len(back.points) - 1, (_end(line, back, span), _end(line, on, span)))


def _end(line: _Line, path: Path, span: tuple[float, float]) -> str:
    """Why a path ends."""
    if path.outside is None:
        return "followed far enough" if len(path.points) >= MOST_POINTS else "the equations become singular"
    if not span[0] <= path.outside[-1] <= span[1]:
        return "span"
    c = len(line.walls)
    shortest = int(np.argmin(path.points[-1, c : 2 * c]))
    grazes = path.points[-1, c + shortest] < 1e-2
    if grazes:
        return f"graze: contact {shortest} with {_name(line.walls[shortest])} {LOST}"
    return "graze: a contact is made"


def _name(wall: int) -> str:
    return "Σ⁺" if wall > 0 else "Σ⁻"


def _built(line: _Line, points: Array, tangents: Array, start: int, ends: tuple[str, str]) -> StiffBranch:
    """The branch through solutions, with its saddle-nodes among the points."""
    problem = line.problem
    folds = np.flatnonzero((tangents[:-1, -1] < 0) != (tangents[1:, -1] < 0))
    marked: list[tuple[int, Kind]] = []
    for k in folds[::-1].tolist():
        a, b = points[k], points[k + 1]
        y = located(problem, a, b, _fold(problem, a, b))
        if y is not None:
            points = np.insert(points, k + 1, y, axis=0)
            start += int(k < start)
            marked = [(k + 1, Kind.SADDLE_NODE), *((i + 1, kind) for i, kind in marked)]
    flips = np.array([line.flip(y) for y in points])
    events = [StiffEvent(kind, _orbit(line, points[i]), i) for i, kind in marked]
    for i in np.flatnonzero((flips[:-1] < 0) != (flips[1:] < 0)).tolist():
        y = located(problem, points[i], points[i + 1], line.flip)
        if y is not None:
            events.append(StiffEvent(Kind.FLIP, _orbit(line, y), i))
    orbits = [_orbit(line, y) for y in points]
    return StiffBranch(
        line.walls,
        line.m,
        line.beta,
        np.array([line.plane(y) for y in points]),
        np.array([orbit.multipliers for orbit in orbits]).T,
        start,
        tuple(sorted(events, key=lambda event: event.point)),
        ends,
    )


def _orbit(line: _Line, y: Array) -> StiffOrbit:
    return orbit_of(line.itinerary(y), line.plane(y)[:-1])


def _fold(problem: Problem, a: Array, b: Array) -> Callable[[Array], float]:
    """The rate of the parameter along the branch from a to b."""
    return lambda y: float(tangent_at(problem, y, b - a)[-1])


def stiff_curve(
    event: StiffEvent, delta: tuple[float, float], epsilon: tuple[float, float], resolution: int = 60
) -> Array:
    """The saddle-node or flip curve through an event at fixed κ: points (k, 2c + 2), δ and ε last, while the motion
    happens in the window of δ and ε (low, high); resolution: points across it, at least. Raises ParameterError.
    """
    require(isinstance(event, StiffEvent), f"event must be a StiffEvent, got {type(event).__name__}")
    from rattle.curves.following import Window, pieces

    window = Window(require_pair("delta", delta), require_pair("epsilon", epsilon), resolution)
    itinerary = event.orbit.itinerary

    def left(x: Array) -> str | None:
        return None if admissible(itinerary, x) else "the motion does not happen"

    found = pieces(condition(itinerary, event.kind), [event.orbit.unknowns], window, left, itinerary.contacts)
    if not found:
        raise RattleError("the event is outside the window, or no solution: choose delta and epsilon around it")
    return found[0].points
