"""The first impact of one flight (compiled): single precision finds and proves it, double precision lands on it; else a
search of monotone pieces that cannot skip a crossing. docs/kernel.md has the derivations.
"""

import math

import numpy as np
from numpy import float32 as f32

from rattle.flight.guess import depth, first_guess, level_of, local_root, refined, taylor
from rattle.flight.law import (
    DRIFT,
    TWO_PI,
    evaluate,
    evaluate_short,
    fourth_derivative,
    negative_arc,
    second_derivative,
    third_derivative,
    versines,
)
from rattle.flight.proof import clears_the_gap, is_located, single_turn
from rattle.numerics.compile import inline, kernel

OK = 0
# Not plain 1 and −1, for which the compiler would make variants of every kernel below.
SIGMA_PLUS, SIGMA_MINUS = np.int64(1), np.int64(-1)
NO_IMPACT = 1  # no impact within LONGEST forcing periods: backwards in time, at tiny damping, or on non-finite input
LONGEST = 1000.0
PIECE = 0.25  # longest piece of the search: a quarter turn of the forcing
SAME_PHASE = 1e-12  # a piece starting this close before the arc starts in it: rounding must not hide the arc's exit
MOST_STEPS = 100
BISECTED = 5  # one step in so many halves the bracket: where F is nearly exponential the others are too short

FARTHEST_STEP = 1e-4  # longest last step, of the flight time or of a period


@inline
def last_step(s, f0, f1, lost, sin1, cos1, a, delta, epsilon):
    """The step u to F = 0 from a close guess s, its height f0 and what `evaluate_short` gives there.

    The root of the Taylor series by reversion, to third order. What is left out is u⁴ (5p (p² − q) + r) with p, q, r =
    F''/2F', F‴/6F', F⁗/24F'. Returns (u, exact); exact tells that this is below 2e-15 s.
    """
    f2 = second_derivative(a, lost, cos1, delta, epsilon)
    f3 = third_derivative(a, lost, sin1, delta, epsilon)
    f4 = fourth_derivative(a, lost, cos1, delta, epsilon)
    inverse = 1.0 / f1
    u = -f0 * inverse
    size = abs(u)
    p = 0.5 * f2 * inverse
    q = f3 * (1.0 / 6.0) * inverse
    # each below 1e-4: |up|, 1e4 |u²q| and 1e7 |u³r|, with r = F⁗/24F'
    terms = 0.5 * abs(f2) + size * (1e4 / 6.0 * abs(f3) + size * (1e7 / 24.0) * abs(f4))
    exact = (size < FARTHEST_STEP * min(s, 1.0)) & (size * terms < 1e-4 * abs(f1))
    return u * (1.0 - u * (p - u * (2.0 * p * p - q))), exact


@inline
def stepped(u, f1, lost, sin1, cos1, a, delta, epsilon):
    """F', F'', 1 − e^(−δs), sin and cos after a step u, by Taylor series: what is left out is below 1e-15 of each."""
    f2 = second_derivative(a, lost, cos1, delta, epsilon)
    f3 = third_derivative(a, lost, sin1, delta, epsilon)
    f4 = fourth_derivative(a, lost, cos1, delta, epsilon)
    y, x = TWO_PI * u, delta * u
    omc, siny = y * y * (0.5 - y * y * (1.0 / 24.0)), y * (1.0 - y * y * (1.0 / 6.0))
    w1 = f1 + u * (f2 + u * (0.5 * f3 + u * f4 * (1.0 / 6.0)))
    cos2 = cos1 - (siny * sin1 + omc * cos1)
    lost += (1.0 - lost) * x * (1.0 - x * (0.5 - x * (1.0 / 6.0)))
    return w1, second_derivative(a, lost, cos2, delta, epsilon), lost, sin1 + (siny * cos1 - omc * sin1), cos2


