"""The axes of a survey's grid, and base classes, types and messages for the fields of requests."""

import json
import re
import unicodedata
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

from gear_rattle.workers.errors import SurveyError
from rattle.errors import did_you_mean

#: A finite number in a request. It is strict: True and "0.6" are refused.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def require_visible_text(what: str, text: str, besides: str = "") -> str:
    """Return a text unchanged if all of its characters are visible, and refuse it otherwise.

    Parameters
    ----------
    what : str
        The name of the text in the message.
    text : str
        The text.
    besides : str
        Further allowed characters, such as line breaks.

    Returns
    -------
    str
        The text, unchanged.

    Raises
    ------
    ValueError
        The text has invisible characters, such as marks that change the direction of writing.
    """
    for each in text:
        if not (each.isprintable() or each in besides or unicodedata.category(each) == "Zs"):
            raise ValueError(
                f"the {what} holds U+{ord(each):04X} ({unicodedata.name(each, 'without a name')}), a character that "
                "cannot be printed: remove it"
            )
    return text


def _require_printable(name: str) -> str:
    return require_visible_text("name", name)


#: The name of a survey or population in a request: at most 200 printable characters.
Name = Annotated[str, Field(max_length=200), AfterValidator(_require_printable)]


def _convert_numpy_numbers(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields with numpy's numbers replaced by Python's, because strict fields refuse numpy's types."""
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in given.items()}


