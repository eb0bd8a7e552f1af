"""Follow a bifurcation of a periodic motion through a window of the (δ, ε) plane, both ways from a solution."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rattle.arclength import CLOSED, Bound, Follower, Path, Problem, located, tangent_at, with_value
from rattle.curves.curve import Curve, Described, Piece, build, crossings
from rattle.numerics.complex_step import Array

LONGEST = 0.05  # of a step, in times
SAME_SOLUTION = 1e-7
POINTS_ACROSS = 60  # at least, over the width of the window

Test = Callable[[Array], str | None]


@dataclass(frozen=True)
class Window:
    """A rectangle of the plane: (low, high) of δ and of ε, and the least number of points of a curve across it."""

    delta: tuple[float, float]
    epsilon: tuple[float, float]
    resolution: int = POINTS_ACROSS

    @property
    def bounds(self) -> tuple[Bound, Bound]:
        """Of the last two unknowns."""
        return Bound(-2, *self.delta), Bound(-1, *self.epsilon)

    def left(self, x: Array) -> str | None:
        """Which side of the window a point is beyond: None if it is inside."""
        limits = zip(("delta", "epsilon"), (bound.crossed(x) for bound in self.bounds), strict=True)
        return next((f"window: {name} = {limit:g}" for name, limit in limits if limit is not None), None)

    def step(self, tangent: Array) -> float:
        """The longest step along a unit tangent."""
        sizes = (self.delta[1] - self.delta[0], self.epsilon[1] - self.epsilon[0])
        rates = [self.resolution * abs(rate) / size for rate, size in zip(tangent[-2:], sizes, strict=True)]
        return 1.0 / max(*rates, float(np.max(np.abs(tangent[:-2]))) / LONGEST)


def pieces(
    problem: Problem, starts: Iterable[Array], window: Window, left: Test, times: int | None = None
) -> list[Piece]:
    """The pieces inside the window through solutions near the starts; a start on a piece already followed adds none.

    left: why a solution in the window is not on the curve (its motion does not happen), None if it is. times: how many
    unknowns are times, by default all but δ and ε.
    """
    found: list[Piece] = []
    twins = partial(_periods_later, times)
    follower = Follower(problem, window.bounds, lambda x: left(x) is None, window.step, twins)
    for guess in starts:
        x = with_value(problem, guess, guess.size - 2, guess[-2])
        if x is None or not follower.inside(x) or any(_on(problem, piece, x, times) for piece in found):
            continue
        found.append(_both_ways(follower, x, lambda y: window.left(y) or left(y)))
    return sorted(found, key=lambda piece: (piece.points[0, -2], piece.points[0, -1]))


def _periods_later(times: int | None, start: Array, x: Array) -> Array:
    """The same motion some forcing periods earlier or later, near x."""
    twin = start.copy()
    twin[: -2 if times is None else times] += np.rint(x[0] - start[0])
    return twin[None]


def _on(problem: Problem, piece: Piece, x: Array, times: int | None) -> bool:
    """Whether a solution is on a piece already, some forcing periods earlier or later perhaps."""
    found = crossings(problem, piece.points, -2, x[-2])
    return any(np.max(np.abs(_periods_later(times, x, y)[0] - y)) < SAME_SOLUTION for y in found)


def _both_ways(follower: Follower, x: Array, why: Test) -> Piece:
    """The whole piece through a solution, its folds among the points, the end of smaller δ first."""
    rising = np.zeros(x.size)
    rising[-2] = 1.0
    tangent = tangent_at(follower.problem, x, rising)
    on = follower.follow(x, tangent)
    if on.closed:
        return Piece(_with_folds(follower.problem, on.points, on.tangents), (CLOSED, CLOSED))
    back = follower.follow(x, -tangent)
    points = np.concatenate([back.points[:0:-1], on.points])
    tangents = np.concatenate([-back.tangents[:0:-1], on.tangents])
    reasons = _reason(back, why), _reason(on, why)
    points = _with_folds(follower.problem, points, tangents)
    if tuple(points[0, -2:]) > tuple(points[-1, -2:]):
        return Piece(points[::-1], (reasons[1], reasons[0]))
    return Piece(points, reasons)


def _with_folds(problem: Problem, points: Array, tangents: Array) -> Array:
    """The points with one more wherever δ or ε turns back, so that both are monotone between neighbours."""
    turns = [
        (int(i), index) for index in (-2, -1) for i in np.flatnonzero(tangents[:-1, index] * tangents[1:, index] < 0)
    ]
    for i, index in sorted(turns, reverse=True):
        chord = points[i + 1] - points[i]
        fold = located(problem, points[i], points[i + 1], partial(_rate, problem, chord, index))
        if fold is not None:
            points = np.insert(points, i + 1, fold, axis=0)
    return points


def _rate(problem: Problem, direction: Array, index: int, x: Array) -> float:
    """Rate of δ (index −2) or ε (−1) along the curve at a solution."""
    return float(tangent_at(problem, x, direction)[index])


def _reason(path: Path, why: Test) -> str:
    if path.outside is None:
        return "the equations become singular: it cannot be followed on"
    return why(path.outside) or "the edge of its existence"


def traced(
    name: str,
    beta: float,
    problem: Problem,
    starts: Iterable[Array],
    window: Window,
    left: Test,
    describe: Callable[[Array], Described],
    named: Callable[[Array, str], str],
    times: int | None = None,
) -> Curve:
    """The curve of a problem in a window, as `pieces`. `named` may put a better name to the reason of an end."""
    found = [
        Piece(piece.points, (named(piece.points[0], piece.reasons[0]), named(piece.points[-1], piece.reasons[1])))
        for piece in pieces(problem, starts, window, left, times)
    ]
    return build(name, beta, problem, found, [[describe(x) for x in piece.points] for piece in found])
