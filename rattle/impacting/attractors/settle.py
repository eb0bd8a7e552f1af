"""Follow samples of many cells in lanes until each is captured, recurs, or reaches its limit of impacts (compiled).

Between chunks of flights every lane that is on Σ⁺ is checked for three outcomes: it is certain to become quiet; it is
in the capture region of a known orbit of its cell; or it has returned to its reference state. The reference is that of
Brent's cycle search: the current state replaces it after 1, 2, 4, … checks. A lane whose sample ends gets the next
sample. The outcome of a sample depends on the known orbits of its cell and on nothing else in the block of lanes.

If impacts lose energy, a chatter may complete: the gear then stays in contact with a wall. The sample then gets the
status RECURRENT, with the value CONTACT in its field `pause` and the wall in its field `gap`, and
`rattle.inelastic.attractors` continues it.
"""

from typing import Any, NamedTuple

from rattle.attractors.chaos import BATCHES
from rattle.attractors.samples import (
    ALIGNMENT,
    CONTACT,
    RECURRENCE,
    Outcome,
    bitmap_top_speed,
    find_capturing_orbit,
    mark_visited_cell,
)
from rattle.flight.contact_phase import IN_CONTACT, is_bounce_captured
from rattle.flight.forcing import DRIFT, contact_force
from rattle.flight.lanes.block import (
    GROUP,
    GROUPS,
    NONE,
    classify_contact_force_of_lanes,
    clear_block,
    is_near_overflow,
    normalise_tangent,
    prepare_flights,
    put_trajectory_on_lane,
    stop_lane_at_limit,
)
from rattle.flight.lanes.stages import advance
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.impacting.map.impact_map import ImpactingPoint
from rattle.numerics.compile import implement_for_type, inline, kernel
from rattle.orbits.return_map import point_between, point_of_cell

# number of flights between two checks, at first and for long trajectories; both are prime, so that in nearly every
# periodic motion the checks come at each impact of the period in turn
CHUNK, LONG_CHUNK = 11, 37
# A probe marks its visited-cell bitmap after each of these numbers of flights, in turn. It is checked after all four,
# that is after every 23 flights. 23 is prime, so that checks of a periodic motion come at each of its impacts in turn.
STRIDES = (6, 6, 6, 5)


class ImpactingCells(NamedTuple):
    """Parameters of n cells with elastic or inelastic impacts, as kernels take them.

    Attributes
    ----------
    quiet_invariant
        The largest v³/g at which a bounce is certain to become quiet, for its speed v and the contact force g.
    capture
        Where impacts lose energy, the largest v/h² at which a chatter is certain to complete, with the contact force h
        towards the wall (`rattle.inelastic.map.contact`); otherwise 0.
    """

    delta: Any
    epsilon: Any
    beta: Any
    quiet_invariant: Any
    restitution: Any
    capture: Any


@inline
def is_certain_to_become_quiet(b, i, largest_invariant):
    """Return whether the bounce of lane i on Σ⁺ is certain to become quiet."""
    force = contact_force(b.sin0[i], b.cos0[i], b.delta[i], b.epsilon[i], DRIFT)
    return is_bounce_captured(-b.w[i], force, largest_invariant)


@inline
def outcome_of_lane(b, i, cell, cells, balls):
    """Return the outcome of lane i, which is on Σ⁺ and follows a sample of cell number `cell`.

    Returns
    -------
    tuple
        (status, orbit): (QUIET, −1); (PERIODIC, number of the orbit that captures the state); or (UNRESOLVED, −1).
    """
    if is_certain_to_become_quiet(b, i, cells.quiet_invariant[cell]):
        return Outcome.QUIET, -1
    orbit = find_capturing_orbit(b.tau[i], -b.w[i], cell, balls)
    return (Outcome.PERIODIC, orbit) if orbit >= 0 else (Outcome.UNRESOLVED, -1)


@inline
def put_sample_on_lane(b, i, k, cells, samples):
    """Put sample k on lane i, which follows it until the sample's limit of impacts."""
    c = samples.cell[k]
    limit = float(samples.limit[k] - samples.impacts[k])
    put_trajectory_on_lane(b, i, samples.tau[k], samples.v[k], cells.delta[c], cells.epsilon[c], cells.beta[c], limit)
    b.restitution[i], b.capture[i] = cells.restitution[c], cells.capture[c]
    b.unit[i] = speed_unit(cells.delta[c], cells.epsilon[c], cells.beta[c])


