"""The period-one motions of one cosine with restitution r, without load, in closed form (compiled).

This is `rattle.impacting.orbits.closed_form` for any r. Let X = ε cos 2πτ, Y = ε sin 2πτ, s = 1/2 + σ the time from Σ⁺
to Σ⁻, E = e^(−δ), Es = e^(−δs), Er = e^(−δ(1−s)), and let p and q be the decaying parts of the velocity after Σ⁺ and
after Σ⁻. P(1,1,1) is periodic where

    p + r Er q = (1 + r)(4π − 2πY),            r Es p + q = (1 + r)(4π − 2πY'),
    p(1 − Es)/δ = 2β + 4πs + Z,                q(1 − Er)/δ = 4π(1 − s) − 2β − Z,

with Z = X' − X, where X' and Y' are the values of X and Y at Σ⁻. The equations are linear in X and Y, with determinant

    −2π(1 + r)² [2π sin 2πσ − δ (1 + cos 2πσ)(Er − Es)/((1 − Es)(1 − Er))],

which vanishes only at σ = 0, for every r. So ε is an explicit function of σ on either side of its pole at σ = 0. The
family is the set of these motions P(1,1,1), with parameter σ.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.flight.first_impact import SIGMA_MINUS, SIGMA_PLUS, first_impact
from rattle.flight.forcing import DRIFT, TWO_PI, versines
from rattle.flight.law import fold_phase
from rattle.inelastic.map.flight import InelasticFlight, forced_flight_tangent
from rattle.numerics.compile import inline, kernel
from rattle.numerics.secant import narrow_bracket

A, B, C, D = range(4)
SAME_TIME = 1e-6  # largest difference, in forcing periods, between a flight's time and the time in the equations
INNERMOST_NODE = 1e-9  # |σ| of the two nodes next to σ = 0, where the equations are singular
NODES_PER_SIDE = 160  # number of values of σ < 0, and of σ > 0, at which ε(σ) is first computed
MOST_NODES = 2 * NODES_PER_SIDE + 24  # nodes on both sides of σ = 0, and at most 24 turning points of ε(σ)
SMALL_DAMPING = 0.05  # value of δ times the flight time below which `departure_speed_over_drift` uses a series
MOST_STEPS = 200  # largest number of secant steps
Array = NDArray[np.float64]


@inline
def departure_speed_over_drift(x, lost):
    """Return x/(1 − e^(−x)) − 1 without cancellation, where `lost` is 1 − e^(−x).

    The value times the drift is the speed with which an unforced flight must leave Σ⁺ to return after the time x/δ.

    Returns
    -------
    float
        The value, about x/2 for small x.
    """
    if x < SMALL_DAMPING:
        y = x * x
        return x * (0.5 + x * (1.0 / 12.0 - y * (1.0 / 720.0 - y * (1.0 / 30240.0 - y / 1209600.0))))
    return x / lost - 1.0


@kernel
def two_impact_family_numerators(sigma, delta, beta, r):
    """Return numerators, with their common denominator, that describe the P(1,1,1) with time 1/2 + σ from Σ⁺ to Σ⁻.

    Returns
    -------
    tuple of float
        The numerators of ε cos 2πτ and ε sin 2πτ at Σ⁺, of the speed after Σ⁺, and of the speed of arrival at Σ⁻; and
        the denominator, which is 0 only at σ = 0.
    """
    omc, siny, _defect = versines(sigma)
    xs, xr = delta * (0.5 + sigma), delta * (0.5 - sigma)
    ls, lr = -math.expm1(-xs), -math.expm1(-xr)
    es, er = 1.0 - ls, 1.0 - lr
    h = abs(sigma)
    apart = math.copysign(-max(es, er) * math.expm1(-2.0 * delta * h), sigma)  # er − es, without cancellation
    f1, f2 = delta / ls, delta / lr
    c1 = DRIFT * departure_speed_over_drift(xs, ls) + 2.0 * beta * f1
    c2 = DRIFT * departure_speed_over_drift(xr, lr) - 2.0 * beta * f2
    k1 = r * es * c1 + c2 - DRIFT * r * ls
    k2 = c1 + r * er * c2 - DRIFT * r * lr
    g1, g2 = r * es * f1 - f2, f1 - r * er * f2
    turn = (1.0 + r) * TWO_PI
    a11, a12 = -g1 * (2.0 - omc) - turn * siny, g1 * siny - turn * (1.0 - omc)
    a21, a22 = -g2 * (2.0 - omc), g2 * siny + turn
    determinant = -turn * (turn * siny - (1.0 + r) * delta * apart * (2.0 - omc) / (ls * lr))
    x, y = k2 * a12 - k1 * a22, k1 * a21 - k2 * a11
    z = y * siny - x * (2.0 - omc)
    y_s = -(x * siny + y * (1.0 - omc))
    p_excess = c1 * determinant + f1 * z  # (p − 4π) times the determinant; p as in the docstring of the module
    return x, y, p_excess + TWO_PI * y, es * p_excess - DRIFT * ls * determinant + TWO_PI * y_s, determinant


@kernel
def epsilon_of_two_impact_family(sigma, delta, beta, r):
    """Return the ε of the P(1,1,1) whose time from Σ⁺ to Σ⁻ is 1/2 + σ; it is infinite at the pole σ = 0."""
    x, y, _v, _u, determinant = two_impact_family_numerators(sigma, delta, beta, r)
    return math.hypot(x, y) / abs(determinant)


@kernel
def sigma_at_epsilon(level, lo, hi, delta, beta, r):
    """Return the σ in (lo, hi) at which `epsilon_of_two_impact_family` equals `level`, by secant steps."""
    f_lo, f_hi = (
        epsilon_of_two_impact_family(lo, delta, beta, r) - level,
        epsilon_of_two_impact_family(hi, delta, beta, r) - level,
    )
    side, last = 0, math.nan
    for _ in range(MOST_STEPS):
        sigma = (lo * f_hi - hi * f_lo) / (f_hi - f_lo)
        if not (min(lo, hi) < sigma < max(lo, hi)):
            sigma = 0.5 * (lo + hi)
        f = epsilon_of_two_impact_family(sigma, delta, beta, r) - level
        if f == 0.0 or abs(sigma - last) <= 1e-16 * abs(sigma):
            return sigma
        last = sigma
        lo, f_lo, hi, f_hi, side = narrow_bracket(lo, f_lo, hi, f_hi, side, sigma, f)
    return 0.5 * (lo + hi)


@kernel
def family_turning_point(lo, hi, sign, delta, beta, r):
    """Return the σ in (lo, hi) at which `epsilon_of_two_impact_family` is least (sign = 1) or greatest (sign = −1)."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    x1, x2 = hi - ratio * (hi - lo), lo + ratio * (hi - lo)
    f1, f2 = (
        sign * epsilon_of_two_impact_family(x1, delta, beta, r),
        sign * epsilon_of_two_impact_family(x2, delta, beta, r),
    )
    while hi - lo > 1e-9 * abs(0.5 * (lo + hi)):
        if f1 < f2:
            hi, x2, f2 = x2, x1, f1
            x1 = hi - ratio * (hi - lo)
            f1 = sign * epsilon_of_two_impact_family(x1, delta, beta, r)
        else:
            lo, x1, f1 = x1, x2, f2
            x2 = lo + ratio * (hi - lo)
            f2 = sign * epsilon_of_two_impact_family(x2, delta, beta, r)
    return 0.5 * (lo + hi)


