"""The request for a population, validated before anything is computed or stored."""

import json
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from gear_rattle.workers.populations.numbers import AnyDistribution, GearNumbers, to_library_form
from gear_rattle.workers.survey.axes import Name, Real, StrictRecord
from gear_rattle.workers.survey.request import LEAST_TILES, MAX_TILE_SAMPLES, MAX_TILES
from gear_rattle.workers.survey.values.schema import Group
from gear_rattle.workers.survey.version import code_version
from rattle import Shock
from rattle.attractors import BUDGET, LARGEST_BUDGET, PERIODS, WATCH
from rattle.models import ADDED, MODELS
from rattle.populations import (
    JUDGED,
    MOST_COUNT,
    MOST_GEARS,
    MOST_SHARE,
    PAIRS,
    Distribution,
    PopulationPlan,
    Tolerances,
)

MAX_TILE_GEARS = 65_536  # largest number of gears of a tile
FEWEST_TILE_GEARS = 64  # a default tile has at least this many gears, unless each gear takes long
DAMPING_SAMPLE_GEARS = 64  # a default tile is sized for the least damping among this many first gears


class RequestedShock(StrictRecord):
    """A shock that separates teeth in contact, as the start of each run.

    speed: the speed at which the teeth separate, in m/s for a machine and otherwise in the model's unit. phase: the
    phase of the forcing at the shock, in forcing periods; by default it is random.
    """

    speed: Real | AnyDistribution
    phase: Real | AnyDistribution | None = None


class PopulationRequest(StrictRecord):
    """The request for a population of gears: the body of `POST /v1/populations`; only `gear` has no default.

    gear: the numbers of a gear, at least one of them a distribution. correlation: correlation matrix of the varying
    numbers, in the order of the fields of `gear`. gears: the number of gears. count: initial conditions of each gear.
    share: a gear passes if at least this share of its runs ends quiet. margin: a gear passes if its boundary distance
    is above this speed; give share or margin. judged: how many gears are tested for passing. pairs: on how many gears
    Sobol indices are based; each of these gears needs additional gears. tile: number of gears in a task and chunk.
    """

    name: Name = ""
    gear: GearNumbers
    correlation: tuple[tuple[Real, ...], ...] | None = None
    gears: Annotated[int, Field(strict=True, ge=2, le=MOST_GEARS)] = 4096
    count: Annotated[int, Field(strict=True, ge=1, le=MOST_COUNT)] = 16
    share: Annotated[Real, Field(gt=0, le=MOST_SHARE)] | None = None
    margin: Annotated[Real, Field(gt=0)] | None = None
    shock: RequestedShock | None = None
    judged: Annotated[int, Field(strict=True, ge=1, le=MOST_GEARS)] = JUDGED
    pairs: Annotated[int, Field(strict=True, ge=0, le=MOST_GEARS)] = PAIRS
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32)] = 0
    budget: Annotated[int, Field(strict=True, ge=1, le=LARGEST_BUDGET)] = BUDGET
    tile: Annotated[int, Field(strict=True, ge=1, le=MAX_TILE_GEARS)] | None = None

    @model_validator(mode="after")
    def _check_plan(self) -> Self:
        """Refuse values that the library refuses, and tiles that are too large or too many. Raises ValueError."""
        # Checked here, because the library refuses a restitution above 1 only when a gear draws it, perhaps in the last
        # tile.
        for name, each in ADDED.items():
            value = self.plan.tolerances.given.get(name)
            if isinstance(value, Distribution) and value.range[1] > each.greatest:
                raise ValueError(
                    f"{name} must be at most {each.greatest:g}, but its distribution goes up to {value.range[1]:.3g}: "
                    f"choose a distribution that ends there, such as a normal one with high = {each.greatest:g}"
                )
        with np.errstate(all="ignore"):  # allowed but extreme numbers may overflow in intermediate results
            size = self.tile_shape[0]
        if size * self.count > MAX_TILE_SAMPLES:
            raise ValueError(f"a tile may hold at most {MAX_TILE_SAMPLES:,} initial conditions: use a smaller tile")
        if self.n_tiles > MAX_TILES:
            raise ValueError(
                f"{self.n_tiles:,} tiles exceed the limit of {MAX_TILES:,}: use a larger tile or fewer gears"
            )
        return self

    @cached_property
    def plan(self) -> PopulationPlan:
        """The plan of the population for `rattle.populations`. Raises ParameterError, which is a ValueError."""
        shock = None
        if self.shock is not None:
            phase = {} if self.shock.phase is None else {"phase": to_library_form(self.shock.phase)}
            shock = Shock(to_library_form(self.shock.speed), **phase)
        tolerances = Tolerances(self.gear.library_numbers, self.correlation)
        asked = self.gears, self.count, self.share, self.margin, shock, self.judged, self.pairs
        return PopulationPlan(tolerances, *asked, self.seed, self.budget)

    @property
    def quantities(self) -> tuple[Group, ...]:
        """The groups of variables of a survey; a population has none."""
        return ()

    @property
    def model(self) -> str:
        """The name of the gears' model."""
        return self.plan.tolerances.model.name

    @cached_property
    def added_parameter_values(self) -> dict[str, float]:
        """The parameters that the model adds to δ, ε and β, by name, with their values for the first gear."""
        points = self.plan.tolerances.points(self.plan.values(np.arange(1)))
        return {name: float(x[0]) for name, x in points.parameters.added.items()}

    @cached_property
    def least_damping(self) -> float:
        """The least damping among the first DAMPING_SAMPLE_GEARS gears."""
        few = self.plan.values(np.arange(min(DAMPING_SAMPLE_GEARS, self.gears)))
        return float(self.plan.tolerances.points(few).parameters.delta.min())

    @property
    def shape(self) -> tuple[int]:
        """Shape of the population's store: its number of rows (gears), with the additional gears for Sobol indices."""
        return (self.plan.rows,)

    @cached_property
    def tile_shape(self) -> tuple[int]:
        """Number of gears of a tile; the last tile may have fewer."""
        if self.tile is not None:
            return (min(self.tile, self.plan.rows),)
        samples = MODELS[self.model].tile_samples
        longer = max(1.0, WATCH / (PERIODS * self.least_damping))
        each = -(-self.samples // self.n_cells)
        most = max(int(samples / longer) // each, 1)
        return (min(most, max(self.plan.rows // LEAST_TILES, FEWEST_TILE_GEARS), self.plan.rows, MAX_TILE_GEARS),)

    @property
    def n_cells(self) -> int:
        """Number of rows (gears). A survey request has a property of the same name for its cells."""
        return self.plan.rows

    @property
    def n_tiles(self) -> int:
        """Number of tiles that cover the rows."""
        return -(-self.n_cells // self.tile_shape[0])

    @property
    def n_slices(self) -> int:
        """Number of slices: 1, like a survey without a third axis."""
        return 1

    @property
    def tile_grid_shape(self) -> tuple[int, int]:
        """Numbers of rows and columns of tiles; there is one row."""
        return 1, self.n_tiles

    @property
    def samples(self) -> int:
        """The largest possible number of samples, including the additional samples of gears tested for passing."""
        judging = self.plan.sample_counts[-1] if self.share is not None else 0
        return self.n_cells * self.count + self.plan.n_judged * judging

    def content_hash(self) -> str:
        """Return the hexadecimal SHA-256 of everything that decides the bytes of the store, with the code version."""
        content = self.model_dump(mode="json", exclude={"name", "tile"})
        content |= {"tile": self.tile_shape, "code": code_version()}
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
