"""Follow samples of the inelastic gear until each is quiet, captured, recurs, or has made its impacts (compiled).

Sample by sample, as in `rattle.stiff.attractors.settle`. What follows a release does not depend on what went before:
the first impact on Σ⁺ after a contact phase is one of a few states, to the bit. Where one of these comes back, the
motion is periodic; the cell then knows them (`ContactStates`), and every sample that comes to one has its answer.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.chaos import BATCHES
from rattle.attractors.recurrence import known, remember
from rattle.attractors.samples import ALIGNMENT, Outcome, begun, finish, looked, top_speed
from rattle.attractors.samples import mark as visit
from rattle.flight.contact_phase import IN_CONTACT
from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit
from rattle.inelastic.map.cells import point_at
from rattle.inelastic.map.impact_map import step, step_tangent
from rattle.inelastic.map.runs import merged_runs
from rattle.numerics.compile import inline, kernel

CONTACT = -1  # pause of a sample that recurs after contact


class ContactStates(NamedTuple):
    """States (n_cells, room) that follow contact phases of known orbits, n (n_cells,) used, and these orbits."""

    n: Any
    tau: Any
    v: Any
    orbit: Any


class Mark(NamedTuple):
    """A state after a contact phase that a sample may come back to (Brent's cycle search).

    n: the number of its return. contacts: how many contact phases went before. following: at which of them it is
    replaced.
    """

    tau: float
    v: float
    n: int
    contacts: int
    following: int


@inline
def after_contact(tau, v, n, k, mark, samples, states):
    """Return the outcome of sample k, whose n-th return followed a contact phase: (status, orbit, mark)."""
    cell = samples.cell[k]
    for i in range(states.n[cell]):
        if tau == states.tau[cell, i] and v == states.v[cell, i]:
            return Outcome.PERIODIC, states.orbit[cell, i], mark
    if mark.contacts > 0 and tau == mark.tau and v == mark.v:
        samples.gap[k], samples.pause[k] = n - mark.n, CONTACT
        return Outcome.RECURRENT, -1, mark
    contacts = mark.contacts + 1
    if contacts >= mark.following:
        return Outcome.UNRESOLVED, -1, Mark(tau, v, n, contacts, 2 * mark.following)
    return Outcome.UNRESOLVED, -1, Mark(mark.tau, mark.v, mark.n, contacts, mark.following)


@inline
def ending_of(code):
    """Return the outcome of a sample whose return does not come back."""
    return Outcome.QUIET if code == IN_CONTACT else Outcome.FAILED


@kernel
def settle(which, cells, samples, balls, states):
    """Follow the samples `which` until they end; a sample that makes all its returns is UNRESOLVED."""
    for j in range(which.size):
        k = which[j]
        point = point_at(samples.cell[k], cells)
        tau, v, n, total = samples.tau[k], samples.v[k], 0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        reference, mark = begun(tau, v), Mark(tau, v, 0, 0, 1)
        status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED and samples.impacts[k] + n < samples.limit[k]:
            code, tau, v, time, _below, on_plus, on_minus = step(tau, v, point)
            if code != OK:
                status = ending_of(code)
                break
            n, total = n + 1, total + time
            if on_plus + on_minus > 0:
                status, orbit, mark = after_contact(tau, v, n, k, mark, samples, states)
            if status == Outcome.UNRESOLVED:
                status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        finish(tau, v, n, total, k, status, orbit, samples)


@kernel
def measure(which, least, periods, cells, samples, balls, states, sums, footprints):
    """Follow samples with a tangent vector, for at least so many returns and forcing periods (k,), or to the limit.

    sums[j, batch], zero before, gathers time, ln stretch and ln|det| of sample which[j] after ALIGNMENT returns,
    footprints[j] the boxes that it visits. Contact makes the stretch −∞, which no chaos has.
    """
    for j in range(which.size):
        k = which[j]
        point = point_at(samples.cell[k], cells)
        tau, v, n, x, y, total = samples.tau[k], samples.v[k], 0, 1.0, 0.0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        most = float(samples.limit[k] - samples.impacts[k])
        reference, mark = begun(tau, v), Mark(tau, v, 0, 0, 1)
        status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED:
            share = min((n - ALIGNMENT) / (least[j] - ALIGNMENT), total / periods[j])
            share = max(share, n / most)
            if share >= 1.0:
                break
            before = v
            code, tau, v, time, _below, j00, j01, j10, j11, log_det, on_plus, on_minus = step_tangent(tau, v, point)
            if code != OK:
                status = ending_of(code)
                break
            n, total = n + 1, total + time
            # in (t, v²/2), where the determinant is that of the impact law
            x, y = j00 * x + j01 / before * y, v * (j10 * x + j11 / before * y)
            size = math.hypot(x, y)
            if size > 0.0:
                x, y = x / size, y / size
            else:
                x, y = 1.0, 0.0
            if n > ALIGNMENT:
                row = sums[j, min(int(max(share, 0.0) * BATCHES), BATCHES - 1)]
                row[0] += time
                row[1] += math.log(size)
                row[2] += log_det
            visit(tau, v, top_speed(point.epsilon, unit), footprints[j])
            if on_plus + on_minus > 0:
                status, orbit, mark = after_contact(tau, v, n, k, mark, samples, states)
            if status == Outcome.UNRESOLVED:
                status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        finish(tau, v, n, total, k, status, orbit, samples)


@kernel
def resolve_contacts(which, cells, samples, orbits, states, waiting):
    """Enter the orbits of samples that recur after contact, and the states that follow their contact phases.

    Samples whose cell has no room for one more orbit are written to waiting; the others become PERIODIC.

    Returns
    -------
    int
        How many samples wait.
    """
    waits = 0
    for k in which:
        cell, gap = samples.cell[k], samples.gap[k]
        if orbits.n[cell] == orbits.m.shape[1]:
            waiting[waits] = k
            waits += 1
            continue
        point = point_at(cell, cells)
        tau, v = samples.tau[k], samples.v[k]
        best_tau, best_v, total, n_minus = tau, v, 0.0, 0
        for _ in range(gap):
            _status, tau, v, time, below, _plus, _minus = step(tau, v, point)
            total += time
            n_minus += below
            if v > best_v:
                best_tau, best_v = tau, v
        m = int(np.rint(total))
        orbit = known(m, gap, n_minus, best_tau, best_v, cell, orbits, point)
        if orbit < 0:
            orbit = remember(m, gap, n_minus, best_tau, best_v, -math.inf, -math.inf, cell, orbits)
        for _ in range(gap):
            _status, tau, v, _time, _below, on_plus, on_minus = step(tau, v, point)
            if on_plus + on_minus > 0:
                i = states.n[cell]
                there = False
                for j in range(i):
                    there |= tau == states.tau[cell, j] and v == states.v[cell, j]
                if not there and i < states.tau.shape[1]:
                    states.tau[cell, i], states.v[cell, i], states.orbit[cell, i] = tau, v, orbit
                    states.n[cell] = i + 1
        samples.status[k], samples.orbit[k] = Outcome.PERIODIC, orbit
    return waits


@kernel
def label_contacts(grown, cells, orbits):
    """Enter the contact phases of the orbits of every cell from number grown[cell] on."""
    for cell in range(grown.size):
        for j in range(grown[cell], orbits.n[cell]):
            if orbits.first[cell, j] == -math.inf:
                point = point_at(cell, cells)
                found = merged_runs(orbits.tau[cell, j], orbits.v[cell, j], orbits.n_plus[cell, j], point)
                orbits.contacts[cell, j], orbits.merged[cell, j] = found
