"""The certificate of a claim about all points of a block of the (δ, ε) plane; all its numbers are exact."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.proof.certificate import Ends, text, texts

FORMAT = 1


class ClaimedState(StrEnum):
    """State that a claim gives to the motion A, B, C or D."""

    NONE = "none"
    THERE = "there"  # exactly one such motion exists; its stability is not claimed
    ATTRACTING = "attracting"
    SADDLE = "saddle"


_NONE, _THERE, _ATTRACTING, _SADDLE = ClaimedState
REGIONS = {
    "I": {"A": _NONE, "B": _NONE, "C": _NONE, "D": _NONE},
    "II": {"A": _SADDLE, "B": _NONE, "C": _THERE, "D": _NONE},
    "III": {"A": _SADDLE, "B": _SADDLE, "C": _THERE, "D": _ATTRACTING},
    "IV": {"A": _SADDLE, "B": _SADDLE, "C": _THERE, "D": _SADDLE},
    "V": {"A": _SADDLE, "B": _NONE, "C": _NONE, "D": _THERE},
}
ATTRACTING = {letter: f"{letter} attracts" for letter in "CD"}
SADDLE = {letter: f"{letter} is a saddle" for letter in "CD"}
ABSENT = {letter: f"{letter} is not there" for letter in "CD"}
#: The state of each motion that a claim names; a claim states nothing about other motions.
CLAIMS: dict[str, dict[str, ClaimedState]] = {
    **REGIONS,
    **{claim: {letter: _ATTRACTING} for letter, claim in ATTRACTING.items()},
    **{claim: {letter: _SADDLE} for letter, claim in SADDLE.items()},
    **{claim: {letter: _NONE} for letter, claim in ABSENT.items()},
}
QUIET, LOUD, CAPTURED = "quiet is possible", "quiet is impossible", "quiet captures"


@dataclass(frozen=True)
class ProvedBlock:
    """Theorem about all points of the block delta × epsilon at one half-backlash beta.

    Attributes
    ----------
    claim : str
        A key of `CLAIMS`, or `QUIET`, `LOUD` or `CAPTURED`.
    beta : Fraction
        Half-backlash.
    delta, epsilon : tuple[Fraction, Fraction]
        Ends of the block; its edges belong to it.
    speed : Fraction or None
        With the claim `CAPTURED`: every motion that leaves Σ⁺ slower than this becomes quiet.
    """

    claim: str
    beta: Fraction
    delta: Ends
    epsilon: Ends
    speed: Fraction | None = None

    @property
    def area(self) -> Fraction:
        """Area of the block in the (δ, ε) plane, (δ₁ − δ₀)(ε₁ − ε₀)."""
        return (self.delta[1] - self.delta[0]) * (self.epsilon[1] - self.epsilon[0])

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Its numbers are exact texts: decimals or ratios of integers."""
        document: dict[str, object] = {
            "format": FORMAT,
            "theorem": "area",
            "claim": self.claim,
            "beta": text(self.beta),
            "delta": texts(self.delta),
            "epsilon": texts(self.epsilon),
        }
        return document if self.speed is None else {**document, "speed": text(self.speed)}

    def json(self) -> str:
        """Return the certificate's JSON document on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
