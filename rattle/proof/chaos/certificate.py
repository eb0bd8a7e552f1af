"""The certificate of a horseshoe: a theorem about chaos. Its numbers are exact, so other programs can check it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.certificate import FORMAT, text_of_number, texts_of_numbers
from rattle.proof.chaos.coverings import HSet

THEOREM = "horseshoe"


@dataclass(frozen=True)
class HorseshoeLoop:
    """A chain of sets from set 0 through other sets back to set 0; the impact map stretches each set across the next.

    L is the number of steps. sets: the numbers (L − 1,) of the other sets, in order.
    sigma_minus: for each step (L,) the number of impacts on Σ⁻.
    periods: for each step (L,) the number of forcing periods from a set to the next.
    """

    sets: tuple[int, ...]
    sigma_minus: tuple[int, ...]
    periods: tuple[int, ...]

    @property
    def length(self) -> int:
        """L, the number of impacts on Σ⁺ in the loop."""
        return len(self.sigma_minus)

    @property
    def first_set_number(self) -> int:
        """The number of the first set after set 0, by which loops are distinguished; 0 for a loop of length 1."""
        return (*self.sets, 0)[0]


@dataclass(frozen=True)
class HorseshoeCertificate:
    """A theorem about the impact map Π at exact parameters: it has a horseshoe.

    In each loop every set covers the next (Lemma 11 of docs/proofs.md), and the sets after set 0 are disjoint for
    different loops. So for every sequence of loops there is a motion that goes through them in this order (Lemma 12),
    and the topological entropy is bounded from below (Lemma 13).

    parameters: δ, ε and β. sets: all sets; loops begin and end at set 0. loops: the loops.
    per_impact, per_period: lower bounds of the entropy per impact on Σ⁺ and per forcing period, in nats.
    versions: versions of the programs that made the certificate.
    """

    parameters: dict[str, Fraction]
    sets: tuple[HSet, ...]
    loops: tuple[HorseshoeLoop, ...]
    per_impact: Fraction
    per_period: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return the theorem in one sentence."""
        where = ", ".join(f"{name} = {text_of_number(value)}" for name, value in self.parameters.items())
        lengths = ", ".join(str(loop.length) for loop in self.loops)
        return (
            f"At {where} the impact map has a horseshoe of {len(self.loops)} loops ({lengths} impacts): entropy at "
            f"least {text_of_number(self.per_impact)} an impact on Σ⁺, {text_of_number(self.per_period)} "
            "a forcing period."
        )

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Numbers that are not integers are text: decimals or ratios."""
        return {
            "format": FORMAT,
            "theorem": THEOREM,
            "model": "impacting",
            "parameters": {name: text_of_number(value) for name, value in self.parameters.items()},
            "sets": [texts_of_numbers([*each.centre, *each.unstable, *each.stable]) for each in self.sets],
            "loops": [
                {"sets": list(loop.sets), "sigma_minus": list(loop.sigma_minus), "periods": list(loop.periods)}
                for loop in self.loops
            ],
            "entropy_per_impact": text_of_number(self.per_impact),
            "entropy_per_period": text_of_number(self.per_period),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the certificate as JSON text on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
