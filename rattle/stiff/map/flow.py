"""The flow of the stiff gear, free flights and contacts in turn, with its exact tangent map (compiled).

A piece is one flight or one contact. The vector field is continuous, so the tangent map of a motion is the product of
the tangent maps of its pieces, each with determinant e^(−δs) for the duration s. With −δ and −τ the pieces run
backwards in time. A state is (wall, position, w) with w = Φ'. In contact, wall is ±1 and position is the depth beyond
the wall; in the gap, wall is GAP (0) and position is Φ. A tangent map (j00, j01, j10, j11) is ∂(Φ, Φ')/∂(Φ₀, Φ'₀) at
fixed times.
"""

import math

from rattle.flight.first_impact import OK, SIGMA_MINUS, SIGMA_PLUS, find_first_crossing, first_impact
from rattle.flight.forcing import DRIFT, contact_force, force_fourier_coefficients, force_integral, sine_cosine_at
from rattle.flight.law import evaluate, flight_from_phase, fold_phase
from rattle.numerics.compile import inline, kernel
from rattle.stiff.map.contact import ENDS, LASTS, STAYS, find_contact_end

GAP = SIGMA_PLUS - SIGMA_PLUS  # 0 in the integer type of the walls: the motion is in the gap
QUIET, STUCK = 3, 4  # status codes besides OK. QUIET: a contact never ends; STUCK: the motion cannot be followed on
MOST_PIECES = 1_000_000  # largest number of flights and contacts that one call follows


@inline
def pressing_force(wall, tau, delta, epsilon):
    """Return the contact force at this phase with the sign of the wall: positive if it presses the teeth together."""
    sine, cosine = sine_cosine_at(tau)
    return wall * contact_force(sine, cosine, delta, epsilon, math.copysign(DRIFT, delta))


@inline
def is_contact_over(wall, tau, position, w, delta, epsilon):
    """Return whether a contact is over: its depth is 0, and the motion moves or is pulled away from the wall."""
    if position != 0.0 or wall * w > 0.0:
        return False
    return wall * w < 0.0 or not pressing_force(wall, tau, delta, epsilon) > 0.0


@inline
def matrix_product(a00, a01, a10, a11, b00, b01, b10, b11):
    """Return the entries of the product ab of two 2 × 2 matrices, row by row."""
    return a00 * b00 + a01 * b10, a00 * b01 + a01 * b11, a10 * b00 + a11 * b10, a10 * b01 + a11 * b11


@kernel
def follow_flight(wall, tau, position, w, delta, epsilon, beta, horizon):
    """Follow a free flight to the next wall, or for the time `horizon`.

    w is the velocity Φ'. The flight starts in the gap (wall GAP), or on a wall with w into the gap. `position` is Φ in
    the gap, and the depth 0 on a wall.

    Returns
    -------
    tuple
        (status, duration s, wall or GAP, position and w at the end, 1 − e^(−δs)).
    """
    drift = math.copysign(DRIFT, delta)
    flight = flight_from_phase(tau, w, delta, epsilon, drift)
    if wall != GAP:
        position = wall * beta
        status, s, target, w1, lost, _flight, _s1, _c1 = first_impact(wall, tau, w, delta, epsilon, beta, drift)
    else:
        lower, upper = min(-beta - position, 0.0), max(beta - position, 0.0)
        status, target, s = find_first_crossing(tau, flight, lower, upper)
        _f0, w1, _f2, lost, _s1, _c1 = evaluate(s, flight)
        w1 = target * max(target * w1, 0.0)
    if status == OK and s <= horizon:
        return OK, s, SIGMA_PLUS if target > 0 else SIGMA_MINUS, 0.0, w1, lost
    if horizon == math.inf:
        return STUCK, 0.0, GAP, position, w, 0.0
    f0, w1, _f2, lost, _s1, _c1 = evaluate(horizon, flight)
    return OK, horizon, GAP, position + f0, w1, lost


@kernel
def follow_piece(wall, tau, position, w, delta, epsilon, beta, kappa, horizon):
    """Follow the next flight or contact to its end, or for the time `horizon`.

    `position` is Φ in the gap, and the depth beyond the wall in contact. w is the velocity Φ'. A motion with depth 0
    and velocity 0 is in contact if the contact force presses on the wall.

    Returns
    -------
    tuple
        (status; duration; wall, position and w at the end; whether the piece is a flight that starts on a wall; the
        tangent map of the piece). Status: OK, QUIET if it is a contact that never ends, STUCK if no end was found.
    """
    leaves = wall != GAP and is_contact_over(wall, tau, position, w, delta, epsilon)
    if wall == GAP or leaves:
        status, s, wall, position, w, lost = follow_flight(wall, tau, position, w, delta, epsilon, beta, horizon)
        return status, s, wall, position, w, leaves, 1.0, lost / delta, 0.0, 1.0 - lost
    status, s, x, v, sine, lost = find_contact_end(wall, tau, position, wall * w, delta, epsilon, kappa, horizon)
    w = wall * v
    if status == STAYS:
        return QUIET, s, wall, x, w, False, 1.0, 0.0, 0.0, 1.0
    status = OK if status in (ENDS, LASTS) else STUCK
    return status, s, wall, x, w, False, 1.0 - lost, sine, -2.0 * kappa * sine, 1.0 - lost - delta * sine