@kernel
def fill_family_nodes(delta, beta, r, sigma, e):
    """Write increasing σ to `sigma`, and the ε(σ) of the motions P(1,1,1) to `e`, both (MOST_NODES,).

    ε(σ) is monotone between neighbouring σ, except across its pole at σ = 0.

    Returns
    -------
    int
        The number of values of σ that are written.
    """
    n = NODES_PER_SIDE
    for i in range(n):
        gap = INNERMOST_NODE * (0.5 * (1.0 - 1e-6) / INNERMOST_NODE) ** (i / (n - 1.0))
        sigma[n - 1 - i], sigma[n + i] = -gap, gap
    size = 2 * n
    for i in range(size):
        e[i] = epsilon_of_two_impact_family(sigma[i], delta, beta, r)
    for i in range(1, 2 * n - 1):
        below = e[i] < e[i - 1] and e[i] < e[i + 1]
        above = e[i] > e[i - 1] and e[i] > e[i + 1]
        pole = i == n - 1 or i == n
        if (below or above) and not pole and size < sigma.size:
            sigma[size] = family_turning_point(sigma[i - 1], sigma[i + 1], 1.0 if below else -1.0, delta, beta, r)
            e[size] = epsilon_of_two_impact_family(sigma[size], delta, beta, r)
            size += 1
    for i in range(2 * n, size):  # insertion sort, because only a few turning points join nodes that are in order
        new, new_e, j = sigma[i], e[i], i
        while sigma[j - 1] > new:
            sigma[j], e[j] = sigma[j - 1], e[j - 1]
            j -= 1
        sigma[j], e[j] = new, new_e
    return size


@kernel
def one_impact_orbit(sign, delta, epsilon, beta, r):
    """Return (admissible, τ, v, trace of the tangent map) of A (sign = −1) or C (sign = 1), by the sign of cos 2πτ."""
    decay, lost = math.exp(-delta), -math.expm1(-delta)
    v = r * delta * DRIFT / (1.0 + r)
    offset = (v - DRIFT * departure_speed_over_drift(delta, lost)) / TWO_PI  # ε sin 2πτ
    if epsilon < abs(offset) or epsilon == 0.0:
        return False, 0.0, v, 0.0
    x = sign * math.sqrt((epsilon - offset) * (epsilon + offset))
    tau = fold_phase(math.atan2(offset, x) / TWO_PI)
    status, time, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    admissible = status == 0 and wall == 1 and abs(time - 1.0) < SAME_TIME
    return admissible, tau, v, 1.0 + r * r * decay - (1.0 + r) ** 2 * math.pi * lost * x / (delta * delta)


