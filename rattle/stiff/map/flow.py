"""The flow of the stiff gear, free flights and contacts in turn, with its exact tangent map (compiled).

A piece is one flight or one contact. The vector field is continuous, so the tangent map of a motion is the product of
the tangent maps of its pieces, each with determinant e^(−δs) for the duration s. With −δ and −τ the pieces run
backwards in time. A state is (wall, position, w) with w = Φ'. In contact, wall is ±1 and position is the depth beyond
the wall; in the gap, wall is GAP (0) and position is Φ. A tangent map (j00, j01, j10, j11) is ∂(Φ, Φ')/∂(Φ₀, Φ'₀) at
fixed times.
"""

import math

from numba.core.types import Tuple, boolean, float64, int64

from rattle.flight.first_impact import OK, SIGMA_MINUS, SIGMA_PLUS, first_impact, searched_crossing
from rattle.flight.forcing import DRIFT, contact_force, force_ahead, force_integral, phase_at
from rattle.flight.law import evaluate, flight_from_phase, folded
from rattle.numerics.compile import inline, kernel
from rattle.stiff.map.contact import ENDS, LASTS, STAYS, contact_end

GAP = SIGMA_PLUS - SIGMA_PLUS
QUIET, STUCK = 3, 4  # further status codes: contact that never ends; a motion that cannot be followed farther
MOST_PIECES = 1_000_000  # most flights and contacts of one call
_MAP = 4 * (float64,)
_PIECE = Tuple((int64, float64, int64, *2 * (float64,), boolean, *_MAP))(int64, *8 * (float64,))
_DEPARTURE = Tuple((int64, *3 * (float64,), int64, *_MAP))(*6 * (float64,))


@inline
def outward_force(wall, tau, delta, epsilon):
    """Return the contact force at this phase, positive where it presses on the wall."""
    sine, cosine = phase_at(tau)
    return wall * contact_force(sine, cosine, delta, epsilon, math.copysign(DRIFT, delta))


@inline
def departs(wall, tau, position, w, delta, epsilon):
    """Return whether a contact has ended: the depth is 0, and the motion moves, or is pulled, away from the wall."""
    if position != 0.0 or wall * w > 0.0:
        return False
    return wall * w < 0.0 or not outward_force(wall, tau, delta, epsilon) > 0.0


@inline
def multiplied(a00, a01, a10, a11, b00, b01, b10, b11):
    """Return the product of the 2 × 2 matrices a and b, row by row."""
    return a00 * b00 + a01 * b10, a00 * b01 + a01 * b11, a10 * b00 + a11 * b10, a10 * b01 + a11 * b11


@kernel
def gap_piece(wall, tau, position, w, delta, epsilon, beta, horizon):
    """Follow a free flight to the next wall, or for the time `horizon`.

    The flight starts in the gap (wall GAP), or on a wall with velocity into the gap.

    Returns
    -------
    tuple
        (status, duration s, wall or GAP, position, w, 1 − e^(−δs)), the state at the end.
    """
    drift = math.copysign(DRIFT, delta)
    flight = flight_from_phase(tau, w, delta, epsilon, drift)
    if wall != GAP:
        position = wall * beta
        status, s, target, w1, lost, _flight, _s1, _c1 = first_impact(wall, tau, w, delta, epsilon, beta, drift)
    else:
        lower, upper = min(-beta - position, 0.0), max(beta - position, 0.0)
        status, target, s = searched_crossing(tau, flight, lower, upper)
        _f0, w1, _f2, lost, _s1, _c1 = evaluate(s, flight)
        w1 = target * max(target * w1, 0.0)
    if status == OK and s <= horizon:
        return OK, s, SIGMA_PLUS if target > 0 else SIGMA_MINUS, 0.0, w1, lost
    if horizon == math.inf:
        return STUCK, 0.0, GAP, position, w, 0.0
    f0, w1, _f2, lost, _s1, _c1 = evaluate(horizon, flight)
    return OK, horizon, GAP, position + f0, w1, lost


@kernel
def piece(wall, tau, position, w, delta, epsilon, beta, kappa, horizon):
    """Follow the next flight or contact to its end, or for the time `horizon`.

    A motion with depth 0 and velocity 0 is in contact if the contact force presses on the wall.

    Returns
    -------
    tuple
        (status; duration; wall, position and w at the end; whether the piece is a flight that starts on a wall; the
        tangent map of the piece).
    """
    leaves = wall != GAP and departs(wall, tau, position, w, delta, epsilon)
    if wall == GAP or leaves:
        status, s, wall, position, w, lost = gap_piece(wall, tau, position, w, delta, epsilon, beta, horizon)
        return status, s, wall, position, w, leaves, 1.0, lost / delta, 0.0, 1.0 - lost
    status, s, x, v, sine, lost = contact_end(wall, tau, position, wall * w, delta, epsilon, kappa, horizon)
    w = wall * v
    if status == STAYS:
        return QUIET, s, wall, x, w, False, 1.0, 0.0, 0.0, 1.0
    status = OK if status in (ENDS, LASTS) else STUCK
    return status, s, wall, x, w, False, 1.0 - lost, sine, -2.0 * kappa * sine, 1.0 - lost - delta * sine


