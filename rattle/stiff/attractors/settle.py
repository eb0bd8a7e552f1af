"""Follow samples of the stiff gear until each is quiet, captured, recurrent, or at its limit of returns (compiled).

The method is that of `rattle.impacting.attractors.settle`, but samples are followed one by one, not in SIMD lanes. A
sample whose contact with Σ⁺ never ends is quiet. Tangent vectors are in the coordinates (Φ, Φ') at fixed times.
"""

import math
from typing import Any, NamedTuple

from rattle.attractors.chaos import BATCHES
from rattle.attractors.samples import (
    ALIGNMENT,
    Outcome,
    bitmap_top_speed,
    check_sample_outcome,
    first_reference_state,
    mark_visited_cell,
    store_sample,
)
from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit
from rattle.numerics.compile import implement_for_type, inline, kernel
from rattle.orbits.return_map import point_between, point_of_cell, step
from rattle.stiff.map import flow
from rattle.stiff.map.return_map import StiffPoint


class StiffCells(NamedTuple):
    """Parameters of the cells (n,); cell_has_quiet_motion is 1 where permanent contact is possible, else 0."""

    delta: Any
    epsilon: Any
    beta: Any
    cell_has_quiet_motion: Any
    kappa: Any


@implement_for_type(point_of_cell, StiffCells)
def _point_of_cell(cell, cells):
    return StiffPoint(cells.delta[cell], cells.epsilon[cell], cells.beta[cell], cells.kappa[cell])


@implement_for_type(point_between, StiffPoint)
def _point_between(share, one, other):
    delta = one.delta + share * (other.delta - one.delta)
    return StiffPoint(delta, one.epsilon + share * (other.epsilon - one.epsilon), one.beta, one.kappa)


@inline
def stiff_outcome(code):
    """Return the outcome QUIET or FAILED of a sample that does not return to Σ⁺, from the status code of `step`."""
    return Outcome.QUIET if code == flow.QUIET else Outcome.FAILED


@kernel
def follow_until_outcome(which, cells, samples, balls):
    """Follow samples `which` until each has an outcome, or stays UNRESOLVED after all returns that its limit allows."""
    for j in range(which.size):
        k = which[j]
        point = point_of_cell(samples.cell[k], cells)
        tau, v, n, total = samples.tau[k], samples.v[k], 0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        reference = first_reference_state(tau, v)
        status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED and samples.impacts[k] + n < samples.limit[k]:
            code, tau, v, time, _below = step(tau, v, point)
            if code != OK:
                status = stiff_outcome(code)
                break
            n, total = n + 1, total + time
            status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        store_sample(tau, v, n, total, k, status, orbit, samples)


@kernel
def follow_probes(which, least, periods, cells, samples, balls, sums, footprints):
    """Follow samples `which` with a tangent vector, to find their Lyapunov exponents.

    Sample which[j] is followed for at least least[j] returns and periods[j] forcing periods, or to its limit of
    returns. sums (k, BATCHES, 3) must be 0 at the start. sums[j] becomes the sums of time, ln stretch and ln|det| over
    the returns of this sample after the first ALIGNMENT ones, in BATCHES successive batches. footprints[j] collects the
    boxes of the (τ, v) plane that the sample visits.
    """
    for j in range(which.size):
        k = which[j]
        point = point_of_cell(samples.cell[k], cells)
        tau, v, n, x, y, total = samples.tau[k], samples.v[k], 0, 1.0, 0.0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        most = float(samples.limit[k] - samples.impacts[k])
        reference = first_reference_state(tau, v)
        status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED:
            share = min((n - ALIGNMENT) / (least[j] - ALIGNMENT), total / periods[j])
            share = max(share, n / most)
            if share >= 1.0:
                break
            code, tau, v, time, _below, j00, j01, j10, j11 = flow.next_departure(
                tau, v, point.delta, point.epsilon, point.beta, point.kappa
            )
            if code != OK:
                status = stiff_outcome(code)
                break
            n, total = n + 1, total + time
            x, y = j00 * x + j01 * y, j10 * x + j11 * y
            size = math.hypot(x, y)
            x, y = x / size, y / size
            if n > ALIGNMENT:
                row = sums[j, min(int(max(share, 0.0) * BATCHES), BATCHES - 1)]
                row[0] += time
                row[1] += math.log(size)
                row[2] += math.log(abs(j00 * j11 - j01 * j10))
            mark_visited_cell(tau, v, bitmap_top_speed(point.epsilon, unit), footprints[j])
            status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        store_sample(tau, v, n, total, k, status, orbit, samples)
