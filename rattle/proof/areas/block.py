"""The claims that are proved on blocks of the (δ, ε) plane, and a proved block as an exact JSON document."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from rattle.proof.certificate import Ends, text_of_number, texts_of_numbers

FORMAT = 1


class ClaimedState(StrEnum):
    """The existence and stability that a claim states for one of the motions A, B, C and D."""

    #: No motion with this letter exists.
    NONE = "none"
    #: Exactly one motion with this letter exists; its stability is not claimed.
    THERE = "there"
    #: Exactly one motion with this letter exists, and both of its multipliers are inside the unit circle.
    ATTRACTING = "attracting"
    #: Exactly one motion with this letter exists, and one of its multipliers is outside the unit circle.
    SADDLE = "saddle"


_NONE, _THERE, _ATTRACTING, _SADDLE = ClaimedState
#: The states that the claim of each region I to V gives to the motions A to D.
REGIONS = {
    "I": {"A": _NONE, "B": _NONE, "C": _NONE, "D": _NONE},
    "II": {"A": _SADDLE, "B": _NONE, "C": _THERE, "D": _NONE},
    "III": {"A": _SADDLE, "B": _SADDLE, "C": _THERE, "D": _ATTRACTING},
    "IV": {"A": _SADDLE, "B": _SADDLE, "C": _THERE, "D": _SADDLE},
    "V": {"A": _SADDLE, "B": _NONE, "C": _NONE, "D": _THERE},
}
#: The claims about one motion alone, C or D, as {letter: claim}. ABSENT: the motion does not exist.
ATTRACTING = {letter: f"{letter} attracts" for letter in "CD"}
SADDLE = {letter: f"{letter} is a saddle" for letter in "CD"}
ABSENT = {letter: f"{letter} is not there" for letter in "CD"}
#: {claim: {letter: state of the motion with this letter, by the claim}}. A claim says nothing about other motions.
CLAIMS: dict[str, dict[str, ClaimedState]] = {
    **REGIONS,
    **{claim: {letter: _ATTRACTING} for letter, claim in ATTRACTING.items()},
    **{claim: {letter: _SADDLE} for letter, claim in SADDLE.items()},
    **{claim: {letter: _NONE} for letter, claim in ABSENT.items()},
}
#: Claims about quiet running. "quiet captures": motions slower than a given speed become quiet.
QUIET, LOUD, CAPTURED = "quiet is possible", "quiet is impossible", "quiet captures"


@dataclass(frozen=True)
class ProvedBlock:
    """A theorem about all points of a block, edges included.

    claim: a region, "I" to "V", or another claim of this module, such as "C attracts" or "quiet is possible".
    beta: the half-backlash.
    delta, epsilon: both ends of the block in δ and in ε.
    speed: for the claim "quiet captures", the speed below which motions that leave Σ⁺ become quiet; otherwise None.
    """

    claim: str
    beta: Fraction
    delta: Ends
    epsilon: Ends
    speed: Fraction | None = None

    @property
    def area(self) -> Fraction:
        """The area of the block, (δ₁ − δ₀)(ε₁ − ε₀)."""
        return (self.delta[1] - self.delta[0]) * (self.epsilon[1] - self.epsilon[0])

    def document(self) -> dict[str, object]:
        """Return the block as a JSON document. Each number is text that is exact: a decimal or a ratio."""
        document: dict[str, object] = {
            "format": FORMAT,
            "theorem": "area",
            "claim": self.claim,
            "beta": text_of_number(self.beta),
            "delta": texts_of_numbers(self.delta),
            "epsilon": texts_of_numbers(self.epsilon),
        }
        return document if self.speed is None else {**document, "speed": text_of_number(self.speed)}

    def json(self) -> str:
        """Return the block as JSON text on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
