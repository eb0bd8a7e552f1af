"""The period-one motions in closed form (compiled): A and C, which are P(1,1,0), and B and D, which are P(1,1,1).

With X = ε cos 2πτ, Y = ε sin 2πτ and the time s = 1/2 + σ from Σ⁺ to Σ⁻, the equations by which a P(1,1,1) closes are
linear in X and Y. Let p and q be the decaying parts of the velocity after the impacts on Σ⁺ and on Σ⁻, Y' = ε sin 2π(τ
+ s), E = e^(−δ), Es = e^(−δs), Er = e^(−δ(1−s)). The velocities close if

    p + Er q = 8π − 4πY,    Es p + q = 8π − 4πY',

and the displacements if p(1 − Es) + q(1 − Er) = 4πδ and p(1 − Es)/δ = 2β + 4πs − X(1 − cos 2πs) − Y sin 2πs.

At small damping and backlash the differences p − 4π, q − 4π and s − 1/2 are as small as δ and β. So the
parameter of the family of P(1,1,1) is σ = s − 1/2, and p − 4π is computed, not p: no digits cancel, however small δ and
β are.

These closed forms hold for forcing by one cosine and elastic impacts (`forcing.Forcing.ONE_COSINE`). Other gears solve
the equations of `rattle.impacting.orbits.impact_times`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.flight.first_impact import SIGMA_MINUS, SIGMA_PLUS, first_impact
from rattle.flight.forcing import DRIFT, TWO_PI, versines
from rattle.flight.law import flight_from_sine_cosine, fold_phase
from rattle.flight.tangent import flight_tangent
from rattle.impacting.orbits.limits import SMALL, epsilon_sine_series
from rattle.numerics.compile import inline, kernel
from rattle.numerics.secant import narrow_bracket

A, B, C, D = np.arange(4)  # of type np.int64, as walls are: kernels would be compiled again for Python integers
FOUR_PI = 4.0 * math.pi
SAME_TIME = 1e-6  # largest difference of two times of flight, in forcing periods, that counts as the same impact
# speed at Σ⁻, relative to the speed at Σ⁺, below which rounding does not distinguish the impact from a graze
GRAZING_SPEED = 2.5e-7
# largest errors of a graze: SLOW of its speed, relative to the speed at Σ⁺; NEAR of its time, in forcing periods
SLOW, NEAR = 2.5e-5, 1e-4
EDGE = 1e-9  # |σ| of the two nodes next to σ = 0, where the equations are singular
NODES_PER_SIDE = 160
MOST_NODES = 2 * NODES_PER_SIDE + 24
Array = NDArray[np.float64]


@inline
def epsilon_sine_of_single_impact_kernel(delta):
    """Return ε sin 2πτ = 2 − δ coth(δ/2) of A and C, for callers in kernels."""
    return epsilon_sine_series(delta * delta) if delta < SMALL else 2.0 - delta / math.tanh(0.5 * delta)


@kernel
def closure_numerators(sigma, delta, beta):
    """Return the P(1,1,1) with the time 1/2 + σ from Σ⁺ to Σ⁻ as fractions: their numerators and common denominator.

    The fractions are X = ε cos 2πτ, Y = ε sin 2πτ, the speed v at Σ⁺ and the speed u at Σ⁻. The common denominator
    vanishes at σ = 0.

    Returns
    -------
    tuple of float
        The numerators of X, Y, v and u, and the denominator.
    """
    omc, siny, _defect = versines(sigma)
    cosy = 1.0 - omc  # siny and cosy are sine and cosine of 2πσ, which are minus sine and cosine of 2πs
    ls, lr = -math.expm1(-delta * (0.5 + sigma)), -math.expm1(-delta * (0.5 - sigma))
    es, er = 1.0 - ls, 1.0 - lr
    le, both = ls + lr - ls * lr, ls * lr
    h = abs(sigma)
    slow = max(es, er)
    apart = math.copysign(-slow * math.expm1(-2.0 * delta * h), sigma)  # e^(−δ(1 − s)) − e^(−δs), for s = 1/2 + σ
    k_r = both - apart
    root = math.expm1(-delta * h)
    b1 = (
        2.0 * le * math.tanh(0.25 * delta) * epsilon_sine_of_single_impact_kernel(0.5 * delta)
        - 4.0 * slow * root * root
    )
    a11, a12 = -k_r * siny, 2.0 * apart + k_r * omc
    f = ls / (delta * le)
    a21 = 2.0 - omc - f * FOUR_PI * er * siny
    a22 = -f * FOUR_PI * (1.0 + er * cosy) - siny
    b2 = 2.0 * beta + FOUR_PI * sigma - TWO_PI * b1 / (delta * le)
    determinant = a11 * a22 - a12 * a21
    x, y = b1 * a22 - a12 * b2, a11 * b2 - a21 * b1
    y_s = -(y * cosy + x * siny)
    p_excess = FOUR_PI * (k_r * determinant + er * y_s - y) / le  # (p − 4π) · determinant
    v = p_excess + TWO_PI * y
    u = p_excess * es - FOUR_PI * ls * determinant + TWO_PI * y_s
    return x, y, v, u, determinant


@kernel
def family_eccentricity(sigma, delta, beta):
    """Return the eccentricity ε of the P(1,1,1) at this σ; it is infinite at the pole σ = 0."""
    x, y, _v, _u, determinant = closure_numerators(sigma, delta, beta)
    return math.hypot(x, y) / abs(determinant)


@kernel
def family_residual(kind, level, sigma, delta, beta):
    """Return the function of σ whose zeros are sought, for the P(1,1,1) with the time 1/2 + σ from Σ⁺ to Σ⁻.

    Returns
    -------
    float
        kind 0: the eccentricity ε of this P(1,1,1) less `level`. kind 1: the numerator of its speed at Σ⁻, which has no
        pole at σ = 0 and does not depend on `level`.
    """
    if kind == 0:
        return family_eccentricity(sigma, delta, beta) - level
    return closure_numerators(sigma, delta, beta)[3]


@kernel
def find_root_in_bracket(kind, level, lo, hi, delta, beta):
    """Return the σ between lo and hi at which `family_residual`(kind, level, σ, …) is 0, to rounding.

    The residual must have different signs at lo and hi. A secant step that leaves the bracket is replaced by bisection.

    Returns
    -------
    float
        The root σ.
    """
    f_lo, f_hi = family_residual(kind, level, lo, delta, beta), family_residual(kind, level, hi, delta, beta)
    side, last = 0, math.nan
    for _ in range(200):
        sigma = (lo * f_hi - hi * f_lo) / (f_hi - f_lo)
        if not (min(lo, hi) < sigma < max(lo, hi)):
            sigma = 0.5 * (lo + hi)
        f = family_residual(kind, level, sigma, delta, beta)
        if f == 0.0 or abs(sigma - last) <= 1e-16 * abs(sigma):
            return sigma
        last = sigma
        lo, f_lo, hi, f_hi, side = narrow_bracket(lo, f_lo, hi, f_hi, side, sigma, f)
    return 0.5 * (lo + hi)


@kernel
def find_sigma_of_extreme_epsilon(lo, hi, sign, delta, beta):
    """Return the σ inside (lo, hi) at which ε(σ) has its minimum (sign = 1) or maximum (−1), by golden section."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    x1, x2 = hi - ratio * (hi - lo), lo + ratio * (hi - lo)
    f1, f2 = sign * family_eccentricity(x1, delta, beta), sign * family_eccentricity(x2, delta, beta)
    while hi - lo > 1e-9 * abs(0.5 * (lo + hi)):
        if f1 < f2:
            hi, x2, f2 = x2, x1, f1
            x1 = hi - ratio * (hi - lo)
            f1 = sign * family_eccentricity(x1, delta, beta)
        else:
            lo, x1, f1 = x1, x2, f2
            x2 = lo + ratio * (hi - lo)
            f2 = sign * family_eccentricity(x2, delta, beta)
    return 0.5 * (lo + hi)


