"""The impact map Π on Σ⁺ (paper 3.16), its inverse and its tangent map (compiled).

State (τ, v): leave Φ = β at phase τ with velocity −v, v > 0. Π flies, bounces off Σ⁻ as often as the motion does, and
arrives at Σ⁺. Run with (−δ, −q, −τ) the same kernel is the inverse map.
"""

import math

from rattle.first_impact import OK, SIGMA_PLUS, first_impact
from rattle.flight import DRIFT, TWO_PI, contact_force, folded, second_derivative
from rattle.numerics.compile import inline, kernel

STUCK = 2  # speed 0 at a wall, or bounces on one flight without end: there is no next flight
MOST_BOUNCES = 100_000
SLOWEST = 1e-150  # below, heights and speeds squared leave double precision


@kernel
def rests(wall, w, tau, delta, epsilon, drift):
    """True if the motion does not leave the wall: no speed into the gap, and a contact force that presses on the wall.

    A graze arrives with no speed and leaves at once, because the force points into the gap.
    """
    if wall * w < -SLOWEST:
        return False
    theta = TWO_PI * tau
    force = contact_force(math.sin(theta), math.cos(theta), delta, epsilon, drift)
    return not (w == 0.0 and wall * force < 0.0)


@inline
def flight_derivatives(lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon):
    """∂F/∂w₀, ∂F/∂t₀ and ∂F'/∂t₀ at fixed flight time; ∂F'/∂w₀ = e^(−δs)."""
    force = TWO_PI * TWO_PI * epsilon
    f_w = lost * inverse_delta
    return f_w, f_w * force * cos0 - TWO_PI * epsilon * (sin1 - sin0), force * ((1.0 - lost) * cos0 - cos1)


@inline
def flight_tangent(w0, w1, lost, sin0, cos0, sin1, cos1, delta, epsilon, drift):
    """∂(t₁, w₁ after reflection)/∂(t₀, w₀) of one flight, row by row.

    F at fixed wall fixes ds = −(∂F/∂t₀ dt₀ + ∂F/∂w₀ dw₀)/w₁; reflection turns w₁ into −w₁.
    """
    a = drift - TWO_PI * epsilon * sin0 - w0
    decay = 1.0 - lost
    f_w, f_t, v_t = flight_derivatives(lost, sin0, cos0, sin1, cos1, 1.0 / delta, epsilon)
    bend = second_derivative(a, lost, cos1, delta, epsilon)
    s_t, s_w = -f_t / w1, -f_w / w1
    return 1.0 + s_t, s_w, -(bend * s_t + v_t), -(bend * s_w + decay)


@inline
def carried(t, w, w1, bend, lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon):
    """A tangent vector (dt, dw) carried over one flight and the reflection, and the flight's determinant, which is
    e^(−δs) w₀/w₁ in absolute value.

    det = (w₁ ∂F'/∂w₀ − F'' ∂F/∂w₀ − ∂F/∂t₀ ∂F'/∂w₀ + ∂F/∂w₀ ∂F'/∂t₀)/w₁: the products with 1/w₁², large near grazing,
    cancel by algebra.
    """
    decay = 1.0 - lost
    f_w, f_t, v_t = flight_derivatives(lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon)
    inverse = 1.0 / w1
    dt = -(f_t * t + f_w * w) * inverse
    determinant = (w1 * decay - f_w * bend - f_t * decay + f_w * v_t) * inverse
    return t + dt, -(bend * dt + v_t * t + decay * w), determinant


@kernel
def impact(tau, v, delta, epsilon, beta, drift):
    """Π: (status, τ', v', elapsed time, Σ⁻ impacts on the way)."""
    status, wall, w, elapsed, n_minus = OK, SIGMA_PLUS, -v, 0.0, 0
    while True:
        if rests(wall, w, tau, delta, epsilon, drift):
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
    status, wall, w, elapsed, n_minus = OK, SIGMA_PLUS, -v, 0.0, 0
    j00, j01, j10, j11, log_det = 1.0, 0.0, 0.0, 1.0, 0.0
    while True:
        if rests(wall, w, tau, delta, epsilon, drift):
            return STUCK, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        w0 = w
        status, s, wall, w1, lost, s0, c0, s1, c1 = first_impact(wall, tau, w0, delta, epsilon, beta, drift)
        if status != OK:
            return status, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        k00, k01, k10, k11 = flight_tangent(w0, w1, lost, s0, c0, s1, c1, delta, epsilon, drift)
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
