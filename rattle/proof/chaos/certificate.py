"""Theorem about chaos at one point of the plane: exact numbers, so that anybody can check it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.certificate import FORMAT, text, texts
from rattle.proof.chaos.coverings import HSet

THEOREM = "horseshoe"


@dataclass(frozen=True)
class Loop:
    """A chain of coverings from set 0 through these sets (L − 1,) back to it.

    Each of its L steps has how often Σ⁻ is met, and how many forcing periods later the next set is meant.
    """

    sets: tuple[int, ...]
    sigma_minus: tuple[int, ...]
    periods: tuple[int, ...]

    @property
    def length(self) -> int:
        """Impacts on Σ⁺."""
        return len(self.sigma_minus)

    @property
    def head(self) -> int:
        """The set after set 0, which tells the loop from others."""
        return (*self.sets, 0)[0]


@dataclass(frozen=True)
class HorseshoeCertificate:
    """A theorem about the impact map Π at exact parameters.

    Each loop is a chain of coverings, and the sets that follow set 0 in them are apart. So for every sequence of loops
    there is a motion that goes through them in this order, and the topological entropy is at least `per_impact` for
    each impact on Σ⁺, and at least `per_period` for each forcing period, in nats.
    """

    parameters: dict[str, Fraction]
    sets: tuple[HSet, ...]
    loops: tuple[Loop, ...]
    per_impact: Fraction
    per_period: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return a readable description."""
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.parameters.items())
        lengths = ", ".join(str(loop.length) for loop in self.loops)
        return (
            f"At {where} the impact map has a horseshoe of {len(self.loops)} loops ({lengths} impacts): entropy at "
            f"least {text(self.per_impact)} an impact on Σ⁺, {text(self.per_period)} a forcing period."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document: every number but the integers is text, a decimal or a ratio."""
        return {
            "format": FORMAT,
            "theorem": THEOREM,
            "model": "impacting",
            "parameters": {name: text(value) for name, value in self.parameters.items()},
            "sets": [texts([*each.centre, *each.unstable, *each.stable]) for each in self.sets],
            "loops": [
                {"sets": list(loop.sets), "sigma_minus": list(loop.sigma_minus), "periods": list(loop.periods)}
                for loop in self.loops
            ],
            "entropy_per_impact": text(self.per_impact),
            "entropy_per_period": text(self.per_period),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the document, on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
