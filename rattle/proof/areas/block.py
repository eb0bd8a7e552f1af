"""Theorem about a block of the plane: exact numbers, so that anybody can check it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.proof.certificate import Ends, text, texts

FORMAT = 1


class ClaimedState(StrEnum):
    """Claim about A, B, C or D."""

    NONE = "none"
    THERE = "there"  # one, and whether it attracts is left open
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
#: What a claim says of which motions; of those that it does not name it says nothing.
CLAIMS: dict[str, dict[str, ClaimedState]] = {
    **REGIONS,
    **{claim: {letter: _ATTRACTING} for letter, claim in ATTRACTING.items()},
    **{claim: {letter: _SADDLE} for letter, claim in SADDLE.items()},
    **{claim: {letter: _NONE} for letter, claim in ABSENT.items()},
}
QUIET, LOUD, CAPTURED = "quiet is possible", "quiet is impossible", "quiet captures"


@dataclass(frozen=True)
class ProvedBlock:
    """A theorem about all δ and ε between these ends, at one β; speed: below it quiet captures, if that is claimed."""

    claim: str
    beta: Fraction
    delta: Ends
    epsilon: Ends
    speed: Fraction | None = None

    @property
    def area(self) -> Fraction:
        """(δ₁ − δ₀)(ε₁ − ε₀)."""
        return (self.delta[1] - self.delta[0]) * (self.epsilon[1] - self.epsilon[0])

    def document(self) -> dict[str, object]:
        """Return the block as a JSON document: every number is text, a decimal or a ratio, and exact."""
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
        """Return the document, on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
