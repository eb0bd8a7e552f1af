"""Contact with a stiff wall in closed form, and where it ends (compiled).

x ≥ 0 is the depth beyond the wall. In contact (paper 2.1, 2.2)

    x'' + δx' + 2κx = h(t),

where h is ± the contact force of `rattle.flight.forcing`, with the sign of the wall. Let S be the response to a unit
velocity and C = S' + δS the response to a unit depth. Then x = C x₀ + S w₀ plus the responses to the mean, the cosine
and the sine of h. This holds for a forcing of one cosine; every harmonic would add a response. docs/stiff.md derives
the formulas, and shows why the search cannot skip the end of a contact. With −δ and −τ the same formulas run backwards
in time.
"""

import math
from typing import NamedTuple

from rattle.flight.first_impact import BISECTED, MOST_STEPS, PIECE, end_of_piece
from rattle.flight.forcing import TWO_PI, find_negative_force_arc, force_fourier_coefficients, sine_cosine_at, versines
from rattle.numerics.compile import inline, kernel

# status codes of `find_contact_end`: the contact ends; lasts to the horizon; never ends; has no end that the search
# finds
ENDS, LASTS, STAYS, TOO_LONG = range(4)
# the search for the end of a contact stops after LONGEST forcing periods plus DECAYS decay times of a free motion
LONGEST = 1000.0
DECAYS = 100.0
SHORT = 0.5  # value of (δ + √(2κ)) s below which the response S is computed by a Taylor series
TERMS = 16  # number of terms of the Taylor series of the response S
# tests of the depth of permanent contact use this share of the depth, so that rounding cannot decide them
SAFETY_FACTOR = 0.999


class Contact(NamedTuple):
    """The quantities that determine the depth x of one contact at all times s."""

    x0: float  # depth at the beginning
    w0: float  # outward velocity at the beginning
    mean: float  # the force is h = mean + a cos 2πs + b sin 2πs
    a: float
    b: float
    delta: float
    kappa: float


@inline
def free_contact_responses(s, delta, kappa):
    """Return S, 1 − C and s − S at the time s without cancellation, also for negative damping.

    S and C are the depths that a unit velocity and a unit depth at s = 0 lead to, without a force.

    Returns
    -------
    tuple of float
        The three values.
    """
    stiffness = 2.0 * kappa
    if (abs(delta) + math.sqrt(stiffness)) * s < SHORT:
        last, term, total, lost, defect = 0.0, s, s, 0.5 * stiffness * s * s, 0.0
        for n in range(1, TERMS):
            last, term = term, -(delta * s * term + stiffness * s * s / n * last) / (n + 1)
            total += term
            defect -= term
            lost += stiffness * s * term / (n + 2)
        return total, lost, defect
    half = 0.5 * delta
    square = half * half - stiffness
    rate = math.sqrt(abs(square))
    angle = rate * s
    if square > 0.0 and angle > 0.5:
        fast = half + rate
        slow = stiffness / fast
        gone_slow, gone_fast = -math.expm1(-slow * s), -math.expm1(-fast * s)
        sine = (1.0 - gone_slow) * -math.expm1(-2.0 * angle) / (2.0 * rate)
        return sine, (fast * gone_slow - slow * gone_fast) / (2.0 * rate), s - sine
    decay = math.exp(-half * s)
    if square > 0.0:
        even, odd = math.cosh(angle), math.sinh(angle) / angle if angle > 0.0 else 1.0
    else:
        even, odd = math.cos(angle), math.sin(angle) / angle if angle > 0.0 else 1.0
    sine = decay * s * odd
    return sine, 1.0 - decay * (even + half * s * odd), s - sine


@inline
def compliance_terms(delta, kappa):
    """Return A/D, B/D and 1/√D for A = 2κ − 4π², B = 2πδ and D = A² + B².

    The force cos 2πs causes the periodic depth (A cos 2πs + B sin 2πs)/D, with the amplitude 1/√D.

    Returns
    -------
    tuple of float
        The three values.
    """
    a, b = 2.0 * kappa - TWO_PI * TWO_PI, TWO_PI * delta
    size = math.hypot(a, b)
    return a / size / size, b / size / size, 1.0 / size