@kernel
def write_family_nodes(delta, beta, sigma, e):
    """Write σ and ε of `nodes_of_family` to `sigma` and `e` (MOST_NODES,), and return the number of nodes."""
    n = NODES_PER_SIDE
    for i in range(n):
        gap = EDGE * (0.5 * (1.0 - 1e-6) / EDGE) ** (i / (n - 1.0))
        sigma[n - 1 - i], sigma[n + i] = -gap, gap
    size = 2 * n
    for i in range(size):
        e[i] = family_eccentricity(sigma[i], delta, beta)
    for i in range(1, 2 * n - 1):
        below = e[i] < e[i - 1] and e[i] < e[i + 1]
        above = e[i] > e[i - 1] and e[i] > e[i + 1]
        pole = i == n - 1 or i == n
        if (below or above) and not pole and size < sigma.size:
            sigma[size] = find_sigma_of_extreme_epsilon(sigma[i - 1], sigma[i + 1], 1.0 if below else -1.0, delta, beta)
            e[size] = family_eccentricity(sigma[size], delta, beta)
            size += 1
    for i in range(2 * n, size):  # insertion sort, because only a few turning points join nodes that are in order
        new, new_e, j = sigma[i], e[i], i
        while sigma[j - 1] > new:
            sigma[j], e[j] = sigma[j - 1], e[j - 1]
            j -= 1
        sigma[j], e[j] = new, new_e
    return size


