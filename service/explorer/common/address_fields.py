"""Dataclass fields that are part of a page's address (its URL): how each is read from its text, and written as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import field, fields
from typing import Any, TypeVar

from gear_rattle.service.operations.diagrams import Pair

T = TypeVar("T")
N = TypeVar("N", int, float)


def address_field(default: Any, parse: Callable[[str], Any], text: Callable[[Any], str] = str) -> Any:
    """Return a dataclass field whose value is part of a page's address, unless the value is the default.

    Parameters
    ----------
    parse : Callable[[str], Any]
        Returns the value that a text describes; raises ValueError if the text is not valid.
    text : Callable[[Any], str]
        Returns the text of a value.

    Returns
    -------
    Any
        The field.
    """
    return field(default=default, metadata={"parse": parse, "text": text})


def parse_address_fields(cls: Any, texts: Mapping[str, str]) -> dict[str, Any]:
    """Return {name: value} of the address fields of a dataclass `cls`, read from `texts`, which are {name: text}.

    Returns
    -------
    dict[str, Any]
        Values by name, without a field whose text is missing or invalid, or whose value is its default.
    """
    values = (
        (each, parse_text_or_default(texts, each.name, each.metadata["parse"], each.default))
        for each in fields(cls)
        if "parse" in each.metadata
    )
    return {each.name: value for each, value in values if value != each.default}


def address_field_texts(instance: Any) -> dict[str, str]:
    """Return {name: text} of the address fields of a dataclass instance, without fields that have their defaults."""
    values = ((each, getattr(instance, each.name)) for each in fields(instance) if "text" in each.metadata)
    return {each.name: each.metadata["text"](value) for each, value in values if value != each.default}


def parse_text_or_default(texts: Mapping[str, str], name: str, parse: Callable[[str], T], default: T) -> T:
    """Return `parse(texts[name])`; the default if there is no text of that name, or if `parse` raises ValueError."""
    try:
        return parse(texts[name]) if name in texts else default
    except ValueError:
        return default


def require_allowed_text(allowed: Collection[str], text: str) -> str:
    """Return an allowed text unchanged. Raises ValueError for any other text."""
    if text not in allowed:
        raise ValueError(f"One of {', '.join(allowed)} is needed, not {text!r}.")
    return text


def parse_pair(text: str) -> Pair:
    """Return the two finite numbers of a text such as "0.6,0.089". Raises ValueError for any other text."""
    first, second = (float(part) for part in text.split(","))
    if not (math.isfinite(first) and math.isfinite(second)):
        raise ValueError(f"Two finite numbers with a comma between them are needed, not {text!r}.")
    return first, second


def parse_point(text: str) -> Pair:
    """Return the point (δ, ε) that a text describes. Raises ValueError unless δ > 0 and ε ≥ 0."""
    delta, epsilon = parse_pair(text)
    if delta <= 0 or epsilon < 0:
        raise ValueError(f"A point needs a δ above 0 and an ε of at least 0, not {text!r}.")
    return delta, epsilon


def require_between(number: N, low: float, high: float) -> N:
    """Return a number unchanged. Raises ValueError unless low <= number <= high."""
    if not low <= number <= high:
        raise ValueError(f"A number from {low:g} to {high:g} is needed, not {number!r}.")
    return number


def pair_text(pair: Pair) -> str:
    """Return two numbers as text, with all digits, so that they are read back unchanged."""
    return ",".join(repr(float(value)) for value in pair)
