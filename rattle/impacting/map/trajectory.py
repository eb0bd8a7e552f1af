"""The motion Φ(t), sampled in closed form on each flight from impact to impact (paper, equations 3.1 and 3.2)."""

import math

from rattle.flight.contact_phase import stays_in_contact
from rattle.flight.first_impact import OK, SIGMA_PLUS, first_impact
from rattle.flight.forcing import DRIFT
from rattle.flight.impact_law import reflected_velocity
from rattle.flight.law import evaluate, fold_phase
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import MOST_IMPACTS, Trajectory, sample_motion

AT_REST = 1e-4  # impact speed below which a motion that is certain to become quiet counts as at rest


@kernel
def fill_trajectory(tau, v, delta, epsilon, beta, slowest, time, phi, velocity, impact_time, impact_wall, impact_speed):
    """Write Φ and Φ' of the motion from (τ, v) at the rising times `time`, and its impacts until the last time.

    A motion that leaves Σ⁺ with a speed below `slowest`, or stays in contact with a wall, counts as at rest from then
    on. Impacts beyond the length of the arrays are counted but not written.

    Returns
    -------
    tuple
        (status, number of impacts, time at which the motion comes to rest, or inf if it does not).
    """
    wall, w, now, phase = SIGMA_PLUS, -v, 0.0, tau
    i, impacts = 0, 0
    while i < time.size:
        if (wall > 0 and abs(w) < slowest) or stays_in_contact(wall, w, phase, delta, epsilon, DRIFT):
            phi[i:], velocity[i:] = wall * beta, 0.0
            return OK, impacts, now
        status, s, target, w1, _l, flight, _s1, _c1 = first_impact(wall, phase, w, delta, epsilon, beta, DRIFT)
        if status != OK:
            return status, impacts, math.inf
        while i < time.size and time[i] < now + s:
            f0, f1, _f2, _lost, _sin, _cos = evaluate(time[i] - now, flight)
            phi[i], velocity[i] = wall * beta + f0, f1
            i += 1
        if i == time.size:
            break
        now, phase, wall, w = now + s, fold_phase(phase + s), target, reflected_velocity(w1)
        if impacts < impact_time.size:
            impact_time[impacts], impact_wall[impacts], impact_speed[impacts] = now, wall, abs(w)
        impacts += 1
        if impacts > MOST_IMPACTS:
            break
    return OK, impacts, math.inf


def trajectory(
    delta: float, epsilon: float, beta: float, tau: float, v: float, periods: float, points: int, slowest: float
) -> Trajectory:
    """Return Φ and Φ' of a motion (`Gear.trajectory`); motions slower than `slowest` are certain to become quiet."""
    return sample_motion(fill_trajectory, tau, v, (delta, epsilon, beta, min(slowest, AT_REST)), periods, points)
