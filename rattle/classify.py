"""Where one initial condition goes: quiet, periodic, chaotic or undecided (compiled).

A trajectory is watched for capture by the quiet motion and for recurrence (Brent's cycle search: a reference point
that moves up at powers of two). A recurrence is only a candidate: Newton's method must find a fixed point of Π^k with
both multipliers inside the unit circle, and the trajectory must be seen to approach it. What remains after the
transient is measured with a tangent vector, and still watched.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle._compile import kernel
from rattle.first_impact import OK
from rattle.flight import DRIFT, TWO_PI, folded
from rattle.impact_map import impact, impact_tangent
from rattle.lyapunov import BATCHES, is_chaotic
from rattle.quiet import contact_force

NONE, QUIET, PERIODIC, CHAOTIC, UNDECIDED = range(5)
GRID = 64  # boxes per side of the (τ, v) plane in which a chaotic trajectory leaves its footprint

RECURRENCE = 1e-6  # a return this close is worth a Newton iteration
APPROACH = 0.5  # the trajectory must come this much closer to the orbit that Newton found ...
ARRIVED = 1e-9  # ... or be here already
NEWTON_STEPS = 15
ALIGNMENT = 64  # impacts in which the tangent vector turns into the most expanding direction
LEAST_MEASURED = 2000  # impacts: fewer leave too thin a footprint, and too short batches


class Point(NamedTuple):
    """A parameter point, with the largest invariant v³/g that is certain to become quiet."""

    delta: float
    epsilon: float
    beta: float
    capture: float


class Budget(NamedTuple):
    """Forcing periods of transient and of first measurement, the most impacts for each, and how often an unclear
    one is repeated longer.
    """

    transient: float = 1000.0
    measured: float = 1000.0
    impacts: int = 100_000
    extensions: int = 3


class Outcome(NamedTuple):
    """What became of one initial condition; m, n_plus, n_minus, log-multipliers for periodic, (tau, v) a point of
    the attractor.
    """

    kind: int
    m: int
    n_plus: int
    n_minus: int
    tau: float
    v: float
    log_first: float
    log_second: float
    impacts: int


@kernel
def wrapped(difference):
    """A phase difference in [−1/2, 1/2]."""
    return difference - np.rint(difference)


@kernel
def is_captured(tau, v, point):
    """True if the bounce is certain to become quiet."""
    return v * v * v <= point.capture * contact_force(tau, point.delta, point.epsilon)


@kernel
def power_map(tau, v, k, point):
    """Π^k with its tangent: (status, τ, v, time, Σ⁻ impacts, j00, j01, j10, j11, ln|det|)."""
    a00, a01, a10, a11, log_det, time, n_minus = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0
    for _ in range(k):
        status, tau, v, s, below, j00, j01, j10, j11, ln = impact_tangent(
            tau, v, point.delta, point.epsilon, point.beta, DRIFT, False
        )
        if status != OK:
            return status, tau, v, time, n_minus, a00, a01, a10, a11, log_det
        a00, a10 = j00 * a00 + j01 * a10, j10 * a00 + j11 * a10
        a01, a11 = j00 * a01 + j01 * a11, j10 * a01 + j11 * a11
        log_det += ln
        time += s
        n_minus += below
    return OK, tau, v, time, n_minus, a00, a01, a10, a11, log_det


@kernel
def newton(tau, v, k, point):
    """Fixed point of Π^k near (τ, v): (found, τ, v)."""
    size = 1.0
    for _ in range(NEWTON_STEPS):
        status, t1, v1, _time, _below, a00, a01, a10, a11, _ln = power_map(tau, v, k, point)
        if status != OK:
            return False, tau, v
        r0, r1 = wrapped(t1 - tau), v1 - v
        determinant = (a00 - 1.0) * (a11 - 1.0) - a01 * a10
        if determinant == 0.0:
            return False, tau, v
        d0 = -((a11 - 1.0) * r0 - a01 * r1) / determinant
        d1 = -((a00 - 1.0) * r1 - a10 * r0) / determinant
        last, size = size, max(abs(d0), abs(d1))
        if not size < 0.1:
            return False, tau, v
        tau = folded(tau + d0)
        v += d1
        if not v > 0.0:
            return False, tau, v
        if size < 1e-13 or (size < 1e-9 and size >= 0.5 * last):  # as exact as rounding lets it be
            return True, tau, v
    return False, tau, v


@kernel
def log_multipliers(trace, log_det):
    """ln|λ| of both multipliers, the larger first."""
    determinant = math.exp(log_det)
    inside = 0.25 * trace * trace - determinant
    if inside <= 0.0:
        return 0.5 * log_det, 0.5 * log_det
    first = math.log(abs(0.5 * trace) + math.sqrt(inside))
    return first, log_det - first


@kernel
def shortest_return(tau, v, k, point):
    """The smallest divisor of k after which the orbit closes."""
    for d in range(1, k // 2 + 1):
        if k % d == 0:
            status, t1, v1, _time, _below, _a, _b, _c, _d, _ln = power_map(tau, v, d, point)
            if status == OK and abs(wrapped(t1 - tau)) < 1e-8 and abs(v1 - v) < 1e-8:
                return d
    return k


@kernel
def approaches(tau, v, star_tau, star_v, k, most, point):
    """True if the trajectory is seen to approach the orbit; also the impacts spent."""
    start = math.hypot(wrapped(tau - star_tau), v - star_v)
    if start < ARRIVED:
        return True, 0
    for spent in range(k, most + 1, k):
        for _ in range(k):
            status, tau, v, _time, _below = impact(tau, v, point.delta, point.epsilon, point.beta, DRIFT)
            if status != OK:
                return False, spent
        distance = math.hypot(wrapped(tau - star_tau), v - star_v)
        if distance < max(APPROACH * start, ARRIVED):
            return True, spent
        if distance > 4.0 * start:
            return False, spent
    return False, most


@kernel
def fastest_point(tau, v, k, point):
    """The orbit's impact of largest speed, so that the same orbit is always represented by the same point."""
    best_tau, best_v = tau, v
    for _ in range(k):
        _status, tau, v, _time, _below = impact(tau, v, point.delta, point.epsilon, point.beta, DRIFT)
        if v > best_v:
            best_tau, best_v = tau, v
    return best_tau, best_v


