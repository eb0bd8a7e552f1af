"""Follow an inelastic motion from impact to impact, for sums over its impacts (compiled).

A chatter that completes has infinitely many impacts. They are followed one by one until the bound of
`is_chatter_captured` holds with a millionfold margin (`REST_FRACTION`). The remaining impacts last less than
2 REST_FRACTION LEAST_SHARE |g|/max|g'|, some 1e-8 forcing periods, and have less than REST_FRACTION² of the energy that
a captured impact may have. (g is the contact force, and `rattle.inelastic.map.contact` has LEAST_SHARE.)

The last followed impact includes the remaining impacts and the contact phase: it lasts until the release, the end of
the contact phase, and the motion leaves it with speed 0. Its impulse is exact. Until the release Φ' goes from the
arrival velocity to 0, and Φ returns to the wall, so the impulse of the wall is the arrival speed plus the integral of
the contact force.
"""

from __future__ import annotations

import cmath
import math

import numpy as np

from rattle.flight.contact_phase import IN_CONTACT
from rattle.flight.first_impact import OK
from rattle.flight.forcing import TWO_PI, sine_cosine_at
from rattle.flight.law import fold_phase, wrap_phase_difference
from rattle.inelastic.map.contact import is_chatter_captured
from rattle.inelastic.map.flight import first_impact_of_forced_flight, prepare_forced_flight
from rattle.inelastic.map.harmonics import AMPLITUDE, ORDER, PHASE, contact_force_and_rate
from rattle.inelastic.map.impact_map import InelasticPoint, force_piece_number
from rattle.intensity.forces import spectral_lines_of_force
from rattle.intensity.visit import follow_to_next_departure, mean_contact_force_at_point
from rattle.numerics.compile import implement_for_type, inline, kernel

# once a chatter is slower than this fraction of the largest captured speed, the rest of it counts as one impact
REST_FRACTION = 1e-6


@inline
def force_antiderivative(tau, delta, harmonics):
    """Return e' + δe at phase tau, the antiderivative of the contact force minus the force's mean; e is the forcing."""
    found = 0.0
    for j in range(harmonics.shape[1]):
        turn = TWO_PI * harmonics[ORDER, j]
        sine, cosine = sine_cosine_at(harmonics[ORDER, j] * tau + harmonics[PHASE, j])
        found += harmonics[AMPLITUDE, j] * (delta * cosine - turn * sine)
    return found


@inline
def index_of_release_zero(tau, zeros):
    """Return the index of the zero of the contact force nearest to tau, the phase at which a contact phase ends."""
    nearest, off = 0, math.inf
    for i in range(zeros.size):
        away = abs(wrap_phase_difference(zeros[i] - tau))
        if away < off:
            nearest, off = i, away
    return nearest


@kernel
def follow_flight_and_impact(wall, tau, w, point):
    """Follow a flight and its impact; return the tuple of `rattle.intensity.visit.follow_to_next_departure`.

    The flight leaves `wall` at phase tau with velocity w; w = 0 means that a contact phase ends there. If the impact
    completes a chatter, it includes the remaining bounces and the contact phase, and the speed of departure is 0.

    Returns
    -------
    tuple
        (status, time of flight, wall, speed of arrival, duration of the contact, impulse, speed of departure).
    """
    delta, harmonics, zeros = point.delta, point.harmonics, point.zeros
    departure = np.empty((2, harmonics.shape[1]))
    if w == 0.0:
        if zeros.size == 0:
            return IN_CONTACT, 0.0, wall, 0.0, 0.0, 0.0, 0.0
        number = index_of_release_zero(tau, zeros)
        tau, piece = zeros[number], number + 1
    else:
        piece = force_piece_number(tau, zeros)
    flight = prepare_forced_flight(tau, w, delta, point.drift, harmonics, departure)
    if zeros.size == 0 and is_chatter_captured(wall, abs(w), flight.force, point):
        return IN_CONTACT, 0.0, wall, abs(w), 0.0, 0.0, abs(w)
    status, s, wall, w1, _bend, _lost = first_impact_of_forced_flight(wall, tau, flight, piece, point, departure)
    speed = abs(w1)
    v = point.restitution * speed
    if status != OK:
        return status, s, wall, abs(w), 0.0, 0.0, abs(w)
    landed = fold_phase(tau + s)
    force, _rate = contact_force_and_rate(landed, delta, point.drift, harmonics)
    slow = v < REST_FRACTION * point.capture * force * force
    if not (slow and zeros.size > 0 and is_chatter_captured(wall, v, force, point)):
        return OK, s, wall, speed, 0.0, speed + v, v
    piece = force_piece_number(landed, zeros)
    end = zeros[piece] if piece < zeros.size else zeros[0] + 1.0
    change = force_antiderivative(end, delta, harmonics) - force_antiderivative(landed, delta, harmonics)
    pressed = wall * (delta * point.drift * (end - landed) + change)
    return OK, s, wall, speed, end - landed, speed + pressed, 0.0


@implement_for_type(follow_to_next_departure, InelasticPoint)
def _bounce(wall, tau, w, point):
    return follow_flight_and_impact(wall, tau, w, point)


@implement_for_type(mean_contact_force_at_point, InelasticPoint)
def _mean_force_at(point):
    return point.delta * point.drift


@spectral_lines_of_force.register
def _(point: InelasticPoint) -> list[tuple[float, complex]]:
    """Return the spectral lines of the contact force: its mean, then two lines at ± the frequency of each harmonic."""
    lines = [(0.0, complex(point.delta * point.drift))]
    for order, amplitude, phase in point.harmonics.T.tolist():
        omega = TWO_PI * order
        size = 0.5 * amplitude * cmath.exp(1j * TWO_PI * phase) * complex(-omega * omega, omega * point.delta)
        lines += [(omega, size), (-omega, size.conjugate())]
    return lines
