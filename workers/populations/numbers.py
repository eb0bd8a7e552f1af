"""Fields of a request for a population that describe a gear: each is a number or a distribution."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator, create_model
from pydantic_core import PydanticCustomError

from gear_rattle.workers.survey.axes import Real, StrictRecord, wrong_field_message
from rattle import LogNormal, Measured, Normal, Triangular, Uniform
from rattle.populations import DIMENSIONLESS, OF_MACHINE, Distribution

MOST_MEASURED = 10_000  # a measured distribution has at most this many values


class NormalNumber(StrictRecord):
    """A normal distribution, truncated at `low` and `high` if these are given. deviation: its standard deviation."""

    distribution: Literal["normal"]
    mean: Real
    deviation: Real
    low: Real | None = None
    high: Real | None = None

    @property
    def library_distribution(self) -> Distribution:
        """The distribution as a `rattle.Normal`. Raises ParameterError."""
        ends = {name: value for name in ("low", "high") if (value := getattr(self, name)) is not None}
        return Normal(self.mean, self.deviation, **ends)


class UniformDistribution(StrictRecord):
    """A uniform distribution from `low` to `high`."""

    distribution: Literal["uniform"]
    low: Real
    high: Real

    @property
    def library_distribution(self) -> Distribution:
        """The distribution as a `rattle.Uniform`."""
        return Uniform(self.low, self.high)


class TriangularDistribution(StrictRecord):
    """A triangular distribution from `low` to `high`, with its peak at `mode`."""

    distribution: Literal["triangular"]
    low: Real
    mode: Real
    high: Real

    @property
    def library_distribution(self) -> Distribution:
        """The distribution as a `rattle.Triangular`."""
        return Triangular(self.low, self.mode, self.high)


class LogNormalDistribution(StrictRecord):
    """A log-normal distribution. deviation: standard deviation of the natural logarithm."""

    distribution: Literal["lognormal"]
    median: Real
    deviation: Real

    @property
    def library_distribution(self) -> Distribution:
        """The distribution as a `rattle.LogNormal`."""
        return LogNormal(self.median, self.deviation)


class MeasuredDistribution(StrictRecord):
    """The distribution of a number whose `values` were measured at some gears."""

    distribution: Literal["measured"]
    values: Annotated[tuple[Real, ...], Field(min_length=2, max_length=MOST_MEASURED)]

    @property
    def library_distribution(self) -> Distribution:
        """The distribution as a `rattle.Measured`."""
        return Measured(self.values)


AnyDistribution = Annotated[
    NormalNumber | UniformDistribution | TriangularDistribution | LogNormalDistribution | MeasuredDistribution,
    Field(discriminator="distribution"),
]


def _validate_number_or_distribution(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """Validate a field for a number or a distribution. Raises one error for a wrong value."""
    try:
        return handler(value)
    except ValidationError as error:
        of_number, *of_distribution = error.errors()
        meant = of_distribution[0] if isinstance(value, Mapping) and of_distribution else of_number
        where = ".".join(str(part) for part in meant["loc"][2:])  # without pydantic's names of the union's branches
        said = f"{where}: {wrong_field_message(meant)}" if where else wrong_field_message(meant)
        raise PydanticCustomError("number_or_distribution", "{said}", {"said": said}) from error


#: A field for a number or a distribution. A wrong value is reported once: as a wrong distribution if it is an object
#: with fields, else as a wrong number.
Number = Annotated[Real | AnyDistribution | None, WrapValidator(_validate_number_or_distribution)]


if TYPE_CHECKING:
    _Numbers = StrictRecord
else:
    _Numbers = create_model(
        "_Numbers", __base__=StrictRecord, **dict.fromkeys((*DIMENSIONLESS, *OF_MACHINE), (Number, None))
    )


class GearNumbers(_Numbers):
    """The numbers of a gear: delta, epsilon, beta, and parameters that a model adds.

    A request may give the numbers of a machine in SI units instead, as `rattle.Machine` takes them, including rpm.
    """

    drive: Literal["torque", "speed"] | None = None

    @property
    def library_numbers(self) -> dict[str, Any]:
        """{name: value} of the given numbers, each as `to_library_form` returns it. Raises ParameterError."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: to_library_form(value) for name, value in given.items() if value is not None}


def to_library_form(value: Any) -> Any:
    """Return a number unchanged, or a distribution as an object such as `rattle.Normal`. Raises ParameterError."""
    return getattr(value, "library_distribution", value)


def convert_to_request_field(value: Any) -> Any:
    """Return the value of a request's field: a number unchanged, an object such as `rattle.Normal` as a dictionary."""
    match value:
        case Normal():
            ends = {name: end for name in ("low", "high") if abs(end := getattr(value, name)) != float("inf")}
            return {"distribution": "normal", "mean": value.mean, "deviation": value.deviation, **ends}
        case Uniform():
            return {"distribution": "uniform", "low": value.low, "high": value.high}
        case Triangular():
            return {"distribution": "triangular", "low": value.low, "mode": value.mode, "high": value.high}
        case LogNormal():
            return {"distribution": "lognormal", "median": value.median, "deviation": value.deviation}
        case Measured():
            return {"distribution": "measured", "values": list(value.values)}
    return value