def nodes_of_family(delta: float, beta: float) -> tuple[Array, Array]:
    """Return nodes of the family of P(1,1,1): rising σ, and ε(σ), which is monotone between neighbouring nodes.

    The nodes are geometrically spaced on both sides of the pole σ = 0. The turning points of ε(σ) are nodes too.

    Returns
    -------
    tuple[Array, Array]
        σ and ε, of equal length.
    """
    sigma, e = np.zeros(MOST_NODES), np.zeros(MOST_NODES)
    n = write_family_nodes(delta, beta, sigma, e)
    return sigma[:n], e[:n]


@kernel
def trace_of_single_impact_orbit(delta, x):
    """Return the trace of the tangent map DΠ at A or C. x is ε cos 2πτ of the orbit."""
    return 1.0 + math.exp(-delta) + FOUR_PI * math.expm1(-delta) * x / (delta * delta)


@kernel
def single_impact_orbit(cosine, delta, epsilon, beta, offset):
    """Return (admissible, τ, v, trace of the tangent map) of A or C.

    cosine: the sign of cos 2πτ, −1 for A and 1 for C. offset: ε sin 2πτ of both.

    Returns
    -------
    tuple
        (admissible, τ, v, trace).
    """
    v = TWO_PI * delta
    if epsilon < abs(offset) or epsilon == 0.0:
        return False, 0.0, v, 0.0
    x = cosine * math.sqrt((epsilon - offset) * (epsilon + offset))
    tau = fold_phase(math.atan2(offset, x) / TWO_PI)
    status, time, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    admissible = status == 0 and wall == 1 and abs(time - 1.0) < SAME_TIME
    return admissible, tau, v, trace_of_single_impact_orbit(delta, x)


@kernel
def two_impact_orbit_at_sigma(sigma, delta, epsilon, beta):
    """Return existence and state of the P(1,1,1) with time 1/2 + σ from Σ⁺ to Σ⁻, whose eccentricity is epsilon.

    Returns
    -------
    tuple
        (admissible, τ, v, trace of the tangent map). The trace is 0 if the motion is not admissible.
    """
    x, y, v, u, determinant = closure_numerators(sigma, delta, beta)
    x, y, v, u = x / determinant, y / determinant, v / determinant, u / determinant
    tau, s, r = fold_phase(math.atan2(y, x) / TWO_PI), 0.5 + sigma, 0.5 - sigma
    if not (v > 0.0 and u > 0.0):
        return False, tau, v, 0.0
    status, t1, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    touches = wall == -1 and abs(t1 - s) < SAME_TIME
    grazes = u < GRAZING_SPEED * v and wall == 1 and abs(t1 - 1.0) < 1e-3
    if status != 0 or not (touches or grazes):
        return False, tau, v, 0.0
    middle = fold_phase(tau + s)
    status, t2, wall, _w, _d, _f, _s, _c = first_impact(SIGMA_MINUS, middle, u, delta, epsilon, beta, DRIFT)
    if status != 0 or wall != 1 or abs(t2 - r) > SAME_TIME:
        return False, tau, v, 0.0
    sin0, cos0 = y / epsilon, x / epsilon
    omc, siny, _defect = versines(sigma)
    # sine and cosine of 2π(τ + s), at the impact on Σ⁻; as s = 1/2 + σ, those of 2πs are minus those of 2πσ
    sin1, cos1 = sin0 * omc - sin0 - cos0 * siny, cos0 * omc - cos0 + sin0 * siny
    d1, d2 = -math.expm1(-delta * s), -math.expm1(-delta * r)
    down = flight_from_sine_cosine(-v, sin0, cos0, delta, epsilon, DRIFT)
    up = flight_from_sine_cosine(u, sin1, cos1, delta, epsilon, DRIFT)
    a00, a01, a10, a11 = flight_tangent(-u, d1, sin1, cos1, down)
    b00, b01, b10, b11 = flight_tangent(v, d2, sin0, cos0, up)
    return True, tau, v, b00 * a00 + b01 * a10 + b10 * a01 + b11 * a11


