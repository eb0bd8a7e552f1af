"""Pseudo-arclength continuation: follow the solutions of N equations in N + 1 unknowns through folds.

A step goes along the tangent of the curve, and Newton's method then corrects it in the hyperplane normal to the
tangent. The length of steps adapts to the number of corrections and to the turning of the curve.

Source: H. B. Keller, Numerical solution of bifurcation and nonlinear eigenvalue problems (1977).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rattle.numerics.complex_step import Array, Function, value_and_jacobian

#: Largest number of Newton corrections of a step.
MOST_CORRECTIONS = 8
#: Newton's method has converged if its correction, relative to the unknowns and their scale, is below this.
SMALLEST_CORRECTION = 1e-13
#: Newton's method has also converged if a correction is below this and below 1/1000 of the correction before: as it
#: converges quadratically, the next correction would be below rounding.
QUADRATIC_CORRECTION = 1e-8
#: Correction above which a step is given up.
LARGEST_CORRECTION = 0.3
#: After a correction above this, `ContinuationProblem.prepare` is called again. It is not called after smaller
#: corrections, because a call takes as long as one evaluation of the equations.
LARGE_CORRECTION = 1e-3
#: Correction below which Newton's method may stop if corrections no longer become smaller, as near singular equations.
ACCEPTED_CORRECTION = 1e-11
#: Step length below which a curve is not followed further.
SHORTEST_STEP = 1e-10
#: The longest step in arclength s is the longest step in the last unknown p, divided by the rate |dp/ds|. A rate below
#: LEAST_RATE counts as LEAST_RATE, so that nothing is divided by 0.
LEAST_RATE = 1e-12
#: Largest angle between the tangents of neighbouring points, in radians.
LARGEST_TURN = 0.2
#: MOST_POINTS: largest number of points of a path. MOST_BISECTIONS: largest number of bisections in the search of the
#: edge at which a path ends.
MOST_POINTS = 4000
MOST_BISECTIONS = 200
#: The edge at which a path ends is added as its last point only if some unknown of the edge differs by more than this
#: from the same unknown of the point before.
SAME_POINT = 1e-12
#: A curve is closed if it comes back to its start: every unknown then differs from its first value by less than this.
SAME_SOLUTION = 1e-8
CLOSED = "closed: it comes back to its start"
#: Damping below which tolerances of δ and ε are relative to the damping; at larger dampings they are absolute.
SMALL_DAMPING = 0.25


def plane_scale(delta: float) -> float:
    """Return the unit in which differences of δ and of ε are measured near this damping.

    The unit shrinks with the damping, because at small damping motions depend on differences relative to the damping.

    Returns
    -------
    float
        The unit: in proportion to the damping, and at most 1.
    """
    return min(max(abs(float(delta)) / SMALL_DAMPING, 1e-300), 1.0)


@dataclass(frozen=True)
class ContinuationProblem:
    """N equations in N + 1 unknowns, whose solution curve is to be followed.

    equations: the function that maps points (…, N + 1) to residuals (…, N).
    prepare: a function of points (…, N + 1), called before the equations are evaluated near these points. It may adapt
    constants of the equations to these points (`rattle.continuation.conditions`).
    scale: a function that maps a point to the size of each unknown, a number or (N + 1,). Corrections are measured
    relative to this size.
    """

    equations: Function
    prepare: Callable[[Array], None] = lambda _: None
    scale: Callable[[Array], Array | float] = lambda _: 1.0


def line_scale(origin: Array, direction: Array) -> Callable[[Array], Array]:
    """Return the function `scale` of a `ContinuationProblem` whose parameters are on a line, origin + p · direction.

    The last unknown is p. The first two numbers of origin and direction belong to δ and ε.

    Returns
    -------
    callable
        A function that maps unknowns (N + 1,) to their sizes (N + 1,).
    """
    length = float(np.hypot(*direction[:2]))
    last = min(1.0, plane_scale(origin[0]) / length) if length else 1.0

    def scale(y: Array) -> Array:
        found = np.ones(y.size)
        found[-1] = last
        return found

    return scale


def append_row(jacobian: Array, row: Array) -> Array:
    """Return the square matrix (N + 1, N + 1) of a Jacobian (N, N + 1) with a further row below it."""
    matrix = np.empty((row.size, row.size))
    matrix[:-1], matrix[-1] = jacobian, row
    return matrix


@dataclass(frozen=True)
class OneWayPath:
    """A curve that was followed in one direction.

    points, tangents: points (k, N + 1) and unit tangents.
    first_point_outside: the first point that is outside the bounds or not admissible; None if the curve closed, could
    not be followed further, or has the largest allowed number of points.
    closed: whether the curve returned to its start, which is then the last point too.
    """

    points: Array
    tangents: Array
    first_point_outside: Array | None
    closed: bool = False


class FollowedCurve(NamedTuple):
    """A curve that was followed in both directions from a start.

    points, tangents: points (k, N + 1) and unit tangents (k, N + 1). start: the index of the start in `points`.
    paths: the paths backward and forward from the start, or None if the curve is closed.
    """

    points: Array
    tangents: Array
    start: int
    paths: tuple[OneWayPath, OneWayPath] | None


def solve_on_curve(problem: ContinuationProblem, x: Array, constraint: Array) -> tuple[Array, int] | None:
    """Solve for a point of the curve near x, in the hyperplane through x that is normal to `constraint`.

    Returns
    -------
    tuple[Array, int] | None
        The solution (N + 1,) and the number of Newton corrections; None if Newton's method fails.
    """
    x, scale = x.copy(), problem.scale(x)
    size, right = np.inf, np.zeros(x.size)
    for i in range(MOST_CORRECTIONS):
        if size > LARGE_CORRECTION:
            problem.prepare(x)
        value, jacobian = value_and_jacobian(problem.equations, x)
        matrix = append_row(jacobian, constraint)
        np.negative(value, out=right[:-1])
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return None
        try:
            step = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return None
        last, size = size, float((np.abs(step) / (scale + np.abs(x))).max())
        if _has_diverged(i, size, last):
            return None
        x += step
        if _has_converged(size, last):
            return x, i + 1
    return None


def _has_diverged(i: int, size: Any, last: Any) -> Any:
    """Return whether Newton's method diverges at correction number i.

    size, last: the sizes of this correction and of the previous correction; arrays for several solutions at once.

    Returns
    -------
    Any
        A bool, or an array of bools of the shape of the sizes.
    """
    return (size > LARGEST_CORRECTION) | ((i > 2) & (size > last) & (last > ACCEPTED_CORRECTION))


def _has_converged(size: Any, last: Any) -> Any:
    """Return whether Newton's method has converged, from the sizes of the last two corrections."""
    quadratic = (size < QUADRATIC_CORRECTION) & (size < 1e-3 * last)
    return (size < SMALLEST_CORRECTION) | quadratic | ((size < ACCEPTED_CORRECTION) & (size > 0.1 * last))