@kernel
def periodic_outcome(tau, v, k, impacts, most, point):
    """The outcome if (τ, v) recurs after k impacts because a stable orbit attracts it, else kind NONE."""
    failed = Outcome(NONE, 0, 0, 0, tau, v, math.nan, math.nan, impacts)
    found, star_tau, star_v = newton(tau, v, k, point)
    if not found or math.hypot(wrapped(tau - star_tau), v - star_v) > 0.05:
        return failed
    k = shortest_return(star_tau, star_v, k, point)
    _status, _t, _v, time, n_minus, a00, _b, _c, a11, log_det = power_map(star_tau, star_v, k, point)
    first, second = log_multipliers(a00 + a11, log_det)
    if not first < 0.0:
        return failed
    near, spent = approaches(tau, v, star_tau, star_v, k, most, point)
    if not near:
        return failed
    star_tau, star_v = fastest_point(star_tau, star_v, k, point)
    m = int(np.rint(time))
    return Outcome(PERIODIC, m, k, n_minus, star_tau, star_v, first / m, second / m, impacts + spent)


@kernel
def mark(tau, v, epsilon, footprint):
    """Enter (τ, v) into the footprint, whose rows are phases and whose bits are speeds up to the largest there can
    be.
    """
    row = min(int(tau * GRID), GRID - 1)
    column = min(int(v / (DRIFT + TWO_PI * epsilon) * GRID), GRID - 1)
    footprint[row] |= np.uint64(1) << np.uint64(column)


