"""The certificate of chaos at one point of the plane; all its numbers are exact."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.certificate import FORMAT, text, texts
from rattle.proof.chaos.coverings import HSet

THEOREM = "horseshoe"


@dataclass(frozen=True)
class Loop:
    """A chain of covering relations from set 0 back to set 0.

    Attributes
    ----------
    sets : tuple[int, ...]
        Numbers of the L − 1 sets between.
    sigma_minus : tuple[int, ...]
        For each of the L steps, the number of impacts on Σ⁻.
    periods : tuple[int, ...]
        For each step, the number of forcing periods until the next set is reached.
    """

    sets: tuple[int, ...]
    sigma_minus: tuple[int, ...]
    periods: tuple[int, ...]

    @property
    def length(self) -> int:
        """Number L of impacts on Σ⁺."""
        return len(self.sigma_minus)

    @property
    def head(self) -> int:
        """Number of the set after set 0. It is different for each loop."""
        return (*self.sets, 0)[0]


@dataclass(frozen=True)
class HorseshoeCertificate:
    """Theorem: the impact map Π has a horseshoe at exact parameters.

    Each loop is a chain of covering relations. The sets that follow set 0 in the loops are disjoint. So for every
    sequence of loops a motion exists that passes through them in this order (lemmas 11 and 12 of docs/proofs.md). The
    topological entropy is at least `per_impact` for each impact on Σ⁺ and `per_period` for each forcing period, in nats
    (lemma 13).
    """

    parameters: dict[str, Fraction]
    sets: tuple[HSet, ...]
    loops: tuple[Loop, ...]
    per_impact: Fraction
    per_period: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return the theorem as one sentence."""
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.parameters.items())
        lengths = ", ".join(str(loop.length) for loop in self.loops)
        return (
            f"At {where} the impact map has a horseshoe of {len(self.loops)} loops ({lengths} impacts): entropy at "
            f"least {text(self.per_impact)} an impact on Σ⁺, {text(self.per_period)} a forcing period."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Numbers except integers are texts: decimals or ratios."""
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
        """Return the certificate's JSON document on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