@inline
def finish_sample(b, i, k, status, orbit, samples):
    """Write the state and the outcome of lane i back to sample k, and stop the lane."""
    samples.tau[k], samples.v[k], samples.status[k], samples.orbit[k] = b.tau[i], abs(b.w[i]), status, orbit
    samples.impacts[k] += int(b.n_plus[i])
    samples.time[k] += b.time[i]
    b.limit[i] = -1.0


@inline
def has_recurred(b, i, k, samples):
    """Return whether lane i is back at its reference state, and sample k has made `samples.pause[k]` impacts or more.

    If both hold, `samples.gap[k]` becomes the number of impacts on Σ⁺ since the reference state. Otherwise, after
    1, 2, 4, … checks of the lane, the current state replaces the reference state.

    Returns
    -------
    bool
        True if both hold.
    """
    tau, v, n = b.tau[i], -b.w[i], b.n_plus[i]
    near = abs(v - b.at_v[i]) < RECURRENCE * b.unit[i] and abs(wrap_phase_difference(tau - b.at_tau[i])) < RECURRENCE
    b.looks[i] += 1.0
    if near and samples.impacts[k] + n >= samples.pause[k]:
        samples.gap[k] = int(n - b.at_n[i])
        return True
    if b.looks[i] >= b.next_look[i]:
        b.at_tau[i], b.at_v[i], b.at_n[i], b.next_look[i] = tau, v, n, 2.0 * b.next_look[i]
    return False


@inline
def check_outcome_of_lane(b, i, k, cells, samples, balls):
    """Check lane i, which holds sample k, for an outcome.

    Returns
    -------
    tuple
        The status, UNRESOLVED if there is no outcome; the number of the orbit that captures the state, or −1; and
        whether the sample ends here, because it has an outcome or has reached its limit of impacts.
    """
    over = stop_lane_at_limit(b, i)
    if b.wall[i] > 0.0:
        status, orbit = outcome_of_lane(b, i, samples.cell[k], cells, balls)
        if status != Outcome.UNRESOLVED:
            return status, orbit, True
    if b.stuck[i] == IN_CONTACT and b.capture[i] > 0.0:
        samples.gap[k], samples.pause[k] = int(b.wall[i]), CONTACT
        return Outcome.RECURRENT, -1, True
    if b.stuck[i] > 0.0:
        return Outcome.FAILED, -1, True
    if b.wall[i] > 0.0 and has_recurred(b, i, k, samples):
        return Outcome.RECURRENT, -1, True
    return Outcome.UNRESOLVED, -1, over


@inline
def check_lanes(b, groups, fresh, which, cells, samples, balls):
    """Check every lane in use, and put new samples on lanes whose samples ended.

    which (k,): the numbers of the samples to follow. fresh: how many samples were put on lanes before this call.

    Returns
    -------
    int
        How many samples were put on lanes by the end of this call.
    """
    for i in range(GROUP * groups):
        k = b.who[i]
        if k >= 0:
            status, orbit, over = check_outcome_of_lane(b, i, k, cells, samples, balls)
            if over:
                finish_sample(b, i, k, status, orbit, samples)
                b.who[i] = -1
        if b.who[i] < 0 and fresh < which.size:
            put_sample_on_lane(b, i, which[fresh], cells, samples)
            b.who[i] = which[fresh]
            fresh += 1
    return fresh


@kernel
def follow_until_outcome(memory, which, flights, cells, samples, balls, paths):
    """Follow the samples whose numbers are in `which` until each has an outcome or reaches its limit of impacts.

    `flights` flights pass between two checks of the lanes. A sample that reaches its limit without an outcome remains
    UNRESOLVED. `paths` (2,) counts flights whose first impact needs a scan, and flights whose first impact needs the
    slower safe search.
    """
    b, fresh, groups = memory[0], NONE, GROUPS
    clear_block(b)
    while groups > 0:
        fresh = check_lanes(b, groups, fresh, which, cells, samples, balls)
        groups = prepare_flights(b, groups, fresh == which.size)
        advance(memory, groups, flights, classify_contact_force_of_lanes(b, groups), False, paths)


@inline
def record_tangent_growth(b, i, batches):
    """Add to a row of `batches` the time, ln stretch and ln|det| that lane i gained since the last call.

    Each row belongs to one of BATCHES successive parts of the observation; `b.batch[i]` is the present part. As long as
    the lane's tangent vector is not yet aligned, the gains are dropped.
    """
    stretch, contraction = normalise_tangent(b, i)
    if b.batch[i] >= 0:
        row = batches[int(b.batch[i])]
        row[0] += b.time[i] - b.since[i]
        row[1] += stretch
        row[2] += contraction


