"""Compute the gears of a population. Many gears are computed at once, with the same results as one by one."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import PERIODS, WATCH
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import NATURAL, SampleSpec
from rattle.attractors.table import AttractorTable, tabulate_attractors
from rattle.impacting.attractors.boundary_distance import boundary_distances
from rattle.intensity.table import Stretch, intensities_of
from rattle.models import MODELS
from rattle.numerics.sampling import initial_conditions, wilson_interval
from rattle.populations.distributions import LEAST, Distribution
from rattle.populations.plan import Z_LOOKS, Plan
from rattle.populations.tolerances import Points

#: Samples that are followed at once at strong damping.
BLOCK = 65_536
#: Gears whose margins are computed at once.
TOGETHER = 64
NOT_ASKED, PASSES, FAILS, UNKNOWN = range(4)
VERDICTS = ("not_asked", "passes", "fails", "unknown")

Array = NDArray[np.float64]


class Gears(NamedTuple):
    """The computed rows of a population, one for each gear.

    Attributes
    ----------
    part : ndarray of int, (n,)
        Number of the part of the plan to which the row belongs.
    values : ndarray, (n, d)
        The numbers that vary.
    delta, epsilon, beta : ndarray, (n,)
        The dimensionless parameters.
    energy : ndarray, (n, count)
        Σv²/2 per revolution of the attractor that each sample reaches, in rising order: 0 if it is quiet, NaN (last) if
        the sample is undecided.
    verdict : ndarray of int, (n,)
        Index into `VERDICTS`.
    """

    part: NDArray[np.int64]
    values: Array
    delta: Array
    epsilon: Array
    beta: Array
    energy: Array
    verdict: NDArray[np.int64]


def computed(plan: Plan, start: int, stop: int) -> Gears:
    """Compute the rows from start to stop of a population; each depends only on the plan and the row's number."""
    rows = np.arange(start, stop)
    part, values = plan.parts(rows), plan.values(rows)
    points = plan.tolerances.points(values)
    energy = np.empty((rows.size, plan.count))
    at = points.parameters
    for here in blocks(at.delta, plan.count):
        seeds = part[here]
        for each in np.unique(seeds):
            of = np.arange(here.start, here.stop)[seeds == each]
            energy[of] = energies(plan, points.some(of), plan.count, plan.seed + int(each))
    verdict = np.full(rows.size, NOT_ASKED)
    asked = plan.asked(rows)
    verdict[asked] = judged(plan, points.some(asked))
    return Gears(part, values, at.delta, at.epsilon, at.beta, energy, verdict)


def blocks(delta: Array, count: int) -> list[slice]:
    """Return slices of gears to follow at once. A slice takes some seconds if all motions are chaotic."""
    longer = np.maximum(1.0, WATCH / (PERIODS * delta.min(initial=1.0)))
    size = max(1, int(BLOCK / longer) // count)
    return [slice(start, min(start + size, delta.size)) for start in range(0, delta.size, size)]


def energies(plan: Plan, points: Points, count: int, seed: int) -> Array:
    """Return Σv²/2 per revolution of the attractor of each sample (n, count), sorted for each gear with NaN last."""
    found = np.empty((points.parameters.size, count))
    for rows, few in points.by_shape():
        tau, v = states(plan, few, count, seed)
        table, row, cells, how = follow_gears(few, tau, v, plan.budget)
        energy = intensities_of(table, cells, how).energy
        decided = np.where(table.kind == Outcome.UNDECIDED, np.nan, energy)
        found[rows] = np.sort(decided[row].reshape(tau.shape), axis=1)
    return found


def follow_gears(
    points: Points, tau: Array, v: Array, budget: int
) -> tuple[AttractorTable, NDArray[np.int64], Any, Stretch]:
    """Follow states (n, count) of n gears to their attractors.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64], Any, Stretch]
        The attractors, the row of each state in this table, and the two arguments that `intensities_of` needs: the
        record of cells, and the function that follows a stretch of a motion.
    """
    model = MODELS[points.parameters.model]
    found = model.classify_states(points.parameters, tau, v, budget)
    return *tabulate_attractors(found), found.cells, model.functions.stretch


def states(plan: Plan, points: Points, count: int, seed: int) -> tuple[Array, Array]:
    """Return the initial states (n, count) of the gears: states as in `Gear.attractors`, or states after shocks.

    Returns
    -------
    tuple[Array, Array]
        Phases and speeds (n, count).
    """
    at = points.parameters
    if plan.shock is None:
        return SampleSpec(count, NATURAL, seed).states(at)
    first, second = initial_conditions(at.delta, at.epsilon, at.beta, count, 1.0, seed)
    speed = of_shares(plan.shock.speed, second)
    unit = 1.0 if points.units is None else np.broadcast_to(points.units.velocity, at.shape)[:, None]
    return of_shares(plan.shock.phase, first) % 1.0, np.ascontiguousarray(speed / unit)


def of_shares(given: float | str | Distribution, u: Array) -> Array:
    """Return the quantiles of a distribution at u, or a given number everywhere."""
    if isinstance(given, Distribution):
        return given.quantile(np.clip(u, LEAST, 1.0 - LEAST))
    return np.full(u.shape, float(given))


def judged(plan: Plan, points: Points) -> NDArray[np.int64]:
    """Judge gears (n,) by their margin of quiet running, or by their share of quiet runs.

    For the share, samples are added, up to each number in `Plan.looks`, until the verdict is certain at 95 %
    confidence.

    Returns
    -------
    NDArray[np.int64]
        PASSES, FAILS or UNKNOWN for each gear.
    """
    if plan.margin is not None:
        least = plan.margin if points.units is None else plan.margin / points.units.velocity
        at = points.parameters
        found = np.full(at.size, np.nan)
        for start in range(0, found.size, TOGETHER):
            few = slice(start, start + TOGETHER)
            found[few] = boundary_distances(at.delta[few], at.epsilon[few], at.beta[few], NATURAL).v
        return np.where(np.isnan(found), UNKNOWN, np.where(found > least, PASSES, FAILS))
    verdict = np.full(points.parameters.size, UNKNOWN)
    quiet, rattling, before = np.zeros(verdict.size), np.zeros(verdict.size), 0
    for look, after in enumerate(plan.looks):
        open_ = np.flatnonzero(verdict == UNKNOWN)
        here = points.some(open_)
        for rows in blocks(here.parameters.delta, after - before):
            seed = plan.seed + (look + 1 << 64)  # differs from the seeds of all parts
            found = energies(plan, here.some(rows), after - before, seed)
            quiet[open_[rows]] += (found == 0.0).sum(axis=1)
            rattling[open_[rows]] += (found > 0.0).sum(axis=1)
        low, _ = wilson_interval(quiet[open_], after, Z_LOOKS)
        _, high = wilson_interval(after - rattling[open_], after, Z_LOOKS)
        share = plan.share or 0.0
        verdict[open_[low >= share]], verdict[open_[high < share]] = PASSES, FAILS
        before = after
    return verdict
