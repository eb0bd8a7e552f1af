"""Guess the end of a flight in single precision.

Double precision improves the guess, and `proof` proves that it is the first impact. Every function here is
straight-line code on float32 numbers, run for one flight or in a loop over a block of lanes. docs/kernel.md derives
each inequality. Two margins bound float32 rounding:

- A value of a flight's height F has an error below ERROR times `sum_of_height_term_sizes`, the sum of the sizes of its
  terms. (ERROR is 100 units of float32 rounding. The evaluation takes fewer than 30 operations on inputs rounded once,
  and its polynomials have relative errors below 3e-7.)
- A value of the flight's speed F' has an error below ERROR times `sum_of_slope_term_sizes`.
"""

from typing import NamedTuple

from numpy import float32 as f32
from numpy import sqrt

from rattle.flight.forcing import (
    DRIFT,
    W1,
    Q,
    add_mean_acceleration32,
    add_slope32,
    coarse_forcing_remainder_bound32,
    forcing_fourth_derivative32,
    forcing_remainder_bound32,
    forcing_slope_range32,
    forcing_third_derivative32,
    largest_sixth_coefficient32,
    mean_cosine32,
    minus_forcing_fifth_derivative32,
)
from rattle.flight.law import LONGEST_DECAY, Flight, evaluate32
from rattle.numerics.compile import inline

ERROR = f32(6e-6)
EQUAL_WITHIN = f32(1e-5)  # difference of flight times or phases below which they count as equal
LONGEST_TAYLOR_STEP = f32(0.1)  # longest step to the minimum of F; a longer step is unreliable where F'' is small
# The error bound is computed for a step of at least this length, because the sixth power of a much shorter step would
# be a denormal number, which processors handle slowly.
SHORTEST_TAYLOR_STEP = f32(3e-6)
LONGEST_DECAY32 = f32(LONGEST_DECAY)  # largest δs for which the polynomials hold
UNBOUNDED = f32(-1e30)  # a lower bound so low that it proves nothing
SCAN_STEP = f32(1 / 8)  # time between two points of a scan, in forcing periods
SCAN_STEPS = 16
PER_DRIFT = f32(1.0 / DRIFT)


class FlightMinimum(NamedTuple):
    """A point of a flight near a minimum of its height F, with bounds of F and |F'| there."""

    bound: f32  # lower bound of F at the point
    tilt: f32  # upper bound of |F'| at the point
    time: f32  # time of the point since the departure


class ScanState(NamedTuple):
    """The state of a scan, which evaluates one flight at successive times until its end is bracketed."""

    f: f32  # F at the last time of the scan
    g: f32  # F' at the last time of the scan
    turned: bool  # the flight has passed a minimum of F
    turn: f32  # time of the last minimum
    ended: bool  # the scan has found the end of the flight
    falls: bool  # the flight ends on Σ⁻
    # time of the flight's end; −1 if the step in which the flight ends also holds a minimum of F: the end is then
    # computed from this minimum
    end: f32


@inline
def convert_flight_to_single_precision(flight):
    """Return a flight in single precision; its field `a` is computed from the rounded numbers."""
    w, sin0, cos0, epsilon = f32(flight.w), f32(flight.sin0), f32(flight.cos0), f32(flight.epsilon)
    return Flight(w, add_slope32(Q, sin0, cos0, epsilon) - w, sin0, cos0, f32(flight.delta), epsilon)


@inline
def guess_time_of_turn_or_arrival(wall, gap, inverse_delta, flight):
    """Return a guess, from the mean force, of the time until a flight from Σ⁺ turns or a flight from Σ⁻ meets Σ⁺."""
    w, _a, sin0, cos0, delta, epsilon = flight
    speed = abs(w)
    u = speed * PER_DRIFT
    # y/2π: the time after which a flight from Σ⁺ would turn if there were no forcing
    y = W1 * u * (f32(1.0) - u * (f32(0.5) - f32(0.25) * u)) * inverse_delta
    y = min(y, W1)
    cosine = mean_cosine32(y, sin0, cos0)
    force = add_mean_acceleration32(delta * (Q + f32(0.5) * speed), cosine, epsilon)
    rise = delta * (Q - f32(1.2))
    mean_speed = f32(0.5) * (speed + sqrt(speed * speed + f32(2.0) * gap * rise))
    # the guess is way/pace: for a flight from Σ⁺ the time speed/force until it turns, for a flight from Σ⁻ the time
    # gap/mean speed until it arrives
    way, pace = speed, max(force, f32(0.35) * Q * delta)
    way = way if wall > f32(0.0) else gap
    pace = pace if wall > f32(0.0) else mean_speed
    return min(way / pace, f32(0.95 * LONGEST_DECAY) * inverse_delta)


