"""Theorem about one motion: exact numbers, so that anybody can check it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.errors import ParameterError, require_finite

FORMAT = 1
#: A decimal, or a ratio of integers; short enough for its powers of ten to be written out.
NUMBER = re.compile(r"[+-]?(\d{1,400}(\.\d{0,1100})?|\.\d{1,1100})([eE][+-]?\d{1,3})?|[+-]?\d{1,1100}/[1-9]\d{0,1100}")

Exact = str | float | Fraction
Ends = tuple[Fraction, Fraction]


class Verdict(StrEnum):
    """Verdict by the enclosed multipliers."""

    ATTRACTING = "attracting"
    SADDLE = "saddle"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Certificate:
    """A theorem about one motion of the gear at exact parameters.

    There is exactly one periodic motion with these times, each ± time_radius, and speeds, each ± speed_radius. It
    meets exactly these walls in this order in m forcing periods, m being its least period; no speed is 0. times: of its
    impacts, speeds: after them; of the stiff gear both at begin and end of each contact in turn. trace, determinant,
    multipliers: ends of enclosures (of multipliers, those of real and imaginary part in turn). verdict: whether both
    multipliers are inside the unit circle ("attracting"), one is outside ("saddle"), or that is not decided.
    """

    model: str
    parameters: dict[str, Fraction]
    m: int
    walls: tuple[int, ...]
    times: tuple[Fraction, ...]
    speeds: tuple[Fraction, ...]
    time_radius: Fraction
    speed_radius: Fraction
    trace: Ends
    determinant: Ends
    multipliers: tuple[Ends, Ends, Ends, Ends]
    verdict: Verdict
    versions: dict[str, str]

    @property
    def label(self) -> tuple[int, int, int]:
        """(m, n_plus, n_minus)."""
        return self.m, self.walls.count(1), self.walls.count(-1)

    def __str__(self) -> str:
        """Return a readable description."""
        m, n_plus, n_minus = self.label
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.parameters.items())
        return (
            f"At {where} the {self.model} gear has one P({m}, {n_plus}, {n_minus}) with these times ± "
            f"{float(self.time_radius):.0e}, {'not decided' if self.verdict is Verdict.UNDECIDED else self.verdict}."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document: every number but the integers is text, a decimal or a ratio."""
        return {
            "format": FORMAT,
            "model": self.model,
            "parameters": {name: text(value) for name, value in self.parameters.items()},
            "label": list(self.label),
            "walls": list(self.walls),
            "times": texts(self.times),
            "speeds": texts(self.speeds),
            "time_radius": text(self.time_radius),
            "speed_radius": text(self.speed_radius),
            "trace": texts(self.trace),
            "determinant": texts(self.determinant),
            "multipliers": [texts(ends) for ends in self.multipliers],
            "verdict": str(self.verdict),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the document, on one line."""
        return json.dumps(self.document(), ensure_ascii=False)


def exact_number(name: str, value: Exact) -> Fraction:
    """Return a decimal or a ratio as text, or a double, as the number that it is. Raises ParameterError."""
    if isinstance(value, str):
        if NUMBER.fullmatch(value):
            return Fraction(value)
    elif isinstance(value, Fraction):
        return value
    else:
        return Fraction(require_finite(name, value))
    raise ParameterError(f"{name} must be a number, or text such as '0.6' or '3/5' for that very number, got {value!r}")


def text(value: Fraction) -> str:
    """Return an exact number as a decimal, or as a ratio where it is none."""
    twos, fives, rest = 0, 0, value.denominator
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    if rest != 1:
        return str(value)
    places = max(twos, fives)
    digits = f"{abs(value.numerator) * 10**places // value.denominator:0{places + 1}d}"
    whole, part = digits[: len(digits) - places], digits[len(digits) - places :]
    return ("-" if value < 0 else "") + whole + (f".{part}" if part else "")


def texts(values: Sequence[Fraction]) -> list[str]:
    """Return the texts of several exact numbers."""
    return [text(value) for value in values]
