"""The motion Φ(t) of the stiff gear at given times, in closed form on each flight and contact."""

import math

from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.law import fold_phase
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import Trajectory, sample_motion
from rattle.stiff.map.flow import GAP, MOST_PIECES, QUIET, follow_piece


@kernel
def write_stiff_motion(
    tau, v, delta, epsilon, beta, kappa, time, phi, velocity, contact_time, contact_wall, contact_speed
):
    """Write Φ and Φ' at increasing times, and the contacts that begin before the last of these times, to given arrays.

    Contacts beyond the length of the arrays are counted but not written.

    Returns
    -------
    tuple
        (status, number of contacts, rest); rest is the time from which contact lasts for ever, infinite if it never
        does.
    """
    wall, position, w, now, i, contacts, rest = SIGMA_PLUS, 0.0, -v, 0.0, 0, 0, math.inf
    for _ in range(MOST_PIECES):
        phase, free = fold_phase(tau + now), wall == GAP
        for_ever, s, after, end, w1, left, _a, _b, _c, _d = follow_piece(
            wall, phase, position, w, delta, epsilon, beta, kappa, math.inf
        )
        if for_ever == QUIET:
            s, rest = math.inf, min(rest, now)
        elif for_ever != OK:
            return for_ever, contacts, rest
        while i < time.size and time[i] < now + s:
            status, _s, at, x, velocity[i], _left, _a, _b, _c, _d = follow_piece(
                wall, phase, position, w, delta, epsilon, beta, kappa, time[i] - now
            )
            if status != OK:
                return status, contacts, rest
            phi[i] = x if at == GAP else at * (beta + x)
            i += 1
        if i == time.size:
            return OK, contacts, rest
        now += s
        if (free or left) and after != GAP:
            if contacts < contact_time.size:
                contact_time[contacts], contact_wall[contacts], contact_speed[contacts] = now, after, abs(w1)
            contacts += 1
        wall, position, w = after, end, w1
    return OK + MOST_PIECES, contacts, rest


def trajectory(
    delta: float, epsilon: float, beta: float, kappa: float, tau: float, v: float, periods: float, points: int
) -> Trajectory:
    """Return Φ and Φ' of the motion from a departure (τ, v) from Σ⁺, as `rattle.stiff.StiffGear.trajectory` does."""
    return sample_motion(write_stiff_motion, tau, v, (delta, epsilon, beta, kappa), periods, points)
