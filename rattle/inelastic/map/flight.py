"""Free flight under a forcing of several harmonics, and its first impact (compiled).

A flight leaves a wall at phase t₀ with velocity w. With A = q + e'(t₀) − w and k(x) = e^(−x) − 1 + x,

    F(s) = Φ(s) − Φ(0) = w s + A k(δs)/δ + [e(t₀ + s) − e(t₀) − s e'(t₀)],    F'' + δF' = g(t₀ + s).

Each term is computed without cancellation for short flights, as in `rattle.flight.law`. The function e^(δs) F' has the
derivative e^(δs) g, so it is monotone on a piece between two zeros of g, and F has at most one extremum there. The
search goes from piece to piece. The values of F at both ends of a piece, and if needed at its extremum, show whether F
reaches a wall on the piece, so the search cannot skip an impact.
"""

import math
from typing import NamedTuple

from rattle.flight.first_impact import BISECTED, LONGEST, MOST_STEPS, NO_IMPACT, OK
from rattle.flight.forcing import TWO_PI, sine_cosine_at, versines
from rattle.flight.law import LONGEST_DECAY, decay_remainder64
from rattle.inelastic.map.harmonics import AMPLITUDE, ORDER, PHASE
from rattle.numerics.compile import inline, kernel

LONGEST_PIECE = 0.5  # longest piece of a flight that is searched at once, in forcing periods; longer pieces are cut
FIRST_PIECE = 0.25  # length of the first piece, in forcing periods, of a flight that is not a bounce
FIRST_PIECE_FACTOR = 1.2  # length of the first piece of a bounce divided by the estimated flight time, 2|w|/|F''|
# rows of the array `departure` (2, K): amplitude times cosine and sine of the phase of each harmonic at departure
COSINE, SINE = range(2)


class InelasticFlight(NamedTuple):
    """One flight, given by quantities at its departure at time t₀, which `prepare_forced_flight` computes."""

    w: float  # velocity of departure
    a: float  # A = q + e'(t₀) − w, with the drift q and the forcing e
    forcing_acceleration: float  # e''(t₀)
    force: float  # contact force g(t₀)
    delta: float


@inline
def prepare_forced_flight(tau, w, delta, drift, harmonics, departure):
    """Return the flight that departs at phase tau with velocity w, and fill the array `departure` (2, K) for it."""
    slope, bend = 0.0, 0.0
    for j in range(harmonics.shape[1]):
        turn = TWO_PI * harmonics[ORDER, j]
        sine, cosine = sine_cosine_at(harmonics[ORDER, j] * tau + harmonics[PHASE, j])
        departure[COSINE, j], departure[SINE, j] = harmonics[AMPLITUDE, j] * cosine, harmonics[AMPLITUDE, j] * sine
        slope -= turn * departure[SINE, j]
        bend -= turn * turn * departure[COSINE, j]
    return InelasticFlight(w, drift + slope - w, bend, delta * (drift + slope) + bend, delta)


@inline
def evaluate_forced_flight(s, flight, harmonics, departure):
    """Return the displacement F since the departure, F', F'' and 1 − e^(−δs) at the flight time s."""
    w, a, _bend, _force, delta = flight
    x = delta * s
    if x <= LONGEST_DECAY:
        k = x * decay_remainder64(x)  # (e^(−x) − 1 + x)/x
        lost = x * (1.0 - k)
        f0 = s * (w + a * k)
    else:
        lost = -math.expm1(-x)
        f0 = w * s + a * ((x - lost) / delta)
    f1, f2 = w + a * lost, delta * a * (1.0 - lost)
    for j in range(harmonics.shape[1]):
        turn = TWO_PI * harmonics[ORDER, j]
        omc, sine, defect = versines(harmonics[ORDER, j] * s)
        cos0, sin0 = departure[COSINE, j], departure[SINE, j]
        f0 += sin0 * defect - cos0 * omc
        f1 += turn * (sin0 * omc - cos0 * sine)
        f2 -= turn * turn * (cos0 - cos0 * omc - sin0 * sine)
    return f0, f1, f2, lost


