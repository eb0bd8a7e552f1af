"""Follow bifurcation curves through a window of the (δ, ε) plane; the result is a `Curve`.

A curve consists of connected pieces. A piece is followed in both directions from one of its solutions, until it ends or
leaves the window.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import (
    CLOSED,
    MOST_POINTS,
    BoundsOfUnknown,
    ContinuationProblem,
    CurveFollower,
    OneWayPath,
    find_root_between,
    plane_scale,
    solve_all_with_fixed_unknown,
    solve_with_fixed_unknown,
    tangent_at,
)
from rattle.errors import require, require_number, require_pair
from rattle.notebook import Columns, TabularResult
from rattle.numerics.complex_step import Array

#: Largest distance in δ and ε, in units of `plane_scale`, between points that count as the same.
SAME_POINT = 1e-9
#: Longest step along a curve in the times of its motion, in forcing periods.
LONGEST_TIME_STEP = 0.05
#: Largest difference in an unknown between solutions that count as the same.
SAME_SOLUTION = 1e-7
#: Least number of points of a curve across the width of the window.
POINTS_ACROSS = 60
Test = Callable[[Array], str | None]
#: Number of evenly spaced dampings at which a curve is searched. Every piece that is wider in δ than their spacing is
#: found.
STARTS = 33
#: Largest allowed δ and ε of a window; for larger numbers double precision has too few digits.
FARTHEST = 1e6
#: Name of the quiet limit, the only curve on which no periodic orbit bifurcates.
QUIET_LIMIT = "quiet_limit"


@dataclass(frozen=True)
class PieceEnd:
    """An end of a piece of a curve: the index of the last point, and the reason in words why the curve ends there."""

    index: int
    reason: str


class CurvePiece(NamedTuple):
    """A connected piece of a curve.

    points: unknowns (k, N), the last two of which are δ and ε. reasons: the reasons in words why the piece ends at its
    first and at its last point.
    """

    points: Array
    reasons: tuple[str, str]


class MotionAtCurvePoint(NamedTuple):
    """The motion that bifurcates at a point of a curve.

    tau, v: the phase of the motion's impact on Σ⁺, and the speed after this impact. multipliers (2,): the
    Floquet multipliers of the motion. At the quiet limit, where no orbit bifurcates, tau is the phase at which contact
    is lost, v is 0, and multipliers are NaN.
    """

    tau: float
    v: float
    multipliers: NDArray[np.complex128]


@dataclass(frozen=True, repr=False)
class Curve(TabularResult):
    """A bifurcation curve at half-backlash beta: n points, piece by piece; n = 0 if it does not exist in the window.

    delta, epsilon (n,): the points.
    tau, v (n,): phase in [0, 1) and speed after the impact on Σ⁺ of the motion that bifurcates.
    multipliers (2, n): the Floquet multipliers of this motion; on a grazing curve, of the motion that just misses the
    wall.
    arclength (n,): the length along (δ, ε) from the start of the piece. piece (n,): the number of the connected piece.
    folds: the numbers of the points at which δ turns back. ends: both ends of each piece.
    On the quiet limit tau is the phase at which contact is lost, v is 0, and multipliers are NaN.
    All numbers are dimensionless; phases are in forcing periods.
    """

    name: str
    beta: float
    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]
    arclength: NDArray[np.float64]
    piece: NDArray[np.int64]
    folds: tuple[int, ...]
    ends: tuple[PieceEnd, ...]
    _problem: ContinuationProblem = field(repr=False)
    _points: tuple[Array, ...] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of points."""
        return self.delta.size

    def _caption(self) -> str:
        reasons = ", ".join(end.reason for end in self.ends) or "it does not exist here"
        return f"{self.name} at β = {self.beta:g}, {len(self)} points; ends: {reasons}"

    def _columns(self) -> Columns:
        return {
            "delta": self.delta,
            "epsilon": self.epsilon,
            "tau": self.tau,
            "v": self.v,
            "multiplier_1": self.multipliers[0],
            "multiplier_2": self.multipliers[1],
            "arclength": self.arclength,
            "piece": self.piece,
        }

    def at(self, delta: float | None = None, epsilon: float | None = None) -> tuple[float, ...]:
        """Return all ε of the curve at a damping, or all δ at an eccentricity.

        Returns
        -------
        tuple[float, ...]
            The values of the other parameter, exact to rounding, in rising order; empty if there is none.

        Raises
        ------
        ParameterError
            If not exactly one of `delta` and `epsilon` is given, or the given number is outside its domain.
        """
        given = [(name, x) for name, x in (("delta", delta), ("epsilon", epsilon)) if x is not None]
        require(len(given) == 1, "exactly one of delta and epsilon must be given")
        name, value = given[0][0], require_number(*given[0])
        index = -2 if name == "delta" else -1
        found = (find_crossings(self._problem, points, index, value) for points in self._points)
        return tuple(sorted({float(x[-3 - index]) for each in found for x in each}))


