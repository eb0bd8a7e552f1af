"""Compute the attractors of a population's gears, many gears at once, with the same results as one after another."""

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
from rattle.populations.plan import Z_TESTS, PopulationPlan
from rattle.populations.tolerances import GearPoints

#: Largest number of samples that are followed at once. At weak damping each sample is observed longer than at strong
#: damping, so this number is divided by the ratio of the observation times.
SAMPLE_BLOCK = 65_536
#: Number of gears whose margins are computed at once.
MARGIN_BLOCK = 64
#: Codes of verdicts: the gear was not tested; it passes; it fails; its samples do not decide whether it passes.
NOT_ASKED, PASSES, FAILS, UNKNOWN = range(4)
#: Names of the verdicts in the order of their codes.
VERDICTS = ("not_asked", "passes", "fails", "unknown")

Array = NDArray[np.float64]


class ComputedGears(NamedTuple):
    """The computed rows of a population, one for each gear.

    Attributes
    ----------
    part : ndarray of int, (n,)
        Number of the part of the `PopulationPlan` to which the row belongs.
    values : ndarray, (n, d)
        The numbers that vary.
    delta, epsilon, beta : ndarray, (n,)
        The dimensionless parameters.
    energy : ndarray, (n, count)
        Σv²/2 per forcing period on the attractor that each sample reaches, in rising order: 0 if the attractor is
        quiet, NaN (last) if the sample is undecided.
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


def compute_gears(plan: PopulationPlan, start: int, stop: int) -> ComputedGears:
    """Compute rows number start to stop − 1 of a population; a row depends only on the plan and the row's number."""
    rows = np.arange(start, stop)
    part, values = plan.parts(rows), plan.values(rows)
    points = plan.tolerances.points(values)
    energy = np.empty((rows.size, plan.count))
    at = points.parameters
    for here in divide_gears_into_slices(at.delta, plan.count):
        seeds = part[here]
        for each in np.unique(seeds):
            of = np.arange(here.start, here.stop)[seeds == each]
            energy[of] = sorted_energies(plan, points.take(of), plan.count, plan.seed + int(each))
    verdict = np.full(rows.size, NOT_ASKED)
    asked = plan.flag_judged_rows(rows)
    verdict[asked] = judge_gears(plan, points.take(asked))
    return ComputedGears(part, values, at.delta, at.epsilon, at.beta, energy, verdict)


def divide_gears_into_slices(delta: Array, count: int) -> list[slice]:
    """Divide gears into slices; the gears of a slice are followed at once, in some seconds if all motions are chaotic.

    delta (n,): δ of each gear. count: the number of samples of a gear.

    Returns
    -------
    list[slice]
        Slices that together cover all n gears, in their order.
    """
    longer = np.maximum(1.0, WATCH / (PERIODS * delta.min(initial=1.0)))
    size = max(1, int(SAMPLE_BLOCK / longer) // count)
    return [slice(start, min(start + size, delta.size)) for start in range(0, delta.size, size)]


def sorted_energies(plan: PopulationPlan, points: GearPoints, count: int, seed: int) -> Array:
    """Return Σv²/2 per forcing period on the attractor of each sample (n, count), sorted within each gear.

    Returns
    -------
    Array
        The energies; NaN, which is last, for undecided samples.
    """
    found = np.empty((points.parameters.size, count))
    for rows, few in points.group_by_harmonics():
        tau, v = initial_states(plan, few, count, seed)
        table, row, cells, how = follow_gears(few, tau, v, plan.budget)
        energy = intensities_of(table, cells, how).energy
        decided = np.where(table.kind == Outcome.UNDECIDED, np.nan, energy)
        found[rows] = np.sort(decided[row].reshape(tau.shape), axis=1)
    return found


def follow_gears(
    points: GearPoints, tau: Array, v: Array, budget: int
) -> tuple[AttractorTable, NDArray[np.int64], Any, Stretch]:
    """Follow states (n, count) of n gears to their attractors.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64], Any, Stretch]
        The table of attractors; the row of each state's attractor in the table; the cells, one for each gear; and the
        function that continues chaotic motions. `intensities_of` takes the table, the cells and the function.
    """
    model = MODELS[points.parameters.model]
    found = model.classify_states(points.parameters, tau, v, budget)
    return *tabulate_attractors(found), found.cells, model.functions.stretch


def initial_states(plan: PopulationPlan, points: GearPoints, count: int, seed: int) -> tuple[Array, Array]:
    """Return the initial states (n, count) of gears: as in `Gear.attractors`, or after a shock if the plan has one.

    Returns
    -------
    tuple[Array, Array]
        Phases and speeds (n, count).
    """
    at = points.parameters
    if plan.shock is None:
        return SampleSpec(count, NATURAL, seed).draw_states(at)
    first, second = initial_conditions(at.delta, at.epsilon, at.beta, count, 1.0, seed)
    speed = values_at_quantiles(plan.shock.speed, second)
    unit = 1.0 if points.units is None else np.broadcast_to(points.units.velocity, at.shape)[:, None]
    return values_at_quantiles(plan.shock.phase, first) % 1.0, np.ascontiguousarray(speed / unit)


def values_at_quantiles(given: float | str | Distribution, u: Array) -> Array:
    """Return the quantiles of a distribution at u; if `given` is a number, return this number for each u."""
    if isinstance(given, Distribution):
        return given.quantile(np.clip(u, LEAST, 1.0 - LEAST))
    return np.full(u.shape, float(given))


def judge_gears(plan: PopulationPlan, points: GearPoints) -> NDArray[np.int64]:
    """Test whether gears (n,) meet the plan's requirement on their margin or on their share of quiet runs.

    For the share, samples are added until the verdict is certain at 95 % confidence. The test is made at each number of
    samples in `PopulationPlan.sample_counts`.

    Returns
    -------
    NDArray[np.int64]
        PASSES, FAILS or UNKNOWN for each gear.
    """
    if plan.margin is not None:
        least = plan.margin if points.units is None else plan.margin / points.units.velocity
        at = points.parameters
        found = np.full(at.size, np.nan)
        for start in range(0, found.size, MARGIN_BLOCK):
            few = slice(start, start + MARGIN_BLOCK)
            found[few] = boundary_distances(at.delta[few], at.epsilon[few], at.beta[few], NATURAL).v
        return np.where(np.isnan(found), UNKNOWN, np.where(found > least, PASSES, FAILS))
    verdict = np.full(points.parameters.size, UNKNOWN)
    quiet, rattling, before = np.zeros(verdict.size), np.zeros(verdict.size), 0
    for look, after in enumerate(plan.sample_counts):
        open_ = np.flatnonzero(verdict == UNKNOWN)
        here = points.take(open_)
        for rows in divide_gears_into_slices(here.parameters.delta, after - before):
            seed = plan.seed + (look + 1 << 64)  # larger than any seed of the plan's parts, plan.seed + part
            found = sorted_energies(plan, here.take(rows), after - before, seed)
            quiet[open_[rows]] += (found == 0.0).sum(axis=1)
            rattling[open_[rows]] += (found > 0.0).sum(axis=1)
        low, _ = wilson_interval(quiet[open_], after, Z_TESTS)
        _, high = wilson_interval(after - rattling[open_], after, Z_TESTS)
        share = plan.share or 0.0
        verdict[open_[low >= share]], verdict[open_[high < share]] = PASSES, FAILS
        before = after
    return verdict