@kernel
def time_of_forced_crossing(low, high, guess, level, rising, third, flight, harmonics, departure):
    """Return the only time in (low, high) at which the displacement F of a flight is `level`, by Halley steps.

    rising: whether F rises at the crossing. third: an upper bound of |F‴|. After a step u the error is below
    |u|³ (p² + third/|F'|) with p = F''/(2F'); the search ends when this bound is smaller than rounding errors.

    Returns
    -------
    float
        The flight time of the crossing, in forcing periods.
    """
    s = guess
    if not (low < s < high):
        s = 0.5 * (low + high)
    for k in range(1, MOST_STEPS + 1):
        f0, f1, f2, _lost = evaluate_forced_flight(s, flight, harmonics, departure)
        f0 -= level
        if (f0 > 0.0) == rising:
            high = s
        else:
            low = s
        u, p = -f0 / f1, 0.5 * f2 / f1
        u /= 1.0 + u * p
        bend = p * p + abs(third / f1)
        new = s + u
        inside = low <= new <= high
        if inside and abs(u) * u * u * bend < 1e-17 * s:
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (low + high)
        if new == s or low == high:
            return new
        s = new
    return s


@kernel
def time_of_forced_extremum(low, high, guess, convex, third, flight, harmonics, departure):
    """Return the only time in (low, high) at which the displacement F of a flight is extreme.

    convex: whether the extremum is a minimum. third: an upper bound of |F‴|. The time is so accurate that F at it is
    exact to rounding.

    Returns
    -------
    float
        The flight time of the extremum, in forcing periods.
    """
    s = guess
    if not (low < s < high):
        s = 0.5 * (low + high)
    for k in range(1, MOST_STEPS + 1):
        _f0, f1, f2, _lost = evaluate_forced_flight(s, flight, harmonics, departure)
        if (f1 > 0.0) == convex:
            high = s
        else:
            low = s
        force = f2 + flight.delta * f1
        u = -f1 / force
        new = s + u
        inside = low <= new <= high
        bend = abs(third / force) + flight.delta
        if inside and u * u * bend < 1e-10 * min(s, 1.0):
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (low + high)
        if new == s or low == high:
            return new
        s = new
    return s


@inline
def displacement_lower_bound_on_piece(length, g0, slope0, g1, slope1, delta):
    """Return a lower bound of a displacement G over a time `length` in which e^(δs) G' rises through 0.

    g0, slope0, g1, slope1: G and G' at the beginning and at the end. Without damping G lies above its tangents at both
    ends. With damping G lies above the first tangent, and above the second one if its slope is divided by 1 − δ length.

    Returns
    -------
    float
        The value at which these two lines meet; −∞ if δ length ≥ 1/2.
    """
    x = delta * length
    if not x < 0.5:
        return -math.inf
    steep = slope1 / (1.0 - x)  # at least slope1 · e^x, because 1/(1 − x) ≥ e^x
    return g0 + slope0 * ((g1 - g0 - steep * length) / (slope0 - steep))


@kernel
def find_crossing_on_piece(sign, s0, f0, f1, s1, e0, e1, guess, lower, upper, third, flight, harmonics, departure):
    """Return the first time from s0 to s1 at which the displacement F leaves the interval from `lower` to `upper`.

    sign: the sign of the contact force from s0 to s1. Therefore sign · F falls, or rises, or first falls and then
    rises. f0, f1, e0, e1: F and F' at s0, then F and F' at s1. guess: a guess of the time, or NaN.

    Returns
    -------
    wall : int
        The wall that is reached, +1 or −1; 0 if there is no crossing.
    time : float
        The time of the crossing; s1 if there is none.
    """
    g0, slope0, g1, slope1 = sign * f0, sign * f1, sign * e0, sign * e1
    low, high = (lower, upper) if sign > 0 else (-upper, -lower)
    begin = s0
    if slope0 < 0.0:
        end, reached = s1, g1
        if slope1 > 0.0:
            if displacement_lower_bound_on_piece(s1 - s0, g0, slope0, g1, slope1, flight.delta) > low:
                reached = low
            else:
                turn = s0 + (s1 - s0) * slope0 / (slope0 - slope1)
                end = time_of_forced_extremum(s0, s1, turn, sign > 0, third, flight, harmonics, departure)
                reached = sign * evaluate_forced_flight(end, flight, harmonics, departure)[0]
                begin = end
        if reached < low:
            first = s0 + (low - g0) / (reached - g0) * (end - s0)
            return -sign, time_of_forced_crossing(
                s0, end, first, sign * low, sign < 0, third, flight, harmonics, departure
            )
    if slope1 > 0.0 and g1 > high:
        return sign, time_of_forced_crossing(
            begin, s1, guess, sign * high, sign > 0, third, flight, harmonics, departure
        )
    return 0, s1


