"""The impact map Π on Σ⁺ of the inelastic gear, with its tangent map (compiled).

A state (τ, v) leaves an impact on Σ⁺ at phase τ with speed v. If the impact is captured (`is_chatter_captured`), the
following chatter and contact phase belong to the same step and count as this one impact. The motion then leaves the
wall at the release, the end of the contact phase, with speed 0. Π is constant over states that are captured before the
same release, so its tangent map is 0 there. On Σ⁻ a run of impacts that ends in contact counts as one impact.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.flight.contact_phase import ENDLESS, IN_CONTACT, MOST_BOUNCES
from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.law import fold_phase
from rattle.inelastic.map.contact import is_chatter_captured
from rattle.inelastic.map.flight import first_impact_of_forced_flight, forced_flight_tangent, prepare_forced_flight
from rattle.numerics.compile import implement_for_type, inline, kernel
from rattle.orbits import return_map


class InelasticPoint(NamedTuple):
    """A parameter point, with quantities that follow from its forcing.

    Attributes
    ----------
    harmonics : (3, K)
        The harmonics with the amplitudes of this ε.
    zeros : (n,)
        Phases at which the contact force is 0.
    positive
        Whether the contact force is positive at phase 0.
    third
        Upper bound of |e‴|, e being the forcing.
    capture, quiet_invariant
        Largest v/g² of impacts that are certain to lead to contact, and largest v³/g of those that are certain to
        become quiet if impacts are elastic; v is the speed after the impact, g the contact force.
    """

    delta: float
    epsilon: float
    beta: float
    restitution: float
    drift: float
    harmonics: Any
    zeros: Any
    positive: bool
    third: float
    capture: float
    quiet_invariant: float


@inline
def force_piece_number(tau, zeros):
    """Return how many `zeros` of the contact force lie at or before phase tau: the number of the piece that has tau."""
    low, high = 0, zeros.size
    while low < high:
        middle = (low + high) // 2
        if zeros[middle] <= tau:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def flight_after_impact(wall, tau, w, piece, point, departure):
    """Return the flight that follows an impact, after the contact phase if the impact leads to contact.

    wall, tau, w: the wall and the phase of the impact, and the velocity after it; w = 0 at a zero of the contact force
    means that a contact phase ends there. piece: the number of zeros of the contact force at or before tau.
    departure (2, K): filled with the terms of the forcing at the departure, as `prepare_forced_flight` does.

    Returns
    -------
    contact : bool
        Whether the flight follows a contact phase.
    wait : float
        Time to the end of the contact phase: infinite if contact never ends, 0 if there is no contact.
    tau, piece, flight
        Phase of departure, the number of its piece, and the flight.
    """
    delta, harmonics, zeros = point.delta, point.harmonics, point.zeros
    flight = prepare_forced_flight(tau, w, delta, point.drift, harmonics, departure)
    if not is_chatter_captured(wall, abs(w), flight.force, point):
        return False, 0.0, tau, piece, flight
    if zeros.size == 0:
        return True, math.inf, tau, piece, flight
    number = piece if piece < zeros.size else 0
    release = zeros[number]
    wait = release - tau if piece < zeros.size else release + 1.0 - tau
    flight = prepare_forced_flight(release, 0.0, delta, point.drift, harmonics, departure)
    return True, wait, release, number + 1, flight


@kernel
def step_with_tangent(tau, v, point):
    """Return the next state (τ', v') on Σ⁺ after a state (τ, v), with the tangent map.

    Returns
    -------
    tuple
        (status, τ', v', time, number of impacts on Σ⁻, j00, j01, j10, j11, ln det in (t, v²/2), numbers of contact
        phases on Σ⁺ and on Σ⁻).
    """
    departure = np.empty((2, point.harmonics.shape[1]))
    wall, w, time, n_minus, run, bounces = SIGMA_PLUS, -v, 0.0, 0, 0, 0
    j00, j01, j10, j11, log_det = 1.0, 0.0, 0.0, 1.0, 0.0
    on_plus, on_minus = 0, 0
    loss = 2.0 * math.log(point.restitution)
    piece = force_piece_number(tau, point.zeros)
    while True:
        begun = tau
        contact, wait, tau, piece, flight = flight_after_impact(wall, begun, w, piece, point, departure)
        if contact:
            if wait == math.inf:
                return IN_CONTACT, begun, abs(w), time, n_minus, j00, j01, j10, j11, log_det, on_plus, on_minus
            time += wait
            j00, j01, j10, j11, log_det = 0.0, 0.0, 0.0, 0.0, -math.inf
            if wall > 0:
                on_plus += 1
            else:
                on_minus += 1
                n_minus -= run - 1
                run = 0
        status, s, wall, w1, bend1, lost = first_impact_of_forced_flight(wall, tau, flight, piece, point, departure)
        if status != OK:
            return status, tau, abs(w), time, n_minus, j00, j01, j10, j11, log_det, on_plus, on_minus
        k00, k01, k10, k11 = forced_flight_tangent(w1, bend1, lost, point.restitution, flight)
        if log_det > -math.inf:  # after a contact phase the tangent stays 0, even if the next impact is a graze
            j00, j10 = k00 * j00 + k01 * j10, k10 * j00 + k11 * j10
            j01, j11 = k00 * j01 + k01 * j11, k10 * j01 + k11 * j11
            log_det += loss - point.delta * s
        time += s
        tau = fold_phase(tau + s)
        piece = force_piece_number(tau, point.zeros)
        w = -point.restitution * w1
        if wall > 0:
            # at both impacts on Σ⁺ the speed is v = −w, so dv = −dw
            return OK, tau, abs(w), time, n_minus, j00, -j01, -j10, j11, log_det, on_plus, on_minus
        n_minus += 1
        run += 1
        bounces += 1
        if bounces > MOST_BOUNCES:
            return ENDLESS, tau, abs(w), time, n_minus, j00, j01, j10, j11, log_det, on_plus, on_minus


@kernel
def step(tau, v, point):
    """Return the next state on Σ⁺ after a state (τ, v) on Σ⁺.

    Returns
    -------
    tuple
        (status, τ', v', time, number of impacts on Σ⁻, numbers of contact phases on Σ⁺ and on Σ⁻).
    """
    return next_impact_on_plus(SIGMA_PLUS, tau, -v, point)


@kernel
def next_impact_on_plus(wall, tau, w, point):
    """Follow a motion that leaves a wall with velocity w to its next impact on Σ⁺; return a tuple as `step` does."""
    departure = np.empty((2, point.harmonics.shape[1]))
    time, n_minus, run, bounces = 0.0, 0, 0, 0
    on_plus, on_minus = 0, 0
    piece = force_piece_number(tau, point.zeros)
    while True:
        begun = tau
        contact, wait, tau, piece, flight = flight_after_impact(wall, begun, w, piece, point, departure)
        if contact:
            if wait == math.inf:
                return IN_CONTACT, begun, abs(w), time, n_minus, on_plus, on_minus
            time += wait
            if wall > 0:
                on_plus += 1
            else:
                on_minus += 1
                n_minus -= run - 1
                run = 0
        status, s, wall, w1, _bend, _lost = first_impact_of_forced_flight(wall, tau, flight, piece, point, departure)
        if status != OK:
            return status, tau, abs(w), time, n_minus, on_plus, on_minus
        time += s
        tau = fold_phase(tau + s)
        piece = force_piece_number(tau, point.zeros)
        w = -point.restitution * w1
        if wall > 0:
            return OK, tau, abs(w), time, n_minus, on_plus, on_minus
        n_minus += 1
        run += 1
        bounces += 1
        if bounces > MOST_BOUNCES:
            return ENDLESS, tau, abs(w), time, n_minus, on_plus, on_minus


@implement_for_type(return_map.step, InelasticPoint)
def _step(tau, v, point):
    status, tau1, v1, time, n_minus, _plus, _minus = step(tau, v, point)
    return status, tau1, v1, time, n_minus


@implement_for_type(return_map.step_with_tangent, InelasticPoint)
def _step_tangent(tau, v, point):
    status, tau1, v1, time, n_minus, j00, j01, j10, j11, log_det, _plus, _minus = step_with_tangent(tau, v, point)
    return status, tau1, v1, time, n_minus, j00, j01, j10, j11, log_det
