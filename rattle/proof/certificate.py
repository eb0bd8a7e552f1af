"""The certificate of one periodic motion: a theorem in exact numbers, which other programs can check."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.errors import ParameterError, require_finite

#: Version of the JSON document.
FORMAT = 1
#: Text that is a decimal or a ratio of integers. Its limited length keeps exact numbers to a few thousand digits.
NUMBER = re.compile(r"[+-]?(\d{1,400}(\.\d{0,1100})?|\.\d{1,1100})([eE][+-]?\d{1,3})?|[+-]?\d{1,1100}/[1-9]\d{0,1100}")

Exact = str | float | Fraction
Ends = tuple[Fraction, Fraction]


class StabilityVerdict(StrEnum):
    """The stability that the enclosures of both multipliers prove."""

    ATTRACTING = "attracting"
    SADDLE = "saddle"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Certificate:
    """A theorem about one motion of the gear at exact parameters.

    There is exactly one periodic motion with these times, each ± time_radius, and these speeds, each ± speed_radius. It
    meets exactly these walls in this order in m forcing periods, and m is its least period. None of the speeds is 0.

    model: "impacting" or "stiff".
    parameters: δ, ε and β, and κ of the stiff gear.
    walls: the walls of its impacts or contacts in order, 1 for Σ⁺ and −1 for Σ⁻.
    times, speeds: times of the impacts and speeds after them; for the stiff gear times and speeds at the beginning and
    the end of each contact in turn.
    trace, determinant: both ends of the enclosures of the trace and the determinant of the tangent map over the m
    forcing periods.
    multipliers: ends of four enclosures, the real and the imaginary part of the first multiplier, then of the second.
    verdict: "attracting" if both multipliers are inside the unit circle, "saddle" if one is outside, else "undecided".
    versions: versions of the programs that made the certificate.
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
    verdict: StabilityVerdict
    versions: dict[str, str]

    @property
    def label(self) -> tuple[int, int, int]:
        """The label (m, n_plus, n_minus) of the motion."""
        return self.m, self.walls.count(1), self.walls.count(-1)

    def __str__(self) -> str:
        """Return the theorem in one sentence."""
        m, n_plus, n_minus = self.label
        where = ", ".join(f"{name} = {text_of_number(value)}" for name, value in self.parameters.items())
        verdict = "not decided" if self.verdict is StabilityVerdict.UNDECIDED else self.verdict
        return (
            f"At {where} the {self.model} gear has one P({m}, {n_plus}, {n_minus}) with these times ± "
            f"{float(self.time_radius):.0e}, {verdict}."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Each number that is no integer is text: a decimal or a ratio."""
        return {
            "format": FORMAT,
            "model": self.model,
            "parameters": {name: text_of_number(value) for name, value in self.parameters.items()},
            "label": list(self.label),
            "walls": list(self.walls),
            "times": texts_of_numbers(self.times),
            "speeds": texts_of_numbers(self.speeds),
            "time_radius": text_of_number(self.time_radius),
            "speed_radius": text_of_number(self.speed_radius),
            "trace": texts_of_numbers(self.trace),
            "determinant": texts_of_numbers(self.determinant),
            "multipliers": [texts_of_numbers(ends) for ends in self.multipliers],
            "verdict": str(self.verdict),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the certificate as JSON text on one line."""
        return json.dumps(self.document(), ensure_ascii=False)


def exact_number(name: str, value: Exact) -> Fraction:
    """Return the exact value of a decimal or ratio given as text, of a double or a Fraction. Raises ParameterError."""
    if isinstance(value, str):
        if NUMBER.fullmatch(value):
            return Fraction(value)
    elif isinstance(value, Fraction):
        return value
    else:
        return Fraction(require_finite(name, value))
    raise ParameterError(f"{name} must be a number, or text with an exact number such as '0.6' or '3/5', got {value!r}")


def text_of_number(value: Fraction) -> str:
    """Return an exact number as text: a decimal if finitely many decimals suffice, else a ratio of integers."""
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


def texts_of_numbers(values: Sequence[Fraction]) -> list[str]:
    """Return the texts of several exact numbers."""
    return [text_of_number(value) for value in values]
