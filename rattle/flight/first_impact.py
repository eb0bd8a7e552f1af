"""The first impact of one flight (compiled).

Single precision locates the impact and proves that it is the first, and double precision computes it. Where the proof
fails, the flight is searched in monotone pieces that cannot skip a crossing. docs/kernel.md has the derivations.
"""

import math

import numpy as np
from numba.core.types import NamedUniTuple, Tuple, float64, int64
from numpy import float32 as f32

from rattle.flight.forcing import advance_sine_and_cosine, find_negative_force_arc, short_versine_and_sine
from rattle.flight.guess import (
    convert_flight_to_single_precision,
    estimate_minimum,
    guess_time_of_turn_or_arrival,
    height_at_next_wall,
    refine_time_at_level,
    taylor_coefficients,
    time_step_to_level,
)
from rattle.flight.law import (
    Flight,
    evaluate,
    evaluate_short,
    flight_from_phase,
    fourth_derivative,
    second_derivative,
    third_derivative,
)
from rattle.flight.proof import (
    convert_arc_to_single_precision,
    has_at_most_one_turn,
    is_certain_to_miss_opposite_wall,
    is_one_final_step_enough,
)
from rattle.numerics.compile import inline, kernel

OK = 0
# The walls are np.int64, because for the Python integers 1 and −1 numba would compile variants of every kernel below.
SIGMA_PLUS, SIGMA_MINUS = np.int64(1), np.int64(-1)
# Status of a flight that has no impact within LONGEST forcing periods. This happens backwards in time, at tiny damping,
# and if a number is not finite.
NO_IMPACT = 1
LONGEST = 1000.0
PIECE = 0.25  # longest piece of the search, in forcing periods
# Because of rounding, a piece that starts at most this long before the arc of negative force counts as starting in it.
SAME_PHASE = 1e-12
MOST_STEPS = 100
BISECTED = 5  # every fifth step halves the bracket, because other steps are too short where F is nearly exponential

FARTHEST_STEP = 1e-4  # the last step must be shorter than this share of the flight time, and of a forcing period

FLIGHT = NamedUniTuple(float64, len(Flight._fields), Flight)
_SAFE = Tuple((int64, float64, int64, *4 * (float64,)))(int64, float64, FLIGHT, float64)
_FIRST = Tuple((int64, float64, int64, *2 * (float64,), FLIGHT, *2 * (float64,)))(int64, *6 * (float64,))


@inline
def final_step_to_impact(s, f0, f1, lost, sin1, cos1, flight):
    """Return the step u from a close guess s to the impact, where F = 0, by reversion of the Taylor series of F.

    f0 is F at s, measured from the wall; f1, lost, sin1 and cos1 are the values of `evaluate_short` at s. The reversion
    is of third order. The neglected term is u⁴ (5p (p² − q) + r), where p = F''/2F', q = F‴/6F' and r = F⁗/24F'.

    Returns
    -------
    tuple[float, bool]
        u in forcing periods, and whether the neglected term is below 2e-15 times s.
    """
    f2 = second_derivative(lost, sin1, cos1, flight)
    f3 = third_derivative(lost, sin1, cos1, flight)
    f4 = fourth_derivative(lost, sin1, cos1, flight)
    inverse = 1.0 / f1
    u = -f0 * inverse
    size = abs(u)
    p = 0.5 * f2 * inverse
    q = f3 * (1.0 / 6.0) * inverse
    # if `exact` is true, then |up| < 1e-4, |u²q| < 1e-8 and |u³r| < 1e-11, where r = F⁗/24F'
    terms = 0.5 * abs(f2) + size * (1e4 / 6.0 * abs(f3) + size * (1e7 / 24.0) * abs(f4))
    exact = (size < FARTHEST_STEP * min(s, 1.0)) & (size * terms < 1e-4 * abs(f1))
    return u * (1.0 - u * (p - u * (2.0 * p * p - q))), exact


@inline
def state_after_step(u, f1, lost, sin1, cos1, flight):
    """Return F', F'', 1 − e^(−δs), and sine and cosine of the forcing's phase, at the time s + u of a flight.

    f1, lost, sin1, cos1: F', 1 − e^(−δs), sine and cosine at the time s. The five numbers follow by Taylor series in u,
    with relative errors below 1e-15.

    Returns
    -------
    tuple of float
        The five numbers.
    """
    f2 = second_derivative(lost, sin1, cos1, flight)
    f3 = third_derivative(lost, sin1, cos1, flight)
    f4 = fourth_derivative(lost, sin1, cos1, flight)
    step, x = short_versine_and_sine(u), flight.delta * u
    w1 = f1 + u * (f2 + u * (0.5 * f3 + u * f4 * (1.0 / 6.0)))
    sin2, cos2 = advance_sine_and_cosine(step, sin1, cos1)
    lost += (1.0 - lost) * x * (1.0 - x * (0.5 - x * (1.0 / 6.0)))
    return w1, second_derivative(lost, sin2, cos2, flight), lost, sin2, cos2