@kernel
def record_orbit(orbit, admissible, tau, v, trace, exists, phase, speed, traces, i):
    """Write an orbit of cell i to the arrays if it is admissible and the first orbit of its letter A to D in the cell.

    `orbit` is the number of the letter. The orbits of a cell are passed in the order of falling σ, from 1/2 on. The
    first of several orbits of one letter therefore has the largest σ, and is on the branch born at SN2.
    """
    if admissible and not exists[orbit, i]:
        exists[orbit, i] = True
        phase[orbit, i], speed[orbit, i], traces[orbit, i] = tau, v, trace


@kernel
def fill_period_one_orbits(order, delta, epsilon, beta, offset, sigma, e, exists, phase, speed, traces):
    """Write the admissible orbits A to D of n cells to the last four arguments, arrays (4, n).

    Before the call `exists` holds False and the other three arrays hold NaN, which remain where an orbit does not
    exist. `order` (n,) holds the numbers of the cells in the order in which they are computed: the nodes of a family
    are computed once for successive cells with equal (δ, β). offset (n,): ε sin 2πτ of A and C. sigma and e
    (MOST_NODES,) are scratch memory for the nodes.
    """
    last, n = -1, 0
    for i in order:
        d, eps, b = delta[i], epsilon[i], beta[i]
        ok, tau, v, trace = single_impact_orbit(-1.0, d, eps, b, offset[i])
        record_orbit(A, ok, tau, v, trace, exists, phase, speed, traces, i)
        ok, tau, v, trace = single_impact_orbit(1.0, d, eps, b, offset[i])
        record_orbit(C, ok, tau, v, trace, exists, phase, speed, traces, i)
        if last < 0 or d != delta[last] or b != beta[last]:
            n = write_family_nodes(d, b, sigma, e)
        last = i
        for j in range(n - 2, -1, -1):
            if (e[j] - eps) * (e[j + 1] - eps) <= 0.0 and not sigma[j] < 0.0 < sigma[j + 1]:
                root = find_root_in_bracket(0, eps, sigma[j], sigma[j + 1], d, b)
                ok, tau, v, trace = two_impact_orbit_at_sigma(root, d, eps, b)
                record_orbit(D if e[j + 1] > e[j] else B, ok, tau, v, trace, exists, phase, speed, traces, i)


def closed_form_orbits(
    order: NDArray[np.int64], delta: Array, epsilon: Array, beta: Array, offset: Array
) -> tuple[NDArray[np.bool_], Array, Array, Array]:
    """Return the admissible orbits A to D at flat arrays of parameters (n,).

    order (n,): the numbers of the points in the order in which they are computed; this is fast if points with equal
    (δ, β) follow one another. offset (n,): ε sin 2πτ of A and C.

    Returns
    -------
    tuple[NDArray[np.bool_], Array, Array, Array]
        (exists, τ, v, trace of the tangent map), each (4, n) for A to D, NaN where an orbit does not exist.
    """
    exists = np.zeros((4, delta.size), np.bool_)
    phase, speed, traces = np.full((3, *exists.shape), np.nan)
    sigma, e = np.zeros((2, MOST_NODES))
    fill_period_one_orbits(order, delta, epsilon, beta, offset, sigma, e, exists, phase, speed, traces)
    return exists, phase, speed, traces