class ProbeObservation(NamedTuple):
    """The limits of the observation of k probes, and the arrays for its results.

    Attributes
    ----------
    least, periods : (k,)
        Least number of impacts on Σ⁺, and of forcing periods, for which each probe is followed.
    sums : (k, BATCHES, 3)
        For each of BATCHES successive parts of the observation: the part's time, and ln stretch and ln|det| of the
        tangent map.
    footprints
        Visited-cell bitmap of each probe.
    """

    least_impacts: Any
    least_periods: Any
    sums: Any
    footprints: Any


@inline
def check_probes(b, groups, fresh, which, cells, samples, balls, watch):
    """Check every lane in use, and put new probes on lanes whose probes ended.

    The observation of a probe consists of BATCHES successive parts. When a part or the probe ends, or the tangent
    vector is near overflow, the vector's growth since the last record is added to the part's row of `watch.sums`.
    which (k,): the sample numbers of the probes. fresh: how many probes were put on lanes before this call.

    Returns
    -------
    int
        How many probes were put on lanes by the end of this call.
    """
    for i in range(GROUP * groups):
        j = b.who[i]
        if j >= 0:
            k = which[j]
            share = min(
                (b.n_plus[i] - ALIGNMENT) / (watch.least_impacts[j] - ALIGNMENT), b.time[i] / watch.least_periods[j]
            )
            share = max(share, b.n_plus[i] / b.limit[i])
            batch = min(int(share * BATCHES), BATCHES - 1) if b.n_plus[i] >= ALIGNMENT else -1
            status, orbit, over = check_outcome_of_lane(b, i, k, cells, samples, balls)
            over |= share >= 1.0 and b.wall[i] > 0.0
            if over or batch != b.batch[i] or is_near_overflow(b, i):
                record_tangent_growth(b, i, watch.sums[j])
                b.batch[i], b.since[i] = batch, b.time[i]
            if over:
                finish_sample(b, i, k, status, orbit, samples)
                b.who[i] = -1
        if b.who[i] < 0 and fresh < which.size:
            put_sample_on_lane(b, i, which[fresh], cells, samples)
            b.who[i] = fresh
            fresh += 1
    return fresh


@inline
def mark_visited_cells(b, groups, footprints):
    """Mark the state of each lane on Σ⁺ in the visited-cell bitmap of its probe."""
    for i in range(GROUP * groups):
        if b.who[i] >= 0 and b.wall[i] > 0.0:
            mark_visited_cell(b.tau[i], -b.w[i], bitmap_top_speed(b.epsilon[i], b.unit[i]), footprints[b.who[i]])


@kernel
def follow_probes_in_lanes(memory, which, least, periods, cells, samples, balls, sums, footprints, paths):
    """Follow the probes `which` (k,) in lanes, each with a tangent vector.

    Probe j goes on for at least least[j] impacts and periods[j] forcing periods, unless it has an outcome or reaches
    its limit of impacts before. sums[j, batch], zero at the start, collects the probe's time, and ln stretch and
    ln|det| of its tangent map, in each of BATCHES successive parts; the first ALIGNMENT impacts are left out.
    footprints[j] is the probe's visited-cell bitmap. `paths` (2,) counts flights whose first impact needs a scan, and
    flights whose first impact needs the slower safe search.
    """
    b, fresh, groups, watch = memory[0], NONE, GROUPS, ProbeObservation(least, periods, sums, footprints)
    clear_block(b)
    while groups > 0:
        fresh = check_probes(b, groups, fresh, which, cells, samples, balls, watch)
        groups = prepare_flights(b, groups, fresh == which.size)
        force = classify_contact_force_of_lanes(b, groups)
        for flights in STRIDES:
            advance(memory, groups, flights, force, True, paths)
            mark_visited_cells(b, groups, footprints)


@implement_for_type(point_of_cell, ImpactingCells)
def _point_of_cell(cell, cells):
    return ImpactingPoint(cells.delta[cell], cells.epsilon[cell], cells.beta[cell], cells.quiet_invariant[cell])


@implement_for_type(point_between, ImpactingPoint)
def _point_between(share, one, other):
    return ImpactingPoint(
        one.delta + share * (other.delta - one.delta),
        one.epsilon + share * (other.epsilon - one.epsilon),
        one.beta,
        one.quiet_invariant + share * (other.quiet_invariant - one.quiet_invariant),
    )
