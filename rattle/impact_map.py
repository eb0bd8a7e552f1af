"""The impact map Π on Σ⁺ (paper 3.16), its inverse and its tangent map (compiled).

State (τ, v): leave Φ = β at phase τ with velocity −v, v > 0. Π flies, bounces off Σ⁻ as often as the motion does, and
arrives at Σ⁺. Run with (−δ, −q, −τ) the same kernel is the inverse map.
"""

import math

import numpy as np

from rattle._compile import kernel
from rattle.first_impact import OK, first_impact
from rattle.flight import DRIFT, TWO_PI, folded

STUCK = 2  # speed 0 at a wall, or bounces on one flight without end: there is no next flight
MOST_BOUNCES = 100_000
SLOWEST = 1e-150  # below, heights and speeds squared leave double precision


@kernel
def flight_tangent(w0, s, w1, decay, sin0, cos0, sin1, cos1, delta, epsilon, drift):
    """∂(t₁, w₁ after reflection)/∂(t₀, w₀) of one flight, row by row.

    F at fixed wall fixes ds = −(∂F/∂t₀ dt₀ + ∂F/∂w₀ dw₀)/w₁; reflection turns w₁ into −w₁.
    """
    a = drift - TWO_PI * epsilon * sin0 - w0
    lost = -math.expm1(-delta * s) / delta
    force = TWO_PI * TWO_PI * epsilon
    f_t = lost * force * cos0 - TWO_PI * epsilon * (sin1 - sin0)
    v_t = force * (decay * cos0 - cos1)
    bend = delta * a * decay - force * cos1
    s_t, s_w = -f_t / w1, -lost / w1
    return 1.0 + s_t, s_w, -(bend * s_t + v_t), -(bend * s_w + decay)


@kernel
def impact(tau, v, delta, epsilon, beta, drift):
    """Π: (status, τ', v', elapsed time, Σ⁻ impacts on the way)."""
    status, wall, w, elapsed, n_minus = OK, 1, -v, 0.0, 0
    while True:
        if not wall * w < -SLOWEST:
            return STUCK, tau, abs(w), elapsed, n_minus
        status, s, wall, w1, _d, _s0, _c0, _s1, _c1 = first_impact(wall, tau, w, delta, epsilon, beta, drift)
        if status != OK:
            return status, tau, abs(w), elapsed, n_minus
        elapsed += s
        tau = folded(tau + s)
        w = -w1
        if wall > 0:
            return OK, tau, w1, elapsed, n_minus
        n_minus += 1
        if n_minus > MOST_BOUNCES:
            return STUCK, tau, abs(w), elapsed, n_minus


@kernel
def impact_tangent(tau, v, delta, epsilon, beta, drift, energy):
    """Π with its 2×2 tangent matrix: (status, τ', v', elapsed, Σ⁻ impacts, j00, j01, j10, j11, ln det).

    Coordinates (τ, v), or (τ, v²/2) if energy; in the latter each flight has determinant e^(−δs). ln det is summed over
    the flights' own determinants, which near grazing is far more accurate than the determinant of the product.
    """
    status, wall, w, elapsed, n_minus = OK, 1, -v, 0.0, 0
    j00, j01, j10, j11, log_det = 1.0, 0.0, 0.0, 1.0, 0.0
    while True:
        if not wall * w < -SLOWEST:
            return STUCK, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        w0 = w
        status, s, wall, w1, decay, s0, c0, s1, c1 = first_impact(wall, tau, w0, delta, epsilon, beta, drift)
        if status != OK:
            return status, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        k00, k01, k10, k11 = flight_tangent(w0, s, w1, decay, s0, c0, s1, c1, delta, epsilon, drift)
        w = -w1
        if energy:  # e = w²/2: de = w dw
            k01, k10, k11 = k01 / w0, k10 * w, k11 * w / w0
        log_det += math.log(abs(k00 * k11 - k01 * k10))
        j00, j10 = k00 * j00 + k01 * j10, k10 * j00 + k11 * j10
        j01, j11 = k00 * j01 + k01 * j11, k10 * j01 + k11 * j11
        elapsed += s
        tau = folded(tau + s)
        if wall > 0:
            break
        n_minus += 1
        if n_minus > MOST_BOUNCES:
            return STUCK, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
    if not energy:  # dv = −dw at both ends
        j01, j10 = -j01, -j10
    return OK, tau, w1, elapsed, n_minus, j00, j01, j10, j11, log_det


@kernel
def inverse_impact(tau, v, delta, epsilon, beta):
    """Π⁻¹ by running time backwards: (status, τ, v, elapsed time, Σ⁻ impacts on the way)."""
    status, t, speed, elapsed, n_minus = impact(folded(-tau), v, -delta, epsilon, beta, -DRIFT)
    return status, folded(-t), speed, elapsed, n_minus


@kernel
def iterate_many(tau, v, n, delta, epsilon, beta):
    """Π^n of each element of flat arrays: (status, τ, v, impacts on Σ⁺, impacts on Σ⁻)."""
    size = tau.size
    out_tau, out_v = np.empty(size), np.empty(size)
    n_plus, n_minus = np.zeros(size, np.int64), np.zeros(size, np.int64)
    status = np.zeros(size, np.int8)
    for i in range(size):
        t, speed = tau[i], v[i]
        for _ in range(n[i]):
            code, t, speed, _elapsed, below = impact(t, speed, delta[i], epsilon[i], beta[i], DRIFT)
            n_minus[i] += below
            if code != OK:
                status[i] = code
                break
            n_plus[i] += 1
        out_tau[i], out_v[i] = t, speed
    return status, out_tau, out_v, n_plus, n_minus
