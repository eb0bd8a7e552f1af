"""The certificate of one periodic motion; all its numbers are exact."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.errors import ParameterError, require_finite

FORMAT = 1
#: A decimal number or a ratio of integers. The exponent is short, so that the number can be written out as an integer.
NUMBER = re.compile(r"[+-]?(\d{1,400}(\.\d{0,1100})?|\.\d{1,1100})([eE][+-]?\d{1,3})?|[+-]?\d{1,1100}/[1-9]\d{0,1100}")

Exact = str | float | Fraction
Ends = tuple[Fraction, Fraction]


class Verdict(StrEnum):
    """Stability of a motion, from its enclosed multipliers."""

    ATTRACTING = "attracting"
    SADDLE = "saddle"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Certificate:
    """Theorem about one periodic motion of a gear at exact parameters.

    Exactly one periodic motion has its event times within time_radius of `times` and its speeds within speed_radius of
    `speeds`. It meets exactly `walls`, in this order, in m forcing periods. Its least period is m, and no speed is 0.

    Attributes
    ----------
    times, speeds : tuple[Fraction, ...]
        Of the impacting gear the times of impacts and the speeds after them. Of the stiff gear the times and speeds at
        the beginning and end of each contact in turn.
    trace, determinant
        Ends of the enclosures of the tangent map's trace and determinant over one period.
    multipliers
        Ends of the enclosures of both multipliers: real part, then imaginary part, of each.
    verdict : Verdict
        "attracting" if both multipliers lie inside the unit circle, "saddle" if one lies outside, else "undecided".
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
        """Label (m, n_plus, n_minus) of the motion."""
        return self.m, self.walls.count(1), self.walls.count(-1)

    def __str__(self) -> str:
        """Return the theorem as one sentence."""
        m, n_plus, n_minus = self.label
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.parameters.items())
        return (
            f"At {where} the {self.model} gear has one P({m}, {n_plus}, {n_minus}) with these times ± "
            f"{float(self.time_radius):.0e}, {'not decided' if self.verdict is Verdict.UNDECIDED else self.verdict}."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Numbers except integers are texts: decimals or ratios."""
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
        """Return the certificate's JSON document on one line."""
        return json.dumps(self.document(), ensure_ascii=False)


def exact_number(name: str, value: Exact) -> Fraction:
    """Return the exact value of a decimal or ratio in a text, of a Fraction, or of a double. Raises ParameterError."""
    if isinstance(value, str):
        if NUMBER.fullmatch(value):
            return Fraction(value)
    elif isinstance(value, Fraction):
        return value
    else:
        return Fraction(require_finite(name, value))
    raise ParameterError(
        f"{name} must be a number, or a text such as '0.6' or '3/5' for an exact number, got {value!r}"
    )


def text(value: Fraction) -> str:
    """Return an exact number as a decimal if its decimals end, else as a ratio."""
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
