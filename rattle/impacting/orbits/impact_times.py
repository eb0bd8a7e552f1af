"""A motion of period one as the times of its impacts, at one parameter point (compiled).

The equations are those of `rattle.impacting.orbits.equations` for n times. Equation i, R_i = 0, says that impact i is
elastic; it contains three neighbouring times. All equations but the first are solved for all times but the first. The
residual R_0 of the first equation is then a function of the first time, along a curve of motions that close except for
one impact.
"""

import math

import numpy as np

from rattle.flight.first_impact import OK, first_impact
from rattle.flight.forcing import (
    DRIFT,
    add_acceleration,
    add_slope,
    drop_below_tangent_line,
    sine_change_and_new_cosine,
    sine_cosine_at,
    slope_loss_from_sine_change,
    versines,
)
from rattle.flight.impact_law import arrival_term_of_mismatch
from rattle.flight.law import LONGEST_DECAY, decay_remainder64, fold_phase
from rattle.numerics.compile import inline, kernel

SAME_TIME = 1e-6  # largest difference of two times of flight, in forcing periods, that counts as the same flight
SOLVED = 1e-11  # after a Newton step shorter than this, in forcing periods, the solution is exact to rounding
# a Newton step shorter than this, in forcing periods, is also the last one if it is at least half as long as the step
# before it: rounding then prevents a better solution
NEARLY = 1e-7
NEWTON_STEPS = 12
SHARE_LEFT = 0.4  # least share of a flight's duration that remains after one step of Newton's method

MOST_IMPACTS = 128  # largest number of impacts of a motion
MOST_ORBITS = 160  # largest number of stable orbits of a cell
SECTIONS = 32  # number of equal sections of half a period; the rate of bounces is taken as constant in each section

#: Fields of a motion: `times` of its impacts in order, with `sines` and `cosines` of 2πt. For the equation of each
#: impact: its `residual`, and the derivatives `before`, `at` and `after` of the residual with respect to the times of
#: the impact before, of the impact itself and of the impact after it. After elimination: the `change` of the times that
#: solves all equations but the first at a fixed first time, and the `response` of the times to a unit change of the
#: first time.
_OF_MOTION = ("times", "sines", "cosines", "residual", "before", "at", "after", "change", "response")
#: Fields of a walk along the curve of motions that satisfy all equations but the first: the times at its start, the
#: times and the direction at its present point, and those after a step.
_OF_WALK = ("start", "point", "direction", "next_point", "next_direction")
#: Scratch memory of a search for orbits. walls: +1 or −1 for each impact. shares: see
#: `bounces.fill_bounce_distribution`. found: a row for each of the n_found stable orbits of a cell: its impacts on Σ⁺
#: and on Σ⁻ in a period, phase and speed of its fastest impact on Σ⁺, and the trace of its tangent map.
WORK = np.dtype(
    [("walls", np.int64, (MOST_IMPACTS,))]
    + [(name, np.float64, (MOST_IMPACTS,)) for name in (*_OF_MOTION, *_OF_WALK)]
    + [("shares", np.float64, (SECTIONS + 1,)), ("n_found", np.int64), ("found", np.float64, (MOST_ORBITS, 5))]
)


def allocate_workspace() -> np.void:
    """Return scratch memory for a search for orbits, one record of WORK."""
    return np.zeros(1, WORK)[0]


@inline
def flight_velocities(s, sin0, cos0, gap, delta, epsilon):
    """Return the velocities w₀ and w₁ at both ends of a flight of duration s over the distance `gap`, and 1 − e^(−δs).

    sin0, cos0: sine and cosine of 2πt₀ at the departure t₀. w₀ solves the linear equation F(s) = gap, where F is the
    displacement of `rattle.flight.law`. Short flights lose no digits.

    Returns
    -------
    tuple of float
        w₀, w₁ and 1 − e^(−δs).
    """
    step = versines(s)
    x = delta * s
    k = x * decay_remainder64(x) if x <= LONGEST_DECAY else 1.0 + math.expm1(-x) / x
    rest = add_slope(DRIFT, sin0, cos0, epsilon)
    w0 = (gap + drop_below_tangent_line(step, sin0, cos0, epsilon) - rest * s * k) / (s * (1.0 - k))
    lost = x * (1.0 - k)
    w1 = w0 + (rest - w0) * lost - slope_loss_from_sine_change(sine_change_and_new_cosine(step, sin0, cos0)[0], epsilon)
    return w0, w1, lost


@inline
def following_impact_and_period(i, n):
    """Return the number of the impact after impact i of n, and 1.0 if it belongs to the next period, else 0.0."""
    return (i + 1, 0.0) if i < n - 1 else (0, 1.0)


