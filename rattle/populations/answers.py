"""Answers about a population of gears, with 95 % intervals: quiet probability, yield, intensity, sensitivity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError, require, require_one_of
from rattle.numerics.sampling import Z_95, wilson_interval
from rattle.populations.gears import FAILS, NOT_ASKED, PASSES, Gears
from rattle.populations.plan import AGAIN, Plan

#: Default quantiles of the intensity.
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
#: Default number of worst gears.
WORST = 10
#: Least number of gears whose mean is approximately normal.
FEWEST = 30
#: Outputs that have Sobol indices.
OUTPUTS = ("quiet", "energy")

Array = NDArray[np.float64]


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


class Index(NamedTuple):
    """The Sobol indices of one number: its shares of the variance of an output.

    first: the share that the number causes alone. total: the share that the number causes alone and in interaction with
    other numbers.
    Sources: Sobol, Mathematics and Computers in Simulation 55 (2001) 271–280; for correlated numbers, whose first index
    may exceed the total one, Kucherenko, Tarantola and Annoni, Computer Physics Communications 183 (2012) 937–946.
    """

    first: Estimate
    total: Estimate


class Worst(NamedTuple):
    """A gear of the population with a large intensity.

    row: the gear's row. numbers: its varying numbers by name. quiet: its share of quiet runs.
    energy: the mean of Σv²/2 per revolution over its runs; for a machine the mean power in W.
    """

    row: int
    numbers: dict[str, float]
    quiet: float
    energy: float


@dataclass(frozen=True, eq=False)
class Population:
    """A population of gears: its plan, its computed rows, and methods that answer questions about it.

    Energies are Σv²/2 per revolution in the model's unit. For machines `power` converts them to watts.
    """

    plan: Plan
    rows: Gears

    @property
    def gears(self) -> Gears:
        """The gears of the population itself, without the further gears for Sobol indices."""
        return Gears._make(column[: self.plan.gears] for column in self.rows)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers that vary."""
        return self.plan.tolerances.names

    @cached_property
    def quiet(self) -> Estimate:
        """The probability that a random gear, started from a random state, runs quietly.

        Undecided samples widen the interval; in the value they count as not quiet.
        """
        energy = self.gears.energy
        low = mean_share((energy == 0.0).mean(axis=1))
        return Estimate(low.value, low.low, mean_share((~(energy > 0.0)).mean(axis=1)).high)

    @property
    def undecided(self) -> float:
        """The share of undecided samples."""
        return float(np.isnan(self.gears.energy).mean())

    @cached_property
    def passing(self) -> Estimate | None:
        """The yield: the share of gears that pass, of all that were tested; None if the plan has no requirement.

        Gears whose verdict is unknown widen the interval; in the value each of them counts as half a gear that passes.
        """
        verdict = self.gears.verdict
        asked = int((verdict != NOT_ASKED).sum())
        if not asked:
            return None
        passes, fails = int((verdict == PASSES).sum()), int((verdict == FAILS).sum())
        (low, _), (_, high) = wilson_interval(passes, asked), wilson_interval(asked - fails, asked)
        return Estimate(0.5 * (passes + asked - fails) / asked, float(low), float(high))

    @property
    def power(self) -> Array | float:
        """The power in W for an energy of 1 per revolution, for each gear (n,) of the population; 1 if not machines."""
        units = self.plan.tolerances.points(self.gears.values).units
        return 1.0 if units is None else np.broadcast_to(units.power, len(self.gears.values))

    def intensity(self, quantiles: Sequence[float] = QUANTILES) -> dict[float, Estimate]:
        """Return quantiles of the energy per revolution, or of the power in watts of a machine.

        The distribution is that of a random gear started from a random state.

        Parameters
        ----------
        quantiles : Sequence[float]
            Numbers between 0 and 1.

        Returns
        -------
        dict[float, Estimate]
            The quantiles with 95 % intervals; an end of an interval is infinite if the population has too few gears.

        Raises
        ------
        ParameterError
            If a quantile is not between 0 and 1.
        RattleError
            If all samples are undecided.
        """
        require(all(0.0 < q < 1.0 for q in quantiles), "quantiles must be between 0 and 1")
        power = np.asarray(self.power)
        energy = self.gears.energy * (power[:, None] if power.ndim else power)
        if np.isnan(energy).all():
            raise RattleError("all samples of all gears are undecided: allow more impacts (budget)")
        return {q: quantile(energy, q) for q in quantiles}

    def worst(self, most: int = WORST) -> tuple[Worst, ...]:
        """Return the gears with the largest mean energy, or mean power in watts; most: the number of gears."""
        gears = self.gears
        quiet, energy = (gears.energy == 0.0).mean(axis=1), means(gears.energy) * self.power
        order = np.argsort(-np.nan_to_num(energy, nan=-1.0), kind="stable")[:most]
        numbers = [dict(zip(self.names, map(float, gears.values[i]), strict=True)) for i in order]
        rows = zip(order, numbers, strict=True)
        return tuple(Worst(int(i), each, float(quiet[i]), float(energy[i])) for i, each in rows)

    def indices(self, of: str = "quiet") -> dict[str, Index]:
        """Return the Sobol indices, first and total, of each number that varies.

        Parameters
        ----------
        of : str
            The output: "quiet", a gear's share of quiet runs, or "energy", its mean energy.

        Returns
        -------
        dict[str, Index]
            The indices by the name of the number.

        Raises
        ------
        ParameterError
            If `of` is neither "quiet" nor "energy".
        RattleError
            If the output does not vary significantly between gears, or `pairs` is 0.
        """
        require_one_of("of", of, OUTPUTS)
        if len(self.names) == 1:
            whole = Estimate(1.0, 1.0, 1.0)
            return {self.names[0]: Index(whole, whole)}
        if not self.plan.sharing:
            raise RattleError("Sobol indices need gears that share numbers: give `pairs` above 0")
        energy = self.rows.energy
        output = (energy == 0.0).mean(axis=1) if of == "quiet" else means(energy)
        parts = {part: output[self.plan.rows_of(part)] for part in range(AGAIN, int(self.rows.part.max()) + 1)}
        base = output[: self.plan.sharing]
        return {
            name: Index(
                ratio(base, parts[self.plan.part_keeping(i)], parts[AGAIN]),
                one_less(ratio(base, parts[self.plan.part_redrawing(i)], parts[AGAIN])),
            )
            for i, name in enumerate(self.names)
        }