def solve_all_with_fixed_unknown(problem: ContinuationProblem, guesses: Array, index: int) -> Array:
    """Return the solutions near guesses (k, N + 1), in which unknown number `index` keeps its guessed value.

    Returns
    -------
    Array
        Solutions (k, N + 1), with a row of NaN where none was found.
    """
    x, found = guesses.copy(), np.full(guesses.shape, np.nan)
    fixed = np.zeros(x.shape[-1])
    fixed[index] = 1.0
    active, last = np.arange(len(x)), np.full(len(x), np.inf)
    for i in range(MOST_CORRECTIONS):
        if not active.size:
            break
        at = x[active]
        problem.prepare(at)
        value, jacobian = value_and_jacobian(problem.equations, at)
        matrix, right = np.empty((*at.shape, at.shape[-1])), np.zeros(at.shape)
        matrix[:, :-1], matrix[:, -1], right[:, :-1] = jacobian, fixed, -value
        step = _solve_linear_systems(matrix, right)
        scale = np.stack([np.broadcast_to(problem.scale(each), each.shape) for each in at])
        size = (np.abs(step) / (scale + np.abs(at))).max(axis=-1)
        x[active] += step
        good = np.isfinite(size) & ~_has_diverged(i, size, last)
        done = good & _has_converged(size, last)
        found[active[done]] = x[active[done]]
        active, last = active[good & ~done], size[good & ~done]
    return found


