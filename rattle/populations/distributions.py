"""Distributions, over a population, of a number that describes a gear, such as δ or the backlash."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.errors import ParameterError, did_you_mean, require, require_finite, require_number, require_real_array
from rattle.populations.normal import ndtr, ndtri

#: Numbers are drawn between the quantiles LEAST and 1 − LEAST of their distribution, so that none is infinite; a number
#: with a normal distribution is within 6.3 standard deviations of its mean.
LEAST = 2.0**-33
#: Least probability that a normal distribution must have between the values low and high at which it is cut off.
LEAST_PROBABILITY = 1e-6

Array = NDArray[np.float64]


class Distribution(ABC):
    """The distribution, over a population, of one of the numbers that describe a gear, such as δ or the backlash.

    It is the base class of Normal, Uniform, Triangular, LogNormal and Measured.
    """

    @abstractmethod
    def quantile(self, u: Array) -> Array:
        """Return the quantiles of the distribution at u in (0, 1)."""

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest number that can be drawn."""
        low, high = self.quantile(np.array([LEAST, 1.0 - LEAST]))
        return float(low), float(high)


@dataclass(frozen=True)
class Normal(Distribution):
    """The normal distribution, cut off below low and above high if they are given, as by an inspection.

    Raises ParameterError unless deviation > 0 and the distribution has a probability above LEAST_PROBABILITY between
    low and high.
    """

    mean: float
    deviation: float
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        _convert_fields_to_float(self, "mean", "deviation")
        require(
            self.deviation > 0.0,
            f"a normal distribution must have a deviation above 0, got {self.deviation:g}: for a number that does not "
            f"vary give the number itself, {self.mean:g}",
        )
        for name in ("low", "high"):
            end = require_real_array(name, getattr(self, name))
            require(end.ndim == 0 and not np.isnan(end), f"{name} must be a number, got {getattr(self, name)!r}")
            object.__setattr__(self, name, float(end))
        require(self.low < self.high, f"low must be below high, got low {self.low:g} and high {self.high:g}")
        below, above = self._end_probabilities()
        require(
            above - below > LEAST_PROBABILITY,
            f"a normal distribution with mean {self.mean:g} and deviation {self.deviation:g} has almost no probability "
            f"between {self.low:g} and {self.high:g}: change low and high, or the mean",
        )

    def _end_probabilities(self) -> tuple[float, float]:
        """Return P(number < low) and P(number < high) for the normal distribution without the cut-off."""
        return tuple(float(ndtr((end - self.mean) / self.deviation)) for end in (self.low, self.high))  # type: ignore[return-value]

    def quantile(self, u: Array) -> Array:
        """Return the quantiles at u in (0, 1) of the distribution that is cut off at low and high."""
        below_low, below_high = self._end_probabilities()
        found = self.mean + self.deviation * ndtri(below_low + u * (below_high - below_low))
        return np.asarray(np.clip(found, self.low, self.high))


@dataclass(frozen=True)
class Uniform(Distribution):
    """The uniform distribution between low and high. Raises ParameterError unless low < high."""

    low: float
    high: float

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        _convert_fields_to_float(self, "low", "high")
        _require_low_below_high(self.low, self.high, "a uniform distribution")

    def quantile(self, u: Array) -> Array:
        """Return the quantiles at u in (0, 1)."""
        return self.low + u * (self.high - self.low)


@dataclass(frozen=True)
class Triangular(Distribution):
    """The triangular distribution, whose density rises linearly from low to the mode and falls to high.

    Raises ParameterError unless low ≤ mode ≤ high and low < high.
    """

    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        _convert_fields_to_float(self, "low", "mode", "high")
        _require_low_below_high(self.low, self.high, "a triangular distribution")
        require(
            self.low <= self.mode <= self.high,
            f"the mode must be from low to high, got mode {self.mode:g}, low {self.low:g} and high {self.high:g}",
        )

    def quantile(self, u: Array) -> Array:
        """Return the quantiles at u in (0, 1)."""
        width, left, right = self.high - self.low, self.mode - self.low, self.high - self.mode
        rising = self.low + np.sqrt(u * width * left)
        return np.where(u * width < left, rising, self.high - np.sqrt((1.0 - u) * width * right))


