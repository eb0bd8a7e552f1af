"""Follow samples of many cells in lanes until each is captured, recurs, or has made its impacts (compiled).

Between chunks of flights every lane that is on Σ⁺ is checked: is it certain to become quiet, is it in the capture
region of a known orbit of its cell, has it returned to its reference state (Brent's cycle search, whose reference moves
up at powers of two)? A lane that ends is refilled with the next sample. The outcome of a sample depends on the known
orbits of its cell and on nothing else in the block.

Where impacts lose energy a chatter may complete. The sample is then RECURRENT with the pause CONTACT, on the wall in
its field `gap`, and `rattle.inelastic.attractors` continues it.
"""

from typing import Any, NamedTuple

from rattle.attractors.chaos import BATCHES
from rattle.attractors.samples import ALIGNMENT, CONTACT, RECURRENCE, Outcome, capturing_orbit, mark, top_speed
from rattle.flight.contact_phase import IN_CONTACT, is_captured
from rattle.flight.forcing import DRIFT, contact_force
from rattle.flight.lanes.block import (
    GROUP,
    GROUPS,
    NONE,
    empty,
    ended,
    load,
    made_ready,
    overflows,
    roughest,
    stretched,
)
from rattle.flight.lanes.stages import advance
from rattle.flight.law import speed_unit, wrapped
from rattle.impacting.map.impact_map import Point
from rattle.numerics.compile import for_type, inline, kernel
from rattle.orbits.return_map import between, point_of

CHUNK, LONG_CHUNK = 11, 37  # flights between two checks, at first and for long trajectories; prime, so that checks of a
# periodic motion meet all its impacts
# flights between two entries of a measured lane in its bitmap; their sum, a prime, between checks
STRIDES = (6, 6, 6, 5)


class ImpactingCells(NamedTuple):
    """Parameters of the cells (n,), with the largest invariant v³/g that is certain to become quiet.

    Where impacts lose energy, `capture` is the largest v/h² of a chatter that completes
    (`rattle.inelastic.map.contact`); otherwise it is 0.
    """

    delta: Any
    epsilon: Any
    beta: Any
    quiet_invariant: Any
    restitution: Any
    capture: Any


@inline
def is_quiet(b, i, largest_invariant):
    """Return whether the bounce of lane i on Σ⁺ is certain to become quiet."""
    force = contact_force(b.sin0[i], b.cos0[i], b.delta[i], b.epsilon[i], DRIFT)
    return is_captured(-b.w[i], force, largest_invariant)


@inline
def fate_of_lane(b, i, cell, cells, balls):
    """Return the outcome of lane i, on Σ⁺: (status, orbit)."""
    if is_quiet(b, i, cells.quiet_invariant[cell]):
        return Outcome.QUIET, -1
    orbit = capturing_orbit(b.tau[i], -b.w[i], cell, balls)
    return (Outcome.PERIODIC, orbit) if orbit >= 0 else (Outcome.UNRESOLVED, -1)


@inline
def start(b, i, k, cells, samples):
    """Put sample k on lane i for its remaining impacts."""
    c = samples.cell[k]
    limit = float(samples.limit[k] - samples.impacts[k])
    load(b, i, samples.tau[k], samples.v[k], cells.delta[c], cells.epsilon[c], cells.beta[c], limit)
    b.restitution[i], b.capture[i] = cells.restitution[c], cells.capture[c]
    b.unit[i] = speed_unit(cells.delta[c], cells.epsilon[c], cells.beta[c])


@inline
def finish(b, i, k, status, orbit, samples):
    """Write the state of lane i back to sample k."""
    samples.tau[k], samples.v[k], samples.status[k], samples.orbit[k] = b.tau[i], abs(b.w[i]), status, orbit
    samples.impacts[k] += int(b.n_plus[i])
    samples.time[k] += b.time[i]
    b.limit[i] = -1.0


@inline
def recurs(b, i, k, samples):
    """Return whether lane i is back at its reference, and write the impacts since then to the sample."""
    tau, v, n = b.tau[i], -b.w[i], b.n_plus[i]
    near = abs(v - b.at_v[i]) < RECURRENCE * b.unit[i] and abs(wrapped(tau - b.at_tau[i])) < RECURRENCE
    b.looks[i] += 1.0
    if near and samples.impacts[k] + n >= samples.pause[k]:
        samples.gap[k] = int(n - b.at_n[i])
        return True
    if b.looks[i] >= b.next_look[i]:
        b.at_tau[i], b.at_v[i], b.at_n[i], b.next_look[i] = tau, v, n, 2.0 * b.next_look[i]
    return False


