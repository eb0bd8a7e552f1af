"""Theorem about one point of a bifurcation curve: exact numbers, so that anybody can check it."""

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
    """A theorem about a point of the plane, at exact known parameters.

    The others lie between the ends `solved`. There a motion meets its walls at times that are within radius of these
    (n,), and no others, and has the multiplier 1 (kind "SN") or −1 ("PD"), or touches a wall with speed 0 at the impact
    of this number ("GR"). It is a regular zero of equations for all this, so alone near by. name: of the curve, or of
    the point of codimension two.
    """

    name: str
    motion: CurveMotion
    known: dict[str, Fraction]
    solved: dict[str, Ends]
    times: tuple[Fraction, ...]
    radius: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return a readable description."""
        where = ", ".join(f"{name} = {text(value)}" for name, value in self.known.items())
        found = ", ".join(f"{name} = {float(sum(ends) / 2):.16g}" for name, ends in self.solved.items())
        return f"{self.name} at {where}: a {WORDS[self.motion.kind]} at {found}"

    @property
    def width(self) -> Fraction:
        """Width of the widest enclosure of a parameter."""
        return max(high - low for low, high in self.solved.values())

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document: every number but the integers is text, a decimal or a ratio."""
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
        """Return the document, on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
