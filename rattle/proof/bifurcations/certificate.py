"""The certificate of one point of a bifurcation curve; all its numbers are exact."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction

from rattle.continuation.conditions import Kind
from rattle.proof.bifurcations.systems import CurveMotion
from rattle.proof.certificate import FORMAT, Ends, text, texts

THEOREM = "bifurcation"
WORDS = {Kind.SADDLE_NODE: "saddle-node", Kind.FLIP: "flip", Kind.GRAZING: "graze"}


@dataclass(frozen=True)
class BifurcationCertificate:
    """Theorem: at exact known parameters a motion bifurcates at a point between given ends.

    Attributes
    ----------
    name : str
        The curve, or the codimension-two point.
    known, solved : dict
        The parameters that are exact, and the ends of those that are enclosed.
    motion : CurveMotion
        The walls that the motion meets, in order, and the kind of its bifurcation: "SN" if a multiplier is 1, "PD" if
        one is −1, "GR" if one impact grazes a wall with speed 0.
    times, radius
        The impact times (n,), each known to within the radius.

    Notes
    -----
    The point is a regular zero of the equations of lemma 10 (docs/proofs.md), so no other zero is close.
    """

    name: str
    motion: CurveMotion
    known: dict[str, Fraction]
    solved: dict[str, Ends]
    times: tuple[Fraction, ...]
    radius: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return the theorem as one sentence."""
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.known.items())
        found = ", ".join(f"{name} = {float(sum(ends) / 2):.16g}" for name, ends in self.solved.items())
        return f"{self.name} at {where}: a {WORDS[self.motion.kind]} at {found}"

    @property
    def width(self) -> Fraction:
        """Width of the widest enclosure of a parameter."""
        return max(high - low for low, high in self.solved.values())

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Numbers except integers are texts: decimals or ratios."""
        return {
            "format": FORMAT,
            "theorem": THEOREM,
            "model": "impacting",
            "name": self.name,
            "kind": str(self.motion.kind),
            "walls": list(self.motion.walls),
            "m": self.motion.m,
            "impact": self.motion.impact,
            "known": {name: text(value) for name, value in self.known.items()},
            "solved": {name: texts(ends) for name, ends in self.solved.items()},
            "times": texts(self.times),
            "radius": text(self.radius),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the certificate's JSON document on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