def _solve_linear_systems(matrix: Array, right: Array) -> Array:
    """Return the solutions (k, n) of k linear systems with matrices (k, n, n); NaN for a singular matrix."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], np.float64)
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full(right.shape, np.nan)
        return np.concatenate(
            [_solve_linear_systems(*each) for each in zip(matrix[:, None], right[:, None], strict=True)]
        )


def solve_with_fixed_unknown(problem: ContinuationProblem, x: Array, index: int, value: float) -> Array | None:
    """Return the solution near x in which unknown number `index` has this value; None if Newton's method fails."""
    guess, fixed = x.copy(), np.zeros(x.size)
    guess[index], fixed[index] = value, 1.0
    found = solve_on_curve(problem, guess, fixed)
    return None if found is None else found[0]


def tangent_at(problem: ContinuationProblem, x: Array, direction: Array) -> Array:
    """Return the unit tangent (N + 1,) of the solution curve at x, at an acute angle with `direction`."""
    return tangent_and_orientation(problem, x, direction)[0]


def tangent_and_orientation(problem: ContinuationProblem, x: Array, direction: Array) -> tuple[Array, float]:
    """Return the unit tangent at x as `tangent_at` does, and the orientation of the curve there.

    The orientation is the sign of the determinant of the Jacobian with the tangent as last row. It is constant along a
    curve, and opposite on a neighbouring curve that nearly crosses it.

    Returns
    -------
    tuple[Array, float]
        Unit tangent (N + 1,), and the orientation, +1.0 or −1.0.
    """
    problem.prepare(x)
    _, jacobian = value_and_jacobian(problem.equations, x)
    onwards = np.zeros(x.size)
    onwards[-1] = 1.0
    try:
        tangent = np.linalg.solve(append_row(jacobian, direction), onwards)
    except np.linalg.LinAlgError:  # the tangent is normal to `direction`
        tangent = np.linalg.svd(jacobian)[2][-1]
    unit: Array = np.asarray(tangent / np.linalg.norm(tangent), np.float64)
    return unit, float(np.linalg.slogdet(append_row(jacobian, unit))[0])


def solve_normal_to_chord(problem: ContinuationProblem, a: Array, b: Array, share: float) -> Array | None:
    """Return the solution in the hyperplane normal to the chord from a to b, at `share` of the way from a to b.

    Returns
    -------
    Array | None
        The solution (N + 1,); None if Newton's method fails.
    """
    found = solve_on_curve(problem, a + share * (b - a), b - a)
    return None if found is None else found[0]


@dataclass(frozen=True)
class BoundsOfUnknown:
    """Bounds of one unknown: low ≤ x[index] ≤ high."""

    index: int
    low: float
    high: float

    def exceeded_limit(self, x: Array) -> float | None:
        """Return `low` if x[index] is below it, `high` if x[index] is above it, else None."""
        value = x[self.index]
        return self.low if value < self.low else self.high if value > self.high else None


def bracket_admissible_edge(
    problem: ContinuationProblem, a: Array, b: Array, is_admissible: Callable[[Array], bool]
) -> tuple[Array, Array]:
    """Return the last admissible solution between a and b, and the first one that is not admissible.

    a is admissible and b is not. Bisection finds both solutions to rounding. If Newton's method fails near a singular
    solution, the bisection steps along the tangent instead, because b may belong to another branch. If Newton's method
    fails there too, the step is halved.

    Returns
    -------
    tuple[Array, Array]
        Two solutions (N + 1,) that differ by rounding.
    """
    inside, outside, share = a, b, 0.5
    for _ in range(MOST_BISECTIONS):
        if share * np.max(np.abs(outside - inside)) < 1e-15:
            break
        ahead = outside - inside
        found = solve_on_curve(problem, inside + share * ahead, b - a)
        if found is None:
            tangent = tangent_at(problem, inside, ahead)
            found = solve_on_curve(problem, inside + share * float(np.linalg.norm(ahead)) * tangent, tangent)
        if found is None:
            share *= 0.5
        elif is_admissible(found[0]):
            inside, share = found[0], 0.5
        else:
            outside, share = found[0], 0.5
    return inside, outside


