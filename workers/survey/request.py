"""The request for a survey, validated before anything is computed or stored."""

import json
import math
from enum import StrEnum
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    Field,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    create_model,
    field_validator,
    model_validator,
)

from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.survey.axes import Axis, Name, NumberOrAxis, Real, StrictRecord
from gear_rattle.workers.survey.machine import SurveyedMachine, convert_fields_to_dimensionless
from gear_rattle.workers.survey.refined.asked import BLOCK, RefineOptions, RefineOrNot, require_refinable
from gear_rattle.workers.survey.values.quantities import BOUNDED, REFINED, stored_variables, variable_groups_of_model
from gear_rattle.workers.survey.values.schema import DEFAULT, FIXED, NEEDS, SAMPLED, Group, Quantity
from gear_rattle.workers.survey.version import code_version
from rattle.attractors import (
    BUDGET,
    LARGEST_BUDGET,
    NATURAL,
    PAPER_SPEED,
    PERIODS,
    WATCH,
    SampleSpec,
    are_in_paper_plane,
)
from rattle.models import (
    ADDED,
    BETA,
    DEFAULT_MODEL,
    MODELS,
    Capability,
    Model,
    Parameter,
    model_of,
    model_of_parameter,
    with_harmonics,
)

#: The index of a slice along the third axis, in a tuple; () for a survey without a third axis.
Along = tuple[int, ...]
Count = Annotated[int, Field(strict=True, ge=1, le=65_536)]


