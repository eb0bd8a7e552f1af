"""The impact map Π on Σ⁺ (paper, equation 3.16), its inverse and its tangent map (compiled).

A state (τ, v) leaves Φ = β at phase τ with velocity −v, v > 0. Π follows the flights and impacts on Σ⁻ until the next
impact on Σ⁺. If δ, the phase τ and the constant DRIFT of the forcing (`rattle.flight.forcing`) change sign, the same
kernel computes the inverse map, because these signs reverse time.
"""

import math
from typing import NamedTuple

from rattle.flight.contact_phase import ENDLESS, IN_CONTACT, MOST_BOUNCES, is_bounce_captured, stays_in_contact
from rattle.flight.first_impact import OK, SIGMA_PLUS, first_impact
from rattle.flight.forcing import DRIFT, contact_force, mean_contact_force, sine_cosine_at
from rattle.flight.impact_law import impulse_of, reflected_velocity
from rattle.flight.law import fold_phase
from rattle.flight.tangent import flight_tangent
from rattle.intensity.visit import follow_to_next_departure, mean_contact_force_at_point
from rattle.numerics.compile import implement_for_type, kernel
from rattle.orbits.return_map import inverse_step, step, step_with_tangent


@kernel
def apply_impact_map(tau, v, delta, epsilon, beta, drift):
    """Apply the impact map Π to (τ, v).

    drift: the constant DRIFT of `rattle.flight.forcing`. Given −τ, −δ and −DRIFT, the kernel goes back in time: it
    returns the state after Π⁻¹, with −τ' in place of τ' (`apply_inverse_impact_map`).

    Returns
    -------
    tuple
        (status, τ', v', elapsed time, number of impacts on Σ⁻).
    """
    status, wall, w, elapsed, n_minus = OK, SIGMA_PLUS, -v, 0.0, 0
    while True:
        if stays_in_contact(wall, w, tau, delta, epsilon, drift):
            return IN_CONTACT, tau, abs(w), elapsed, n_minus
        status, s, wall, w1, _d, _flight, _s1, _c1 = first_impact(wall, tau, w, delta, epsilon, beta, drift)
        if status != OK:
            return status, tau, abs(w), elapsed, n_minus
        elapsed += s
        tau = fold_phase(tau + s)
        w = reflected_velocity(w1)
        if wall > 0:
            return OK, tau, w1, elapsed, n_minus
        n_minus += 1
        if n_minus > MOST_BOUNCES:
            return ENDLESS, tau, abs(w), elapsed, n_minus


@kernel
def apply_impact_map_with_tangent(tau, v, delta, epsilon, beta, drift, energy):
    """Apply Π to (τ, v), and return the new state with the tangent matrix (2, 2) of Π.

    The coordinates are (τ, v), or (τ, v²/2) if `energy` is true. In (τ, v²/2) each flight of duration s has determinant
    e^(−δs).

    Returns
    -------
    tuple
        (status, τ', v', elapsed time, number of impacts on Σ⁻, j00, j01, j10, j11, ln|det|).
    """
    status, wall, w, elapsed, n_minus = OK, SIGMA_PLUS, -v, 0.0, 0
    j00, j01, j10, j11, log_det = 1.0, 0.0, 0.0, 1.0, 0.0
    while True:
        if stays_in_contact(wall, w, tau, delta, epsilon, drift):
            return IN_CONTACT, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        w0 = w
        status, s, wall, w1, lost, flight, s1, c1 = first_impact(wall, tau, w0, delta, epsilon, beta, drift)
        if status != OK:
            return status, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
        k00, k01, k10, k11 = flight_tangent(w1, lost, s1, c1, flight)
        w = reflected_velocity(w1)
        if energy:  # the energy e = w²/2 changes by de = w dw
            k01, k10, k11 = k01 / w0, k10 * w, k11 * w / w0
        log_det += math.log(abs(k00 * k11 - k01 * k10))
        j00, j10 = k00 * j00 + k01 * j10, k10 * j00 + k11 * j10
        j01, j11 = k00 * j01 + k01 * j11, k10 * j01 + k11 * j11
        elapsed += s
        tau = fold_phase(tau + s)
        if wall > 0:
            break
        n_minus += 1
        if n_minus > MOST_BOUNCES:
            return ENDLESS, tau, abs(w), elapsed, n_minus, j00, j01, j10, j11, log_det
    if not energy:  # the speeds at both ends are v = −w, w the velocity after the impact on Σ⁺, so dv = −dw
        j01, j10 = -j01, -j10
    return OK, tau, w1, elapsed, n_minus, j00, j01, j10, j11, log_det


@kernel
def apply_inverse_impact_map(tau, v, delta, epsilon, beta):
    """Apply Π⁻¹ to (τ, v), and return (status, τ', v', elapsed time, number of impacts on Σ⁻ on the way)."""
    status, t, speed, elapsed, n_minus = apply_impact_map(fold_phase(-tau), v, -delta, epsilon, beta, -DRIFT)
    return status, fold_phase(-t), speed, elapsed, n_minus


class ImpactingPoint(NamedTuple):
    """A parameter point of the impacting gear, as kernels take it.

    quiet_invariant: the largest v³/g at which a bounce on Σ⁺ with speed v and contact force g is certain to become
    quiet.
    """

    delta: float
    epsilon: float
    beta: float
    quiet_invariant: float


@implement_for_type(step, ImpactingPoint)
def _step(tau, v, point):
    return apply_impact_map(tau, v, point.delta, point.epsilon, point.beta, DRIFT)


@implement_for_type(step_with_tangent, ImpactingPoint)
def _step_tangent(tau, v, point):
    return apply_impact_map_with_tangent(tau, v, point.delta, point.epsilon, point.beta, DRIFT, False)


@implement_for_type(inverse_step, ImpactingPoint)
def _inverse_step(tau, v, point):
    return apply_inverse_impact_map(tau, v, point.delta, point.epsilon, point.beta)


@implement_for_type(mean_contact_force_at_point, ImpactingPoint)
def _mean_force_at(point):
    return mean_contact_force(point.delta)


@implement_for_type(follow_to_next_departure, ImpactingPoint)
def _bounce(wall, tau, w, point):
    sine, cosine = sine_cosine_at(tau)
    force = contact_force(sine, cosine, point.delta, point.epsilon, DRIFT)
    captured = wall > 0 and is_bounce_captured(abs(w), force, point.quiet_invariant)
    if captured or stays_in_contact(wall, w, tau, point.delta, point.epsilon, DRIFT):
        return IN_CONTACT, 0.0, wall, abs(w), 0.0, 0.0, abs(w)
    status, s, wall, w1, _d, _flight, _s1, _c1 = first_impact(
        wall, tau, w, point.delta, point.epsilon, point.beta, DRIFT
    )
    return status, s, wall, abs(w1), 0.0, impulse_of(abs(w1)), abs(reflected_velocity(w1))