@kernel
def guess_first_impact(wall, tau, flight, beta):
    """Locate the first impact of one flight by a guess, and return whether it is proved to be the first.

    `rattle.flight.lanes` does the same for many flights, and more: it improves rough first guesses, and it locates the
    impact once more, by a scan, if the proof fails.

    Returns
    -------
    tuple
        (proved, next wall, flight time s, Φ' before the impact, 1 − e^(−δs), sin, cos), with sine and cosine of 2π
        times the phase of arrival. Where `proved` is False, the impact may not be the first.
    """
    wall_, gap, short = f32(wall), f32(2.0 * beta), convert_flight_to_single_precision(flight)
    s = guess_time_of_turn_or_arrival(wall_, gap, f32(1.0 / flight.delta), short)
    series = taylor_coefficients(s, short)
    lowest, minimum = estimate_minimum(s, series, short)
    falls = wall > 0 and lowest < -gap
    level_ = height_at_next_wall(wall_, falls, gap)
    s += time_step_to_level(not falls, level_, series)
    s += time_step_to_level(not falls, level_, taylor_coefficients(s, short))
    s, step, speed = refine_time_at_level(s, level_, short)
    proved = is_one_final_step_enough(s, step, speed, short)
    proved &= is_certain_to_miss_opposite_wall(wall_, not falls, s, minimum, gap, short)
    arc = convert_arc_to_single_precision(find_negative_force_arc(flight.delta, flight.epsilon))
    proved &= has_at_most_one_turn(wall_, not falls, f32(tau), s, minimum.time, short, arc)
    level = -2.0 * beta if falls else (0.0 if wall > 0 else 2.0 * beta)
    close = np.float64(s)
    f0, f1, _f2, lost, sin1, cos1 = evaluate_short(close, flight)
    u, exact = final_step_to_impact(close, f0 - level, f1, lost, sin1, cos1, flight)
    end = close + u
    w1, _bend, lost, sin1, cos1 = state_after_step(u, f1, lost, sin1, cos1, flight)
    proved &= exact
    target = -1 if falls else 1
    return proved and end > 0.0 and target * w1 > 0.0, target, end, w1, lost, sin1, cos1


@kernel
def find_crossing_in_bracket(lo, hi, guess, level, rising, flight):
    """Return the time in (lo, hi) at which F = level, by Halley steps in a shrinking bracket; F is monotone there.

    rising: whether F rises in (lo, hi). guess: a time near the crossing; if it is not in (lo, hi), the search begins in
    the middle. A step u leaves an error of u³ (p² + |F‴/6F'|) with p = F''/2F'. The error of the last step is below
    rounding.

    Returns
    -------
    float
        Time since the departure, in forcing periods.
    """
    s = guess
    if not (lo < s < hi):
        s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        f0, f1, f2, lost, sin1, cos1 = evaluate(s, flight)
        f0 -= level
        if (f0 > 0.0) == rising:
            hi = s
        else:
            lo = s
        u, p = -f0 / f1, 0.5 * f2 / f1
        u /= 1.0 + u * p
        bend = p * p + abs(third_derivative(lost, sin1, cos1, flight) / f1)
        new = s + u
        inside = lo <= new <= hi
        if inside and abs(u) * u * u * bend < 1e-17 * s:
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (lo + hi)
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def find_extremum_between(lo, hi, guess, convex, flight):
    """Return the time of the zero of F' in (lo, hi), where e^(δs) F' is monotone, with an error below 1e-9.

    An error of this size changes F, which is flat there, by less than rounding.
    convex: whether the extremum of F is a minimum.

    Returns
    -------
    float
        Time since the departure, in forcing periods.
    """
    s = guess
    if not (lo < s < hi):
        s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        _f0, f1, f2, lost, sin1, cos1 = evaluate(s, flight)
        if (f1 > 0.0) == convex:
            hi = s
        else:
            lo = s
        # a Newton step for e^(δs) F', whose derivative is e^(δs) times the contact force F'' + δF': not 0 in (lo, hi)
        u = -f1 / (f2 + flight.delta * f1)
        new = s + u
        inside = lo <= new <= hi
        bend = abs(third_derivative(lost, sin1, cos1, flight) / f2) + abs(flight.delta)
        if inside and u * u * bend < 1e-9 * min(s, 1.0):
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (lo + hi)
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def find_impact_on_piece(s0, s1, start, end, guess, lower, upper, flight):
    """Return (wall, time) of the crossing of F = lower or F = upper on a piece on which F is monotone.

    F goes from `start` at time s0 to `end` at time s1. guess: an estimate of the time of the crossing, or nan.

    Returns
    -------
    tuple[int, float]
        +1 for the upper level, −1 for the lower one, 0 if there is no crossing; and the time, s1 if there is none.
    """
    wall = 1 if end > start and end > upper else -1 if end < start and end < lower else 0
    if wall == 0:
        return 0, s1
    level = upper if wall > 0 else lower
    if math.isnan(guess):
        guess = s0 + (level - start) / (end - start) * (s1 - s0)
    return wall, find_crossing_in_bracket(s0, s1, guess, level, wall > 0, flight)