def _check_speed_limit(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """Validate a speed limit. Raises ValueError with one message for all types that a speed limit may have."""
    try:
        return handler(value)
    except ValidationError as error:
        raise ValueError(f'v_max must be a speed above 0, or "{NATURAL}" for the natural speed of each cell') from error


#: Validator that reports a wrong speed limit once, not once for each type that a speed limit may have.
SpeedLimitOnce = WrapValidator(_check_speed_limit)

#: Cells along a side of a default tile: usual number, and least number.
DEFAULT_TILE, SMALLEST_DEFAULT = 32, 4
#: By default a survey has about this many tiles or more, so that workers end at about the same time and progress is
#: visible. A refined survey may have fewer; so may a small one, because its tiles have SMALLEST_DEFAULT cells or more
#: along a side.
LEAST_TILES = 16
#: The default tiles of a large survey are larger, so that it has about this many tiles: each tile has some 35 files.
MOST_TILES = 100
#: A default tile of a large survey has at most this many times the model's usual number of samples (`tile_samples`).
LARGE_TILE_FACTOR = 16
BASIN_SIDE = 8  # cells along a side of a default tile if basins are computed; such a tile takes a second or two
BASIN_SAMPLES = 4096  # number of states of a cell that are followed at a time if basins are computed
MAX_TILE_CELLS = 65_536  # largest number of cells of a tile; results of so many cells take some 50 MB in a worker
#: Largest number of cells of a tile that refines regions alone; its results take only a few bytes per cell.
MAX_TILE_REGIONS = 1_048_576
#: A default tile of a refined survey of regions has more rows than columns, by the square of this factor, because all
#: cells of a column share constants of the closed forms.
TALL_TILE_FACTOR = 4
MAX_TILE_SAMPLES = 4_194_304  # largest number of samples of a tile; a worker needs some 300 MB to follow so many
BY_FRACTION, BY_FAMILY = "fraction", "family"  # values of `slots_by`, the rule that gives an attractor its slot
#: Default numbers of slots: SLOTS, or MORE_SLOTS if the survey begins below the damping MANY_ATTRACTORS.
SLOTS, MORE_SLOTS, MANY_ATTRACTORS = 8, 24, 0.1
MAX_SLOTS = 64
MAX_TILES = 1_000_000  # largest number of tiles; each needs a file per variable, and a millisecond of scheduling
MAX_SLICES = 64  # largest number of slices; the curves of a slice take seconds to compute, and fill a hundred files


class InitialConditions(StrictRecord):
    """The initial conditions of each cell: `count` points (τ, v) of the box [tau_min, tau_max) × (v_min, v_max).

    The box is [0, 1) × (0, v_max) by default.

    v_max: a speed for all cells, or "natural" for 1.5 √(16πδβ) + 2πε of each cell; the default is 7 if all axes are in
    the paper's plane (δ from 0.3 to 1.5, ε to 0.5, β from 0.2 to 1.2), else natural. budget: impacts on Σ⁺ after which
    an unresolved sample is undecided; at small damping the default budget takes seconds for each cell.
    """

    count: Count = 64
    v_max: Annotated[Annotated[Real, Field(gt=0)] | Literal["natural"] | None, SpeedLimitOnce] = None
    budget: Annotated[int, Field(strict=True, ge=1, le=LARGEST_BUDGET)] = BUDGET
    tau_min: Annotated[Real, Field(ge=0, lt=1)] = 0.0
    tau_max: Annotated[Real, Field(gt=0, le=1)] = 1.0
    v_min: Annotated[Real, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _check_range_of_states(self) -> Self:
        if not self.tau_min < self.tau_max:
            raise ValueError(f"tau_min ({self.tau_min}) must be less than tau_max ({self.tau_max})")
        if self.v_min > 0 and not isinstance(self.v_max, float):
            raise ValueError(f"v_min above 0 needs a v_max that is a number: give a v_max above v_min ({self.v_min})")
        if isinstance(self.v_max, float) and not self.v_min < self.v_max:
            raise ValueError(f"v_min ({self.v_min}) must be less than v_max ({self.v_max})")
        return self

    @property
    def tau_range(self) -> tuple[float, float]:
        """Range (low, high) of the phases of the initial conditions."""
        return self.tau_min, self.tau_max


class TileShape(StrictRecord):
    """The numbers of cells along each axis of a tile.

    The default is 32. It is larger in a refined survey or in one of more than 100,000 cells, and smaller in a small
    survey, at small damping, with many initial conditions, or with basins.
    """

    delta: Annotated[int, Field(strict=True, ge=1)] | None = None
    epsilon: Annotated[int, Field(strict=True, ge=1)] | None = None


if TYPE_CHECKING:
    ModelName = str
else:
    ModelName = StrEnum("Model", {name.upper(): name for name in MODELS}, module=__name__, qualname="ModelName")
    ModelName.__doc__ = "A model of the gear."


class _CommonFields(StrictRecord):
    """The fields at the beginning of the JSON of a survey request: name, model and half-backlash."""

    name: Name = ""
    model: ModelName = ModelName(DEFAULT_MODEL)
    beta: Annotated[Annotated[Real, Field(gt=0)] | Axis, NumberOrAxis] = BETA.example


def _field_type(parameter: Parameter) -> Any:
    """Return the type of a request's field for a model's parameter: a number, or also an axis if one is allowed."""
    most = parameter.greatest if math.isfinite(parameter.greatest) else None
    least: Any = {"ge": 0} if parameter.may_be_zero else {"gt": 0}
    number: Any = Annotated[Real, Field(le=most, **least)]
    return Annotated[number | Axis, NumberOrAxis] | None if parameter.is_axis else number | None


if TYPE_CHECKING:
    _ModelFields = _CommonFields
else:
    #: The fields of `_CommonFields`, and a field for each parameter that a model adds.
    _ModelFields = create_model(
        "_ModelFields", __base__=_CommonFields, **{name: (_field_type(each), None) for name, each in ADDED.items()}
    )


class SurveyRequest(_ModelFields):
    """The request for a survey of the (δ, ε) plane: the body of `POST /v1/surveys`; only the axes have no defaults.

    model: the impacting gear, or another model; a model may add parameters. beta, and each added parameter: a number;
    one of them may be a third axis instead, and the survey then has a slice (a plane) for each of its values.
    quantities: groups of variables, by default all groups of the model except expensive ones; a group includes the
    groups that it needs (families: attractors and lyapunov). slots: the most attractors that a cell lists, by default
    8, or 24 if δ begins below 0.1; further attractors are counted, and their share is stored. slots_by: "fraction"
    lists the attractors of a cell by falling basin fraction; "family" gives each family the same slot in all cells, as
    far as there are slots; the default is "family" if families are computed. machine: the dimensions of two gears,
    given instead of β and the axes; its fields `rpm` and `eccentricity` are {"start", "stop", "num"} each, and become
    even steps of δ and ε. refine: compute few cells first, more where motions differ, and fill the others; true, or
    {"audit": share of the filled cells to compute as a check, "bound": largest allowed share of wrong cells among the
    filled ones}. harmonics: further harmonics of the forcing, if the model allows them, each as [order, amplitude
    divided by that of the first harmonic, phase in turns]. certify: prove the periodic attractors; their certificates
    go to a store of their own beside the survey's.
    """

    delta: Axis
    epsilon: Axis
    quantities: tuple[Group, ...] = DEFAULT
    initial_conditions: InitialConditions = InitialConditions()
    slots: Annotated[int, Field(strict=True, ge=1, le=MAX_SLOTS)] | None = None
    slots_by: Literal["fraction", "family"] | None = None
    tile: TileShape = TileShape()
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32)] = 0
    harmonics: tuple[tuple[int, Real, Real], ...] = ()
    machine: SurveyedMachine | None = None
    refine: Annotated[RefineOptions | None, RefineOrNot] = None
    certify: Annotated[bool, Field(strict=True)] = False

    @model_validator(mode="before")
    @classmethod
    def _convert_machine(cls, given: Any) -> Any:
        """Compute β and the axes of δ and ε from a machine's dimensions, speeds and eccentricities."""
        if isinstance(given, dict) and isinstance(given.get("machine"), dict):
            return convert_fields_to_dimensionless(given)
        return given

    @field_validator("delta")
    @classmethod
    def _check_damping(cls, delta: Axis) -> Axis:
        if delta.start <= 0:
            raise ValueError(f"delta must be positive: raise start ({delta.start}) above 0")
        return delta

    @field_validator("epsilon")
    @classmethod
    def _check_eccentricity(cls, epsilon: Axis) -> Axis:
        if epsilon.start < 0:
            raise ValueError(f"epsilon must not be negative: raise start ({epsilon.start}) to 0 or more")
        return epsilon

    @field_validator("beta", *ADDED)
    @classmethod
    def _check_third_axis(cls, value: float | Axis | None, info: ValidationInfo) -> float | Axis | None:
        if not isinstance(value, Axis):
            return value
        may_be_zero = info.field_name in ADDED and ADDED[info.field_name].may_be_zero
        if value.start < 0 and may_be_zero:
            raise ValueError(f"{info.field_name} must not be negative: raise start ({value.start}) to 0 or more")
        if value.start <= 0 and not may_be_zero:
            raise ValueError(f"{info.field_name} must be positive: raise start ({value.start}) above 0")
        most = math.inf if info.field_name not in ADDED else ADDED[info.field_name].greatest
        if value.stop > most:
            raise ValueError(f"{info.field_name} must be at most {most:g}: lower stop ({value.stop})")
        if value.num > MAX_SLICES:
            raise ValueError(f"a third axis may have at most {MAX_SLICES} values: lower num ({value.num})")
        return value

    @model_validator(mode="before")
    @classmethod
    def _choose_groups(cls, given: Any) -> Any:
        """Choose the default groups that the model has, if no quantities are given."""
        if isinstance(given, dict) and given.get("model") in (*MODELS,) and "quantities" not in given:
            known = variable_groups_of_model(given["model"], bool(given.get("harmonics")))
            return given | {"quantities": [str(group) for group in DEFAULT if group in known]}
        return given

    @model_validator(mode="before")
    @classmethod
    def _fill_in_parameters(cls, given: Any) -> Any:
        """Fill in the default values of the model's parameters that are not given."""
        if isinstance(given, dict) and given.get("model") in (*MODELS,):
            added = MODELS[given["model"]].added
            left_out = [each for each in added if each.default is not None and given.get(each.name) is None]
            return given | {each.name: each.default for each in left_out}
        return given

    @field_validator("quantities")
    @classmethod
    def _complete_groups(cls, quantities: tuple[Group, ...]) -> tuple[Group, ...]:
        if not quantities:
            raise ValueError(f"name at least one of {', '.join(Group)}")
        if len(set(quantities)) < len(quantities):
            raise ValueError("each quantity may be named once: remove the duplicates")
        needed = {need for group in quantities for need in NEEDS.get(group, ())}
        return tuple(group for group in Group if group in quantities or group in needed)

    @model_validator(mode="after")
    def _check_model(self) -> Self:
        own = {each.name: each for each in MODELS[self.model].added}
        for name, each in ADDED.items():
            value = getattr(self, name)
            if name in own and value is None:
                raise ValueError(f"the {self.model} model needs {name}, the {each.full_label}: give one, {each.advice}")
            if name not in own and value is not None:
                owner = model_of_parameter(name).name
                raise ValueError(f'only the {owner} model has {name}: set model to "{owner}", or leave {name} out')
        with_harmonics(MODELS[self.model](), self.harmonics)  # raises an error if the model refuses the harmonics
        if len(self.third_axis) > 1:
            raise ValueError(
                f"a survey has at most one third axis: give a number, not an axis, for {' or '.join(self.third_axis)}"
            )
        if self.slots_by == BY_FAMILY and Group.FAMILIES not in self.quantities:
            raise ValueError("slots_by family needs families: add families to quantities, or leave slots_by out")
        known = variable_groups_of_model(self.model, bool(self.harmonics))
        if unknown := set(self.quantities).difference(known):
            names, whose = ", ".join(sorted(unknown)), f"the {self.model} model"
            raise ValueError(
                f"{whose}{' with harmonics' if self.harmonics else ''} has no {names}: choose from {', '.join(known)}"
            )
        return self

    @model_validator(mode="after")
    def _check_machine(self) -> Self:
        if self.machine is None:
            return self
        for each in MODELS[self.model].added:
            if each.machine_number is not None and getattr(self, each.name) != each.default:
                raise ValueError(
                    f"{each.name} of a machine changes with its speed of rotation, but a survey has one {each.name} "
                    "for all cells: "
                    f"leave out the machine, or leave out model and {each.name}"
                )
        if self.beta != self.machine.beta:
            raise ValueError(f"the gears of this machine have beta {self.machine.beta}: leave beta out")
        for delta in (self.delta.start, self.delta.stop):
            self.machine.machine_at_speed(
                float(self.machine.speed_at_damping(delta)),
                float(self.machine.eccentricity_in_metres(self.epsilon.stop)),
            )
        return self

    @model_validator(mode="after")
    def _check_refinable(self) -> Self:
        if self.refine is not None:
            require_refinable(self.quantities, self.model)
        return self

    @model_validator(mode="after")
    def _check_certifiable(self) -> Self:
        if self.certify and Group.ATTRACTORS not in self.quantities:
            raise ValueError("certify needs attractors: add attractors to quantities, or leave certify out")
        if self.certify and Capability.PROOFS not in MODELS[self.model].has:
            raise ValueError(f"periodic motions of the {self.model} model cannot be proved: leave certify out")
        if self.certify and self.third_axis_name:
            raise ValueError(
                f"certify needs a survey without a third axis: give one number for {self.third_axis_name}, or prove "
                "the slices one by one afterwards: rattle certify STORE --slice NUMBER"
            )
        return self

    @model_validator(mode="after")
    def _check_tiles(self) -> Self:
        for axis in ("delta", "epsilon"):
            size, num = getattr(self.tile, axis), getattr(self, axis).num
            if size is not None and size > num:
                raise ValueError(f"tile.{axis} ({size}) exceeds the axis ({num} values): use {num} or less")
            if self.refine is not None and size not in (None, num) and size % BLOCK:
                raise ValueError(
                    f"tile.{axis} ({size}) would divide the blocks of a refined survey: use a multiple of {BLOCK}"
                )
        if self.tile_shape[0] * self.tile_shape[1] > self._most_cells_per_tile:
            raise ValueError(
                f"a tile of {math.prod(self.tile_shape):,} cells exceeds the limit of "
                f"{self._most_cells_per_tile:,}: use a smaller tile"
            )
        if self.tile_shape[0] * self.tile_shape[1] * self.samples_per_cell > MAX_TILE_SAMPLES:
            raise ValueError(f"a tile may hold at most {MAX_TILE_SAMPLES:,} initial conditions: use a smaller tile")
        if self.n_tiles > MAX_TILES:
            raise ValueError(
                f"{self.n_tiles:,} tiles exceed the limit of {MAX_TILES:,}: use a larger tile or a coarser grid"
            )
        return self

    @property
    def variables(self) -> tuple[Quantity, ...]:
        """The variables that the survey's store has, in the order in which tiles are written."""
        more = () if self.refine is None else (*REFINED, *BOUNDED) if self.refine.bound else REFINED
        return stored_variables(self.quantities, self.model, more)

    @property
    def has_wrong_share_bound(self) -> bool:
        """True if the request has a bound for the share of wrong cells among the filled ones."""
        return self.refine is not None and self.refine.bound is not None

    @property
    def gear_model(self) -> Model:
        """The model with its parameters. Raises SurveyError if there is a third axis: each slice has its own model."""
        if self.third_axis_name:
            raise SurveyError(
                f"this survey has {self.n_slices} values of {self.third_axis_name}: choose one of its slices"
            )
        return with_harmonics(model_of(**self.beta_and_added_parameters), self.harmonics)

    @property
    def has_closed_forms(self) -> bool:
        """True if regions and orbits are known in closed form."""
        return Capability.CLOSED_FORM in MODELS[self.model].has

    @property
    def beta_and_added_parameters(self) -> dict[str, Any]:
        """β and the parameters that the model adds, by name. Each value is a number, or the third axis."""
        return {each.name: getattr(self, each.name) for each in MODELS[self.model].parameters()}

    @property
    def added_parameter_values(self) -> dict[str, float]:
        """{name: value} of the parameters that the model adds to δ, ε and β.

        If one of these parameters is the third axis, its value is the last value of the axis.
        """
        return {
            name: value.stop if isinstance(value, Axis) else value
            for name, value in self.beta_and_added_parameters.items()
            if name in ADDED
        }

    @property
    def sample_spec(self) -> SampleSpec:
        """The specification of the initial conditions of each cell: their number, box, seed and budget."""
        given = self.initial_conditions
        return SampleSpec(given.count, self.v_max, self.seed, given.budget, given.tau_range, given.v_min)

    @property
    def third_axis(self) -> dict[str, Axis]:
        """{name: the third axis}; empty without a third axis."""
        return {name: axis for name in FIXED if isinstance(axis := getattr(self, name), Axis)}

    @property
    def third_axis_name(self) -> str:
        """The name of the third axis; "" without a third axis."""
        return next(iter(self.third_axis), "")

    @property
    def n_slices(self) -> int:
        """Number of slices along the third axis; 1 without a third axis."""
        return math.prod(axis.num for axis in self.third_axis.values())

    @property
    def slices(self) -> "dict[Along, SurveyRequest]":
        """{index of a slice: the request for this slice alone}; without a third axis {(): this request}."""
        return {
            place: self.slice_request(place) for place in np.ndindex(*(axis.num for axis in self.third_axis.values()))
        }

    def slice_index(self, number: int) -> Along:
        """Return the index of a slice as a tuple. number: counted from 0; a number too large gives the last slice.

        Returns
        -------
        Along
            (index,), or () for a survey without a third axis, whatever the number.
        """
        return (min(number, self.n_slices - 1),) if self.third_axis_name else ()

    def slice_request(self, place: Along) -> "SurveyRequest":
        """Return the request for one slice alone, with the initial conditions and tile shape of the whole survey.

        place: the index of the slice; () returns this request.

        Returns
        -------
        SurveyRequest
            A request without a third axis.
        """
        if not place:
            return self
        values = {name: float(axis.values()[place[0]]) for name, axis in self.third_axis.items()}
        sample = self.initial_conditions.model_copy(update={"v_max": self.v_max})
        rows, columns = self.tile_shape
        same = {"initial_conditions": sample, "tile": TileShape(delta=columns, epsilon=rows)}
        return self.model_copy(update=values | same)

    @property
    def v_max(self) -> float | Literal["natural"]:
        """The largest initial speed, or "natural" for the natural speed of each cell."""
        if self.initial_conditions.v_max is not None:
            return self.initial_conditions.v_max
        delta, epsilon, beta = (
            np.array([axis.start, axis.stop] if isinstance(axis, Axis) else [axis, axis])
            for axis in (self.delta, self.epsilon, self.beta)
        )
        return PAPER_SPEED if are_in_paper_plane(delta, epsilon, beta).all() else NATURAL

    @property
    def n_slots(self) -> int:
        """The number of slots: the largest number of attractors that a cell lists."""
        return self.slots or (SLOTS if self.delta.start >= MANY_ATTRACTORS else MORE_SLOTS)

    @property
    def slots_follow_families(self) -> bool:
        """True if joined attractors get slots by family: as far as possible a family has the same slot in all cells."""
        return (self.slots_by or BY_FAMILY) == BY_FAMILY and Group.FAMILIES in self.quantities

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of cells along (epsilon, delta) in a slice."""
        return self.epsilon.num, self.delta.num

    @property
    def tile_shape(self) -> tuple[int, int]:
        """Numbers of cells of a tile along (epsilon, delta); the last tile of an axis may be smaller."""
        rows, columns = self._default_tile_sides
        return self.tile.epsilon or min(rows, self.epsilon.num), self.tile.delta or min(columns, self.delta.num)

    @property
    def _default_tile_sides(self) -> tuple[int, int]:
        """Cells along (epsilon, delta) of a tile if the request has no tile shape."""
        larger = math.isqrt(self.n_cells // MOST_TILES)
        side = min(max(DEFAULT_TILE, larger), math.isqrt(self.n_cells // LEAST_TILES))
        if SAMPLED.intersection(self.quantities):
            samples = MODELS[self.model].tile_samples
            samples = min(
                max(samples, self.n_cells * self.initial_conditions.count // MOST_TILES), LARGE_TILE_FACTOR * samples
            )
            longer = max(1.0, WATCH / (PERIODS * self.delta.start))
            side = min(side, math.isqrt(int(samples / longer) // self.initial_conditions.count))
        if Group.BASINS in self.quantities:
            side = min(side, BASIN_SIDE)
        if self.refine is not None:  # few cells of a refined tile are computed, so it may be larger
            side = min(2 * side, math.isqrt(self._most_cells_per_tile))
            tall = TALL_TILE_FACTOR if self._refines_only_regions else 1
            return max(side * tall // BLOCK, 1) * BLOCK, max(side // tall // BLOCK, 1) * BLOCK
        side = min(max(side, SMALLEST_DEFAULT), math.isqrt(self._most_cells_per_tile))
        return side, side

    @property
    def _refines_only_regions(self) -> bool:
        return self.refine is not None and self.quantities == (Group.REGION,)

    @property
    def _most_cells_per_tile(self) -> int:
        """Largest number of cells that a tile of this survey may have."""
        return MAX_TILE_REGIONS if self._refines_only_regions else MAX_TILE_CELLS

    @property
    def samples_per_cell(self) -> int:
        """The largest number of states of a cell that are followed at once, as samples or to find its basins."""
        samples = self.initial_conditions.count if SAMPLED.intersection(self.quantities) else 0
        return max(samples, BASIN_SAMPLES) if Group.BASINS in self.quantities else samples

    @property
    def n_cells(self) -> int:
        """Number of cells in all slices."""
        return self.epsilon.num * self.delta.num * self.n_slices

    @property
    def tile_grid_shape(self) -> tuple[int, int]:
        """Numbers of tiles along (epsilon, delta); the rows of tiles of all slices are counted together."""
        rows, columns = (-(-num // size) for num, size in zip(self.shape, self.tile_shape, strict=True))
        return rows * self.n_slices, columns

    @property
    def n_tiles(self) -> int:
        """Number of tiles that cover the grid."""
        return math.prod(self.tile_grid_shape)

    def content_hash(self) -> str:
        """Return the SHA-256 of everything that decides the bytes of the store, including the code version.

        The name is left out, because a survey stays the same when it is renamed. The tile shape is included, although
        no value of a cell depends on it, because it is the chunk shape of the store.

        Returns
        -------
        str
            64 hexadecimal digits.
        """
        content = self.model_dump(mode="json", exclude={"name", "tile", "slots", "slots_by"})
        content["initial_conditions"]["v_max"] = self.v_max
        slots = {"slots": self.n_slots, "slots_by": BY_FAMILY if self.slots_follow_families else BY_FRACTION}
        content |= {"tile": self.tile_shape, **slots, "code": code_version()}
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
