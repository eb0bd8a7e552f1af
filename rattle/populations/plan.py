"""Plan a population: its gears and the computed quantities, each row by its number alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import BUDGET
from rattle.attractors.speeds import LARGEST_BUDGET
from rattle.errors import require, require_integer, require_number
from rattle.models import Capability, require_capability
from rattle.populations.distributions import Distribution, Uniform, distribution_of
from rattle.populations.tolerances import Tolerances

POPULATION, AGAIN, FIRST_SHARING = 0, 1, 2  # parts
MOST_GEARS, MOST_COUNT = 10_000_000, 65_536
MOST_SAMPLES = 1 << 24  # what is answered of all needs some copies of them, eight bytes each
PAIRS, JUDGED = 1024, 256
LARGEST_SEED = 2**64 - 1
MOST_SHARE = 0.9999
ANY_PHASE = Uniform(0.0, 1.0)
FRESH = 1  # stream of numbers that are drawn anew

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shock:
    """A knock that parts resting teeth.

    The speed with which they leave, in m/s along the line of action for a machine, else the model's, and the phase, by
    default any. Each is a number or a distribution. Raises ParameterError.
    """

    speed: float | str | Distribution
    phase: float | str | Distribution = ANY_PHASE

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name in ("speed", "phase"):
            value = getattr(self, name)
            read = distribution_of(value) if isinstance(value, str) else value
            object.__setattr__(self, name, read)
            if isinstance(read, Distribution):
                require(name == "phase" or read.range[0] > 0.0, f"the {name} of a shock must be above 0")
            else:
                object.__setattr__(self, name, require_number(name, read, positive=name == "speed"))


@dataclass(frozen=True, eq=False)
class Plan:
    """The question: see `rattle.population`.

    Rows are counted through the parts: the population; its first `pairs` gears again; these with one of their varying
    numbers kept and the others drawn anew, for each number; and with all kept but one, for each. With one number that
    varies there is the population alone. Raises ParameterError.
    """

    tolerances: Tolerances
    gears: int = 4096
    count: int = 16
    share: float | None = None
    margin: float | None = None
    shock: Shock | None = None
    judged: int = JUDGED
    pairs: int = PAIRS
    seed: int = 0
    budget: int = BUDGET

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        require_integer("gears", self.gears, 2, MOST_GEARS)
        require_integer("count", self.count, 1, MOST_COUNT)
        require_integer("seed", self.seed, 0, LARGEST_SEED)
        require_integer("budget", self.budget, 1, LARGEST_BUDGET)
        require_integer("pairs", self.pairs, 0, MOST_GEARS)
        require_integer("judged", self.judged, 1, MOST_GEARS)
        by_one = self.share is None or self.margin is None
        require(by_one, "a gear passes by its share of quiet runs or by its margin: give one")
        samples = self.rows * self.count
        require(
            samples <= MOST_SAMPLES,
            f"{self.rows} gears, with those that share numbers, of {self.count} states each are {samples}, at most "
            f"{MOST_SAMPLES}: lower count first, which tells least",
        )
        if self.share is not None:
            share = require_number("share", self.share, positive=True)
            require(share <= MOST_SHARE, f"share must be at most {MOST_SHARE}, got {share:g}: no sample tells more")
        if self.margin is not None:
            require_number("margin", self.margin, positive=True)
            require_capability(Capability.MARGIN, self.tolerances.model)

    @cached_property
    def sharing(self) -> int:
        """Gears that have others which share numbers with them."""
        return min(self.pairs, self.gears) if len(self.tolerances.names) > 1 else 0

    @cached_property
    def judging(self) -> int:
        """Gears that are asked whether they pass."""
        return 0 if self.share is None and self.margin is None else min(self.judged, self.gears)

    @property
    def rows(self) -> int:
        """Rows of all parts."""
        return self.gears + self.sharing * (1 + 2 * len(self.tolerances.names))

    def asked(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether each row is a gear that is asked whether it passes: they are spread over the population."""
        number = rows * self.judging // self.gears
        return np.asarray((rows < self.gears) & (number != (rows - 1) * self.judging // self.gears))

    def parts(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the part of each row."""
        return np.where(rows < self.gears, POPULATION, AGAIN + (rows - self.gears) // max(self.sharing, 1))

    def rows_of(self, part: int) -> slice:
        """Return the rows of a part."""
        if part == POPULATION:
            return slice(0, self.gears)
        start = self.gears + (part - AGAIN) * self.sharing
        return slice(start, start + self.sharing)

    def keeping(self, i: int) -> int:
        """Return the part of gears that keep the i-th number alone."""
        return FIRST_SHARING + i

    def but(self, i: int) -> int:
        """Return the part of gears that keep all numbers but the i-th."""
        return FIRST_SHARING + len(self.tolerances.names) + i

    def values(self, rows: NDArray[np.int64]) -> Array:
        """Return the varying numbers (n, d) of these rows."""
        copula, varying = self.tolerances.copula, len(self.tolerances.names)
        parts = self.parts(rows)
        base = np.where(parts == POPULATION, rows, (rows - self.gears) % max(self.sharing, 1))
        z = copula.draws(self.seed, 0, base)
        shared = parts >= FIRST_SHARING
        if shared.any():
            fresh = copula.draws(self.seed, FRESH, base[shared])
            of, part, found = z[shared], parts[shared], z[shared]
            for i in range(varying):
                for here, draw in ((part == self.keeping(i), copula.keeping), (part == self.but(i), copula.but)):
                    found[here] = draw(i, of[here], fresh[here])
            z[shared] = found
        return self.tolerances.values(z)

    @property
    def looks(self) -> tuple[int, ...]:
        """Samples after which a gear is judged by its share: few tell one that is far from it."""
        share = self.share or 0.5
        fewest = math.ceil(Z_LOOKS**2 * share / (1.0 - share))
        return tuple(sorted({FEW, fewest + 1, 4 * (fewest + 1)}))


FEW = 32
Z_LOOKS = 2.393979799818671  # 95 % over three looks: the point of the normal distribution for 1 − 0.05/6
