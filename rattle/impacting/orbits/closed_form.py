"""The period-one motions in closed form (compiled): A and C (P(1,1,0)), B and D (P(1,1,1)).

With X = ε cos 2πτ, Y = ε sin 2πτ and the time s from Σ⁺ to Σ⁻, closure of P(1,1,1) is linear in X and Y. Let p and q
be the decaying parts of the velocity after Σ⁺ and after Σ⁻, Y' = ε sin 2π(τ + s), E = e^(−δ), Es = e^(−δs), Er =
e^(−δ(1−s)). The velocities close if

    p + Er q = 8π − 4πY,    Es p + q = 8π − 4πY',

and the displacements if p(1 − Es) + q(1 − Er) = 4πδ and p(1 − Es)/δ = 2β + 4πs − X(1 − cos 2πs) − Y sin 2πs.
"""

import math

import numpy as np

from rattle.flight.first_impact import SIGMA_MINUS, SIGMA_PLUS, first_impact
from rattle.flight.law import DRIFT, TWO_PI, Flight, folded, versines
from rattle.flight.tangent import flight_tangent
from rattle.numerics.compile import kernel
from rattle.numerics.secant import narrowed

A, B, C, D = np.arange(4)  # of a type that makes no variants of kernels, as the walls
FOUR_PI = 4.0 * math.pi
SAME_TIME = 1e-6  # a recomputed flight time this close to the family's is the same impact
GRAZING_SPEED = 1e-6
EDGE = 1e-9  # nodes start this close to s = 1/2, where the closure is singular
NODES_PER_SIDE = 160


@kernel
def closure(s, delta, beta):
    """Numerators of X, Y, v, u (speed at Σ⁻) and their common denominator, at time s from Σ⁺ to Σ⁻."""
    omc, siny, _defect = versines(s)
    cosy = 1.0 - omc
    r = 1.0 - s
    ls, lr = -math.expm1(-delta * s), -math.expm1(-delta * r)
    es, er = 1.0 - ls, 1.0 - lr
    le = ls + lr - ls * lr
    k_s, k_r = 2.0 * ls - le, 2.0 * lr - le
    a11, a12, b1 = k_r * siny, k_s + k_r * cosy, 4.0 * ls * lr - delta * le
    f = ls / (delta * le)
    a21 = f * FOUR_PI * er * siny + omc
    a22 = f * FOUR_PI * (er * cosy - 1.0) + siny
    b2 = 2.0 * beta + FOUR_PI * s - f * 2.0 * FOUR_PI * lr
    determinant = a11 * a22 - a12 * a21
    x, y = b1 * a22 - a12 * b2, a11 * b2 - a21 * b1
    y_s = y * cosy + x * siny
    p = (2.0 * FOUR_PI * lr * determinant - FOUR_PI * y + FOUR_PI * er * y_s) / le
    v = p - FOUR_PI * determinant + TWO_PI * y
    u = p * es - FOUR_PI * determinant + TWO_PI * y_s
    return x, y, v, u, determinant


@kernel
def amplitude(s, delta, beta):
    """ε(s) on the family: infinite at its pole."""
    x, y, _v, _u, determinant = closure(s, delta, beta)
    return math.hypot(x, y) / abs(determinant)


@kernel
def residual(kind, level, s, delta, beta):
    """0: ε(s) − level;  1: speed at Σ⁻ times the closure's denominator (no pole)."""
    if kind == 0:
        return amplitude(s, delta, beta) - level
    return closure(s, delta, beta)[3]


@kernel
def solve(kind, level, lo, hi, delta, beta):
    """Root of a residual that changes sign over (lo, hi): secant steps, halved when they stall, down to adjacent
    doubles.
    """
    f_lo, f_hi = residual(kind, level, lo, delta, beta), residual(kind, level, hi, delta, beta)
    side, last = 0, math.nan
    for _ in range(200):
        s = (lo * f_hi - hi * f_lo) / (f_hi - f_lo)
        if not (min(lo, hi) < s < max(lo, hi)):
            s = 0.5 * (lo + hi)
        f = residual(kind, level, s, delta, beta)
        if f == 0.0 or abs(s - last) <= 1e-16:
            return s
        last = s
        lo, f_lo, hi, f_hi, side = narrowed(lo, f_lo, hi, f_hi, side, s, f)
    return 0.5 * (lo + hi)


