"""Find stable orbits of period one that meet given walls in order (compiled).

A walk follows, in small steps, the curve of motions that satisfy all impact equations but the first.

The times that make all impacts but the first elastic lie on a curve (`rattle.impacting.orbits.impact_times`). The
orbits are the zeros along this curve of the residual R_0 of the first impact. The curve is a circuit: either it closes,
or it winds, which means that along it the first time grows by a whole period, after which it repeats.
"""

import math

from rattle.flight.impact_law import determinant
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.orbits.impact_times import (
    eliminate_times,
    find_fastest_impact,
    move_impact_times,
    solve_for_impact_times,
    write_equations,
)
from rattle.numerics.compile import inline, kernel

MOST_CORRECTIONS = 6
# a point is corrected to the curve until a correction is shorter than this, in forcing periods; the remaining error is
# of the order of the square of this correction
CORRECTED = 3e-4
FARTHEST = 0.3  # longest correction from the guess to the first point of a circuit, in forcing periods
SHORTEST = 1e-4  # shortest step along a circuit; a circuit that needs a shorter step is given up
# a step over which the residual R_0 bends too much is shortened, down to this share of the longest step
FINEST = 0.01
LEAST_COSINE = 0.9  # least cosine of the angle between a step and the curve's direction at the end of the step
MOST_STEPS = 400
# MOST_ZOOMS: most refinements towards an extremum of R_0. MOST_HALVINGS: most refinements of a bracket around its zero.
MOST_ZOOMS, MOST_HALVINGS = 12, 24
# the search for an orbit changes to Newton's method on all equations once a step along the circuit is shorter than this
# share of the first bracket around the orbit
NEAR = 0.02
SAME_ORBIT = 1e-7  # largest difference in phase, and relative difference in speed, of equal orbits
# how a walk along a circuit ends. LOST: it found no first point, or its steps became too many or too short; WOUND: the
# time of the first impact has changed by the given span; CLOSED: the walk is back at its start
LOST, WOUND, CLOSED = range(3)


@kernel
def add_orbit_if_new(n_plus, n_minus, tau, v, trace, work):
    """Add an orbit to the list `work.found`, unless it is in the list already or the list is full."""
    n = work.n_found
    for j in range(n):
        label = work.found[j, 0] == n_plus and work.found[j, 1] == n_minus
        if (
            label
            and abs(wrap_phase_difference(work.found[j, 2] - tau)) < SAME_ORBIT
            and abs(work.found[j, 3] - v) < SAME_ORBIT * v
        ):
            return
    if n < work.found.shape[0]:
        row = work.found[n]
        row[0], row[1], row[2], row[3], row[4] = n_plus, n_minus, tau, v, trace
        work.n_found = n + 1


@kernel
def keep_orbit_if_stable(work, n, delta, epsilon, beta):
    """Add the orbit whose n impacts have the times in `work` to `work.found`, if it is admissible and stable."""
    write_equations(work, n, delta, epsilon, beta)
    _value, _slope, at_one = eliminate_times(work, n)
    most = 2.0 * (1.0 + determinant(delta, 1.0, n))
    if 0.0 < at_one < most:  # both multipliers lie inside the unit circle
        admissible, tau, v = find_fastest_impact(work, n, delta, epsilon, beta)
        if admissible:
            n_plus = 0.0
            for i in range(n):
                n_plus += 1.0 if work.walls[i] > 0 else 0.0
            add_orbit_if_new(n_plus, n - n_plus, tau, v, 0.5 * most - at_one, work)


@kernel
def correct_to_curve(work, n, s, farthest, delta, epsilon, beta):
    """Set the times in `work` to the point of a curve at the distance s from `work.point` along `work.direction`.

    The curve holds the motions that satisfy all impact equations but the first, whose residual is R_0; a walk follows
    this curve in steps. The point is not found if a correction is longer than `farthest`, in forcing periods.

    Returns
    -------
    tuple
        (found, R_0, dR_0/ds) at the point.
    """
    for i in range(n):
        work.times[i] = work.point[i] + s * work.direction[i]
    for _ in range(MOST_CORRECTIONS):
        write_equations(work, n, delta, epsilon, beta)
        value, slope, _at_one = eliminate_times(work, n)
        off, along = 0.0, 0.0
        for i in range(n):
            off += work.direction[i] * work.change[i]
            along += work.direction[i] * work.response[i]
        first = -off / along
        size = move_impact_times(work, n, first)
        if not size < farthest:
            break
        if size < CORRECTED:
            return True, value + slope * first, slope / along
    return False, 0.0, 0.0