@inline
def improve_guess_by_newton_step(s, wall, gap, flight):
    """Return the time s, improved by one Newton step to the turning point (from Σ⁺) or to the arrival (from Σ⁻).

    The step at most halves or doubles the time.

    Returns
    -------
    float
        Time since the departure, in forcing periods.
    """
    f0, f1, f2, _l, _s, _c = evaluate32(s, flight)
    turning, arriving = f1 / max(f2, f32(0.2) * Q * flight.delta), (f0 - gap) / max(f1, f32(0.1))
    step = turning if wall > f32(0.0) else arriving
    return min(max(s - step, f32(0.5) * s), f32(2.0) * s)


@inline
def height_at_next_wall(wall, falls, gap):
    """Return the height F at which a flight meets the next wall: −gap if it falls from Σ⁺ to Σ⁻, 0 or gap on Σ⁺.

    F is measured from the departure, so F is 0 on Σ⁺ after a departure from Σ⁺, and `gap` after one from Σ⁻.

    Returns
    -------
    float
        The height, in the unit of Φ.
    """
    level = f32(0.0) if wall > f32(0.0) else gap
    return -gap if falls else level


@inline
def taylor_coefficients(s, flight):
    """Return the Taylor coefficients F, F', F''/2, F'''/6, F⁗/24 and F⁽⁵⁾/120 of a flight's height at time s."""
    f0, f1, f2, lost, sin1, cos1 = evaluate32(s, flight)
    delta, epsilon = flight.delta, flight.epsilon
    b = delta * flight.a * (f32(1.0) - lost)  # the decaying part of F''
    c3 = (forcing_third_derivative32(sin1, cos1, epsilon) - delta * b) * f32(1 / 6)
    c4 = (forcing_fourth_derivative32(sin1, cos1, epsilon) + delta * delta * b) * f32(1 / 24)
    c5 = (minus_forcing_fifth_derivative32(sin1, cos1, epsilon) + delta * delta * delta * b) * f32(-1 / 120)
    return f0, f1, f32(0.5) * f2, c3, c4, c5


@inline
def sum_of_height_term_sizes(s, flight):
    """Return the sum of the sizes of the terms of F at s; the rounding error of F is below ERROR times this sum."""
    w, a, _sin0, _cos0, delta, epsilon = flight
    forced = forcing_remainder_bound32(s)
    return s * (abs(w) + abs(a) * min(f32(0.5) * delta * s, f32(1.0))) + epsilon * forced


@inline
def sum_of_slope_term_sizes(flight):
    """Return the sum of the sizes of the terms of F'; the rounding error of F' is below ERROR times this sum."""
    return abs(flight.w) + abs(flight.a) + forcing_slope_range32(flight.epsilon)


@inline
def taylor_slope(u, c1, c2, c3, c4, c5):
    """Return the derivative at u of the Taylor polynomial with these coefficients."""
    return c1 + u * (f32(2.0) * c2 + u * (f32(3.0) * c3 + u * (f32(4.0) * c4 + u * (f32(5.0) * c5))))


@inline
def taylor_value(u, c0, c1, c2, c3, c4, c5):
    """Return the value at u of the Taylor polynomial with these coefficients."""
    u2 = u * u
    return (c0 + u * c1) + u2 * ((c2 + u * c3) + u2 * (c4 + u * c5))