@dataclass(frozen=True)
class LogNormal(Distribution):
    """The log-normal distribution: the natural logarithm of the number is normal.

    `median` is the median of the number, and `deviation` the standard deviation of the logarithm; 0.1 means a scatter
    of about 10 %. Raises ParameterError unless both are above 0.
    """

    median: float
    deviation: float

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name in ("median", "deviation"):
            object.__setattr__(self, name, require_number(name, getattr(self, name), positive=True))

    def quantile(self, u: Array) -> Array:
        """Return the quantiles at u in (0, 1)."""
        return np.asarray(self.median * np.exp(self.deviation * ndtri(u)))


@dataclass(frozen=True)
class Measured(Distribution):
    """The distribution of measured values, which are equally probable; quantiles between them are interpolated.

    Raises ParameterError unless there are two different numbers.
    """

    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        values = np.sort(require_real_array("values", self.values))
        require(values.ndim == 1 and values.size >= 2, "measured values must be a list of at least two numbers")
        require(bool(np.isfinite(values).all()), "measured values must be finite")
        _require_low_below_high(float(values[0]), float(values[-1]), "the list of measured values")
        object.__setattr__(self, "values", tuple(values.tolist()))

    def quantile(self, u: Array) -> Array:
        """Return quantiles, interpolated between the values; value i of n is at u = (i + ½)/n."""
        n = len(self.values)
        return np.interp(u, (np.arange(n) + 0.5) / n, self.values)


#: The distributions by their names in text.
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "normal": Normal,
    "uniform": Uniform,
    "triangular": Triangular,
    "lognormal": LogNormal,
    "measured": Measured,
}


def parse_distribution(text: str) -> Distribution:
    """Parse a distribution from text NAME:NUMBER:NUMBER…, such as normal:15e-6:5e-6:0.

    The numbers are the fields of the distribution's class in their order. A normal distribution has the numbers mean,
    deviation, low and high; high, or low and high, may be left out.

    Returns
    -------
    Distribution
        The distribution.

    Raises
    ------
    ParameterError
        If the text is no distribution, or a number is outside its domain.
    """
    word, *rest = (part.strip() for part in text.split(":"))
    kind: Any = DISTRIBUTIONS.get(word)
    require(
        kind is not None and kind is not Measured,
        f"{text!r} is no distribution: write a number, or normal:MEAN:DEVIATION[:LOW[:HIGH]], uniform:LOW:HIGH, "
        f"triangular:LOW:MODE:HIGH or lognormal:MEDIAN:DEVIATION{did_you_mean(word, DISTRIBUTIONS)}",
    )
    try:
        numbers = [float(part) for part in rest]
    except ValueError:
        raise ParameterError(f"{text!r} is no distribution: after {word} write numbers, separated by colons") from None
    names = [each.name for each in fields(kind)]
    needed = [each.name for each in fields(kind) if each.name not in ("low", "high") or kind is not Normal]
    require(
        len(needed) <= len(numbers) <= len(names),
        f"{text!r} has {len(numbers)} numbers after {word}: give {', '.join(needed)}"
        + (", and low and high if the distribution is cut off" * (kind is Normal)),
    )
    found: Distribution = kind(*numbers)
    return found


def _convert_fields_to_float(distribution: Any, *names: str) -> None:
    """Convert the named fields of a distribution to float. Raises ParameterError unless they are finite numbers."""
    for name in names:
        object.__setattr__(distribution, name, require_finite(name, getattr(distribution, name)))


def _require_low_below_high(low: float, high: float, what: str) -> None:
    """Raise ParameterError unless low < high. what: words for the distribution, the subject of the message."""
    require(low <= high, f"low must be below high, got low {low:g} and high {high:g}")
    require(low < high, f"{what} has no spread: for a number that does not vary give the number itself, {low:g}")
