"""Samples that are followed one by one, each return looked at: what has become of one (compiled)."""

from typing import NamedTuple

from rattle.attractors.samples import RECURRENCE, Outcome, capturing_orbit
from rattle.flight.law import wrapped
from rattle.numerics.compile import inline


class Reference(NamedTuple):
    """A state that a trajectory may come back to (Brent's cycle search), its number, and that of the next one."""

    tau: float
    v: float
    n: int
    following: int


@inline
def begun(tau, v):
    """The first reference of a trajectory."""
    return Reference(tau, v, 0, 1)


@inline
def looked(tau, v, n, k, reference, samples, balls, unit):
    """What has become of sample k after n returns: (status, orbit, reference)."""
    orbit = capturing_orbit(tau, v, samples.cell[k], balls)
    if orbit >= 0:
        return Outcome.PERIODIC, orbit, reference
    near = abs(v - reference.v) < RECURRENCE * unit and abs(wrapped(tau - reference.tau)) < RECURRENCE
    if near and n > reference.n and samples.impacts[k] + n >= samples.pause[k]:
        samples.gap[k] = n - reference.n
        return Outcome.RECURRENT, -1, reference
    if n >= reference.following:
        return Outcome.UNRESOLVED, -1, Reference(tau, v, n, 2 * reference.following)
    return Outcome.UNRESOLVED, -1, reference


@inline
def finish(tau, v, n, total, k, status, orbit, samples):
    """Write the end of a stretch of n returns in a total time to sample k."""
    samples.tau[k], samples.v[k], samples.status[k], samples.orbit[k] = tau, v, status, orbit
    samples.impacts[k] += n
    samples.time[k] += total