@inline
def estimate_minimum(s, series, flight):
    """Return the estimated minimum near s of a flight's height F, from its Taylor series at s, with bounds there.

    The bounds are a lower bound of F and an upper bound of |F'|. They allow for the remainder of the series and for
    rounding, and hold for δs < 2. The lower bound of F is UNBOUNDED, which proves nothing, where the series is
    unreliable.

    Returns
    -------
    tuple[float, FlightMinimum]
        The estimated F at the minimum, and the point with its bounds.
    """
    w, a, _sin0, _cos0, delta, epsilon = flight
    c0, c1, c2, c3, c4, c5 = series
    i2 = f32(0.5) / c2
    u = -c1 * i2
    k3 = f32(3.0) * c3 * i2
    u *= f32(1.0) - u * (k3 - u * (f32(2.0) * k3 * k3 - f32(4.0) * c4 * i2))
    u = min(max(u, -LONGEST_TAYLOR_STEP), LONGEST_TAYLOR_STEP)
    lowest = taylor_value(u, c0, c1, c2, c3, c4, c5)
    reach = max(abs(u), SHORTEST_TAYLOR_STEP)
    r2 = reach * reach
    # an upper bound of |F⁽⁶⁾|/720 from s to the minimum at s + u, where e^(−δs) differs by less than a factor of 2
    m6 = largest_sixth_coefficient32(epsilon) + f32(1 / 360) * (delta * delta) * (delta * delta) * (delta * abs(a))
    # the remainder of the Taylor series is at most m6 reach⁶ = r2 * left_out in F, and 6 * reach * left_out in F'
    left_out = m6 * r2 * r2
    tilt = (
        abs(taylor_slope(u, c1, c2, c3, c4, c5)) + ERROR * sum_of_slope_term_sizes(flight) + f32(6.0) * reach * left_out
    )
    end = s + reach
    rounding = end * (abs(w) + abs(a) * (f32(0.5) * delta * end)) + coarse_forcing_remainder_bound32(end, epsilon)
    good = (delta * reach < f32(0.3)) & (reach < s)
    bound = lowest - ERROR * rounding - left_out * r2 if good else UNBOUNDED
    return lowest, FlightMinimum(bound, tilt, s + u)


@inline
def time_step_to_level(rising, level, series):
    """Return the step to F = level: the root of a parabola (three terms), improved by a Newton step with all terms."""
    f0, c1, c2, c3, c4, c5 = series
    c0 = f0 - level
    root = sqrt(abs(c1 * c1 - f32(4.0) * c0 * c2))
    signed = root if rising else -root
    # if c1 and the signed square root have the same sign (`direct`), their sum does not lose digits by cancellation;
    # otherwise their difference does not
    direct = (c1 > f32(0.0)) == rising
    numerator = f32(-2.0) * c0 if direct else signed - c1
    denominator = c1 + signed if direct else f32(2.0) * c2
    u = numerator / denominator
    return u - taylor_value(u, c0, c1, c2, c3, c4, c5) / taylor_slope(u, c1, c2, c3, c4, c5)


@inline
def refine_time_at_level(s, level, flight):
    """Return the time after a step of fourth order from s to F = level, the step, and an estimate of F' after it."""
    c0, c1, c2, c3, c4, _c5 = taylor_coefficients(s, flight)
    inverse = f32(1.0) / c1
    u, p, q, r = (level - c0) * inverse, c2 * inverse, c3 * inverse, c4 * inverse
    u *= f32(1.0) - u * (p - u * ((f32(2.0) * p * p - q) - u * (f32(5.0) * p * (p * p - q) + r)))
    return s + u, u, c1 + u * (f32(2.0) * c2 + f32(3.0) * u * c3)


@inline
def advance_scan(s0, s, wall, gap, scan, flight):
    """Advance the scan from time s0 to s. Interpolate linearly to find a minimum or the end of the flight in between.

    Returns
    -------
    ScanState
        The state of the scan at s.
    """
    f0, g0, turned, turn, ended, falls, end = scan
    f, g, _f2, _k, _s, _c = evaluate32(s, flight)
    turns = (g0 < f32(0.0)) & (g > f32(0.0)) & (not ended)
    between = s0 + (s - s0) * g0 / (g0 - g)
    turn = between if turns else turn
    from_top = wall > f32(0.0)
    top = f32(0.0) if from_top else gap
    bottom = top - gap
    hits_bottom = f < bottom
    hits_top = (turned | turns) & (f > top)
    level = bottom if hits_bottom else top
    place = s0 + (s - s0) * (level - f0) / (f - f0)
    place = f32(-1.0) if turns else place
    hit = (hits_bottom | hits_top) & (not ended)
    end = place if hit else end
    return ScanState(f, g, turned | turns, turn, ended | hit, falls | (hit & hits_bottom), end)
