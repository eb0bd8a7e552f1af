"""The answers that the gears of a population give to what was asked of it, each with a 95 % interval."""

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

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
WORST = 10
FEWEST = 30  # gears from which on a mean is about normal
OUTPUTS = ("quiet", "energy")

Array = NDArray[np.float64]


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


class Index(NamedTuple):
    """The share of the variance of an output that one number makes: alone, and with all others that vary with it.

    Source: Sobol, Mathematics and Computers in Simulation 55 (2001) 271–280; of correlated numbers, where first may be
    above total, Kucherenko, Tarantola and Annoni, Computer Physics Communications 183 (2012) 937–946.
    """

    first: Estimate
    total: Estimate


class Worst(NamedTuple):
    """A gear of the population: its row, its numbers, its share of quiet runs, and the mean energy of all."""

    row: int
    numbers: dict[str, float]
    quiet: float
    energy: float


@dataclass(frozen=True, eq=False)
class Population:
    """A population of gears: its plan, its rows, and what follows from them.

    Energies are Σv²/2 per revolution; of a machine, `power` turns them into watts.
    """

    plan: Plan
    rows: Gears

    @property
    def gears(self) -> Gears:
        """The population itself: the rows of its first part."""
        return Gears._make(column[: self.plan.gears] for column in self.rows)

    @property
    def names(self) -> tuple[str, ...]:
        """The numbers that vary."""
        return self.plan.tolerances.names

    @cached_property
    def quiet(self) -> Estimate:
        """The probability that a gear runs quietly: a gear at random, from a state at random.

        What is undecided widens the interval, and counts as not quiet in the value.
        """
        energy = self.gears.energy
        low = mean_share((energy == 0.0).mean(axis=1))
        return Estimate(low.value, low.low, mean_share((~(energy > 0.0)).mean(axis=1)).high)

    @property
    def undecided(self) -> float:
        """The share of samples that no attractor could be told for."""
        return float(np.isnan(self.gears.energy).mean())

    @cached_property
    def passing(self) -> Estimate | None:
        """The yield: the share of gears that pass, of those that were asked.

        Unknown ones widen the interval, and count by halves in the value. None if nothing was asked.
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
        """Watts of a unit of energy in each gear of the population (n,); without a machine 1."""
        units = self.plan.tolerances.points(self.gears.values).units
        return 1.0 if units is None else np.broadcast_to(units.power, len(self.gears.values))

    def intensity(self, quantiles: Sequence[float] = QUANTILES) -> dict[float, Estimate]:
        """Return quantiles of the energy per revolution, or the power in watts of a machine.

        They are those of a gear at random from a state at random; an end of an interval that the population does not
        reach is infinite.

        Returns
        -------
        dict[float, Estimate]
            By quantile, each with its 95 % interval.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            Where all is undecided.
        """
        require(all(0.0 < q < 1.0 for q in quantiles), "quantiles must be between 0 and 1")
        power = np.asarray(self.power)
        energy = self.gears.energy * (power[:, None] if power.ndim else power)
        if np.isnan(energy).all():
            raise RattleError("nothing is known of any gear: allow more impacts (budget)")
        return {q: quantile(energy, q) for q in quantiles}

    def worst(self, most: int = WORST) -> tuple[Worst, ...]:
        """Return the gears whose mean energy, or power, is largest."""
        gears = self.gears
        quiet, energy = (gears.energy == 0.0).mean(axis=1), means(gears.energy) * self.power
        order = np.argsort(-np.nan_to_num(energy, nan=-1.0), kind="stable")[:most]
        numbers = [dict(zip(self.names, map(float, gears.values[i]), strict=True)) for i in order]
        rows = zip(order, numbers, strict=True)
        return tuple(Worst(int(i), each, float(quiet[i]), float(energy[i])) for i, each in rows)

    def indices(self, of: str = "quiet") -> dict[str, Index]:
        """Return the Sobol indices, first and total, of each number that varies.

        The output is a gear's share of quiet runs, or its mean "energy".

        Returns
        -------
        dict[str, Index]
            By name of the number.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        RattleError
            Where nothing varies, or no gears share numbers.
        """
        require_one_of("of", of, OUTPUTS)
        if len(self.names) == 1:
            whole = Estimate(1.0, 1.0, 1.0)
            return {self.names[0]: Index(whole, whole)}
        if not self.plan.sharing:
            raise RattleError("no gears share numbers: ask for pairs")
        energy = self.rows.energy
        output = (energy == 0.0).mean(axis=1) if of == "quiet" else means(energy)
        parts = {part: output[self.plan.rows_of(part)] for part in range(AGAIN, int(self.rows.part.max()) + 1)}
        base = output[: self.plan.sharing]
        return {
            name: Index(
                ratio(base, parts[self.plan.keeping(i)], parts[AGAIN]),
                one_less(ratio(base, parts[self.plan.but(i)], parts[AGAIN])),
            )
            for i, name in enumerate(self.names)
        }


def means(energy: Array) -> Array:
    """Return the mean over what is known of each row, NaN where nothing is."""
    known = (~np.isnan(energy)).sum(axis=1)
    return np.divide(np.nansum(energy, axis=1), known, out=np.full(len(energy), np.nan), where=known > 0)


def mean_share(shares: Array) -> Estimate:
    """Return the mean of shares of independent gears (n,).

    Its interval is Wilson's for as many independent samples as have the variance that the gears show; gears that are
    all alike count as one sample each.

    Returns
    -------
    Estimate
        Between 0 and 1, with the 95 % interval.
    """
    n, mean = shares.size, float(shares.mean())
    variance = float(shares.var(ddof=1)) / n
    alike = variance == 0.0 or n < FEWEST
    samples = n if alike else mean * (1.0 - mean) / variance
    low, high = wilson_interval(mean * samples, samples)
    return Estimate(mean, float(low), float(high))


def quantile(values: Array, q: float) -> Estimate:
    """Return the quantile of values (n, count) of independent rows.

    Its interval is where the share below it, with the variance that rows show, can be q. NaN does not count.

    Returns
    -------
    Estimate
        In the values' unit, with the 95 % interval.
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
    """Estimate Cov(base, other)/Cov(base, again) of gears (n,), by the delta method.

    `again` are the same gears with other samples, so that the variation of samples is no part of it.

    Returns
    -------
    Estimate
        The ratio with its interval.

    Raises
    ------
    RattleError
        Where nothing varies.
    """
    known = ~np.isnan(base + other + again)
    if known.sum() < FEWEST:
        raise RattleError(f"fewer than {FEWEST} gears share numbers and are decided: ask for more pairs")
    x, y, z = (each[known] - each[known].mean() for each in (base, other, again))
    same, shared = x * z, 0.5 * (x + z) * y  # either sample of the same gears
    whole, error = float(same.mean()), 1.0 / np.sqrt(same.size)
    if whole <= Z_95 * float(same.std()) * error:
        raise RattleError(
            "the gears do not differ by more than their samples do: ask for more pairs, or a larger count"
        )
    value = float(shared.mean()) / whole
    deviation = float((shared - value * same).std()) * error / whole
    return Estimate(*(float(np.clip(value + step * Z_95 * deviation, 0.0, 1.0)) for step in (0, -1, 1)))


def one_less(of: Estimate) -> Estimate:
    """Return 1 − a share, with its interval."""
    return Estimate(1.0 - of.value, 1.0 - of.high, 1.0 - of.low)