@kernel
def write_equations(work, n, delta, epsilon, beta):
    """Write the residuals of the n impact equations and their derivatives to `work`.

    Returns
    -------
    bool
        True if each flight leaves its wall into the gap and reaches the next wall from the gap.
    """
    walls, times, at = work.walls, work.times, work.at
    for i in range(n):
        work.sines[i], work.cosines[i] = sine_cosine_at(times[i])
        work.residual[i], at[i] = 0.0, 0.0
    real = True
    for i in range(n):
        j, later = following_impact_and_period(i, n)
        s = times[j] + later - times[i]
        gap = beta * (walls[j] - walls[i])
        w0, w1, lost = flight_velocities(s, work.sines[i], work.cosines[i], gap, delta, epsilon)
        real = real and w0 * walls[i] < 0.0 and w1 * walls[j] > 0.0
        pull, decay = delta / lost, 1.0 - lost
        sin0, cos0, sin1, cos1 = work.sines[i], work.cosines[i], work.sines[j], work.cosines[j]
        c = add_slope(DRIFT, sin0, cos0, epsilon) - w0
        work.residual[i] += w0
        work.residual[j] += arrival_term_of_mismatch(w1)
        at[i] += add_acceleration(w0 * pull + delta * c, sin0, cos0, epsilon)
        at[j] += arrival_term_of_mismatch(add_acceleration((delta * c - w1 * pull) * decay, sin1, cos1, epsilon))
        work.after[i], work.before[j] = -pull * w1, arrival_term_of_mismatch(decay * pull * w0)
    return real


@kernel
def eliminate_times(work, n):
    """Solve all linearised impact equations except the first, for the changes of all times except the first; n ≥ 2.

    `work.change` becomes the solution for a fixed first time, and `work.response` the derivative of the solution with
    respect to the first time. The equations are those that `write_equations` wrote to `work`.

    Returns
    -------
    tuple of float
        (R_0, slope, p). R_0: the residual of the first equation after the changes `work.change`. slope: the
        derivative of R_0 with respect to the first time, along `work.response`. p = (1 − λ₁)(1 − λ₂), where λ₁ and λ₂
        are the multipliers of the orbit whose times are in `work`.
    """
    before, at, after, change, response = work.before, work.at, work.after, work.change, work.response
    for i in range(1, n):
        change[i], response[i] = -work.residual[i], 0.0
    response[1] -= before[1]
    response[n - 1] -= after[n - 1]
    product = 1.0 / after[0]
    for i in range(1, n):
        if i > 1:
            share = before[i] / at[i - 1]
            at[i] -= share * after[i - 1]
            change[i] -= share * change[i - 1]
            response[i] -= share * response[i - 1]
        product *= -at[i] / after[i]
    change[n - 1] /= at[n - 1]
    response[n - 1] /= at[n - 1]
    for i in range(n - 2, 0, -1):
        change[i] = (change[i] - after[i] * change[i + 1]) / at[i]
        response[i] = (response[i] - after[i] * response[i + 1]) / at[i]
    change[0], response[0] = 0.0, 1.0
    value = work.residual[0] + after[0] * change[1] + before[0] * change[n - 1]
    slope = at[0] + after[0] * response[1] + before[0] * response[n - 1]
    return value, slope, slope * product


@kernel
def move_impact_times(work, n, first):
    """Move the times in `work` by `work.change` + first · `work.response`, where first is the change of the first time.

    All changes are shortened by a common factor if otherwise the duration of a flight would almost vanish.

    Returns
    -------
    float
        The largest change of a time, in forcing periods, before it is shortened.
    """
    size, share = 0.0, 1.0
    for i in range(n):
        work.change[i] += first * work.response[i]
        size = max(size, abs(work.change[i]))
    for i in range(n):
        j, later = following_impact_and_period(i, n)
        most = (1.0 - SHARE_LEFT) * (work.times[j] + later - work.times[i])
        shorter = work.change[i] - work.change[j]
        if shorter > most:
            share = min(share, most / shorter)
    for i in range(n):
        work.times[i] += share * work.change[i]
    return size


@kernel
def solve_for_impact_times(work, n, farthest, delta, epsilon, beta):
    """Solve all n impact equations by Newton's method, starting from the times in `work`.

    The method fails if a step is longer than `farthest`, in forcing periods, or if the motion would come from behind a
    wall.

    Returns
    -------
    tuple
        (found, p). p = (1 − λ₁)(1 − λ₂) for the multipliers λ₁ and λ₂ of the solution; meaningless if `found` is False.
    """
    size = math.inf
    for _ in range(NEWTON_STEPS):
        real = write_equations(work, n, delta, epsilon, beta)
        value, slope, at_one = eliminate_times(work, n)
        last, size = size, move_impact_times(work, n, -value / slope)
        if not size < farthest:
            break
        if size < SOLVED or (size < NEARLY and size >= 0.5 * last):
            return real, at_one
    return False, math.nan


@kernel
def find_fastest_impact(work, n, delta, epsilon, beta):
    """Find the fastest impact on Σ⁺ of the motion in `work`, unless the motion is virtual.

    A motion is admissible if each flight leaves its wall into the gap and ends at its first impact.

    Returns
    -------
    tuple
        (admissible, τ, v): phase and speed of the fastest impact, of no use if the motion is not admissible.
    """
    tau, v = 0.0, 0.0
    for i in range(n):
        j, later = following_impact_and_period(i, n)
        wall, t = work.walls[i], fold_phase(work.times[i])
        s, gap = work.times[j] + later - work.times[i], beta * (work.walls[j] - wall)
        sin0, cos0 = sine_cosine_at(t)
        w0, _w1, _lost = flight_velocities(s, sin0, cos0, gap, delta, epsilon)
        if not wall * w0 < 0.0:
            return False, tau, v
        status, time, met, _w, _d, _f, _s1, _c1 = first_impact(wall, t, w0, delta, epsilon, beta, DRIFT)
        if status != OK or met != work.walls[j] or abs(time - s) > SAME_TIME:
            return False, tau, v
        if wall > 0 and -w0 > v:
            tau, v = t, -w0
    return True, tau, v