@kernel
def first_impact_of_forced_flight(wall, tau, flight, piece, point, departure):
    """Return the first impact of a flight that departs from a wall at phase tau.

    piece: the number of zeros of the contact force at or before tau (`force_piece_number`).

    Returns
    -------
    tuple
        (status, flight time s, wall of the impact, Φ' and Φ'' before the impact, 1 − e^(−δs)).
    """
    harmonics, zeros = point.harmonics, point.zeros
    upper = 0.0 if wall > 0 else 2.0 * point.beta
    lower = upper - 2.0 * point.beta
    delta, count = flight.delta, zeros.size
    third = point.third + delta * delta * abs(flight.a)
    sign = 1 if (piece % 2 == 0) == point.positive else -1
    turns = 0.0
    if piece == count:
        piece, turns = 0, 1.0
    zero = zeros[piece] + turns - tau if count > 0 else math.inf
    s, f0, f1 = 0.0, 0.0, flight.w
    length, guess = FIRST_PIECE, math.nan
    outwards = wall * (flight.force - delta * flight.w)
    # If this condition holds, the flight is a bounce, and its duration can be estimated. After a contact phase it does
    # not hold, because w and the force are then 0 up to rounding.
    if outwards > 0.0 and wall * flight.w < 0.0:
        guess = -2.0 * wall * flight.w / outwards
        length = min(FIRST_PIECE_FACTOR * guess, LONGEST_PIECE)
    while s < LONGEST:
        ends = not s + length < zero
        e = zero if ends else s + length
        if e > s:
            e0, e1, _f2, _lost = evaluate_forced_flight(e, flight, harmonics, departure)
            if not abs(e0) < math.inf:
                break
            target, t = find_crossing_on_piece(
                sign, s, f0, f1, e, e0, e1, guess, lower, upper, third, flight, harmonics, departure
            )
            if target != 0:
                _f0, w1, bend, lost = evaluate_forced_flight(t, flight, harmonics, departure)
                return OK, t, target, target * max(target * w1, 0.0), bend, lost
            s, f0, f1 = e, e0, e1
        if ends:
            sign, piece = -sign, piece + 1
            if piece == count:
                piece, turns = 0, turns + 1.0
            zero = zeros[piece] + turns - tau
        length, guess = min(2.0 * length, LONGEST_PIECE), math.nan
    return NO_IMPACT, s, wall, flight.w, 0.0, 0.0


@inline
def forced_flight_tangent(w1, bend1, lost, restitution, flight):
    """Return the tangent map of a flight and the impact at its end: derivatives of (t₁, w₁') by (t₀, w₀), row by row.

    w₁' is the velocity after the impact. w1, bend1: Φ' and Φ'' before the impact. lost: 1 − e^(−δs), for the flight
    time s.

    Returns
    -------
    tuple of float
        ∂t₁/∂t₀, ∂t₁/∂w₀, ∂w₁'/∂t₀ and ∂w₁'/∂w₀.
    """
    decay = 1.0 - lost
    change = w1 - flight.w - flight.a * lost  # e'(t₁) − e'(t₀)
    f_w = lost / flight.delta
    f_t = change - flight.forcing_acceleration * f_w
    v_t = bend1 - flight.delta * flight.a * decay - flight.forcing_acceleration * decay
    s_t, s_w = -f_t / w1, -f_w / w1
    return 1.0 + s_t, s_w, -restitution * (bend1 * s_t + v_t), -restitution * (bend1 * s_w + decay)