class StrictRecord(BaseModel):
    """Base class of immutable records that accept no unknown fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _convert_numbers(cls, given: Any) -> Any:
        return _convert_numpy_numbers(given) if isinstance(given, Mapping) else given


class Axis(StrictRecord):
    """`num` evenly spaced values from `start` to `stop`, both included."""

    start: Real
    stop: Real
    num: Annotated[int, Field(strict=True, ge=2, le=1_000_000)]

    @model_validator(mode="before")
    @classmethod
    def _convert_triple(cls, given: Any) -> Any:
        """Convert a tuple (start, stop, num) to fields. Raises ValueError for a value of another kind."""
        if isinstance(given, tuple) and len(given) == len(cls.model_fields):
            return _convert_numpy_numbers(dict(zip(cls.model_fields, given, strict=True)))
        if not isinstance(given, Mapping | cls):
            raise ValueError(
                "an axis needs start, stop and num: give a triple in Python, an object with these names in JSON"
            )
        return given

    @model_validator(mode="after")
    def _check_increasing(self) -> Self:
        if not self.start < self.stop:
            raise ValueError(
                f"start ({self.start}) must be below stop ({self.stop}): exchange them, or give two different values"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            spaced = np.all(np.diff(self.values()) > 0)
        if not spaced:
            raise ValueError(f"{self.num} values between {self.start} and {self.stop} are not distinct: lower num")
        return self

    def values(self) -> np.ndarray:
        """Return the values of the axis, float64 of shape (num,)."""
        return np.linspace(self.start, self.stop, self.num)

    @classmethod
    def parse(cls, text: str) -> "Axis":
        """Read `START:STOP:NUM` from the command line. Raises SurveyError."""
        parts = text.split(":")
        how = f"axis {text!r}: write START:STOP:NUM, such as 0.4:1.0:61"
        if len(parts) != len(cls.model_fields):
            raise SurveyError(f"{how}, three numbers separated by colons: this text has {len(parts)}")
        numbers: dict[str, Any] = {}
        for name, part in zip(cls.model_fields, parts, strict=True):
            whole = name == "num"
            try:
                numbers[name] = int(part) if whole else float(part)
            except ValueError:
                raise SurveyError(f"{how}: {name} is {part!r}, not {'a whole' if whole else 'a'} number") from None
        try:
            return cls(**numbers)
        except ValidationError as error:
            raise SurveyError(f"{how}: {message_with_field(error)}") from error


#: {pydantic's type of error: our message}. It replaces pydantic's own message, such as "Input should be …".
_MESSAGES = {
    "missing": "is not given: give it",
    "greater_than": "must be greater than {gt}, got {input}",
    "greater_than_equal": "must be at least {ge}, got {input}",
    "less_than": "must be less than {lt}, got {input}",
    "less_than_equal": "must be at most {le}, got {input}",
    "multiple_of": "must be a multiple of {multiple_of}, got {input}",
    "finite_number": "must be a finite number, got {input}",
    **dict.fromkeys(("float_type", "float_parsing"), "must be a number, got {input}"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "must be a whole number, got {input}"),
    "int_parsing_size": "must be a smaller whole number",
    **dict.fromkeys(("bool_type", "bool_parsing"), "must be true or false, got {input}"),
    **dict.fromkeys(("string_type", "string_unicode"), "must be text, got {input}"),
    "string_too_long": "must have at most {max_length} characters: shorten it",
    "string_too_short": "must have at least {min_length} characters",
    "string_pattern_mismatch": "must match {pattern}, got {input}",
    **dict.fromkeys(("list_type", "tuple_type"), "must be a list, got {input}"),
    **dict.fromkeys(
        ("model_type", "model_attributes_type", "dict_type", "dataclass_type"),
        "must be an object with named fields, got {input}",
    ),
    "union_tag_not_found": "must name its {discriminator}",
    "json_invalid": "is no valid JSON ({error}): send one JSON object, with names and text in double quotes",
    "json_type": "must be JSON, got {input}",
}
_CHOICE = re.compile(r"'([^']*)'")
_ENDS = (("least", "min_length"), ("most", "max_length"))
LONGEST_QUOTE = 60  # a message quotes at most this many characters of a given value


def _fields_of_subclasses(kind: type[BaseModel]) -> set[str]:
    """Return the names of all fields of all direct and indirect subclasses of a pydantic model."""
    below = kind.__subclasses__()
    return {field for each in below for field in each.model_fields}.union(*map(_fields_of_subclasses, below))


def wrong_field_message(detail: Mapping[str, Any]) -> str:
    """Return the message for a wrong field in this project's words: the value, the allowed values, what to do.

    Parameters
    ----------
    detail : mapping
        An entry of `errors()` of pydantic's ValidationError, or a mapping with the field `msg` alone.

    Returns
    -------
    str
        A sentence without the name of the field.
    """
    kind, given = detail.get("type"), detail.get("input")
    context = {**detail.get("ctx", {}), "input": _shorten_text(given)}
    if kind in ("enum", "literal_error"):
        known = _CHOICE.findall(str(context.get("expected", "")))
        return f"must be one of {', '.join(known)}, got {context['input']}{did_you_mean(given, known)}"
    if kind == "union_tag_invalid":
        known, tag = _CHOICE.findall(str(context["expected_tags"])), context["tag"]
        return f"{context['discriminator']} must be one of {', '.join(known)}, got {tag!r}{did_you_mean(tag, known)}"
    if kind == "extra_forbidden":
        name = str(detail["loc"][-1])
        known = sorted(_fields_of_subclasses(StrictRecord) - {name})
        return f"is not a known field{did_you_mean(name, known) or ': remove it'}"
    if kind in ("too_long", "too_short"):
        ends = [f"at {end} {context[key]}" for end, key in _ENDS if context.get(key) is not None]
        return f"has {context.get('actual_length')} entries: give {' and '.join(ends)}"
    try:
        return _MESSAGES[str(kind)].format_map(context)
    except KeyError:  # this type of error has no message in _MESSAGES, or our own validator raised it: use its `msg`
        return str(detail["msg"]).removeprefix("Value error, ")


def _shorten_text(given: Any) -> str:
    try:
        text = json.dumps(given, ensure_ascii=False) if isinstance(given, bool | str | None) else repr(given)
    except ValueError:  # Python refuses to print an integer of thousands of digits
        return "a number too long to print"
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]} …"


def message_of_first_error(error: ValueError) -> str:
    """Return the message for the first wrong field, without its name, or the text of an error that names no field."""
    errors = getattr(error, "errors", None)
    return wrong_field_message(errors()[0]) if errors else str(error)


def message_with_field(error: ValidationError) -> str:
    """Return the message for the first wrong field, with the name of the field at the beginning."""
    where = ".".join(str(part) for part in error.errors()[0]["loc"])
    return f"{where}: {message_of_first_error(error)}" if where else message_of_first_error(error)


def _validate_number_or_axis(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    is_axis = isinstance(value, Mapping | tuple | Axis)
    try:
        return Axis.model_validate(value) if is_axis else handler(value)
    except ValidationError as error:
        first = error.errors()[0]
        where = [".".join(map(str, first["loc"]))] if is_axis and first["loc"] else []
        raise PydanticCustomError(
            "number_or_axis", "{said}", {"said": ": ".join([*where, message_of_first_error(error)])}
        ) from error


#: Validator that reports a wrong value once: as a wrong axis if it looks like an axis, else as a wrong number.
NumberOrAxis = WrapValidator(_validate_number_or_axis)


class Window(NamedTuple):
    """A rectangle of the (δ, ε) plane: the range (low, high) of δ and the range of ε."""

    delta: tuple[float, float]
    epsilon: tuple[float, float]