@inline
def contact_responses(s, delta, kappa):
    """Return the responses of a contact at the time s to a unit velocity, a unit depth, and the forces cos and sin 2πs.

    Returns
    -------
    tuple of float
        S, 1 − C, x_c, x_s, v_c, v_s, 1 − cos 2πs, sin 2πs. S and C are the depths that a unit velocity and a unit depth
        lead to. x_c and x_s are the depths, v_c and v_s the velocities, that the forces cos 2πs and sin 2πs cause from
        rest at depth 0.
    """
    sine, lost, defect = free_contact_responses(s, delta, kappa)
    omc, siny, forced_defect = versines(s)
    in_phase, behind, _size = compliance_terms(delta, kappa)
    p, q = lost - omc, TWO_PI * defect - forced_defect  # p = cos 2πs − C and q = sin 2πs − 2πS, without cancellation
    dp, dq = 2.0 * kappa * sine - TWO_PI * siny, TWO_PI * (lost + delta * sine - omc)
    x_c, x_s = in_phase * p + behind * q, in_phase * q - behind * p
    v_c, v_s = in_phase * dp + behind * dq, in_phase * dq - behind * dp
    return sine, lost, x_c, x_s, v_c, v_s, omc, siny


@inline
def contact_state(s, contact):
    """Return depth x, velocity x' and force h of a contact at the time s, and S, 1 − C of `free_contact_responses`."""
    x0, w0, mean, a, b, delta, kappa = contact
    sine, lost, x_c, x_s, v_c, v_s, omc, siny = contact_responses(s, delta, kappa)
    stiffness = 2.0 * kappa
    x = x0 * (1.0 - lost) + w0 * sine + mean * lost / stiffness + (a * x_c + b * x_s)
    v = w0 * (1.0 - lost - delta * sine) + (mean - stiffness * x0) * sine + (a * v_c + b * v_s)
    return x, v, mean + a * (1.0 - omc) + b * siny, sine, lost


@inline
def steady_contact_state(s, contact):
    """Return the depth and velocity at the time s in permanent (periodic) contact under the force of this contact."""
    _x0, _w0, mean, a, b, delta, kappa = contact
    omc, sine, _defect = versines(s)
    cosine = 1.0 - omc
    in_phase, behind, _size = compliance_terms(delta, kappa)
    c, d = a * in_phase - b * behind, a * behind + b * in_phase
    return mean / (2.0 * kappa) + c * cosine + d * sine, TWO_PI * (d * cosine - c * sine)


@inline
def logarithmic_derivative_of_free_motion(s, delta, square, rate):
    """Return u'/u at the time s for the free motion u = e^(−δs/2) cos(rate · s), with cosh for cos if `square` > 0.

    u is the depth of a contact on which no external force acts; s counts from the middle of an interval on which u > 0.
    square: δ²/4 − 2κ. rate: the square root of |square|.

    Returns
    -------
    float
        The logarithmic derivative of u.
    """
    if square > 0.0:
        return rate * math.tanh(rate * s) - 0.5 * delta
    return -rate * math.tan(rate * s) - 0.5 * delta


