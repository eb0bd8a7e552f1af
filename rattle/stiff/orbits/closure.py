"""The equations of one periodic motion of the stiff gear with all derivatives, and its admissibility (compiled).

The equations are those of `rattle.stiff.orbits.equations` at one δ, β and κ. For c contacts there are 2c + 1 unknowns
y: the times at which the contacts begin, their durations σ in units of p = 1/√(2κ), and ε. Every contact begins with
the velocity at the end of the flight before it. The equations state that the depth is 0 after the time pσ, and that the
velocity is then the initial velocity of the next flight.

`rattle.stiff.orbits.equations` treats many motions at once, complex numbers for exact derivatives, and p down to 0.
This module treats one real motion at finite κ. Tests compare both modules with the same complex steps.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.flight.first_impact import OK, first_impact
from rattle.flight.forcing import (
    DRIFT,
    TWO_PI,
    add_acceleration,
    add_slope,
    force_fourier_coefficients,
    forcing_change_per_epsilon,
    forcing_slope_per_epsilon,
    sine_cosine_by_math_library,
)
from rattle.flight.law import LONGEST_DECAY, decay_remainder64, fold_phase, speed_unit
from rattle.numerics.compile import inline, kernel
from rattle.stiff.map.contact import ENDS, contact_responses, find_contact_end, free_contact_responses

SAME_TIME = 1e-6  # largest error of a flight's duration, in forcing periods, and of a contact's, in units of πp
LEAST_CONTACT = 1e-6  # duration of a contact, in units of 1/√(2κ), below which the contact counts as a graze
GRAZING = 1e-6  # speed, in units of `speed_unit`, below which rounding decides whether a flight meets a wall
# largest error of a contact's duration that is allowed in addition to SAME_TIME, in forcing periods, because of grazes
SAME_END = 1e-9


class ContactCycle(NamedTuple):
    """The data common to all motions of a family; the motions differ in ε, and in times and durations of contacts.

    walls (c,): the walls ±1 that a motion meets, in order, Σ⁺ first. m: the period in forcing periods. delta, beta,
    kappa: δ, β and κ.
    """

    walls: Any
    m: int
    delta: float
    beta: float
    kappa: float


def softness(kappa: float) -> float:
    """Return p = 1/√(2κ), which is 0 for infinite stiffness."""
    return float(1.0 / np.sqrt(2.0 * kappa))


class FlightEnds(NamedTuple):
    """Velocities w0 and w1 at the beginning and end of a flight, with derivatives: w0_t1 is ∂w0/∂t1, w0_e is ∂w0/∂ε.

    t0 and t1 are the times of the beginning and the end.
    """

    w0: float
    w1: float
    w0_t0: float
    w0_t1: float
    w0_e: float
    w1_t0: float
    w1_t1: float
    w1_e: float


class ContactExit(NamedTuple):
    """Depth x and outward velocity v at the end of a contact, with derivatives: x_u is ∂x/∂u, x_e is ∂x/∂ε.

    u is the outward velocity at the beginning of the contact, t the time of the beginning, and s the duration.
    """

    x: float
    v: float
    x_u: float
    x_t: float
    x_e: float
    v_u: float
    v_t: float
    v_e: float
    v_s: float  # there is no field x_s, because ∂x/∂s is v


@inline
def flight_end_velocities(t0, t1, gap, delta, epsilon):
    """Return the velocities at both ends of the flight from t0 to t1 in which Φ grows by `gap`, with derivatives.

    Source: equations (3.1) and (3.2) of the paper.

    Returns
    -------
    FlightEnds
        The velocities and their derivatives.
    """
    s = t1 - t0
    x = delta * s
    decay, pull = math.exp(-x), -delta / math.expm1(-x)
    lag = 1.0 - s * pull  # the contribution of the drift to w₀, divided by 4π
    if x < LONGEST_DECAY:  # in a short flight 1 − s · pull would lose digits by cancellation
        k = x * decay_remainder64(x)
        lag = -k / (1.0 - k)
    (sin0, cos0), (sin1, cos1) = sine_cosine_by_math_library(t0), sine_cosine_by_math_library(t1)
    swing = forcing_change_per_epsilon(t0, t1, s) * pull
    apart = epsilon * swing - gap * pull
    w0 = add_slope(DRIFT * lag, sin0, cos0, epsilon) - apart
    w1 = add_slope(DRIFT * (lag + x), sin1, cos1, epsilon) - apart * decay
    slowing = delta * (DRIFT * (1.0 - lag) + apart)
    return FlightEnds(
        w0=w0,
        w1=w1,
        w0_t0=add_acceleration(w0 * pull + slowing, sin0, cos0, epsilon),
        w0_t1=-pull * w1,
        w0_e=forcing_slope_per_epsilon(sin0, cos0) - swing,
        w1_t0=decay * pull * w0,
        w1_t1=add_acceleration((slowing - w1 * pull) * decay, sin1, cos1, epsilon),
        w1_e=forcing_slope_per_epsilon(sin1, cos1) - swing * decay,
    )


@inline
def contact_state_after(wall, t, u, s, delta, epsilon, kappa):
    """Return depth and velocity, with derivatives, a time s after a contact began at time t with outward velocity u."""
    sine, lost, x_c, x_s, v_c, v_s, omc, siny = contact_responses(s, delta, kappa)
    sin0, cos0 = sine_cosine_by_math_library(t)
    mean, a, b = force_fourier_coefficients(wall, sin0, cos0, delta, 1.0)
    v_u = 1.0 - lost - delta * sine
    x_e, v_e = a * x_c + b * x_s, a * v_c + b * v_s
    x = u * sine + mean * lost / (2.0 * kappa) + epsilon * x_e
    v = u * v_u + mean * sine + epsilon * v_e
    turn, force = TWO_PI * epsilon, mean + epsilon * (a * (1.0 - omc) + b * siny)
    return ContactExit(
        x=x,
        v=v,
        x_u=sine,
        x_t=turn * (b * x_c - a * x_s),
        x_e=x_e,
        v_u=v_u,
        v_t=turn * (b * v_c - a * v_s),
        v_e=v_e,
        v_s=force - delta * v - 2.0 * kappa * x,
    )


@inline
def flight_after_contact(i, y, cycle):
    """Return the flight after contact i: number of the next contact, times of beginning and end, rise of Φ (signed)."""
    c = cycle.walls.size
    after = i + 1 if i < c - 1 else 0
    t1 = y[after] if i < c - 1 else y[0] + cycle.m
    gap = cycle.beta * (cycle.walls[after] - cycle.walls[i])
    return after, y[i] + y[c + i] / math.sqrt(2.0 * cycle.kappa), t1, gap


@kernel
def write_residuals(y, cycle, value, jacobian):
    """Write the residuals (2c,) of a motion's equations to `value`, and their Jacobian (2c, 2c + 1) to `jacobian`.

    y (2c + 1,): the times at which the c contacts begin, their durations σ in units of p = 1/√(2κ), and ε. The first c
    residuals are the depths at the ends of the contacts, divided by pσ; the others are the jumps of velocity there.

    Returns
    -------
    bool
        False if a flight does not have a positive duration.
    """
    c, delta, epsilon, kappa = cycle.walls.size, cycle.delta, y[2 * cycle.walls.size], cycle.kappa
    p = 1.0 / math.sqrt(2.0 * kappa)
    value[:] = 0.0
    jacobian[:] = 0.0
    for i in range(c):  # flight i leads from contact i to the next one
        after, t0, t1, gap = flight_after_contact(i, y, cycle)
        if not t1 > t0:
            return False
        wall, ends = cycle.walls[i], flight_end_velocities(t0, t1, gap, delta, epsilon)
        value[c + i] -= wall * ends.w0
        jacobian[c + i, i] -= wall * ends.w0_t0
        jacobian[c + i, c + i] -= wall * p * ends.w0_t0
        jacobian[c + i, after] -= wall * ends.w0_t1
        jacobian[c + i, 2 * c] -= wall * ends.w0_e
        wall, s = cycle.walls[after], p * y[c + after]
        met = contact_state_after(wall, y[after], wall * ends.w1, s, delta, epsilon, kappa)
        x_u = met.x_u / s
        value[after] = met.x / s
        jacobian[after, i] += x_u * wall * ends.w1_t0
        jacobian[after, c + i] += x_u * wall * p * ends.w1_t0
        jacobian[after, after] += x_u * wall * ends.w1_t1 + met.x_t / s
        jacobian[after, c + after] += p * (met.v - met.x / s) / s
        jacobian[after, 2 * c] += x_u * wall * ends.w1_e + met.x_e / s
        value[c + after] += met.v
        jacobian[c + after, i] += met.v_u * wall * ends.w1_t0
        jacobian[c + after, c + i] += met.v_u * wall * p * ends.w1_t0
        jacobian[c + after, after] += met.v_u * wall * ends.w1_t1 + met.v_t
        jacobian[c + after, c + after] += p * met.v_s
        jacobian[c + after, 2 * c] += met.v_u * wall * ends.w1_e + met.v_e
    return True


@kernel
def tangent_map_trace(y, cycle):
    """Return the trace of a motion's tangent map over its period.

    The map, in (Φ, Φ'), is the product of the exact tangent maps of flights and contacts.

    Returns
    -------
    float
        The trace, which is the sum of both Floquet multipliers.
    """
    c, delta, kappa = cycle.walls.size, cycle.delta, cycle.kappa
    p = 1.0 / math.sqrt(2.0 * kappa)
    j00, j01, j10, j11 = 1.0, 0.0, 0.0, 1.0
    for i in range(c):
        _after, t0, t1, _gap = flight_after_contact(i, y, cycle)
        sine, lost, _defect = free_contact_responses(p * y[c + i], delta, kappa)
        kept = 1.0 - lost - delta * sine
        j00, j01, j10, j11 = (
            (1.0 - lost) * j00 + sine * j10,
            (1.0 - lost) * j01 + sine * j11,
            kept * j10 - 2.0 * kappa * sine * j00,
            kept * j11 - 2.0 * kappa * sine * j01,
        )
        gone = -math.expm1(-delta * (t1 - t0))
        j00, j01 = j00 + gone / delta * j10, j01 + gone / delta * j11
        j10, j11 = (1.0 - gone) * j10, (1.0 - gone) * j11
    return j00 + j11


@kernel
def find_failing_piece(y, cycle):
    """Return the first flight or contact of a solution that does not end as its equations assume.

    Returns
    -------
    tuple
        The number of the flight or contact, whether it is a contact, and the wall and time at which it ends instead.
        The wall is 0 if the flight or contact cannot begin or has no end. The number is −1 if the motion is admissible.
    """
    c, delta, epsilon, beta, kappa = cycle.walls.size, cycle.delta, y[y.size - 1], cycle.beta, cycle.kappa
    p = 1.0 / math.sqrt(2.0 * kappa)
    if not (np.isfinite(y).all() and delta > 0.0 and epsilon >= 0.0 and y[c : 2 * c].min() > LEAST_CONTACT):
        return 0, True, 0, 0.0
    for i in range(c):
        after, t0, t1, gap = flight_after_contact(i, y, cycle)
        if not t1 > t0:
            return i, False, 0, t0
        ends = flight_end_velocities(t0, t1, gap, delta, epsilon)
        w0, wall, target = ends.w0, cycle.walls[i], cycle.walls[after]
        u, lasts = target * ends.w1, p * y[c + after]
        if not (wall * w0 < 0.0 < u):
            return i, False, 0, t0
        status, s, met, _w, _d, _f, _s, _c = first_impact(wall, fold_phase(t0), w0, delta, epsilon, beta, DRIFT)
        if status != OK:
            return i, False, 0, t0
        missed = met != target or abs(s - (t1 - t0)) > SAME_TIME
        if missed and not (u < GRAZING * speed_unit(delta, epsilon, beta) and s > t1 - t0 - SAME_TIME):
            return i, False, met, t0 + s
        status, s, _x, _v, _s, _l = find_contact_end(target, fold_phase(t1), 0.0, u, delta, epsilon, kappa, math.inf)
        if status != ENDS or abs(s - lasts) > SAME_TIME * p * math.pi + SAME_END:
            return after, True, target if status == ENDS else 0, y[after] + s
    return -1, False, 0, 0.0


@kernel
def is_admissible(y, cycle):
    """Return whether a solution is admissible: each flight and contact ends when and where its equations assume."""
    return find_failing_piece(y, cycle)[0] < 0


@kernel
def time_at_sigma_minus(y, cycle):
    """Return the time at which the flight of a P(1,1,0) meets Σ⁻; NaN if the flight does not meet Σ⁻."""
    _after, t0, t1, gap = flight_after_contact(0, y, cycle)
    w0 = flight_end_velocities(t0, t1, gap, cycle.delta, y[2]).w0
    if not w0 < 0.0:
        return math.nan
    status, s, met, _w, _d, _f, _s, _c = first_impact(
        cycle.walls[0], fold_phase(t0), w0, cycle.delta, y[2], cycle.beta, DRIFT
    )
    return t0 + s if status == OK and met < 0 else math.nan


@kernel
def departure_after_first_contact(y, cycle):
    """Return the phase and speed with which a motion leaves Σ⁺ after its first contact."""
    _after, t0, t1, gap = flight_after_contact(0, y, cycle)
    return fold_phase(t0), -flight_end_velocities(t0, t1, gap, cycle.delta, y[y.size - 1]).w0
