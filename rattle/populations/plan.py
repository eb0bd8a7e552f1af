"""The plan of a population: the gears that are computed, one for each row, and their initial states."""

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
from rattle.populations.distributions import Distribution, Uniform, parse_distribution
from rattle.populations.tolerances import Tolerances

#: Numbers of the parts into which the rows of a plan are divided. POPULATION: the gears of the population. AGAIN: the
#: population's first gears once more, with other samples. FIRST_REDRAWN and above: the same first gears, with some of
#: their numbers drawn again.
POPULATION, AGAIN, FIRST_REDRAWN = 0, 1, 2
#: Largest allowed numbers of gears, and of samples of a gear.
MOST_GEARS, MOST_COUNT = 10_000_000, 65_536
#: Largest allowed number of samples of all rows together. Answers hold several numbers of eight bytes for each sample
#: in memory.
MOST_SAMPLES = 1 << 24
#: Default values of the arguments `pairs` and `judged` of `rattle.population`.
PAIRS, JUDGED = 1024, 256
#: Largest allowed seed.
LARGEST_SEED = 2**64 - 1
#: Largest share of quiet runs that can be required.
MOST_SHARE = 0.9999
#: Distribution of a phase that is random.
ANY_PHASE = Uniform(0.0, 1.0)
#: Index of the random stream of the numbers that are drawn again for Sobol indices; stream 0 draws the population.
REDRAWN_STREAM = 1

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shock:
    """A shock that separates teeth in contact on Σ⁺, as the start of a run.

    speed: the speed of departure, in m/s along the line of action for a machine, else in the model's unit.
    phase: the phase of the forcing at the departure; by default it is random.
    Speed and phase may be numbers or distributions. Raises ParameterError unless all speeds are above 0.
    """

    speed: float | str | Distribution
    phase: float | str | Distribution = ANY_PHASE

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name in ("speed", "phase"):
            value = getattr(self, name)
            read = parse_distribution(value) if isinstance(value, str) else value
            object.__setattr__(self, name, read)
            if isinstance(read, Distribution):
                least = read.range[0]
                require(
                    name == "phase" or least > 0.0,
                    f"the {name} of a shock must be above 0, but its distribution reaches down to {least:g}: cut it "
                    "off above 0",
                )
            else:
                object.__setattr__(self, name, require_number(name, read, positive=name == "speed"))


@dataclass(frozen=True, eq=False)
class PopulationPlan:
    """The plan of a population; the fields are the arguments of `rattle.population`.

    Each row is one gear. Rows are numbered consecutively through the parts of the plan. The first part is the
    population. All other parts are for Sobol indices, and have `rows_per_sobol_part` gears each. The second part
    repeats the first gears of the population, with other samples. Then each varying number has a part with these
    gears, in which this number is kept and all other numbers are drawn again. After these parts, each varying number
    has a part in which this number is drawn again and all others are kept. If only one number varies, the population
    is the only part. Raises ParameterError if a field is outside its domain.
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
        require(
            by_one, "a gear passes by its share of quiet runs or by its margin: give either share or margin, not both"
        )
        samples = self.rows * self.count
        require(
            samples <= MOST_SAMPLES,
            f"{self.rows:,} gears, including those for Sobol indices, times {self.count:,} states exceed the limit of "
            f"{MOST_SAMPLES:,} samples: make `count` smaller first, which costs the least accuracy",
        )
        if self.share is not None:
            share = require_number("share", self.share, positive=True)
            require(
                share <= MOST_SHARE,
                f"share must be at most {MOST_SHARE}, got {share:g}: no sample is large enough for more",
            )
        if self.margin is not None:
            require_number("margin", self.margin, positive=True)
            require_capability(Capability.MARGIN, self.tolerances.model)

    @cached_property
    def rows_per_sobol_part(self) -> int:
        """The number of rows in each part except the first; only Sobol indices need these parts.

        The number is the smaller of `pairs` and `gears`; 0 if only one number of the gear varies.
        """
        return min(self.pairs, self.gears) if len(self.tolerances.names) > 1 else 0

    @cached_property
    def n_judged(self) -> int:
        """The number of gears that are tested for the requirement on share or margin; 0 if there is no requirement."""
        return 0 if self.share is None and self.margin is None else min(self.judged, self.gears)

    @property
    def rows(self) -> int:
        """The number of rows, and so of gears, of all parts of the plan together."""
        return self.gears + self.rows_per_sobol_part * (1 + 2 * len(self.tolerances.names))

    def flag_judged_rows(self, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags of the rows whose gears are tested: `n_judged` rows, evenly spread over the population."""
        number = rows * self.n_judged // self.gears
        return np.asarray((rows < self.gears) & (number != (rows - 1) * self.n_judged // self.gears))

    def parts(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the number of the part of the plan to which each row belongs."""
        return np.where(rows < self.gears, POPULATION, AGAIN + (rows - self.gears) // max(self.rows_per_sobol_part, 1))

    def rows_of_part(self, part: int) -> slice:
        """Return the rows of one part of the plan as a slice. part: the number of the part, from 0."""
        if part == POPULATION:
            return slice(0, self.gears)
        start = self.gears + (part - AGAIN) * self.rows_per_sobol_part
        return slice(start, start + self.rows_per_sobol_part)

    def part_that_keeps_number(self, i: int) -> int:
        """Return the index of the part that keeps the varying number of index i and draws all others again."""
        return FIRST_REDRAWN + i

    def part_that_redraws_number(self, i: int) -> int:
        """Return the index of the part that draws the varying number of index i again and keeps all others."""
        return FIRST_REDRAWN + len(self.tolerances.names) + i

    def values(self, rows: NDArray[np.int64]) -> Array:
        """Return the values (n, d) of the d numbers that vary, for the gears of these n rows."""
        copula, varying = self.tolerances.copula, len(self.tolerances.names)
        parts = self.parts(rows)
        base = np.where(parts == POPULATION, rows, (rows - self.gears) % max(self.rows_per_sobol_part, 1))
        z = copula.draw_rows(self.seed, 0, base)
        shared = parts >= FIRST_REDRAWN
        if shared.any():
            fresh = copula.draw_rows(self.seed, REDRAWN_STREAM, base[shared])
            original, part, found = z[shared], parts[shared], z[shared]
            for i in range(varying):
                kept, redrawn = part == self.part_that_keeps_number(i), part == self.part_that_redraws_number(i)
                found[kept] = copula.redraw_other_columns(i, original[kept], fresh[kept])
                found[redrawn] = copula.redraw_column(i, original[redrawn], fresh[redrawn])
            z[shared] = found
        return self.tolerances.values(z)

    @property
    def sample_counts(self) -> tuple[int, ...]:
        """The numbers of samples after which the share of quiet runs of a gear is tested, until one test decides."""
        share = self.share or 0.5
        fewest = math.ceil(Z_TESTS**2 * share / (1.0 - share))
        return tuple(sorted({FIRST_COUNT, fewest + 1, 4 * (fewest + 1)}))


#: One of the three numbers of samples after which the share of quiet runs of a gear is tested.
#: `PopulationPlan.sample_counts` computes the other two from the required share.
FIRST_COUNT = 32
#: Normal quantile at 1 − 0.05/6, which gives 95 % confidence over all three tests of a gear together.
Z_TESTS = 2.393979799818671