def make_longest_step_function(span: tuple[float, float], resolution: int, longest: float) -> Callable[[Array], float]:
    """Return a function that maps a unit tangent of a curve to the longest allowed step along this tangent.

    The step is at most `longest_step`, and so short that a curve across the span (low, high) of the last unknown has at
    least `resolution` points.

    Returns
    -------
    callable
        The longest step as a function of a unit tangent (N + 1,).
    """
    step = (span[1] - span[0]) / resolution
    return lambda tangent: min(longest, step / max(abs(float(tangent[-1])), LEAST_RATE))


@dataclass(frozen=True)
class CurveFollower:
    """A continuation problem with the rules by which its curve is followed.

    bounds, is_admissible: the curve is followed as long as its points are "inside": within the bounds and admissible.
    longest_step: the longest step, as a function of the unit tangent, in the Euclidean norm of the unknowns.
    equivalent_unknowns(start, x): all arrays of unknowns (…, N + 1) that describe the same solution as `start`, near x.
    """

    problem: ContinuationProblem
    bounds: Sequence[BoundsOfUnknown]
    is_admissible: Callable[[Array], bool]
    longest_step: Callable[[Array], float]
    equivalent_unknowns: Callable[[Array, Array], Array] = lambda start, _: start[None]

    def is_inside(self, x: Array) -> bool:
        """Return whether x is within the bounds and admissible."""
        return all(bound.exceeded_limit(x) is None for bound in self.bounds) and self.is_admissible(x)

    def follow(self, start: Array, tangent: Array, most: int = MOST_POINTS, first: float = np.inf) -> OneWayPath:
        """Follow the curve from a solution in the direction of `tangent`, until it goes outside or closes.

        "Inside" and "outside" are those of `CurveFollower`; the start is inside. If the curve goes outside, the last
        point is the last solution inside, to rounding.

        most: the largest number of points. first: the longest allowed first step. Give `first` if another curve crosses
        this one at the start, as at a flip: then the orientation of the curve is not checked in the first step.

        Returns
        -------
        OneWayPath
            Points and tangents of the curve, the first point outside if there is one, and whether the curve closed.
        """
        points, tangents = [start], [tangent]
        sign = tangent_and_orientation(self.problem, start, tangent)[1] if first == np.inf else None
        step = min(first, 0.2 * self.longest_step(tangent))
        shortest = min(SHORTEST_STEP, 0.01 * step)
        while len(points) < most and step >= shortest:
            x, direction = points[-1], tangents[-1]
            step = min(step, self.longest_step(direction))
            found = solve_on_curve(self.problem, x + step * direction, direction)
            if found is None or np.linalg.norm(found[0] - x) > 2.0 * step:
                step *= 0.4
                continue
            new, corrections = found
            new_tangent, new_sign = tangent_and_orientation(self.problem, new, direction)
            turn = float(np.arccos(np.clip(new_tangent @ direction, -1.0, 1.0)))
            if turn > LARGEST_TURN or new_sign != (sign or new_sign):
                step *= 0.4
                continue
            sign = new_sign
            back = self._closing_solution(start, x, new) if len(points) > 1 else None
            if back is not None:
                points.append(back)
                tangents.append(tangent_at(self.problem, back, direction))
                return OneWayPath(np.array(points), np.array(tangents), None, closed=True)
            if not self.is_inside(new):
                edge = self._find_last_point_inside(x, new)
                if np.max(np.abs(edge - x)) > SAME_POINT:
                    points.append(edge)
                    tangents.append(tangent_at(self.problem, edge, direction))
                return OneWayPath(np.array(points), np.array(tangents), new)
            points.append(new)
            tangents.append(new_tangent)
            step *= min(2.0, 0.5 * LARGEST_TURN / max(turn, 1e-9)) if corrections <= 4 else 0.7
        return OneWayPath(np.array(points), np.array(tangents), None)

    def follow_both_ways(self, start: Array, index: int, most: int = MOST_POINTS) -> FollowedCurve:
        """Follow the curve in both directions from a solution `start` that `is_inside` accepts.

        Returns
        -------
        FollowedCurve
            The curve. Its forward direction is the one in which the unknown x[index] rises at first.
        """
        rising = np.zeros(start.size)
        rising[index] = 1.0
        tangent = tangent_at(self.problem, start, rising)
        on = self.follow(start, tangent, most)
        if on.closed:
            return FollowedCurve(on.points, on.tangents, 0, None)
        back = self.follow(start, -tangent, most)
        points = np.concatenate([back.points[:0:-1], on.points])
        tangents = np.concatenate([-back.tangents[:0:-1], on.tangents])
        return FollowedCurve(points, tangents, len(back.points) - 1, (back, on))

    def _closing_solution(self, start: Array, a: Array, b: Array) -> Array | None:
        """Return a solution that describes the same motion as `start` and lies between points a and b of the curve.

        Returns
        -------
        Array | None
            The solution (N + 1,), at which the curve closes; None if there is none between a and b.
        """
        chord = b - a
        for twin in self.equivalent_unknowns(start, b):
            share = float((twin - a) @ chord / (chord @ chord))
            if 0.0 < share <= 1.0 and np.max(np.abs(twin - a - share * chord)) < LARGEST_TURN * np.max(np.abs(chord)):
                found = solve_normal_to_chord(self.problem, a, b, share)
                if found is not None and np.max(np.abs(found - twin)) < SAME_SOLUTION:
                    return found
        return None

    def _find_last_point_inside(self, a: Array, b: Array) -> Array:
        """Return the last point at which `is_inside` holds on the curve from a, which is inside, to b, which is not."""
        for bound in self.bounds:
            limit = bound.exceeded_limit(b)
            if limit is not None:
                share = (limit - a[bound.index]) / (b[bound.index] - a[bound.index])
                found = solve_with_fixed_unknown(self.problem, a + share * (b - a), bound.index, limit)
                b = b if found is None else found
        return b if self.is_inside(b) else bracket_admissible_edge(self.problem, a, b, self.is_inside)[0]