@kernel
def follow(tau, v, point, periods, most, measuring, sums, footprint):
    """Follow a trajectory until it is captured, periodic, or its periods or impacts are spent (kind NONE): (outcome,
    τ, v).

    While measuring, sums[b] gathers time, ln stretch and ln|det| of batch b, and the footprint its visited boxes.
    """
    time, n = 0.0, 0
    least = LEAST_MEASURED if measuring else 0
    anchor, anchor_tau, anchor_v, limit, pause = 0, -1.0, -1.0, 1, 0
    x0, x1 = 1.0, 0.0
    while (time < periods or n < least) and n < most:
        if is_captured(tau, v, point):
            return Outcome(QUIET, 0, 0, 0, tau, v, math.nan, math.nan, n), tau, v
        if n >= pause and abs(v - anchor_v) < RECURRENCE and abs(wrapped(tau - anchor_tau)) < RECURRENCE:
            outcome = periodic_outcome(tau, v, n - anchor, n, most - n, point)
            if outcome.kind == PERIODIC:
                return outcome, tau, v
            pause = n + 2 * (n - anchor) + 16
        if n == limit:
            anchor, anchor_tau, anchor_v, limit = n, tau, v, 2 * n
        if measuring:
            status, t1, v1, s, _below, j00, j01, j10, j11, ln = impact_tangent(
                tau, v, point.delta, point.epsilon, point.beta, DRIFT, True
            )
            x0, x1 = j00 * x0 + j01 * x1, j10 * x0 + j11 * x1
            size = math.hypot(x0, x1)
            x0, x1 = x0 / size, x1 / size
            if n >= ALIGNMENT:
                batch = min(int(min(time / periods, n / least) * BATCHES), BATCHES - 1)
                sums[batch, 0] += s
                sums[batch, 1] += math.log(size)
                sums[batch, 2] += ln
            mark(t1, v1, point.epsilon, footprint)
        else:
            status, t1, v1, s, _below = impact(tau, v, point.delta, point.epsilon, point.beta, DRIFT)
        if status != OK:
            return Outcome(UNDECIDED, 0, 0, 0, tau, v, math.nan, math.nan, n), tau, v
        tau, v = t1, v1
        time += s
        n += 1
    return Outcome(NONE, 0, 0, 0, tau, v, math.nan, math.nan, n), tau, v


@kernel
def with_kind(outcome, kind, impacts):
    """The same outcome under another kind and impact count."""
    return Outcome(
        kind,
        outcome.m,
        outcome.n_plus,
        outcome.n_minus,
        outcome.tau,
        outcome.v,
        outcome.log_first,
        outcome.log_second,
        impacts,
    )


@kernel
def classify(tau, v, point, budget, sums, footprint):
    """The fate of one initial condition. sums and footprint are filled for the chaotic and the undecided."""
    outcome, tau, v = follow(tau, v, point, budget.transient, budget.impacts, False, sums, footprint)
    impacts, periods = outcome.impacts, budget.measured
    for _ in range(budget.extensions + 1):
        if outcome.kind != NONE:
            return with_kind(outcome, outcome.kind, impacts)
        sums[:] = 0.0
        footprint[:] = 0
        outcome, tau, v = follow(tau, v, point, periods, budget.impacts, True, sums, footprint)
        impacts += outcome.impacts
        if outcome.kind == NONE and is_chaotic(sums):
            return with_kind(outcome, CHAOTIC, impacts)
        periods *= 2.0
    return with_kind(outcome, UNDECIDED if outcome.kind == NONE else outcome.kind, impacts)


@kernel
def classify_many(tau, v, point, budget):
    """Outcomes of flat arrays of initial conditions, with their batch sums (n, BATCHES, 3) and footprints (n, GRID)."""
    sums = np.zeros((tau.size, BATCHES, 3))
    footprints = np.zeros((tau.size, GRID), np.uint64)
    outcomes = [classify(tau[i], v[i], point, budget, sums[i], footprints[i]) for i in range(tau.size)]
    return outcomes, sums, footprints
