"""Answers about a population of gears, with 95 % intervals: quiet probability, yield, intensity, Sobol indices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError, require, require_one_of
from rattle.numerics.sampling import Z_95, wilson_interval
from rattle.populations.gears import FAILS, NOT_ASKED, PASSES, ComputedGears
from rattle.populations.plan import AGAIN, PopulationPlan

#: Quantiles of the intensity that `Population.intensity` returns by default.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
#: Number of gears that `Population.worst` returns by default.
MOST_WORST = 10
#: Least number of gears for which a mean over the gears counts as normally distributed. Sobol indices need at least as
#: many gears with decided samples.
FEWEST = 30
#: Outputs of a gear whose Sobol indices are computed: its share of quiet runs, and its mean energy.
OUTPUTS = ("quiet", "energy")

Array = NDArray[np.float64]


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


class SobolIndex(NamedTuple):
    """The Sobol indices of a number that varies: how much of an output's variance is due to this number.

    first: the share of the variance that the number causes alone. total: the share that it causes alone and together
    with other numbers.
    Sources: Sobol, Mathematics and Computers in Simulation 55 (2001) 271–280; for correlated numbers, whose first index
    may exceed the total one, Kucherenko, Tarantola and Annoni, Computer Physics Communications 183 (2012) 937–946.
    """

    first: Estimate
    total: Estimate


class WorstGear(NamedTuple):
    """One of the gears with the largest mean energy.

    row: the number of the gear in the population. numbers: the values of the numbers that vary, by name. quiet: the
    share of the gear's runs that are quiet. energy: the mean over its runs of Σv²/2 per forcing period; for a machine
    the mean power in W.
    """

    row: int
    numbers: dict[str, float]
    quiet: float
    energy: float


@dataclass(frozen=True, eq=False)
class Population:
    """A computed population of gears: its plan, its rows, and methods that answer questions about it.

    Energies are Σv²/2 per forcing period in the model's unit. For machines, `watts_per_power_unit` is this unit in W.
    """

    plan: PopulationPlan
    rows: ComputedGears

    @property
    def gears(self) -> ComputedGears:
        """The gears of the population itself, without the additional gears that Sobol indices need."""
        return ComputedGears._make(column[: self.plan.gears] for column in self.rows)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers that vary."""
        return self.plan.tolerances.names

    @cached_property
    def quiet(self) -> Estimate:
        """The probability that a random gear runs quietly after a random start: a random state, or the plan's shock.

        Undecided samples widen the interval; in the value they count as not quiet.
        """
        energy = self.gears.energy
        low = mean_of_shares((energy == 0.0).mean(axis=1))
        return Estimate(low.value, low.low, mean_of_shares((~(energy > 0.0)).mean(axis=1)).high)

    @property
    def undecided(self) -> float:
        """The share of undecided samples among all samples of the population."""
        return float(np.isnan(self.gears.energy).mean())

    @cached_property
    def passing(self) -> Estimate | None:
        """The yield: the share of the tested gears that pass; None if the plan has no requirement.

        A gear whose verdict is unknown widens the interval, and counts in the value as half a gear that passes.
        """
        verdict = self.gears.verdict
        asked = int((verdict != NOT_ASKED).sum())
        if not asked:
            return None
        passes, fails = int((verdict == PASSES).sum()), int((verdict == FAILS).sum())
        (low, _), (_, high) = wilson_interval(passes, asked), wilson_interval(asked - fails, asked)
        return Estimate(0.5 * (passes + asked - fails) / asked, float(low), float(high))

    @property
    def watts_per_power_unit(self) -> Array | float:
        """The power in W of one unit of energy per forcing period, for each gear (n,); 1 if gears are not machines."""
        units = self.plan.tolerances.points(self.gears.values).units
        return 1.0 if units is None else np.broadcast_to(units.power, len(self.gears.values))

    def intensity(self, quantiles: Sequence[float] = QUANTILES) -> dict[float, Estimate]:
        """Return quantiles of the energy per forcing period; for machines quantiles of the power in watts.

        The distribution is that of a random gear after a random start: a random state, or the plan's shock.

        Parameters
        ----------
        quantiles : Sequence[float]
            Numbers between 0 and 1.

        Returns
        -------
        dict[float, Estimate]
            Each quantile of the argument, with its value and 95 % interval. An end of an interval is infinite if the
            population has too few gears.

        Raises
        ------
        ParameterError
            If a quantile is not between 0 and 1.
        RattleError
            If all samples are undecided.
        """
        require(all(0.0 < q < 1.0 for q in quantiles), f"quantiles must be between 0 and 1, got {quantiles}")
        power = np.asarray(self.watts_per_power_unit)
        energy = self.gears.energy * (power[:, None] if power.ndim else power)
        if np.isnan(energy).all():
            raise RattleError("all samples of all gears are undecided: make `budget`, the number of impacts, larger")
        return {q: quantile_estimate(energy, q) for q in quantiles}

    def worst(self, most: int = MOST_WORST) -> tuple[WorstGear, ...]:
        """Return up to `most` gears with the largest mean energy (for machines the mean power in W), largest first."""
        gears = self.gears
        quiet, energy = (gears.energy == 0.0).mean(axis=1), row_means(gears.energy) * self.watts_per_power_unit
        order = np.argsort(-np.nan_to_num(energy, nan=-1.0), kind="stable")[:most]
        numbers = [dict(zip(self.names, map(float, gears.values[i]), strict=True)) for i in order]
        rows = zip(order, numbers, strict=True)
        return tuple(WorstGear(int(i), each, float(quiet[i]), float(energy[i])) for i, each in rows)

    def indices(self, of: str = "quiet") -> dict[str, SobolIndex]:
        """Return the Sobol indices, first and total, of each number that varies.

        Parameters
        ----------
        of : str
            The output whose variance is explained: "quiet", a gear's share of quiet runs, or "energy", its mean energy.

        Returns
        -------
        dict[str, SobolIndex]
            The indices of each number, by its name. If only one number varies, both of its indices are 1.

        Raises
        ------
        ParameterError
            If `of` is neither "quiet" nor "energy".
        RattleError
            If the population was computed with `pairs` = 0, fewer than FEWEST gears have decided samples, or the output
            does not vary significantly between gears. There is no error if only one number varies.
        """
        require_one_of("of", of, OUTPUTS)
        if len(self.names) == 1:
            whole = Estimate(1.0, 1.0, 1.0)
            return {self.names[0]: SobolIndex(whole, whole)}
        if not self.plan.rows_per_sobol_part:
            raise RattleError("Sobol indices need additional gears, but `pairs` is 0: give `pairs` above 0")
        energy = self.rows.energy
        output = (energy == 0.0).mean(axis=1) if of == "quiet" else row_means(energy)
        parts = {part: output[self.plan.rows_of_part(part)] for part in range(AGAIN, int(self.rows.part.max()) + 1)}
        base = output[: self.plan.rows_per_sobol_part]
        return {
            name: SobolIndex(
                covariance_ratio(base, parts[self.plan.part_that_keeps_number(i)], parts[AGAIN]),
                subtract_from_one(covariance_ratio(base, parts[self.plan.part_that_redraws_number(i)], parts[AGAIN])),
            )
            for i, name in enumerate(self.names)
        }