@kernel
def turning_point(lo, hi, sign, delta, beta):
    """Minimum (sign = 1) or maximum (−1) of ε(s) inside (lo, hi) by golden section."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    x1, x2 = hi - ratio * (hi - lo), lo + ratio * (hi - lo)
    f1, f2 = sign * amplitude(x1, delta, beta), sign * amplitude(x2, delta, beta)
    while hi - lo > 1e-9 * abs(0.5 * (lo + hi) - 0.5) + 1e-13:
        if f1 < f2:
            hi, x2, f2 = x2, x1, f1
            x1 = hi - ratio * (hi - lo)
            f1 = sign * amplitude(x1, delta, beta)
        else:
            lo, x1, f1 = x1, x2, f2
            x2 = lo + ratio * (hi - lo)
            f2 = sign * amplitude(x2, delta, beta)
    return 0.5 * (lo + hi)


@kernel
def nodes(delta, beta):
    """Increasing s and ε(s), between which ε is monotone: a scan that is geometric about the pole, with the turning
    points added.
    """
    n = NODES_PER_SIDE
    s = np.empty(2 * n + 24)
    for i in range(n):
        gap = EDGE * (0.5 * (1.0 - 1e-6) / EDGE) ** (i / (n - 1.0))
        s[n - 1 - i], s[n + i] = 0.5 - gap, 0.5 + gap
    size = 2 * n
    e = np.empty(s.size)
    for i in range(size):
        e[i] = amplitude(s[i], delta, beta)
    for i in range(1, 2 * n - 1):
        below = e[i] < e[i - 1] and e[i] < e[i + 1]
        above = e[i] > e[i - 1] and e[i] > e[i + 1]
        pole = i == n - 1 or i == n
        if (below or above) and not pole and size < s.size:
            s[size] = turning_point(s[i - 1], s[i + 1], 1.0 if below else -1.0, delta, beta)
            e[size] = amplitude(s[size], delta, beta)
            size += 1
    for i in range(2 * n, size):  # a few turning points among nodes in order: insertion
        new_s, new_e, j = s[i], e[i], i
        while s[j - 1] > new_s:
            s[j], e[j] = s[j - 1], e[j - 1]
            j -= 1
        s[j], e[j] = new_s, new_e
    return s[:size], e[:size]


@kernel
def trace_of_one_flight(delta, x):
    """Trace of DΠ at A or C, with x = ε cos 2πτ; the determinant is e^(−δ)."""
    return 1.0 + math.exp(-delta) + FOUR_PI * math.expm1(-delta) * x / (delta * delta)


@kernel
def single_impact_orbit(cosine, delta, epsilon, beta, offset):
    """A (cosine < 0) or C (cosine > 0): (admissible, τ, v, trace)."""
    v = TWO_PI * delta
    if epsilon < abs(offset) or epsilon == 0.0:
        return False, 0.0, v, 0.0
    x = cosine * math.sqrt((epsilon - offset) * (epsilon + offset))
    tau = folded(math.atan2(offset, x) / TWO_PI)
    status, time, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    admissible = status == 0 and wall == 1 and abs(time - 1.0) < SAME_TIME
    return admissible, tau, v, trace_of_one_flight(delta, x)


@kernel
def double_impact_orbit(s, delta, epsilon, beta):
    """The P(1,1,1) orbit of this family member: (admissible, τ, v, trace)."""
    x, y, v, u, determinant = closure(s, delta, beta)
    x, y, v, u = x / determinant, y / determinant, v / determinant, u / determinant
    tau = folded(math.atan2(y, x) / TWO_PI)
    if not (v > 0.0 and u > 0.0):
        return False, tau, v, 0.0
    status, t1, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    touches = wall == -1 and abs(t1 - s) < SAME_TIME
    grazes = u < GRAZING_SPEED and wall == 1 and abs(t1 - 1.0) < 1e-3  # a depth of u² is lost in rounding
    if status != 0 or not (touches or grazes):
        return False, tau, v, 0.0
    middle = folded(tau + s)
    status, t2, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_MINUS, middle, u, delta, epsilon, beta, DRIFT)
    if status != 0 or wall != 1 or abs(s + t2 - 1.0) > SAME_TIME:
        return False, tau, v, 0.0
    sin0, cos0 = y / epsilon, x / epsilon
    omc, siny, _defect = versines(s)
    sin1, cos1 = sin0 + cos0 * siny - sin0 * omc, cos0 - cos0 * omc - sin0 * siny
    d1, d2 = -math.expm1(-delta * s), -math.expm1(-delta * (1.0 - s))
    down = Flight(-v, DRIFT - TWO_PI * epsilon * sin0 + v, sin0, cos0, delta, epsilon)
    up = Flight(u, DRIFT - TWO_PI * epsilon * sin1 - u, sin1, cos1, delta, epsilon)
    a00, a01, a10, a11 = flight_tangent(-u, d1, sin1, cos1, down)
    b00, b01, b10, b11 = flight_tangent(v, d2, sin0, cos0, up)
    return True, tau, v, b00 * a00 + b01 * a10 + b10 * a01 + b11 * a11


@kernel
def record(orbit, admissible, tau, v, trace, exists, phase, speed, traces, i):
    """Keep the first admissible orbit of a kind: with s from 1 down, the branch that SN2 creates comes first."""
    if admissible and not exists[orbit, i]:
        exists[orbit, i] = True
        phase[orbit, i], speed[orbit, i], traces[orbit, i] = tau, v, trace


@kernel
def period_one_cells(order, delta, epsilon, beta, offset):
    """All admissible A–D of flat parameter arrays, visited so that equal (δ, β) follow each other: (exists, τ, v,
    trace), (4, n).
    """
    n = delta.size
    exists = np.zeros((4, n), np.bool_)
    phase, speed, traces = np.full((4, n), np.nan), np.full((4, n), np.nan), np.full((4, n), np.nan)
    last = -1
    s, e = np.empty(0), np.empty(0)
    for i in order:
        d, eps, b = delta[i], epsilon[i], beta[i]
        ok, tau, v, trace = single_impact_orbit(-1.0, d, eps, b, offset[i])
        record(A, ok, tau, v, trace, exists, phase, speed, traces, i)
        ok, tau, v, trace = single_impact_orbit(1.0, d, eps, b, offset[i])
        record(C, ok, tau, v, trace, exists, phase, speed, traces, i)
        if last < 0 or d != delta[last] or b != beta[last]:
            s, e = nodes(d, b)
        last = i
        for j in range(s.size - 2, -1, -1):
            if (e[j] - eps) * (e[j + 1] - eps) <= 0.0 and not s[j] < 0.5 < s[j + 1]:
                root = solve(0, eps, s[j], s[j + 1], d, b)
                ok, tau, v, trace = double_impact_orbit(root, d, eps, b)
                record(D if e[j + 1] > e[j] else B, ok, tau, v, trace, exists, phase, speed, traces, i)
    return exists, phase, speed, traces


@kernel
def next_grazing(s, delta, beta):
    """The first time in (s, 1) at which the family's speed at Σ⁻ vanishes, NaN if there is none."""
    lo, f_lo = s, closure(s, delta, beta)[3]
    ratio = (0.5 / EDGE) ** (1.0 / (2.0 * NODES_PER_SIDE))
    while lo < 1.0:
        hi = min(0.5 + (lo - 0.5) * ratio, 1.0)
        f_hi = closure(hi, delta, beta)[3]
        if (f_lo > 0.0) != (f_hi > 0.0):
            return solve(1, 0.0, lo, hi, delta, beta)
        lo, f_lo = hi, f_hi
    return math.nan