def means(energy: Array) -> Array:
    """Return the mean of each row over its values that are not NaN; NaN if all values of the row are NaN."""
    known = (~np.isnan(energy)).sum(axis=1)
    return np.divide(np.nansum(energy, axis=1), known, out=np.full(len(energy), np.nan), where=known > 0)


def mean_share(shares: Array) -> Estimate:
    """Return the mean of the shares of independent gears (n,).

    The interval is Wilson's, for the number of independent samples that would have the variance of these shares. If all
    shares are equal, or there are fewer than FEWEST gears, each gear counts as one sample.

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


def quantile(values: Array, q: float) -> Estimate:
    """Return a quantile of values (n, count), whose rows are independent; NaN is ignored.

    The interval contains the values that may be the true quantile, given the variance between rows.

    Returns
    -------
    Estimate
        The quantile with its 95 % interval.
    """
    known = np.sort(values[~np.isnan(values)])
    value = float(known[min(int(q * known.size), known.size - 1)])
    below = means(np.where(np.isnan(values), np.nan, values <= value))
    below = below[~np.isnan(below)]
    deviation = max(float(below.std()), np.sqrt(q * (1.0 - q) / values.shape[1])) / np.sqrt(below.size)
    low, high = (int(np.floor((q + sign * Z_95 * deviation) * known.size)) for sign in (-1, 1))
    return Estimate(
        value,
        float(known[low]) if low >= 0 else -np.inf,
        float(known[high]) if high < known.size else np.inf,
    )


def ratio(base: Array, other: Array, again: Array) -> Estimate:
    """Estimate Cov(base, other)/Cov(base, again) over gears (n,), with its interval by the delta method.

    base, again: outputs of the same gears from different samples of initial states, so that sampling errors do not add
    to the covariance. other: outputs of gears that have some numbers in common with these gears.

    Returns
    -------
    Estimate
        The ratio with its interval.

    Raises
    ------
    RattleError
        If too few gears are decided, or the gears do not differ significantly.
    """
    known = ~np.isnan(base + other + again)
    if known.sum() < FEWEST:
        raise RattleError(f"fewer than {FEWEST} of the gears that share numbers are decided: give more pairs")
    x, y, z = (each[known] - each[known].mean() for each in (base, other, again))
    same, shared = x * z, 0.5 * (x + z) * y  # the mean over both samples of the same gears
    whole, error = float(same.mean()), 1.0 / np.sqrt(same.size)
    if whole <= Z_95 * float(same.std()) * error:
        raise RattleError(
            "the gears differ by no more than the sampling error of each: give more pairs, or a larger count"
        )
    value = float(shared.mean()) / whole
    deviation = float((shared - value * same).std()) * error / whole
    return Estimate(*(float(np.clip(value + step * Z_95 * deviation, 0.0, 1.0)) for step in (0, -1, 1)))


def one_less(of: Estimate) -> Estimate:
    """Return 1 minus an estimate, with its interval."""
    return Estimate(1.0 - of.value, 1.0 - of.high, 1.0 - of.low)