@kernel
def flow(wall, tau, position, w, duration, delta, epsilon, beta, kappa):
    """Follow a motion for a duration, in forcing periods, from a state in the gap (wall 0) or in contact (wall ±1).

    `position` is Φ in the gap, and the depth beyond the wall in contact. w is the velocity Φ'. A contact begins when a
    flight meets a wall.

    Returns
    -------
    tuple
        (status; wall, position and w at the end; numbers of contacts that began with Σ⁺ and with Σ⁻; tangent map).
    """
    j00, j01, j10, j11, n_plus, n_minus, time = 1.0, 0.0, 0.0, 1.0, 0, 0, 0.0
    for _ in range(MOST_PIECES):
        free = wall == GAP
        status, s, after, position, w, left, m00, m01, m10, m11 = follow_piece(
            wall, fold_phase(tau + time), position, w, delta, epsilon, beta, kappa, duration - time
        )
        if status != OK:
            return status, wall, position, w, n_plus, n_minus, j00, j01, j10, j11
        j00, j01, j10, j11 = matrix_product(m00, m01, m10, m11, j00, j01, j10, j11)
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

    If the next contact with Σ⁺ never ends, the status is QUIET, and τ' = τ and v' = v.

    Returns
    -------
    tuple
        (status, τ', v', time, number of contacts with Σ⁻, the four entries of the tangent map). The tangent map
        relates changes of (Φ, Φ') at the times of the two departures.
    """
    j00, j01, j10, j11, n_minus, time = 1.0, 0.0, 0.0, 1.0, 0, 0.0
    wall, position, w = SIGMA_PLUS, 0.0, -v
    begun = False  # whether a contact with Σ⁺ has begun
    for _ in range(MOST_PIECES):
        phase = fold_phase(tau + time)
        if (
            begun
            and position == 0.0
            and (w < 0.0 or (w == 0.0 and not pressing_force(wall, phase, delta, epsilon) > 0.0))
        ):
            return OK, phase, -w, time, n_minus, j00, j01, j10, j11
        status, s, after, position, w, left, m00, m01, m10, m11 = follow_piece(
            wall, phase, position, w, delta, epsilon, beta, kappa, math.inf
        )
        if status != OK:
            return status, tau, v, time, n_minus, j00, j01, j10, j11
        j00, j01, j10, j11 = matrix_product(m00, m01, m10, m11, j00, j01, j10, j11)
        time += s
        if left:
            n_minus += after == SIGMA_MINUS
            begun = after == SIGMA_PLUS
        wall = after
    return STUCK, tau, v, time, n_minus, j00, j01, j10, j11


@kernel
def follow_flight_and_contact(wall, tau, w, delta, epsilon, beta, kappa):
    """Return the flight and the contact that follow a departure from either wall, up to the next departure.

    The contact obeys x'' + δx' + 2κx = h, with depth x and outward contact force h, and begins and ends at x = 0. Its
    impulse ∫ 2κx is therefore the speed of arrival plus the speed of departure plus ∫ h.

    Returns
    -------
    tuple
        (status, time of flight, wall, speed of arrival, duration of the contact, impulse of the contact, speed of
        departure).
    """
    status, flown, wall, position, w, _l, _a, _b, _c, _d = follow_piece(
        wall, tau, 0.0, w, delta, epsilon, beta, kappa, math.inf
    )
    speed, duration, begun = abs(w), 0.0, fold_phase(tau + flown)
    for _ in range(MOST_PIECES):
        if status != OK or is_contact_over(wall, fold_phase(begun + duration), position, w, delta, epsilon):
            break
        status, s, wall, position, w, _l, _a, _b, _c, _d = follow_piece(
            wall, fold_phase(begun + duration), position, w, delta, epsilon, beta, kappa, math.inf
        )
        duration += s
    else:
        status = STUCK
    sin0, cos0 = sine_cosine_at(begun)
    mean, a, b = force_fourier_coefficients(wall, sin0, cos0, delta, epsilon)
    pressed = force_integral(duration, mean, a, b)
    return status, flown, wall, speed, duration, speed + abs(w) + pressed, abs(w)


@kernel
def previous_departure(tau, v, delta, epsilon, beta, kappa):
    """Return the departure from Σ⁺ before the departure (τ, v), Π⁻¹(τ, v), by following the motion backwards.

    Returns
    -------
    tuple
        (status, τ, v, time between the departures, number of contacts with Σ⁻); the status is STUCK if the motion
        cannot be followed back, for example because it has always been in contact.
    """
    wall, position, w, time, n_minus = SIGMA_PLUS, 0.0, v, 0.0, 0
    for _ in range(MOST_PIECES):
        free = wall == GAP
        status, s, wall, position, w, left, _a, _b, _c, _d = follow_piece(
            wall, fold_phase(-(tau - time)), position, w, -delta, epsilon, beta, kappa, math.inf
        )
        if status != OK:
            return STUCK, tau, v, time, n_minus
        time += s
        if (left or free) and wall == SIGMA_PLUS:
            return OK, fold_phase(tau - time), w, time, n_minus
        n_minus += (left or free) and wall == SIGMA_MINUS
    return STUCK, tau, v, time, n_minus