@inline
def end_of_piece(s, longest, tau, arc):
    """Return the end of a piece of a flight that begins at s: s + longest, or an earlier zero of the contact force.

    tau: the phase of the flight's departure. arc: the arc of negative contact force.

    Returns
    -------
    float
        Time since the departure, in forcing periods.
    """
    e = s + longest
    if arc.exists:
        to_exit = arc.exit_phase - tau - s
        to_exit -= math.floor(to_exit)
        ahead = to_exit - arc.length if to_exit > arc.length + SAME_PHASE else to_exit
        if s + ahead > s:
            e = min(e, s + ahead)
    return e


@kernel
def find_first_crossing(tau, flight, lower, upper):
    """Return the first crossing of F = lower ≤ 0 downwards or of F = upper ≥ 0 upwards.

    The search goes by pieces on which e^(δs) F' is monotone, so that F has at most one extremum on each. Pieces end
    where the contact force changes sign, and after at most a quarter of a period. Each piece is cut at its extremum.
    The first monotone part that reaches a level holds the crossing.

    Returns
    -------
    tuple
        (status, +1 for the upper or −1 for the lower level, time); status is OK, or NO_IMPACT if there is no crossing.
    """
    arc = find_negative_force_arc(flight.delta, flight.epsilon)
    s, f0, f1 = 0.0, 0.0, flight.w
    while s < LONGEST:
        e = end_of_piece(s, PIECE, tau, arc)
        e0, e1, _f2, _d, _s, _c = evaluate(e, flight)
        if not (abs(e0) < math.inf):
            break
        first, x0 = s, f0
        if f1 < 0.0 < e1 or e1 < 0.0 < f1:
            guess = s - f1 * (e - s) / (e1 - f1)
            first = find_extremum_between(s, e, guess, e1 > 0.0, flight)
            x0 = evaluate(first, flight)[0]
            hit, t = find_impact_on_piece(s, first, f0, x0, math.nan, lower, upper, flight)
            if hit != 0:
                return OK, hit, t
        # a small bounce is nearly a parabola: its flight lasts about twice the time to the turning point
        guess = 2.0 * first if s == 0.0 else math.nan
        hit, t = find_impact_on_piece(first, e, x0, e0, guess, lower, upper, flight)
        if hit != 0:
            return OK, hit, t
        s, f0, f1 = e, e0, e1
    return NO_IMPACT, 0, s


@kernel
def first_impact_by_safe_search(wall, tau, flight, beta):
    """Return the first impact of a flight, found by the search that cannot skip a crossing.

    Returns
    -------
    tuple
        (status, flight time s, wall, F', 1 − e^(−δs), sin, cos), with sine and cosine of 2π times the phase of arrival.
        If status is NO_IMPACT instead of OK, the other values have no meaning.
    """
    upper = 0.0 if wall > 0 else 2.0 * beta
    lower = upper - 2.0 * beta
    status, target, s = find_first_crossing(tau, flight, lower, upper)
    _f0, w1, _f2, lost, sin1, cos1 = evaluate(s, flight)
    w1 = target * max(target * w1, 0.0)  # rounding must not give a grazing arrival a velocity away from the wall
    return status, s, target, w1, lost, sin1, cos1


@kernel
def first_impact(wall, tau, w, delta, epsilon, beta, drift):
    """Return the first impact after leaving a wall at phase tau ∈ [0, 1) with velocity w into the gap.

    Returns
    -------
    tuple
        (status, time, wall, velocity before reflection, 1 − e^(−δ time), the flight, sin, cos of 2π phase at arrival).
        If status is NO_IMPACT instead of OK, only the flight has a meaning.
    """
    flight = flight_from_phase(tau, w, delta, epsilon, drift)
    if delta > 0.0:
        proved, target, s, w1, lost, sin1, cos1 = guess_first_impact(wall, tau, flight, beta)
        if proved:
            return OK, s, target, w1, lost, flight, sin1, cos1
    status, s, target, w1, lost, sin1, cos1 = first_impact_by_safe_search(wall, tau, flight, beta)
    return status, s, target, w1, lost, flight, sin1, cos1