@inline
def flight_at_phase(w, x, y, delta):
    """Return the flight that departs with velocity w at a phase τ, given as x = ε cos 2πτ and y = ε sin 2πτ."""
    slope, bend = -TWO_PI * y, -TWO_PI * TWO_PI * x
    return InelasticFlight(w, DRIFT + slope - w, bend, delta * (DRIFT + slope) + bend, delta)


@kernel
def two_impact_orbit(sigma, delta, epsilon, beta, r):
    """Return (admissible, τ, v, trace of the tangent map) of the P(1,1,1) with time 1/2 + σ from Σ⁺ to Σ⁻."""
    x, y, v, u, determinant = two_impact_family_numerators(sigma, delta, beta, r)
    x, y, v, u = x / determinant, y / determinant, v / determinant, u / determinant
    tau, s, rest = fold_phase(math.atan2(y, x) / TWO_PI), 0.5 + sigma, 0.5 - sigma
    if not (v > 0.0 and u > 0.0):
        return False, tau, v, 0.0
    status, t1, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    if status != 0 or wall != -1 or abs(t1 - s) > SAME_TIME:
        return False, tau, v, 0.0
    status, t2, wall, _w, _d, _f, _s, _c = first_impact(
        SIGMA_MINUS, fold_phase(tau + s), r * u, delta, epsilon, beta, DRIFT
    )
    if status != 0 or wall != 1 or abs(t2 - rest) > SAME_TIME:
        return False, tau, v, 0.0
    omc, siny, _defect = versines(sigma)
    y1, x1 = y * omc - y - x * siny, x * omc - x + y * siny  # ε sin and ε cos of 2π(τ + s), where s = 1/2 + σ
    down, up = flight_at_phase(-v, x, y, delta), flight_at_phase(r * u, x1, y1, delta)
    # Φ'' at both arrivals, from the contact force of a flight with the phase and velocity of the arrival
    ends = flight_at_phase(-u, x1, y1, delta), flight_at_phase(v / r, x, y, delta)
    bend_down, bend_up = ends[0].force + delta * u, ends[1].force - delta * v / r
    a00, a01, a10, a11 = forced_flight_tangent(-u, bend_down, -math.expm1(-delta * s), r, down)
    b00, b01, b10, b11 = forced_flight_tangent(v / r, bend_up, -math.expm1(-delta * rest), r, up)
    return True, tau, v, b00 * a00 + b01 * a10 + b10 * a01 + b11 * a11


@kernel
def store_orbit_unless_stored(orbit, found, exists, phase, speed, traces, i):
    """Store an orbit at parameter point i, if it is admissible and no orbit with its letter is stored there.

    orbit: the letter, 0 to 3 for A to D. found: the tuple of `one_impact_orbit` or `two_impact_orbit`. Callers
    store orbits in falling order of the time from Σ⁺ to Σ⁻, so of each letter the orbit with the longest time is kept.
    """
    admissible, tau, v, trace = found
    if admissible and not exists[orbit, i]:
        exists[orbit, i] = True
        phase[orbit, i], speed[orbit, i], traces[orbit, i] = tau, v, trace


@kernel
def fill_family_orbits(order, delta, epsilon, beta, r, exists, phase, speed, traces):
    """Write the orbits A to D at n parameter points to exists, phase, speed and traces (4, n).

    order: the numbers of the points in the order in which they are computed. The function is fastest if points with
    equal δ, β and r are adjacent. Before the call `exists` must be False and the other arrays NaN. Entries of orbits
    that do not exist keep these values.
    """
    last, n = -1, 0
    sigma, e = np.zeros(MOST_NODES), np.zeros(MOST_NODES)
    for i in order:
        d, eps, b, rest = delta[i], epsilon[i], beta[i], r[i]
        store_orbit_unless_stored(A, one_impact_orbit(-1.0, d, eps, b, rest), exists, phase, speed, traces, i)
        store_orbit_unless_stored(C, one_impact_orbit(1.0, d, eps, b, rest), exists, phase, speed, traces, i)
        if last < 0 or d != delta[last] or b != beta[last] or rest != r[last]:
            n = fill_family_nodes(d, b, rest, sigma, e)
        last = i
        for j in range(n - 2, -1, -1):
            if (e[j] - eps) * (e[j + 1] - eps) <= 0.0 and not sigma[j] < 0.0 < sigma[j + 1]:
                root = sigma_at_epsilon(eps, sigma[j], sigma[j + 1], d, b, rest)
                which = D if e[j + 1] > e[j] else B
                store_orbit_unless_stored(
                    which, two_impact_orbit(root, d, eps, b, rest), exists, phase, speed, traces, i
                )


def tabulate_epsilon_of_family(delta: float, beta: float, r: float) -> tuple[Array, Array]:
    """Return increasing σ, and the ε(σ) of the P(1,1,1) with time 1/2 + σ from Σ⁺ to Σ⁻.

    ε is monotone between neighbouring σ, except across its pole at σ = 0.

    Returns
    -------
    tuple of ndarray
        σ and ε(σ), both (k,).
    """
    sigma, e = np.zeros(MOST_NODES), np.zeros(MOST_NODES)
    n = fill_family_nodes(delta, beta, r, sigma, e)
    return sigma[:n], e[:n]