@kernel
def find_next_grazing_sigma(sigma, delta, beta):
    """Return the next larger σ at which the P(1,1,1) has speed 0 at Σ⁻; NaN if there is none up to 1/2."""
    lo, f_lo = sigma, closure_numerators(sigma, delta, beta)[3]
    ratio = (0.5 / EDGE) ** (1.0 / (2.0 * NODES_PER_SIDE))
    while lo < 0.5:
        hi = min(lo * ratio, 0.5)
        f_hi = closure_numerators(hi, delta, beta)[3]
        if (f_lo > 0.0) != (f_hi > 0.0):
            return find_root_in_bracket(1, 0.0, lo, hi, delta, beta)
        lo, f_lo = hi, f_hi
    return math.nan


@kernel
def grazing_motion_at_sigma(sigma, delta, beta):
    """Return the P(1,1,1) that touches Σ⁻ with speed 0, at a σ from `find_next_grazing_sigma`.

    The motion is admissible if, between its impacts on Σ⁺, it meets Σ⁻ in this touch only.

    Returns
    -------
    tuple
        (admissible, ε, τ, ε cos 2πτ).
    """
    x, y, _v, _u, determinant = closure_numerators(sigma, delta, beta)
    x, y = x / determinant, y / determinant
    epsilon, tau, s = math.hypot(x, y), fold_phase(math.atan2(y, x) / TWO_PI), 0.5 + sigma
    v = TWO_PI * delta
    status, t1, wall, w1, _d, _f, _s, _c = first_impact(SIGMA_PLUS, tau, -v, delta, epsilon, beta, DRIFT)
    if status == 0 and wall == -1 and abs(t1 - s) < NEAR and abs(w1) < SLOW * v:
        status, t2, wall, _w, _d, _f, _s, _c = first_impact(
            SIGMA_MINUS, fold_phase(tau + s), GRAZING_SPEED * v, delta, epsilon, beta, DRIFT
        )
        t1 = s + t2
    return status == 0 and wall == 1 and abs(t1 - 1.0) < NEAR, epsilon, tau, x


@kernel
def fill_grazing_curve(curve, delta, beta, epsilon, phase, trace):
    """Write ε, τ and the trace of `grazing_curve` to epsilon, phase and trace (n,), which must hold NaN at the start.

    curve: 0 for G1, 1 for G2. The entries of points at which the curve does not exist remain NaN.
    """
    for i in range(delta.size):
        sigma = find_next_grazing_sigma(EDGE, delta[i], beta[i])
        while sigma < 0.5:
            admissible, eps, tau, x = grazing_motion_at_sigma(sigma, delta[i], beta[i])
            if admissible and (x >= 0.0) == (curve == 0):
                epsilon[i], phase[i], trace[i] = eps, tau, trace_of_single_impact_orbit(delta[i], x)
                break
            sigma = find_next_grazing_sigma(sigma * (1.0 + 1e-11), delta[i], beta[i])


def grazing_curve(curve: int, delta: Array, beta: Array) -> tuple[Array, Array, Array]:
    """Return the curve G1 (curve = 0, where C grazes) or G2 (curve = 1, where A grazes) at flat arrays of δ and β.

    Returns
    -------
    tuple[Array, Array, Array]
        ε, τ, and the trace of the tangent map without the graze, each (n,); NaN where the curve does not exist.
    """
    epsilon, phase, trace = np.full((3, delta.size), np.nan)
    fill_grazing_curve(curve, delta, beta, epsilon, phase, trace)
    return epsilon, phase, trace


@kernel
def first_graze_cosine_and_epsilon(delta, beta):
    """Return ε cos 2πτ and ε at the first σ > 0 at which the P(1,1,1) grazes Σ⁻; NaN if there is none."""
    sigma = find_next_grazing_sigma(EDGE, delta, beta)
    x, y, _v, _u, determinant = closure_numerators(sigma, delta, beta)
    return x / determinant, math.hypot(x, y) / abs(determinant)