@kernel
def proven_impact(wall, tau, w, a, sin0, cos0, delta, epsilon, beta):
    """The first impact by the stages that a block of lanes runs: (proved, next wall, s, F', 1 − e^(−δs), sin,
    cos)."""
    wall_, w_, sin_, cos_, delta_, epsilon_ = f32(wall), f32(w), f32(sin0), f32(cos0), f32(delta), f32(epsilon)
    gap = f32(2.0 * beta)
    a_ = f32(DRIFT) - f32(TWO_PI) * epsilon_ * sin_ - w_
    s = first_guess(wall_, w_, sin_, cos_, delta_, f32(1.0 / delta), epsilon_, gap)
    c0, c1, c2, c3, c4, c5 = taylor(s, w_, a_, sin_, cos_, delta_, epsilon_)
    lowest, bound, tilt, turn = depth(s, c0, c1, c2, c3, c4, c5, w_, a_, delta_, epsilon_)
    falls = wall > 0 and lowest < -gap
    level_ = level_of(wall_, falls, gap)
    s += local_root(not falls, c0 - level_, c1, c2, c3, c4, c5)
    s, step, speed = refined(s, level_, w_, a_, sin_, cos_, delta_, epsilon_)
    proved = is_located(s, step, speed, w_, a_, delta_, epsilon_)
    proved &= clears_the_gap(wall_, not falls, s, turn, bound, tilt, gap, w_, a_, sin_, delta_, epsilon_)
    arc, leave, length, sin_entry, sin_exit = negative_arc(delta, epsilon)
    proved &= single_turn(
        wall_,
        not falls,
        f32(tau),
        s,
        turn,
        w_,
        a_,
        sin_,
        delta_,
        epsilon_,
        f32(leave),
        f32(length),
        f32(sin_entry),
        f32(sin_exit),
        not arc,
    )
    level = -2.0 * beta if falls else (0.0 if wall > 0 else 2.0 * beta)
    close = np.float64(s)
    f0, f1, _f2, lost, sin1, cos1 = evaluate_short(close, w, a, sin0, cos0, delta, epsilon)
    u, exact = last_step(close, f0 - level, f1, lost, sin1, cos1, a, delta, epsilon)
    end = close + u
    w1, _bend, lost, sin1, cos1 = stepped(u, f1, lost, sin1, cos1, a, delta, epsilon)
    proved &= exact
    target = -1 if falls else 1
    return proved and end > 0.0 and target * w1 > 0.0, target, end, w1, lost, sin1, cos1


@kernel
def root_in(lo, hi, guess, level, rising, w, a, sin0, cos0, delta, epsilon):
    """The crossing F = level in (lo, hi), where F is monotone: Halley steps u kept inside a shrinking bracket.

    A step leaves an error of u³ (p² + |F‴/6F'|) with p = F''/2F'; the last one leaves less than rounding.
    """
    s = guess
    if not (lo < s < hi):
        s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        f0, f1, f2, lost, sin1, _c = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        f0 -= level
        if (f0 > 0.0) == rising:
            hi = s
        else:
            lo = s
        u, p = -f0 / f1, 0.5 * f2 / f1
        u /= 1.0 + u * p
        bend = p * p + abs(third_derivative(a, lost, sin1, delta, epsilon) / f1)
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
def extremum_in(lo, hi, guess, convex, w, a, sin0, cos0, delta, epsilon):
    """The zero of F' in (lo, hi), where e^(δs) F' is monotone, to 1e-9: F there is then exact to rounding."""
    s = guess
    if not (lo < s < hi):
        s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        _f0, f1, f2, lost, sin1, _c = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        if (f1 > 0.0) == convex:
            hi = s
        else:
            lo = s
        u = -f1 / (f2 + delta * f1)  # F'' + δF' is the contact force, which keeps its sign
        new = s + u
        inside = lo <= new <= hi
        bend = abs(third_derivative(a, lost, sin1, delta, epsilon) / f2) + abs(delta)
        if inside and u * u * bend < 1e-9 * min(s, 1.0):
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (lo + hi)
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def impact_on_piece(s0, s1, start, end, guess, lower, upper, w, a, sin0, cos0, delta, epsilon):
    """The crossing, if any, on a monotone piece from F = start to F = end: (wall or 0, time)."""
    wall = 1 if end > start and end > upper else -1 if end < start and end < lower else 0
    if wall == 0:
        return 0, s1
    level = upper if wall > 0 else lower
    if math.isnan(guess):
        guess = s0 + (level - start) / (end - start) * (s1 - s0)
    return wall, root_in(s0, s1, guess, level, wall > 0, w, a, sin0, cos0, delta, epsilon)