@kernel
def time_of_extreme_ratio(lo, hi, middle, contact):
    """Return the time in (lo, hi) at which x/u is extreme; x is the depth of contact, and u the free motion in contact.

    `logarithmic_derivative_of_free_motion` counts its time from `middle`. The method finds the zero of q = x' − x u'/u,
    which has the sign of the derivative of x/u and changes sign once in (lo, hi). With the force h, q' = h − (δ + u'/u)
    q.

    Returns
    -------
    float
        Time since the contact began, in forcing periods.
    """
    delta = contact.delta
    square = 0.25 * delta * delta - 2.0 * contact.kappa
    rate = math.sqrt(abs(square))
    x, v, _h, _s, _l = contact_state(hi, contact)
    rising = v - x * logarithmic_derivative_of_free_motion(hi - middle, delta, square, rate) > 0.0
    s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        x, v, h, _s, _l = contact_state(s, contact)
        r = logarithmic_derivative_of_free_motion(s - middle, delta, square, rate)
        q = v - x * r
        if (q > 0.0) == rising:
            hi = s
        else:
            lo = s
        step = -q / (h - (delta + r) * q)
        new = s + step
        inside = lo <= new <= hi
        if inside and abs(step) < 1e-9 * s:
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (lo + hi)
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def time_of_zero_depth(lo, hi, contact):
    """Return the only time in (lo, hi) at which the depth falls to 0, by Halley steps inside a bracket."""
    s = 0.5 * (lo + hi)
    for k in range(1, MOST_STEPS + 1):
        x, v, h, _s, _l = contact_state(s, contact)
        if x > 0.0:
            lo = s
        else:
            hi = s
        step = -x / v
        step /= 1.0 + 0.5 * step * (h - contact.delta * v - 2.0 * contact.kappa * x) / v
        new = s + step
        inside = lo <= new <= hi
        if inside and abs(step) <= 1e-15 * s:
            return new
        if not inside or k % BISECTED == 0:
            new = 0.5 * (lo + hi)
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def find_contact_end(wall, tau, x0, w0, delta, epsilon, kappa, horizon):
    """Follow a contact from phase tau, depth x0 ≥ 0 and outward velocity w0 until the depth x first falls to 0.

    If x0 is 0, the motion must move into the wall or be pressed on it. horizon: the time after which the search stops;
    endless contact is recognised only if `horizon` is infinite.

    Returns
    -------
    tuple
        (status; the time s; x and x' at s; S and 1 − C of `free_contact_responses` at s, both 0 if the status is
        STAYS). Status: ENDS; LASTS if the contact lasts to the horizon, STAYS if it never ends, TOO_LONG if no end was
        found.
    """
    sin0, cos0 = sine_cosine_at(tau)
    mean, a, b = force_fourier_coefficients(wall, sin0, cos0, delta, epsilon)
    contact = Contact(x0, w0, mean, a, b, delta, kappa)
    arc = find_negative_force_arc(delta, epsilon)
    square = 0.25 * delta * delta - 2.0 * kappa
    rate = math.sqrt(abs(square))
    longest = PIECE if square >= 0.0 else min(PIECE, 0.75 * math.pi / rate)
    slow = 0.5 * abs(delta) if square <= 0.0 else 2.0 * kappa / (0.5 * abs(delta) + rate)
    latest = LONGEST + DECAYS / slow
    swing = math.hypot(a, b) * compliance_terms(delta, kappa)[2]  # amplitude of the depth in permanent contact
    least = mean / (2.0 * kappa) - swing
    s, x, v = 0.0, x0, w0
    while s < horizon:
        rest, rest_v = steady_contact_state(s, contact)
        # from the time s on, the depth differs from the depth of permanent contact by at most `reach`
        reach = math.sqrt((x - rest) ** 2 + (v - rest_v) ** 2 / (2.0 * kappa))
        if delta < 0.0:  # backwards in time the difference from permanent contact grows without bound
            reach = math.inf
        if reach < SAFETY_FACTOR * least and horizon == math.inf:
            return STAYS, s, x, v, 0.0, 0.0
        if s > latest:
            break
        # the depth of permanent contact oscillates with the amplitude `swing`, so it falls at most at the rate 2π swing
        room = SAFETY_FACTOR * rest - reach
        ahead = math.inf if reach < SAFETY_FACTOR * least else max(room, 0.0) / (TWO_PI * swing) if swing > 0.0 else 0.0
        if ahead > longest:
            s = min(s + ahead, horizon)
            x, v, _h, _s, _l = contact_state(s, contact)
            continue
        end = min(end_of_piece(s, longest, tau, arc), horizon)
        x1, v1, _h, _s, _l = contact_state(end, contact)
        middle = 0.5 * (s + end)
        q0 = v - x * logarithmic_derivative_of_free_motion(s - middle, delta, square, rate)
        q1 = v1 - x1 * logarithmic_derivative_of_free_motion(end - middle, delta, square, rate)
        lo, hi = s, end
        ends = not x1 > 0.0
        if q0 < 0.0 < q1 or q1 < 0.0 < q0:
            turn = time_of_extreme_ratio(s, end, middle, contact)
            if q0 > 0.0:
                lo = turn
            elif not contact_state(turn, contact)[0] > 0.0:
                hi, ends = turn, True
        if ends:
            s = time_of_zero_depth(lo, hi, contact)
            x, v, _h, sine, lost = contact_state(s, contact)
            return ENDS, s, 0.0, min(v, 0.0), sine, lost
        s, x, v = end, x1, v1
    x, v, _h, sine, lost = contact_state(s, contact)
    return (LASTS if s >= horizon else TOO_LONG), s, x, v, sine, lost
