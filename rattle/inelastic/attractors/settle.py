"""Follow samples of the inelastic gear until each is quiet, captured, recurrent, or at its limit of returns (compiled).

The samples are followed one by one, as in `rattle.stiff.attractors.settle`. The motion after a contact phase does not
depend on the motion before it: the first impact on Σ⁺ afterwards is one of a few states, identical to the last bit.
When a sample first reaches such a state, the motion is followed until a state after contact occurs again. The motion is
then periodic, however long its period. `ContactStates` keeps these states for the cell, so that every later sample that
reaches a kept state is resolved at once.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from rattle.attractors.chaos import BATCHES
from rattle.attractors.recurrence import append_orbit, index_of_orbit
from rattle.attractors.samples import (
    ALIGNMENT,
    CONTACT,
    RECURRENCE,
    Outcome,
    ReferenceState,
    bitmap_top_speed,
    check_sample_outcome,
    find_capturing_orbit,
    first_reference_state,
    store_sample,
)
from rattle.attractors.samples import mark_visited_cell as visit
from rattle.flight.contact_phase import IN_CONTACT
from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.inelastic.map.cells import inelastic_point_of_cell
from rattle.inelastic.map.impact_map import next_impact_on_plus, step, step_with_tangent
from rattle.inelastic.map.runs import count_contacts_and_merged_impacts
from rattle.numerics.compile import inline, kernel

#: Codes in place of the number of the orbit to which a state after contact leads. NO_ORBIT: the motion makes no
#: further return, or does not repeat within MOST_RETURNS. UNKNOWN: neither the state nor its orbit is recorded.
#: NOT_YET: the state leads to a motion without contact that has no capture region yet.
NO_ORBIT, UNKNOWN, NOT_YET = -1, -2, -3
MOST_RETURNS = 2**16  # largest number of returns for which a state after contact is followed


class ContactStates(NamedTuple):
    """The known states after contact phases of each cell, and the orbits to which these states lead.

    tau, v, orbit (n_cells, room): the states, each with the number of its orbit, or NO_ORBIT. n (n_cells,): the number
    of entries of each cell that are used.
    """

    n: Any
    tau: Any
    v: Any
    orbit: Any


@inline
def orbit_number_after_contact(tau, v, cell, states):
    """Return the number of the orbit to which a state (τ, v) after contact leads.

    Returns
    -------
    int
        The number; NO_ORBIT if the state is recorded without an orbit, UNKNOWN if the state is not recorded.
    """
    for i in range(states.n[cell]):
        if tau == states.tau[cell, i] and v == states.v[cell, i]:
            return states.orbit[cell, i]
    return UNKNOWN


@inline
def outcome_after_contact(tau, v, k, samples, states):
    """Return the status of sample k, which has just come out of a contact phase, and the number of its orbit.

    Returns
    -------
    tuple
        (PERIODIC, orbit) if the state (τ, v) is recorded with the number of an orbit; (UNRESOLVED, −1) if it is
        recorded with NO_ORBIT, because no orbit was found from it; (RECURRENT, −1) if it is not recorded. In the first
        and the last case the sample's `pause` is set to CONTACT, and its `gap` to 0.
    """
    orbit = orbit_number_after_contact(tau, v, samples.cell[k], states)
    if orbit == NO_ORBIT:
        return Outcome.UNRESOLVED, -1
    samples.gap[k], samples.pause[k] = 0, CONTACT
    return (Outcome.PERIODIC, orbit) if orbit >= 0 else (Outcome.RECURRENT, -1)


@inline
def outcome_without_return(code):
    """Return the outcome QUIET or FAILED of a sample that does not return to Σ⁺, from the status code of `step`."""
    return Outcome.QUIET if code == IN_CONTACT else Outcome.FAILED


@kernel
def follow_until_outcome(which, cells, samples, balls, states):
    """Follow samples `which` until each has an outcome, or stays UNRESOLVED after all returns that its limit allows."""
    for j in range(which.size):
        k = which[j]
        point = inelastic_point_of_cell(samples.cell[k], cells)
        tau, v, n, total = samples.tau[k], samples.v[k], 0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        reference = first_reference_state(tau, v)
        status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED and samples.impacts[k] + n < samples.limit[k]:
            code, tau, v, time, _below, on_plus, on_minus = step(tau, v, point)
            if code != OK:
                status = outcome_without_return(code)
                break
            n, total = n + 1, total + time
            if on_plus + on_minus > 0:
                status, orbit = outcome_after_contact(tau, v, k, samples, states)
            if status == Outcome.UNRESOLVED:
                status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        store_sample(tau, v, n, total, k, status, orbit, samples)


@kernel
def follow_probes(which, least, periods, cells, samples, balls, states, sums, footprints):
    """Follow samples `which` with a tangent vector, to find their Lyapunov exponents.

    Sample which[j] is followed for at least least[j] returns and periods[j] forcing periods, unless it has an outcome
    or reaches its limit of returns before. sums (k, BATCHES, 3) must be 0 at the start. sums[j] becomes the sums of
    time, ln stretch and ln|det| over the returns of this sample after the first ALIGNMENT returns, in BATCHES
    successive parts. A contact phase makes ln stretch −∞, which excludes chaos. footprints[j] collects the boxes of
    the (τ, v) plane that the sample visits.
    """
    for j in range(which.size):
        k = which[j]
        point = inelastic_point_of_cell(samples.cell[k], cells)
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
            before = v
            code, tau, v, time, _below, j00, j01, j10, j11, log_det, on_plus, on_minus = step_with_tangent(
                tau, v, point
            )
            if code != OK:
                status = outcome_without_return(code)
                break
            n, total = n + 1, total + time
            # the tangent is kept in (t, v²/2), because `log_det` is ln|det| in these coordinates
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
            visit(tau, v, bitmap_top_speed(point.epsilon, unit), footprints[j])
            if on_plus + on_minus > 0:
                status, orbit = outcome_after_contact(tau, v, k, samples, states)
            if status == Outcome.UNRESOLVED:
                status, orbit, reference = check_sample_outcome(tau, v, n, k, reference, samples, balls, unit)
        store_sample(tau, v, n, total, k, status, orbit, samples)


@kernel
def follow_after_contact(tau, v, cell, point, balls, states):
    """Follow a state (τ, v) after contact until a later state after contact repeats (Brent's algorithm).

    Returns
    -------
    orbit : int
        The number of the orbit to which the state leads, if this orbit is recorded or captures the motion. Otherwise a
        code. UNKNOWN: a state after contact repeated, so the orbit is new. NOT_YET: before any state after
        contact repeated, a state that does not follow contact almost repeated. NO_ORBIT: no state repeated within
        MOST_RETURNS returns, or the motion makes no further return.
    gap, tau, v
        For UNKNOWN, the number of returns in a period of the new orbit, and a state on this orbit.
    """
    unit = speed_unit(point.delta, point.epsilon, point.beta)
    mark_tau, mark_v, mark_n, contacts, following = tau, v, 0, 0, 1
    reference = first_reference_state(tau, v)
    for n in range(1, MOST_RETURNS + 1):
        code, tau, v, _time, _below, on_plus, on_minus = step(tau, v, point)
        if code != OK:
            break
        orbit = find_capturing_orbit(tau, v, cell, balls)
        if on_plus + on_minus > 0:
            orbit = max(orbit, orbit_number_after_contact(tau, v, cell, states))
            if orbit < 0 and tau == mark_tau and v == mark_v:
                return UNKNOWN, n - mark_n, tau, v
            contacts += 1
            if contacts >= following:
                mark_tau, mark_v, mark_n, following = tau, v, n, 2 * following
        elif abs(v - reference.v) < RECURRENCE * unit and abs(wrap_phase_difference(tau - reference.tau)) < RECURRENCE:
            return NOT_YET, 0, tau, v
        if orbit >= 0:
            return orbit, 0, tau, v
        if n >= reference.n_of_next_reference:
            reference = ReferenceState(tau, v, n, 2 * reference.n_of_next_reference)
    return NO_ORBIT, 0, tau, v


@inline
def record_contact_state(tau, v, orbit, cell, states):
    """Record a state (τ, v) after contact and the number of its orbit, if the state is new and the cell has room."""
    i = states.n[cell]
    if i < states.tau.shape[1] and orbit_number_after_contact(tau, v, cell, states) == UNKNOWN:
        states.tau[cell, i], states.v[cell, i], states.orbit[cell, i] = tau, v, orbit
        states.n[cell] = i + 1


@kernel
def find_orbits_of_contact_samples(which, cells, samples, orbits, balls, states, waiting):
    """Find the orbits of samples with contact phases, and record new orbits and their states after contact.

    samples.gap[k] is the wall with which sample k is in contact, 0 if its contact phase is over. A sample whose cell
    has no room for another orbit is written to `waiting`. Any other sample becomes PERIODIC if its orbit is found,
    QUIET if its contact never ends, or FAILED if it cannot be followed; otherwise it is UNRESOLVED.

    Returns
    -------
    int
        The number of samples in `waiting`.
    """
    waits = 0
    for k in which:
        cell = samples.cell[k]
        point = inelastic_point_of_cell(cell, cells)
        if samples.gap[k] != 0 and not follow_to_sigma_plus(k, samples, point):
            continue
        orbit = orbit_number_after_contact(samples.tau[k], samples.v[k], cell, states)
        if orbit == UNKNOWN:
            if orbits.n[cell] == orbits.m.shape[1]:
                waiting[waits] = k
                waits += 1
                continue
            orbit, gap, tau, v = follow_after_contact(samples.tau[k], samples.v[k], cell, point, balls, states)
            if orbit == UNKNOWN:
                orbit = record_contact_orbit(tau, v, gap, cell, point, orbits, states)
            if orbit != NOT_YET:
                record_contact_state(samples.tau[k], samples.v[k], orbit, cell, states)
        if orbit >= 0:
            samples.status[k], samples.orbit[k] = Outcome.PERIODIC, orbit
        else:
            samples.status[k], samples.pause[k] = Outcome.UNRESOLVED, 0
    return waits


@kernel
def follow_to_sigma_plus(k, samples, point):
    """Follow sample k from its last impact, which is on the wall `samples.gap[k]`, to its next impact on Σ⁺.

    Returns
    -------
    bool
        True if the sample reached Σ⁺ after a contact phase. False if it became QUIET or FAILED on the way, or reached
        Σ⁺ without contact, after which it is UNRESOLVED.
    """
    wall = samples.gap[k]
    code, tau, v, time, _below, on_plus, on_minus = next_impact_on_plus(
        wall, samples.tau[k], -wall * samples.v[k], point
    )
    samples.gap[k] = 0
    if code != OK:
        samples.status[k] = outcome_without_return(code)
        return False
    samples.tau[k], samples.v[k] = tau, v
    samples.impacts[k] += 1
    samples.time[k] += time
    if on_plus + on_minus == 0:
        samples.status[k], samples.pause[k] = Outcome.UNRESOLVED, 0
    return on_plus + on_minus > 0


@kernel
def record_contact_orbit(tau, v, gap, cell, point, orbits, states):
    """Record the orbit through a state (τ, v) after contact, and all states after contact on this orbit.

    gap: the number of returns in a period of the orbit.

    Returns
    -------
    int
        The number of the orbit.
    """
    best_tau, best_v, total, n_minus = tau, v, 0.0, 0
    for _ in range(gap):
        _status, tau, v, time, below, _plus, _minus = step(tau, v, point)
        total += time
        n_minus += below
        if v > best_v:
            best_tau, best_v = tau, v
    m = int(np.rint(total))
    orbit = index_of_orbit(m, gap, n_minus, best_tau, best_v, cell, orbits, point)
    if orbit < 0:
        orbit = append_orbit(m, gap, n_minus, best_tau, best_v, -math.inf, -math.inf, cell, orbits)
    for _ in range(gap):
        _status, tau, v, _time, _below, on_plus, on_minus = step(tau, v, point)
        if on_plus + on_minus > 0:
            record_contact_state(tau, v, orbit, cell, states)
    return orbit


@kernel
def count_contact_phases(grown, cells, orbits):
    """Count contact phases and merged impacts of the orbits with contact after the first grown[cell] of each cell."""
    for cell in range(grown.size):
        for j in range(grown[cell], orbits.n[cell]):
            if orbits.first[cell, j] == -math.inf:
                point = inelastic_point_of_cell(cell, cells)
                found = count_contacts_and_merged_impacts(
                    orbits.tau[cell, j], orbits.v[cell, j], orbits.n_plus[cell, j], point
                )
                orbits.contacts[cell, j], orbits.merged[cell, j] = found