def find_crossings(problem: ContinuationProblem, points: Array, index: int, value: float) -> list[Array]:
    """Return all solutions on a piece (k, N) at which δ (index −2) or ε (index −1) is equal to `value`, each once."""
    found: list[Array] = []
    for guess in _find_points_on_chords(points, index, value):
        x = solve_with_fixed_unknown(problem, guess, index, value)
        if x is None:
            continue
        near = SAME_POINT * plane_scale(x[-2])
        if not any(np.max(np.abs((x - other)[-2:])) < near for other in found):
            found.append(x)
    return found


def _find_points_on_chords(points: Array, index: int, value: float) -> Array:
    """Return the points at which δ or ε has a given value on the straight lines between neighbouring points.

    points (k, N): the points of one piece of a curve. index: −2 for δ, −1 for ε. value: the given value.

    Returns
    -------
    Array
        The points found (l, N), l ≥ 0. They are guesses of solutions, not solutions.
    """
    d = points[:, index] - value
    i = np.flatnonzero((d[:-1] <= 0) & (d[1:] >= 0) | (d[:-1] >= 0) & (d[1:] <= 0))
    rise = d[i + 1] - d[i]
    share = np.where(rise != 0.0, -d[i] / np.where(rise != 0.0, rise, 1.0), 0.0)
    found = points[i] + share[:, None] * (points[i + 1] - points[i])
    found[:, index] = value
    return found


def build_curve(
    name: str,
    beta: float,
    problem: ContinuationProblem,
    pieces: Sequence[CurvePiece],
    described: Sequence[Sequence[MotionAtCurvePoint]],
) -> Curve:
    """Return the curve that consists of these pieces. described: for each piece, the motion at each of its points."""
    motions = [motion for piece in described for motion in piece]
    sizes = [len(piece.points) for piece in pieces]
    starts = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
    plane = np.concatenate([np.empty((0, 2)), *(piece.points[:, -2:] for piece in pieces)])
    lengths = [_arclength(piece.points[:, -2:]) for piece in pieces]
    ends = [
        end
        for start, size, piece in zip(starts, sizes, pieces, strict=False)
        for end in (PieceEnd(int(start), piece.reasons[0]), PieceEnd(int(start) + size - 1, piece.reasons[1]))
    ]
    folds = [
        int(start) + i for start, piece in zip(starts, pieces, strict=False) for i in _fold_indices(piece.points[:, -2])
    ]
    return Curve(
        name,
        beta,
        plane[:, 0],
        plane[:, 1],
        np.array([motion.tau for motion in motions]),
        np.array([motion.v for motion in motions]),
        np.array([motion.multipliers for motion in motions], np.complex128).reshape(-1, 2).T,
        np.concatenate([np.empty(0), *lengths]),
        np.repeat(np.arange(len(pieces)), sizes),
        tuple(folds),
        tuple(ends),
        problem,
        tuple(piece.points for piece in pieces),
    )


