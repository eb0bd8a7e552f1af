"""The axes of a survey's grid, and what all parts of a request have in common."""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from workers.errors import SurveyError

#: Strict: neither True nor "0.6" is a number here.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError("the name holds characters that cannot be printed: remove them")
    return name


Name = Annotated[str, Field(max_length=200), AfterValidator(_printable)]


def _plain(given: Mapping[str, Any]) -> dict[str, Any]:
    """With Python's numbers instead of numpy's, which are as good."""
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in given.items()}


class Strict(BaseModel):
    """What cannot be changed, and takes no other fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _numbers(cls, given: Any) -> Any:
        return _plain(given) if isinstance(given, Mapping) else given


class Axis(Strict):
    """`num` evenly spaced values from `start` to `stop`, both included."""

    start: Real
    stop: Real
    num: Annotated[int, Field(strict=True, ge=2, le=1_000_000)]

    @model_validator(mode="before")
    @classmethod
    def _triple(cls, given: Any) -> Any:
        """(start, stop, num), as it is shortest in Python."""
        if isinstance(given, tuple) and len(given) == len(cls.model_fields):
            return _plain(dict(zip(cls.model_fields, given, strict=True)))
        if not isinstance(given, Mapping | cls):
            raise ValueError("an axis has start, stop and num: a triple in Python, an object with these names in JSON")
        return given

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.start < self.stop:
            raise ValueError(f"start ({self.start}) must be below stop ({self.stop}): exchange or separate them")
        with np.errstate(over="ignore", invalid="ignore"):
            spaced = np.all(np.diff(self.values()) > 0)
        if not spaced:
            raise ValueError(f"{self.num} values between {self.start} and {self.stop} are not distinct: lower num")
        return self

    def values(self) -> np.ndarray:
        """Return the values as float64, shape (num,): the ones that are computed with and stored."""
        return np.linspace(self.start, self.stop, self.num)

    @classmethod
    def parse(cls, text: str) -> "Axis":
        """Read `START:STOP:NUM`, as the command line takes it. Raises SurveyError."""
        try:
            start, stop, num = text.split(":")
            return cls(start=float(start), stop=float(stop), num=int(num))
        except ValueError as error:
            raise SurveyError(f"axis {text!r}: write START:STOP:NUM, such as 0.4:1.0:61 ({reason(error)})") from error


def reason(error: ValueError) -> str:
    """Return the first thing that is wrong, without pydantic's preamble."""
    errors = getattr(error, "errors", None)
    return str(errors()[0]["msg"]).removeprefix("Value error, ") if errors else str(error)


def place_and_reason(error: ValidationError) -> str:
    """Return the same, and of which field."""
    where = ".".join(str(part) for part in error.errors()[0]["loc"])
    return f"{where}: {reason(error)}" if where else reason(error)


def _number_or_axis(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    is_axis = isinstance(value, Mapping | tuple | Axis)
    try:
        return Axis.model_validate(value) if is_axis else handler(value)
    except ValidationError as error:
        first = error.errors()[0]
        where = [".".join(map(str, first["loc"]))] if is_axis and first["loc"] else []
        raise PydanticCustomError("number_or_axis", "{said}", {"said": ": ".join([*where, reason(error)])}) from error


#: What is wrong with it is said of what it was meant to be, not of both.
NumberOrAxis = WrapValidator(_number_or_axis)


class Window(NamedTuple):
    """A rectangle of the plane: (low, high) of δ and of ε."""

    delta: tuple[float, float]
    epsilon: tuple[float, float]
