"""Pseudo-arclength continuation of a family of periodic motions of the stiff gear in ε (compiled).

The method is that of `rattle.continuation.arclength`, here for the equations of `rattle.stiff.orbits.closure` and some
hundred times as fast. A family is followed through virtual motions too, until a contact is lost (σ = 0), ε leaves its
range, or a flight vanishes. Lengths and angles of vectors of unknowns are measured with ε in units of `epsilon_unit`,
which is 1 at strong damping and proportional to δ at weak damping.
"""

import math

import numpy as np

from rattle.continuation.arclength import (
    ACCEPTED_CORRECTION,
    LARGEST_TURN,
    MOST_CORRECTIONS,
    QUADRATIC_CORRECTION,
    SAME_SOLUTION,
    SHORTEST_STEP,
    SMALL_DAMPING,
    SMALLEST_CORRECTION,
)
from rattle.numerics.compile import inline, kernel
from rattle.numerics.secant import narrow_bracket
from rattle.stiff.orbits.closure import LEAST_CONTACT, write_residuals

# reasons why a family ends, in this order: ε leaves its range; a contact vanishes; a flight vanishes; the family
# closes; no continuation step succeeds, or the family has too many points
SPAN, LOST, FLIGHT, CLOSED, BROKEN = range(5)
LONGEST_STEP = 0.1  # longest continuation step, in the unknowns
STEP_SHARE = 0.3  # longest continuation step, as a share of the duration of the shortest contact
FIRST_STEP = 1e-3  # first continuation step, in the unknowns
LEAST_FLIGHT = 1e-4  # shortest flight, in forcing periods; the equations become singular where flights vanish
MOST_POINTS = 4000  # largest number of points of a family in one direction
MOST_SECANTS = 100  # largest number of secant steps of `locate_solution_between`