def _arclength(plane: Array) -> Array:
    """Return the length (k,) of a line of points (k, 2) from its first point to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(plane, axis=0).T))])


def _fold_indices(delta: Array) -> list[int]:
    """Return the indices of the points at which δ turns back along a curve."""
    rises = np.sign(np.diff(delta))
    return [int(i) + 1 for i in np.flatnonzero(rises[:-1] * rises[1:] < 0)]


@dataclass(frozen=True)
class PlaneWindow:
    """A window of the plane: ranges (low, high) of δ and ε.

    resolution: the least number of points of a curve across the window.
    """

    delta: tuple[float, float]
    epsilon: tuple[float, float]
    resolution: int = POINTS_ACROSS

    def __str__(self) -> str:
        """Return both ranges in words, for messages."""
        ranges = (("delta", self.delta), ("epsilon", self.epsilon))
        return " and ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in ranges)

    @property
    def bounds(self) -> tuple[BoundsOfUnknown, BoundsOfUnknown]:
        """The bounds of the last two unknowns, δ and ε."""
        return BoundsOfUnknown(-2, *self.delta), BoundsOfUnknown(-1, *self.epsilon)

    def reason_outside_window(self, x: Array) -> str | None:
        """Return the side of the window beyond which a point x lies, in words; None if x is inside the window."""
        limits = zip(("delta", "epsilon"), (bound.exceeded_limit(x) for bound in self.bounds), strict=True)
        return next((f"window: {name} = {limit:g}" for name, limit in limits if limit is not None), None)

    def longest_step(self, tangent: Array) -> float:
        """Return the longest allowed step, in arclength over all unknowns, along a unit tangent (N,)."""
        sizes = (self.delta[1] - self.delta[0], self.epsilon[1] - self.epsilon[0])
        rates = [self.resolution * abs(rate) / size for rate, size in zip(tangent[-2:], sizes, strict=True)]
        return 1.0 / max(*rates, float(np.max(np.abs(tangent[:-2]))) / LONGEST_TIME_STEP)


def trace_pieces_in_window(
    problem: ContinuationProblem,
    starts: Iterable[Array],
    window: PlaneWindow,
    why_excluded: Test,
    times: int | None = None,
) -> list[CurvePiece]:
    """Return the pieces of a curve inside a window that pass through solutions near the starts, each once.

    Parameters
    ----------
    problem : ContinuationProblem
        The equations of the curve.
    starts : Iterable[Array]
        Guesses (N,) of solutions.
    window : PlaneWindow
        The window.
    why_excluded : Test
        A function of a solution in the window. It returns None if the solution belongs to the curve, else the reason in
        words why it does not, such as that its motion is virtual.
    times : int | None
        The number of unknowns that are times, by default all but δ and ε.

    Returns
    -------
    list[CurvePiece]
        The pieces, in the order of δ and ε at their first points.
    """
    found: list[CurvePiece] = []
    equivalent_unknowns = partial(_shift_times_near, times)
    follower = CurveFollower(
        problem, window.bounds, lambda x: why_excluded(x) is None, window.longest_step, equivalent_unknowns
    )
    guesses = [*starts]
    solved = solve_all_with_fixed_unknown(problem, np.array(guesses), -2) if guesses else np.empty((0, 2))
    solved = solved[~np.isnan(solved[:, 0])]
    while len(solved):
        x, solved = solved[0], solved[1:]
        if not follower.is_inside(x):
            continue
        new = _follow_curve_piece(follower, x, lambda y: window.reason_outside_window(y) or why_excluded(y))
        # rounding may have ended an earlier piece too early, so that it does not reach x: the new piece replaces it
        found = [
            piece
            for piece in found
            if not _are_solutions_on_piece(problem, new, piece.points[None, len(piece.points) // 2], times)
        ]
        found.append(new)
        solved = solved[~_are_solutions_on_piece(problem, new, solved, times)]
    return sorted(found, key=lambda piece: (piece.points[0, -2], piece.points[0, -1]))


def _shift_times_near(times: int | None, start: Array, x: Array) -> Array:
    """Return the unknowns `start` of a motion with all times shifted by the same number of forcing periods.

    The shift brings the first time as near as possible to the first time of the unknowns x (N,). times: the number
    of unknowns that are times; None for all but δ and ε. start (N,): the unknowns of the motion, δ and ε at the end.

    Returns
    -------
    Array
        The shifted unknowns (1, N).
    """
    twin = start.copy()
    twin[: -2 if times is None else times] += np.rint(x[0] - start[0])
    return twin[None]


def _are_solutions_on_piece(
    problem: ContinuationProblem, piece: CurvePiece, solved: Array, times: int | None
) -> NDArray[np.bool_]:
    """Return for each of the solutions `solved` (k, N) whether it is on a piece of a curve.

    Solutions count as the same if all their times differ by one common whole number of forcing periods. times: the
    number of unknowns that are times; None if all unknowns but δ and ε are times.

    Returns
    -------
    NDArray[np.bool_]
        Flags (k,), True for a solution on the piece.
    """
    on = np.zeros(len(solved), bool)
    guesses = [_find_points_on_chords(piece.points, -2, x[-2]) for x in solved]
    whose = np.repeat(np.arange(len(solved)), [len(each) for each in guesses])
    if whose.size:
        for i, y in zip(whose, solve_all_with_fixed_unknown(problem, np.concatenate(guesses), -2), strict=True):
            on[i] |= bool(np.max(np.abs(_shift_times_near(times, solved[i], y)[0] - y)) < SAME_SOLUTION)
    return on


def _follow_curve_piece(follower: CurveFollower, x: Array, reason_outside_window: Test) -> CurvePiece:
    """Return the piece of a curve that contains the solution x, with the folds of the piece among its points.

    An open piece begins at its end with the smaller δ.
    reason_outside_window: a function that returns, in words, why a point is outside the window or not on the curve;
    None for other points.

    Returns
    -------
    CurvePiece
        The piece.
    """
    followed = follower.follow_both_ways(x, -2)
    points = _insert_folds(follower.problem, followed.points, followed.tangents)
    if followed.paths is None:
        return CurvePiece(points, (CLOSED, CLOSED))
    reasons = (
        _why_path_ends(followed.paths[0], reason_outside_window),
        _why_path_ends(followed.paths[1], reason_outside_window),
    )
    if tuple(points[0, -2:]) > tuple(points[-1, -2:]):
        return CurvePiece(points[::-1], (reasons[1], reasons[0]))
    return CurvePiece(points, reasons)


def _insert_folds(problem: ContinuationProblem, points: Array, tangents: Array) -> Array:
    """Return the points with a further point wherever δ or ε turns back, so that both are monotone in between."""
    turns = [
        (int(i), index) for index in (-2, -1) for i in np.flatnonzero(tangents[:-1, index] * tangents[1:, index] < 0)
    ]
    for i, index in sorted(turns, reverse=True):
        chord = points[i + 1] - points[i]
        fold = find_root_between(problem, points[i], points[i + 1], partial(_tangent_entry, problem, chord, index))
        if fold is not None:
            points = np.insert(points, i + 1, fold, axis=0)
    return points


def _tangent_entry(problem: ContinuationProblem, direction: Array, index: int, x: Array) -> float:
    """Return entry `index` (−2 for δ, −1 for ε) of the unit tangent at x that has an acute angle with `direction`."""
    return float(tangent_at(problem, x, direction)[index])


def _why_path_ends(path: OneWayPath, reason_outside_window: Test) -> str:
    """Return the reason in words why a path ends.

    reason_outside_window: a function that returns, in words, why a point is outside the window or not on the curve.

    Returns
    -------
    str
        The reason.
    """
    if path.first_point_outside is None and len(path.points) >= MOST_POINTS:
        return f"a curve is followed for at most {MOST_POINTS} points"
    if path.first_point_outside is None:
        return "the equations become singular: the curve cannot be followed further"
    return reason_outside_window(path.first_point_outside) or "the edge of its existence"


def trace_curve_of_problem(
    name: str,
    beta: float,
    problem: ContinuationProblem,
    starts: Iterable[Array],
    window: PlaneWindow,
    why_excluded: Test,
    describe: Callable[[Array], MotionAtCurvePoint],
    better_reason: Callable[[Array, str], str],
    times: int | None = None,
) -> Curve:
    """Return the curve of a problem in a window. Arguments without explanation are those of `trace_pieces_in_window`.

    describe: a function of a solution that returns its motion. better_reason: a function of the unknowns at an end and
    of the reason why the curve ends there. It returns the reason that the result gives: the same, or a more specific
    reason, such as the name of a codimension-two point.

    Returns
    -------
    Curve
        The curve.
    """
    found = [
        CurvePiece(
            piece.points,
            (better_reason(piece.points[0], piece.reasons[0]), better_reason(piece.points[-1], piece.reasons[1])),
        )
        for piece in trace_pieces_in_window(problem, starts, window, why_excluded, times)
    ]
    return build_curve(name, beta, problem, found, [[describe(x) for x in piece.points] for piece in found])


def evenly_spaced_numbers_between(low: float, high: float) -> Array:
    """Return STARTS evenly spaced numbers between low and high, without low and high."""
    return np.linspace(low, high, 2 * STARTS + 1)[1::2]


def require_window_range(name: str, value: tuple[float, float], positive: bool = False) -> tuple[float, float]:
    """Return the range (low, high) of a window after a check. Raises ParameterError if the range is not allowed."""
    low, high = (require_number(name, number, positive=positive) for number in require_pair(name, value))
    require(low < high, f"{name} must be a pair (low, high) with low < high, got {value!r}")
    require(max(-low, high) <= FARTHEST, f"{name} must be within ±{FARTHEST:g}, got {value!r}")
    return low, high


def trace_quiet_limit(
    beta: float, problem: ContinuationProblem, guesses: Iterable[Array], window: PlaneWindow
) -> Curve:
    """Return the quiet limit as a `Curve`. The unknowns are the phase at which contact is lost, δ and ε."""
    nothing = np.full(2, complex(np.nan, np.nan))
    return trace_curve_of_problem(
        QUIET_LIMIT,
        beta,
        problem,
        guesses,
        window,
        lambda _: None,
        lambda x: MotionAtCurvePoint(float(x[0] - np.floor(x[0])), 0.0, nothing),
        lambda _, reason: reason,
    )
