"""The motion Φ(t) of the inelastic gear at given times, in closed form on each flight from impact to impact."""

import math

import numpy as np

from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.law import fold_phase
from rattle.inelastic.map.flight import evaluate_forced_flight, first_impact_of_forced_flight, prepare_forced_flight
from rattle.inelastic.map.impact_map import InelasticPoint, flight_after_impact, force_piece_number
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import MOST_IMPACTS, Trajectory, sample_motion

SHORT_CHATTER = 1e-5  # duration, in forcing periods, below which the rest of a chatter is not followed impact by impact


@kernel
def remaining_chatter_time(wall, v, force, point):
    """Return an estimate of the time that a chatter still lasts after one of its impacts: 2v/((1 − r)|g|).

    v: the speed after this impact. force: the contact force g at the impact. The relative error is about as large as
    the duration, in forcing periods.

    Returns
    -------
    float
        The time in forcing periods; infinite if impacts are elastic.
    """
    if point.restitution == 1.0:
        return math.inf
    return 2.0 * v / ((1.0 - point.restitution) * wall * force)


@kernel
def write_inelastic_motion(tau, v, point, time, phi, velocity, impact_time, impact_wall, impact_speed):
    """Write Φ and Φ' at increasing times, and the impacts before the last of these times, to given arrays.

    A chatter is followed until its remaining duration, from `remaining_chatter_time`, is below SHORT_CHATTER. The error
    of the time at which contact begins is then about SHORT_CHATTER². If impacts are elastic, the bounces of a motion
    that is certain to become quiet are replaced by contact. Impacts beyond the length of the arrays are counted but not
    written.

    Returns
    -------
    status : int
        OK, or the code of the reason why the motion cannot be followed.
    impacts : int
        Number of impacts.
    rest : float
        The time from which contact lasts for ever, infinite if it never does.
    """
    departure = np.empty((2, point.harmonics.shape[1]))
    wall, w, now, phase, i, impacts, rest = SIGMA_PLUS, -v, 0.0, tau, 0, 0, math.inf
    piece = force_piece_number(tau, point.zeros)
    while i < time.size:
        contact, wait, release, number, flight = flight_after_impact(wall, phase, w, piece, point, departure)
        if contact:
            flight = prepare_forced_flight(phase, w, point.delta, point.drift, point.harmonics, departure)
            left = remaining_chatter_time(wall, abs(w), flight.force, point)
            if left < SHORT_CHATTER or (point.restitution == 1.0):
                if wait == math.inf:
                    rest = now + min(left, SHORT_CHATTER)
                while i < time.size and time[i] < now + wait:
                    phi[i], velocity[i] = wall * point.beta, 0.0
                    i += 1
                if wait == math.inf or i == time.size:
                    return OK, impacts, rest
                now, phase, piece, w = now + wait, release, number, 0.0
                flight = prepare_forced_flight(phase, w, point.delta, point.drift, point.harmonics, departure)
        status, s, target, w1, _bend, _lost = first_impact_of_forced_flight(
            wall, phase, flight, piece, point, departure
        )
        if status != OK:
            return status, impacts, math.inf
        while i < time.size and time[i] < now + s:
            f0, f1, _f2, _lost = evaluate_forced_flight(time[i] - now, flight, point.harmonics, departure)
            phi[i], velocity[i] = wall * point.beta + f0, f1
            i += 1
        if i == time.size:
            break
        now, phase, wall = now + s, fold_phase(phase + s), target
        piece = force_piece_number(phase, point.zeros)
        w = -point.restitution * w1
        if impacts < impact_time.size:
            impact_time[impacts], impact_wall[impacts], impact_speed[impacts] = now, wall, abs(w1)
        impacts += 1
        if impacts > MOST_IMPACTS:
            break
    return OK, impacts, math.inf


def trajectory(point: InelasticPoint, tau: float, v: float, periods: float, points: int) -> Trajectory:
    """Return Φ and Φ' of the motion from a state (τ, v) on Σ⁺, as `rattle.inelastic.InelasticGear.trajectory` does."""
    return sample_motion(write_inelastic_motion, tau, v, (point,), periods, points)