@kernel
def flow(wall, tau, position, w, duration, delta, epsilon, beta, kappa):
    """Follow a motion for a duration, in forcing periods.

    A contact begins when a flight meets a wall.

    Returns
    -------
    tuple
        (status, wall, position, w, numbers of contacts that began with Σ⁺ and with Σ⁻, tangent map).
    """
    j00, j01, j10, j11, n_plus, n_minus, time = 1.0, 0.0, 0.0, 1.0, 0, 0, 0.0
    for _ in range(MOST_PIECES):
        free = wall == GAP
        status, s, after, position, w, left, m00, m01, m10, m11 = piece(
            wall, folded(tau + time), position, w, delta, epsilon, beta, kappa, duration - time
        )
        if status != OK:
            return status, wall, position, w, n_plus, n_minus, j00, j01, j10, j11
        j00, j01, j10, j11 = multiplied(m00, m01, m10, m11, j00, j01, j10, j11)
        if free or left:
            n_plus += after == SIGMA_PLUS
            n_minus += after == SIGMA_MINUS
        wall, time = after, time + s
        if time >= duration:
            return OK, wall, position, w, n_plus, n_minus, j00, j01, j10, j11
    return STUCK, wall, position, w, n_plus, n_minus, j00, j01, j10, j11


@kernel
def next_departure(tau, v, delta, epsilon, beta, kappa):
    """Return Π(τ, v), the next departure from Σ⁺ after a departure (τ, v) from Σ⁺.

    If the next contact with Σ⁺ never ends, the status is QUIET, and τ' and v' are τ and v.

    Returns
    -------
    tuple
        (status, τ', v', time, number of contacts with Σ⁻, tangent map at fixed times).
    """
    j00, j01, j10, j11, n_minus, time = 1.0, 0.0, 0.0, 1.0, 0, 0.0
    wall, position, w = SIGMA_PLUS, 0.0, -v
    begun = False  # whether a contact with Σ⁺ has begun
    for _ in range(MOST_PIECES):
        phase = folded(tau + time)
        if (
            begun
            and position == 0.0
            and (w < 0.0 or (w == 0.0 and not outward_force(wall, phase, delta, epsilon) > 0.0))
        ):
            return OK, phase, -w, time, n_minus, j00, j01, j10, j11
        status, s, after, position, w, left, m00, m01, m10, m11 = piece(
            wall, phase, position, w, delta, epsilon, beta, kappa, math.inf
        )
        if status != OK:
            return status, tau, v, time, n_minus, j00, j01, j10, j11
        j00, j01, j10, j11 = multiplied(m00, m01, m10, m11, j00, j01, j10, j11)
        time += s
        if left:
            n_minus += after == SIGMA_MINUS
            begun = after == SIGMA_PLUS
        wall = after
    return STUCK, tau, v, time, n_minus, j00, j01, j10, j11


@kernel
def bounced(wall, tau, w, delta, epsilon, beta, kappa):
    """Return the flight and the contact that follow a departure from either wall, up to the next departure.

    In the contact x'' + δx' + 2κx = h holds from depth 0 to depth 0. The impulse ∫ 2κx of the contact is therefore the
    speed of arrival plus the speed of departure plus ∫ h.

    Returns
    -------
    tuple
        (status, time of flight, wall, speed of arrival, duration of the contact, impulse of the contact, speed of
        departure).
    """
    status, flown, wall, position, w, _l, _a, _b, _c, _d = piece(
        wall, tau, 0.0, w, delta, epsilon, beta, kappa, math.inf
    )
    speed, duration, begun = abs(w), 0.0, folded(tau + flown)
    for _ in range(MOST_PIECES):
        if status != OK or departs(wall, folded(begun + duration), position, w, delta, epsilon):
            break
        status, s, wall, position, w, _l, _a, _b, _c, _d = piece(
            wall, folded(begun + duration), position, w, delta, epsilon, beta, kappa, math.inf
        )
        duration += s
    else:
        status = STUCK
    sin0, cos0 = phase_at(begun)
    mean, a, b = force_ahead(wall, sin0, cos0, delta, epsilon)
    pressed = force_integral(duration, mean, a, b)
    return status, flown, wall, speed, duration, speed + abs(w) + pressed, abs(w)


@kernel
def preceding(tau, v, delta, epsilon, beta, kappa):
    """Return Π⁻¹(τ, v), following the motion backwards in time, first through the contact that this departure ends.

    Returns
    -------
    tuple
        (status, τ, v, time, number of contacts with Σ⁻); the status is STUCK if the motion cannot be followed back, as
        where it has been in contact for ever.
    """
    wall, position, w, time, n_minus = SIGMA_PLUS, 0.0, v, 0.0, 0
    for _ in range(MOST_PIECES):
        free = wall == GAP
        status, s, wall, position, w, left, _a, _b, _c, _d = piece(
            wall, folded(-(tau - time)), position, w, -delta, epsilon, beta, kappa, math.inf
        )
        if status != OK:
            return STUCK, tau, v, time, n_minus
        time += s
        if (left or free) and wall == SIGMA_PLUS:
            return OK, folded(tau - time), w, time, n_minus
        n_minus += (left or free) and wall == SIGMA_MINUS
    return STUCK, tau, v, time, n_minus