@kernel
def grazing_point(s, delta, beta):
    """The grazing orbit of that time: (admissible, ε, τ, ε cos 2πτ). Its minimum is on Σ⁻, and nothing else is
    touched.
    """
    x, y, _v, _u, determinant = closure(s, delta, beta)
    x, y = x / determinant, y / determinant
    epsilon, tau = math.hypot(x, y), folded(math.atan2(y, x) / TWO_PI)
    w = -TWO_PI * delta
    status, t1, wall, w1, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, w, delta, epsilon, beta, DRIFT)
    if status == 0 and wall == -1 and abs(t1 - s) < 1e-4 and abs(w1) < 1e-4:
        status, t2, wall, _w, _d, _f, _s, _c = first_impact(
            SIGMA_MINUS, folded(tau + s), GRAZING_SPEED, delta, epsilon, beta, DRIFT
        )
        t1 = s + t2
    return status == 0 and wall == 1 and abs(t1 - 1.0) < 1e-4, epsilon, tau, x


@kernel
def grazing_cells(curve, delta, beta):
    """G1 (curve 0: C grazes) or G2 (1: A grazes) of flat arrays: (ε, τ, trace), NaN where absent."""
    epsilon, phase, trace = np.full(delta.size, np.nan), np.full(delta.size, np.nan), np.full(delta.size, np.nan)
    for i in range(delta.size):
        s = next_grazing(0.5 + EDGE, delta[i], beta[i])
        while s < 1.0:
            admissible, eps, tau, x = grazing_point(s, delta[i], beta[i])
            if admissible and (x >= 0.0) == (curve == 0):
                epsilon[i], phase[i], trace[i] = eps, tau, trace_of_one_flight(delta[i], x)
                break
            s = next_grazing(s + 1e-12, delta[i], beta[i])
    return epsilon, phase, trace


@kernel
def grazing_cosine(delta, beta):
    """ε cos 2πτ and ε where the family first grazes beyond s = 1/2, whichever orbit that is; NaN if nowhere."""
    s = next_grazing(0.5 + EDGE, delta, beta)
    x, y, _v, _u, determinant = closure(s, delta, beta)
    return x / determinant, math.hypot(x, y) / abs(determinant)