@inline
def look(b, i, k, cells, samples, balls):
    """Check lane i of sample k and return (status, orbit, ended); the status is UNRESOLVED while it goes on."""
    over = ended(b, i)
    if b.wall[i] > 0.0:
        status, orbit = fate_of_lane(b, i, samples.cell[k], cells, balls)
        if status != Outcome.UNRESOLVED:
            return status, orbit, True
    if b.stuck[i] == IN_CONTACT and b.capture[i] > 0.0:
        samples.gap[k], samples.pause[k] = int(b.wall[i]), CONTACT
        return Outcome.RECURRENT, -1, True
    if b.stuck[i] > 0.0:
        return Outcome.FAILED, -1, True
    if b.wall[i] > 0.0 and recurs(b, i, k, samples):
        return Outcome.RECURRENT, -1, True
    return Outcome.UNRESOLVED, -1, over


@inline
def looked_round(b, groups, fresh, which, cells, samples, balls):
    """Check every lane in use, refill those that ended, and return how many of the samples `which` have begun."""
    for i in range(GROUP * groups):
        k = b.who[i]
        if k >= 0:
            status, orbit, over = look(b, i, k, cells, samples, balls)
            if over:
                finish(b, i, k, status, orbit, samples)
                b.who[i] = -1
        if b.who[i] < 0 and fresh < which.size:
            start(b, i, which[fresh], cells, samples)
            b.who[i] = which[fresh]
            fresh += 1
    return fresh


@kernel
def settle(memory, which, flights, cells, samples, balls, paths):
    """Follow the samples `which` until they end, with this many flights between two checks.

    A sample that makes all its impacts remains UNRESOLVED.
    """
    b, fresh, groups = memory[0], NONE, GROUPS
    empty(b)
    while groups > 0:
        fresh = looked_round(b, groups, fresh, which, cells, samples, balls)
        groups = made_ready(b, groups, fresh == which.size)
        advance(memory, groups, flights, roughest(b, groups), False, paths)


@inline
def record(b, i, batches):
    """Add time, ln stretch and ln|det| of lane i since the last call to its batch, if it has one."""
    stretch, contraction = stretched(b, i)
    if b.batch[i] >= 0:
        row = batches[int(b.batch[i])]
        row[0] += b.time[i] - b.since[i]
        row[1] += stretch
        row[2] += contraction


class Observation(NamedTuple):
    """The observation of probes: least impacts and forcing periods (k,), batch sums, and visited-cell bitmaps."""

    least: Any
    periods: Any
    sums: Any
    footprints: Any


@inline
def watched_round(b, groups, fresh, which, cells, samples, balls, watch):
    """Do the work of `looked_round` for lanes with a tangent vector."""
    for i in range(GROUP * groups):
        j = b.who[i]
        if j >= 0:
            k = which[j]
            share = min((b.n_plus[i] - ALIGNMENT) / (watch.least[j] - ALIGNMENT), b.time[i] / watch.periods[j])
            share = max(share, b.n_plus[i] / b.limit[i])
            batch = min(int(share * BATCHES), BATCHES - 1) if b.n_plus[i] >= ALIGNMENT else -1
            status, orbit, over = look(b, i, k, cells, samples, balls)
            over |= share >= 1.0 and b.wall[i] > 0.0
            if over or batch != b.batch[i] or overflows(b, i):
                record(b, i, watch.sums[j])
                b.batch[i], b.since[i] = batch, b.time[i]
            if over:
                finish(b, i, k, status, orbit, samples)
                b.who[i] = -1
        if b.who[i] < 0 and fresh < which.size:
            start(b, i, which[fresh], cells, samples)
            b.who[i] = fresh
            fresh += 1
    return fresh


@inline
def leave_footprints(b, groups, footprints):
    """Enter the states of lanes on Σ⁺ into their visited-cell bitmaps."""
    for i in range(GROUP * groups):
        if b.who[i] >= 0 and b.wall[i] > 0.0:
            mark(b.tau[i], -b.w[i], top_speed(b.epsilon[i], b.unit[i]), footprints[b.who[i]])


@kernel
def measure(memory, which, least, periods, cells, samples, balls, sums, footprints, paths):
    """Settle probes with a tangent vector, for at least `least` impacts and `periods` forcing periods (k,).

    A probe ends earlier at its limit. sums[j, batch], zero before, collects time, ln stretch and ln|det| of sample
    which[j] after ALIGNMENT impacts. footprints[j] collects the boxes that the sample visits.
    """
    b, fresh, groups, watch = memory[0], NONE, GROUPS, Observation(least, periods, sums, footprints)
    empty(b)
    while groups > 0:
        fresh = watched_round(b, groups, fresh, which, cells, samples, balls, watch)
        groups = made_ready(b, groups, fresh == which.size)
        force = roughest(b, groups)
        for flights in STRIDES:
            advance(memory, groups, flights, force, True, paths)
            leave_footprints(b, groups, footprints)


@for_type(point_of, ImpactingCells)
def _point_of(cell, cells):
    return Point(cells.delta[cell], cells.epsilon[cell], cells.beta[cell], cells.quiet_invariant[cell])


@for_type(between, Point)
def _between(share, one, other):
    return Point(
        one.delta + share * (other.delta - one.delta),
        one.epsilon + share * (other.epsilon - one.epsilon),
        one.beta,
        one.quiet_invariant + share * (other.quiet_invariant - one.quiet_invariant),
    )