@inline
def solve_linear_system(matrix, right):
    """Solve matrix x = right by Gaussian elimination and write x to `right`.

    Returns
    -------
    float
        The sign of the determinant; 0 if the matrix is singular.
    """
    n, sign = right.size, 1.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if not abs(matrix[best, k]) > 0.0:
            return 0.0
        if best != k:
            sign = -sign
            for j in range(k, n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            right[k], right[best] = right[best], right[k]
        sign = math.copysign(sign, sign * matrix[k, k])
        for i in range(k + 1, n):
            share = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= share * matrix[k, j]
            right[i] -= share * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return sign


@inline
def epsilon_unit(cycle):
    """Return the unit in which ε enters lengths and angles of vectors of unknowns: δ/SMALL_DAMPING, at most 1."""
    return min(1.0, cycle.delta / SMALL_DAMPING)


@inline
def inner_product(a, b, unit):
    """Return the inner product of two vectors of unknowns, with ε in units of `unit`."""
    n, found = a.size - 1, 0.0
    for j in range(n):
        found += a[j] * b[j]
    return found + a[n] * b[n] / (unit * unit)


@kernel
def correct_in_hyperplane(y, constraint, cycle):
    """Correct a guess y in place by Newton's method, in the hyperplane through y that is normal to `constraint`.

    Returns
    -------
    int
        The number of corrections; 0 if the method fails.
    """
    n = y.size - 1
    matrix, right = np.empty((n + 1, n + 1)), np.empty(n + 1)
    size, unit = math.inf, epsilon_unit(cycle)
    for i in range(MOST_CORRECTIONS):
        if not write_residuals(y, cycle, right[:n], matrix[:n]):
            return 0
        matrix[n], right[n] = constraint, 0.0
        matrix[n, n] /= unit * unit
        if solve_linear_system(matrix, right) == 0.0:
            return 0
        last, size = size, 0.0
        for j in range(n + 1):
            size = max(size, abs(right[j]) / ((1.0 if j < n else unit) + abs(y[j])))
        if not size <= 0.3 or (i > 2 and size > last and last > ACCEPTED_CORRECTION):
            return 0
        y -= right
        quadratic = size < QUADRATIC_CORRECTION and size < 1e-3 * last
        if size < SMALLEST_CORRECTION or quadratic or (size < ACCEPTED_CORRECTION and size > 0.1 * last):
            return i + 1
    return 0


@kernel
def write_family_tangent(y, direction, cycle, tangent):
    """Write the unit tangent of the family at y to `tangent`; its inner product with `direction` is positive.

    Returns
    -------
    float
        The sign of the determinant of the Jacobian with `direction` as last row; 0 if it is singular.
    """
    n = y.size - 1
    matrix, right = np.empty((n + 1, n + 1)), np.zeros(n + 1)
    if not write_residuals(y, cycle, right[:n], matrix[:n]):
        return 0.0
    unit = epsilon_unit(cycle)
    matrix[n], right[:n], right[n] = direction, 0.0, 1.0
    matrix[n, n] /= unit * unit
    sign = solve_linear_system(matrix, right)
    size = math.sqrt(inner_product(right, right, unit))
    if sign == 0.0 or not size < math.inf:
        return 0.0
    tangent[:] = right / size
    return sign


@inline
def shortest_flight_duration(y, cycle):
    """Return the duration of the shortest flight between contacts, in forcing periods."""
    c, shortest = cycle.walls.size, math.inf
    for i in range(c):
        begins = y[i + 1] if i < c - 1 else y[0] + cycle.m
        shortest = min(shortest, begins - y[i] - y[c + i] / math.sqrt(2.0 * cycle.kappa))
    return shortest


@inline
def reason_out_of_range(y, cycle, largest):
    """Return why a motion y is out of range, and which unknown shows it; `largest` is the end of the range of ε.

    Returns
    -------
    tuple of int
        SPAN (ε is out of its range), LOST (a contact vanishes) or FLIGHT (a flight vanishes), and the index of the
        unknown (−1 for FLIGHT); (−1, 0) if y is in range.
    """
    c = cycle.walls.size
    if not 0.0 <= y[2 * c] <= largest:
        return SPAN, 2 * c
    for i in range(c):
        if not y[c + i] >= LEAST_CONTACT:
            return LOST, c + i
    if not shortest_flight_duration(y, cycle) > LEAST_FLIGHT:
        return FLIGHT, -1
    return -1, 0


@kernel
def solve_family_above_chord(a, b, share, cycle, y):
    """Write to y the solution in the plane normal to the chord from a to b, at the fraction `share` of the chord.

    Returns
    -------
    bool
        False if Newton's method fails.
    """
    y[:] = a + share * (b - a)
    return correct_in_hyperplane(y, b - a, cycle) > 0


@inline
def offset_from_target(y, index, level, chord, cycle, tangent):
    """Return the residual at y that is 0 at the solution which `locate_solution_between` seeks.

    The residual is y[index] − level. If a fold is sought (index −1), it is the rate at which ε changes along the family
    in the direction of `chord`. `tangent` is scratch memory.

    Returns
    -------
    float
        The residual; its sign differs on the two sides of the sought solution.
    """
    if index >= 0:
        return y[index] - level
    write_family_tangent(y, chord, cycle, tangent)
    return tangent[y.size - 1]


@kernel
def locate_solution_between(a, b, index, level, cycle, y):
    """Write to y the solution between a and b at which y[index] = level; for index −1, the fold at which ε turns back.

    The search makes secant steps along the chord, and halves its interval if a step leaves the interval.

    Returns
    -------
    bool
        False if Newton's method fails.
    """
    tangent, chord = np.empty(y.size), b - a
    lo, hi, side, share = 0.0, 1.0, 0, math.nan
    f_lo = offset_from_target(a, index, level, chord, cycle, tangent)
    f_hi = offset_from_target(b, index, level, chord, cycle, tangent)
    if f_lo * f_hi >= 0.0:  # no change of sign: the solution is at an end, where rounding may have changed the sign
        y[:] = b if abs(f_hi) < abs(f_lo) else a
        return True
    for _ in range(MOST_SECANTS):
        last, share = share, (lo * f_hi - hi * f_lo) / (f_hi - f_lo)
        if not lo < share < hi:
            share = 0.5 * (lo + hi)
        if not solve_family_above_chord(a, b, share, cycle, y):
            return False
        f = offset_from_target(y, index, level, chord, cycle, tangent)
        if f == 0.0 or abs(share - last) <= 1e-15:
            return True
        lo, f_lo, hi, f_hi, side = narrow_bracket(lo, f_lo, hi, f_hi, side, share, f)
    return True


@kernel
def is_solution_between(solution, a, b, cycle, y):
    """Return whether a solution lies on a family between two points a and b of the family.

    The times of the solution may differ from those of the family by whole periods. y is overwritten in any
    case. If the solution lies there, y receives it with times shifted to those of the family.

    Returns
    -------
    bool
        True if the solution lies between a and b.
    """
    c, along, length, off, size = cycle.walls.size, 0.0, 0.0, 0.0, 0.0
    unit, n = epsilon_unit(cycle), a.size - 1
    later = cycle.m * np.rint((b[0] - solution[0]) / cycle.m)
    for j in range(a.size):
        y[j] = solution[j] + (later if j < c else 0.0)
        of = 1.0 if j < n else unit
        along += (y[j] - a[j]) * (b[j] - a[j]) / (of * of)
        length += ((b[j] - a[j]) / of) ** 2
    share = along / length
    if not 0.0 <= share <= 1.0:
        return False
    for j in range(a.size):
        of = 1.0 if j < n else unit
        off = max(off, abs(y[j] - a[j] - share * (b[j] - a[j])) / of)
        size = max(size, abs(b[j] - a[j]) / of)
    if not off < LARGEST_TURN * size:
        return False
    twin = y.copy()
    return solve_family_above_chord(a, b, share, cycle, y) and np.max(np.abs(y - twin)) < SAME_SOLUTION


@kernel
def follow_family(start, direction, cycle, largest, points):
    """Follow a family from the solution `start` towards `direction`, while ε is from 0 to `largest`.

    The unknowns of motions with c contacts are written to `points` (most, 2c + 1), whose length limits their number.

    Returns
    -------
    tuple
        The number of points, and the code (SPAN to BROKEN) of the reason why the family ends.
    """
    n = start.size
    tangent, new_tangent, new = np.empty(n), np.empty(n), np.empty(n)
    sign = write_family_tangent(start, direction, cycle, tangent)
    points[0], k, step = start, 1, FIRST_STEP
    if sign == 0.0:
        return k, BROKEN
    c, unit = cycle.walls.size, epsilon_unit(cycle)
    while k < len(points):
        x = points[k - 1]
        step = min(step, LONGEST_STEP, max(STEP_SHARE * x[c : 2 * c].min(), LEAST_CONTACT))
        if step < SHORTEST_STEP:
            return k, BROKEN
        new[:] = x + step * tangent
        corrections = correct_in_hyperplane(new, tangent, cycle)
        far = math.sqrt(inner_product(new - x, new - x, unit)) > 2.0 * step
        new_sign = write_family_tangent(new, tangent, cycle, new_tangent) if corrections > 0 and not far else 0.0
        turn = math.acos(min(max(inner_product(tangent, new_tangent, unit), -1.0), 1.0))
        if new_sign != sign or turn > LARGEST_TURN:
            step *= 0.4
            continue
        if k > 2 and is_solution_between(start, x, new, cycle, points[k]):
            return k + 1, CLOSED
        why, index = reason_out_of_range(new, cycle, largest)
        if why >= 0:
            if why == FLIGHT:
                points[k] = new
                return k + 1, FLIGHT
            level = LEAST_CONTACT if why == LOST else largest if new[index] > 0.0 else 0.0
            return k + locate_solution_between(x, new, index, level, cycle, points[k]), why
        points[k], tangent[:], k = new, new_tangent, k + 1
        step *= min(2.0, 0.5 * LARGEST_TURN / max(turn, 1e-9)) if corrections <= 4 else 0.7
    return k, BROKEN


@kernel
def find_folds(points, cycle, folds):
    """Return the k folds of a family, at which ε turns back, as unknowns (k, 2c + 1) of motions with c contacts.

    The folds lie between points of the family. For each fold the index of the point before it is written to `folds`.

    Returns
    -------
    tuple
        The folds, and whether all of them could be located.
    """
    n = points.shape[1]
    tangent, found, before = np.empty(n), np.empty((len(points), n)), np.empty(n)
    rate, k, all_located = 0.0, 0, True
    for i in range(len(points)):
        towards = points[i + 1] - points[i] if i < len(points) - 1 else points[i] - points[i - 1]
        write_family_tangent(points[i], towards, cycle, tangent)
        if i > 0 and tangent[n - 1] * rate < 0.0:
            if locate_solution_between(points[i - 1], points[i], -1, 0.0, cycle, before):
                found[k], folds[k] = before, i - 1
                k += 1
            else:
                all_located = False
        rate = tangent[n - 1]
    return found[:k], all_located


@kernel
def index_on_family(points, solution, cycle):
    """Return the index of the family's point after which a solution lies; −1 if the solution is not on the family."""
    y = np.empty(solution.size)
    for i in range(len(points) - 1):
        if is_solution_between(solution, points[i], points[i + 1], cycle, y):
            return i
    return -1