@inline
def end_of_piece(s, longest, tau, arc, leave, length):
    """Where a piece that starts after s ends: after `longest`, or before, where the contact force changes sign."""
    e = s + longest
    if arc:
        to_exit = leave - tau - s
        to_exit -= math.floor(to_exit)
        ahead = to_exit - length if to_exit > length + SAME_PHASE else to_exit
        if s + ahead > s:
            e = min(e, s + ahead)
    return e


@kernel
def searched_crossing(tau, w, a, sin0, cos0, delta, epsilon, lower, upper):
    """First crossing of F = lower ≤ 0 downwards or F = upper ≥ 0 upwards by pieces on which e^(δs) F' is monotone, so
    that F has one extremum at most: (status, +1 for the upper and −1 for the lower one, time).

    The pieces end where the contact force changes sign, and at least four times a period; each is cut at its extremum,
    and the first monotone part that reaches a level holds the crossing.
    """
    arc, leave, length, _entry, _exit = negative_arc(delta, epsilon)
    s, f0, f1 = 0.0, 0.0, w
    while s < LONGEST:
        e = end_of_piece(s, PIECE, tau, arc, leave, length)
        e0, e1, _f2, _d, _s, _c = evaluate(e, w, a, sin0, cos0, delta, epsilon)
        if not (abs(e0) < math.inf):
            break
        first, x0 = s, f0
        if f1 < 0.0 < e1 or e1 < 0.0 < f1:
            guess = s - f1 * (e - s) / (e1 - f1)
            first = extremum_in(s, e, guess, e1 > 0.0, w, a, sin0, cos0, delta, epsilon)
            x0 = evaluate(first, w, a, sin0, cos0, delta, epsilon)[0]
            hit, t = impact_on_piece(s, first, f0, x0, math.nan, lower, upper, w, a, sin0, cos0, delta, epsilon)
            if hit != 0:
                return OK, hit, t
        guess = 2.0 * first if s == 0.0 else math.nan  # a small bounce is a parabola
        hit, t = impact_on_piece(first, e, x0, e0, guess, lower, upper, w, a, sin0, cos0, delta, epsilon)
        if hit != 0:
            return OK, hit, t
        s, f0, f1 = e, e0, e1
    return NO_IMPACT, 0, s


@kernel
def safe_impact(wall, tau, w, sin0, cos0, delta, epsilon, beta, drift):
    """The search, with the state at the impact: (status, s, wall, F', 1 − e^(−δs), sin, cos)."""
    a = drift - TWO_PI * epsilon * sin0 - w
    upper = 0.0 if wall > 0 else 2.0 * beta
    lower = upper - 2.0 * beta
    status, target, s = searched_crossing(tau, w, a, sin0, cos0, delta, epsilon, lower, upper)
    _f0, w1, _f2, lost, sin1, cos1 = evaluate(s, w, a, sin0, cos0, delta, epsilon)
    w1 = target * max(target * w1, 0.0)  # a graze to the last bit arrives with speed 0, never backwards
    return status, s, target, w1, lost, sin1, cos1


@kernel
def first_impact(wall, tau, w, delta, epsilon, beta, drift):
    """First impact after leaving a wall at phase tau ∈ [0, 1) with velocity w into the gap.

    Returns (status, time, wall, velocity before reflection, 1 − e^(−δ time), sin, cos of 2π phase at departure, at
    arrival).
    """
    versine, sin0, _defect = versines(tau)
    cos0 = 1.0 - versine
    if delta > 0.0:
        a = drift - TWO_PI * epsilon * sin0 - w
        proved, target, s, w1, lost, sin1, cos1 = proven_impact(wall, tau, w, a, sin0, cos0, delta, epsilon, beta)
        if proved:
            return OK, s, target, w1, lost, sin0, cos0, sin1, cos1
    status, s, target, w1, lost, sin1, cos1 = safe_impact(wall, tau, w, sin0, cos0, delta, epsilon, beta, drift)
    return status, s, target, w1, lost, sin0, cos0, sin1, cos1