def row_means(energy: Array) -> Array:
    """Return the mean (n,) of each row of an array (n, count). NaN are left out; the mean is NaN if all are NaN."""
    known = (~np.isnan(energy)).sum(axis=1)
    return np.divide(np.nansum(energy, axis=1), known, out=np.full(len(energy), np.nan), where=known > 0)


def mean_of_shares(shares: Array) -> Estimate:
    """Return the mean of the shares (n,) of independent gears, each a share of the gear's runs.

    The interval is Wilson's, for the number of independent yes-or-no samples whose mean would have the same variance.
    If all shares are equal, or there are fewer than FEWEST gears, each gear counts as one such sample.

    Returns
    -------
    Estimate
        The mean, between 0 and 1, with its 95 % interval.
    """
    n, mean = shares.size, float(shares.mean())
    variance = float(shares.var(ddof=1)) / n
    alike = variance == 0.0 or n < FEWEST
    samples = n if alike else mean * (1.0 - mean) / variance
    low, high = wilson_interval(mean * samples, samples)
    return Estimate(mean, float(low), float(high))


def quantile_estimate(values: Array, q: float) -> Estimate:
    """Estimate the quantile q of values (n, count), whose rows are independent; values that are NaN are ignored.

    The interval takes account of the correlation between the values of one row. An end of the interval is infinite if
    there are too few rows to bound the quantile on that side.

    Returns
    -------
    Estimate
        The quantile with its 95 % interval.
    """
    known = np.sort(values[~np.isnan(values)])
    value = float(known[min(int(q * known.size), known.size - 1)])
    below = row_means(np.where(np.isnan(values), np.nan, values <= value))
    below = below[~np.isnan(below)]
    deviation = max(float(below.std()), np.sqrt(q * (1.0 - q) / values.shape[1])) / np.sqrt(below.size)
    low, high = (int(np.floor((q + sign * Z_95 * deviation) * known.size)) for sign in (-1, 1))
    return Estimate(
        value,
        float(known[low]) if low >= 0 else -np.inf,
        float(known[high]) if high < known.size else np.inf,
    )


def covariance_ratio(base: Array, other: Array, again: Array) -> Estimate:
    """Estimate Cov(base, other)/Cov(base, again) over gears (n,), from which Sobol indices are computed.

    base, again: outputs of the same gears from different initial states, so that sampling errors do not add to the
    covariance. other: outputs of n other gears; gear i of them has some of its numbers in common with gear i of base.
    The interval is by the delta method.

    Returns
    -------
    Estimate
        The ratio, limited to [0, 1], with its interval.

    Raises
    ------
    RattleError
        If fewer than FEWEST gears have decided samples, or the outputs of the gears do not differ significantly.
    """
    known = ~np.isnan(base + other + again)
    if known.sum() < FEWEST:
        raise RattleError(
            f"Sobol indices need {FEWEST} gears with decided samples, but only {known.sum()} have them: make `pairs` "
            "or `budget` larger"
        )
    x, y, z = (each[known] - each[known].mean() for each in (base, other, again))
    # in `shared`, the mean of `base` and `again` takes the place of `base`, because it has less noise
    same, shared = x * z, 0.5 * (x + z) * y
    whole, error = float(same.mean()), 1.0 / np.sqrt(same.size)
    if whole <= Z_95 * float(same.std()) * error:
        raise RattleError(
            "Sobol indices cannot be estimated, because the gears differ by no more than their sampling errors: make "
            "`pairs` or `count` larger"
        )
    value = float(shared.mean()) / whole
    deviation = float((shared - value * same).std()) * error / whole
    return Estimate(*(float(np.clip(value + step * Z_95 * deviation, 0.0, 1.0)) for step in (0, -1, 1)))


def subtract_from_one(estimate: Estimate) -> Estimate:
    """Return the estimate of 1 − x, with the interval of 1 − x, from the estimate of a number x."""
    return Estimate(1.0 - estimate.value, 1.0 - estimate.high, 1.0 - estimate.low)