def find_root_between(
    problem: ContinuationProblem, a: Array, b: Array, test: Callable[[Array], float], tolerance: float = 1e-15
) -> Array | None:
    """Return the solution between a and b at which a test function is 0.

    The function has different signs at a and b. tolerance: the accuracy, as a share of the way from a to b.

    Returns
    -------
    Array | None
        The solution (N + 1,), or None if Newton's method fails between a and b.
    """

    def evaluate_test(share: float) -> float:
        """Return `test` at the solution of `solve_normal_to_chord`. Raises ArithmeticError if there is none."""
        x = solve_normal_to_chord(problem, a, b, share)
        if x is None:
            raise ArithmeticError(f"Newton's method found no solution in the hyperplane at {share} of a chord")
        return test(x)

    from scipy.optimize import brentq  # imported here because it takes a quarter of a second to load

    try:
        ends = evaluate_test(0.0), evaluate_test(1.0)
        if ends[0] * ends[1] >= 0.0:  # the zero is at an end, where rounding changed the sign
            return b if abs(ends[1]) < abs(ends[0]) else a
        share = brentq(evaluate_test, 0.0, 1.0, xtol=tolerance, rtol=4 * np.finfo(float).eps)
    except ArithmeticError:  # Newton's method failed between a and b
        return None
    return solve_normal_to_chord(problem, a, b, float(share))
