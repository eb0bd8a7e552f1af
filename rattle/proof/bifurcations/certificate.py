"""The certificate of a point of a bifurcation curve: a theorem in exact numbers, which other programs can check."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction

from rattle.continuation.conditions import EventKind
from rattle.proof.bifurcations.systems import BifurcatingMotion
from rattle.proof.certificate import FORMAT, Ends, text_of_number, texts_of_numbers

THEOREM = "bifurcation"
WORDS = {EventKind.SADDLE_NODE: "saddle-node", EventKind.FLIP: "flip", EventKind.GRAZING: "graze"}


@dataclass(frozen=True)
class BifurcationCertificate:
    """A theorem about a point of a bifurcation curve in the (δ, ε) plane.

    At the `known` parameters, and at values of the other parameters between the ends `solved`, a motion meets its walls
    at times within `radius` of `times`, and meets no other walls. It has the multiplier 1 (kind "SN") or −1 ("PD"), or
    the speed of one of its impacts is 0 ("GR"). This motion is a regular zero of its equations (Lemma 10 of
    docs/proofs.md), so no other such motion is near it.

    name: the curve or the codimension-two point, such as "SN1" or "COD20"; the kind alone for an event of a branch.
    motion: the walls, the forcing periods, the kind and the grazing impact of the motion.
    known: exact values of parameters. solved: both ends of the enclosure of each other parameter.
    times, radius: the centres (n,) and the half-width of the box of the impacts' times.
    versions: versions of the programs that made the certificate.
    """

    name: str
    motion: BifurcatingMotion
    known: dict[str, Fraction]
    solved: dict[str, Ends]
    times: tuple[Fraction, ...]
    radius: Fraction
    versions: dict[str, str]

    def __str__(self) -> str:
        """Return the theorem in one sentence."""
        where = ", ".join(f"{name} = {text_of_number(value)}" for name, value in self.known.items())
        found = ", ".join(f"{name} = {float(sum(ends) / 2):.16g}" for name, ends in self.solved.items())
        return f"{self.name} at {where}: a {WORDS[self.motion.kind]} at {found}"

    @property
    def width(self) -> Fraction:
        """The width of the widest interval in `solved`, the enclosures of the unknown parameters."""
        return max(high - low for low, high in self.solved.values())

    def document(self) -> dict[str, object]:
        """Return the certificate as a JSON document. Each number that is no integer is text: a decimal or a ratio."""
        return {
            "format": FORMAT,
            "theorem": THEOREM,
            "model": "impacting",
            "name": self.name,
            "kind": str(self.motion.kind),
            "walls": list(self.motion.walls),
            "m": self.motion.m,
            "impact": self.motion.impact,
            "known": {name: text_of_number(value) for name, value in self.known.items()},
            "solved": {name: texts_of_numbers(ends) for name, ends in self.solved.items()},
            "times": texts_of_numbers(self.times),
            "radius": text_of_number(self.radius),
            "versions": self.versions,
        }

    def json(self) -> str:
        """Return the certificate as JSON text on one line."""
        return json.dumps(self.document(), ensure_ascii=False)