@kernel
def compare_step_with_curve(work, n):
    """Compare a step of a walk along a curve with the curve's direction at the end of the step.

    `work.direction` is the unit vector of the step, and `work.response` a tangent vector of the curve.

    Returns
    -------
    tuple of float
        The absolute cosine of the angle between step and curve, and the length of `work.response`, with a minus sign if
        this vector points backwards.
    """
    square, along = 0.0, 0.0
    for i in range(n):
        square += work.response[i] * work.response[i]
        along += work.direction[i] * work.response[i]
    length = math.copysign(math.sqrt(square), along)
    return along / length, length


@kernel
def keep_stable_orbit_between(work, n, lo, hi, f_lo, f_hi, farthest, delta, epsilon, beta):
    """Find the orbit between the distances lo and hi, where R_0 changes sign; add it to `work.found` if it is stable.

    The search runs along the curve of motions that satisfy all impact equations but the first. R_0 is the residual of
    the first equation; f_lo and f_hi are its values at lo and hi. Distances are measured from `work.point` along
    `work.direction`. The search takes Newton steps, or halves the bracket if a step leaves it. Finally Newton's method
    solves all equations.
    """
    s, close = lo - f_lo * (hi - lo) / (f_hi - f_lo), NEAR * (hi - lo)
    for _ in range(MOST_HALVINGS):
        ok, f, slope = correct_to_curve(work, n, s, farthest, delta, epsilon, beta)
        if not ok:
            break
        lo, hi = (s, hi) if (f > 0.0) == (f_lo > 0.0) else (lo, s)
        step = -f / slope
        inside = lo <= s + step <= hi
        if inside and abs(step) < close:
            break
        s = s + step if inside else 0.5 * (lo + hi)
    solved, _at_one = solve_for_impact_times(work, n, 0.1, delta, epsilon, beta)
    if solved:
        keep_orbit_if_stable(work, n, delta, epsilon, beta)


@kernel
def find_sign_change(work, n, hi, f_lo, slope_lo, f_hi, slope_hi, delta, epsilon, beta):
    """Search between the distances 0 and hi for a point at which R_0 has a sign other than at both ends.

    R_0 is the residual of the first impact equation. It has an extremum between the ends if its slopes there differ in
    sign. Distances are measured from `work.point` along `work.direction`.

    Returns
    -------
    tuple
        (found, distance, R_0) of the point.
    """
    lo, whole = 0.0, hi
    if min(abs(f_lo), abs(f_hi)) > 0.5 * hi * max(abs(slope_lo), abs(slope_hi)):
        return False, 0.0, 0.0
    for _ in range(MOST_ZOOMS):
        if not slope_lo * f_lo < 0.0 < slope_hi * f_hi:
            break
        # On an interval shorter than half of the first one, R_0 counts as convex or concave. Then it has no zero if the
        # tangents at both ends of the interval meet before they reach 0.
        if hi - lo < 0.5 * whole:
            s = (f_hi - f_lo + slope_lo * lo - slope_hi * hi) / (slope_lo - slope_hi)
            if (f_lo + slope_lo * (s - lo)) * f_lo > 0.0:
                break
        s = lo - slope_lo * (hi - lo) / (slope_hi - slope_lo)
        ok, f, slope = correct_to_curve(work, n, s, whole, delta, epsilon, beta)
        if not ok:
            break
        if f * f_lo <= 0.0:
            return True, s, f
        if slope * f < 0.0:
            lo, f_lo, slope_lo = s, f, slope
        else:
            hi, f_hi, slope_hi = s, f, slope
    return False, 0.0, 0.0


@inline
def is_step_short_enough(s, f0, slope0, f1, slope1):
    """Return whether a step of length s is so short that the residual R_0 bends little over the step.

    f0, slope0: R_0 and its slope at the beginning of the step. f1, slope1: the same at the end.

    Returns
    -------
    bool
        True if R_0 bends so little that the signs of f0 and f1 tell whether R_0 has a zero within the step.
    """
    bend = abs(f1 - f0 - 0.5 * s * (slope0 + slope1))
    return bend < (0.2 * abs(f1 - f0) if (f0 > 0.0) != (f1 > 0.0) else min(abs(f0), abs(f1)))


@kernel
def does_step_pass_start(work, n, s):
    """Return whether the next step along a curve, of length s, passes the curve's start: then the curve is closed."""
    ahead, square = 0.0, 0.0
    for i in range(n):
        d = work.start[i] - work.point[i]
        ahead += work.direction[i] * d
        square += d * d
    return 0.0 < ahead <= s and square - ahead * ahead < 0.25 * s * s


@kernel
def begin_walk(work, n, delta, epsilon, beta):
    """Begin a walk along the curve of motions that satisfy all impact equations but the first.

    The first point of the walk is the motion of the curve near the times in `work`.

    Returns
    -------
    tuple
        (found, R_0, dR_0/ds) at the first point. R_0 is the residual of the first impact equation, and s the
        distance along the curve.
    """
    for i in range(n):
        work.point[i], work.direction[i] = work.times[i], 0.0
    work.direction[0] = 1.0
    ok, f, slope = correct_to_curve(work, n, 0.0, FARTHEST, delta, epsilon, beta)
    cosine, length = compare_step_with_curve(work, n)
    for i in range(n):
        work.start[i] = work.point[i] = work.times[i]
        work.direction[i] = work.response[i] / length
    return ok, f, slope * cosine


@kernel
def walk_circuit(work, n, span, longest, delta, epsilon, beta):
    """Walk along the circuit near the times in `work`, and add all stable orbits on it to `work.found`.

    A circuit is a curve of motions that satisfy all impact equations but the first. The orbits are the zeros of the
    residual R_0 of the first impact equation along the curve. The walk ends when the first time has changed by `span`,
    or when the circuit closes. Steps are no longer than `longest`.

    Returns
    -------
    tuple
        (end, zeros). end: WOUND if the first time changed by `span`, CLOSED if the circuit closed, LOST if the walk was
        given up before. zeros: the number of sign changes of R_0.
    """
    ok, f0, slope0 = begin_walk(work, n, delta, epsilon, beta)
    s, zeros = longest, 0
    for step in range(MOST_STEPS if ok else 0):
        ok, f1, slope1 = correct_to_curve(work, n, s, s, delta, epsilon, beta)
        cosine, length = compare_step_with_curve(work, n)
        if (
            not ok
            or cosine < LEAST_COSINE
            or (s > FINEST * longest and not is_step_short_enough(s, f0, slope0, f1, slope1))
        ):
            s *= 0.4
            if s < SHORTEST:
                break
            continue
        for i in range(n):
            work.next_point[i], work.next_direction[i] = work.times[i], work.response[i] / length
        if (f0 > 0.0) != (f1 > 0.0):
            zeros += 1
            keep_stable_orbit_between(work, n, 0.0, s, f0, f1, s, delta, epsilon, beta)
        else:
            crosses, at, f = find_sign_change(work, n, s, f0, slope0, f1, slope1, delta, epsilon, beta)
            if crosses:
                zeros += 2
                keep_stable_orbit_between(work, n, 0.0, at, f0, f, s, delta, epsilon, beta)
                keep_stable_orbit_between(work, n, at, s, f, f1, s, delta, epsilon, beta)
        if step > 2 and does_step_pass_start(work, n, s):
            return CLOSED, zeros
        if abs(work.next_point[0] - work.start[0]) >= span:
            return WOUND, zeros
        for i in range(n):
            work.point[i], work.direction[i] = work.next_point[i], work.next_direction[i]
        f0, slope0 = f1, slope1 * cosine
        s = min(1.5 * s, longest)
    return LOST, zeros
