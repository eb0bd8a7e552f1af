"""The proved share of a plane, from the blocks' areas: exact sums."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock

REGION = "the region"
#: What holds on which blocks, and on which it is proved not to; elsewhere it is not told.
_KINDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "A is there, a saddle": (("II", "III", "IV", "V"), ("I",)),
    "B is there, a saddle": (("III", "IV"), ("I", "II", "V")),
    "C is there": ((ATTRACTING["C"], SADDLE["C"]), (ABSENT["C"],)),
    ATTRACTING["C"]: ((ATTRACTING["C"],), (SADDLE["C"], ABSENT["C"])),
    "D is there": ((ATTRACTING["D"], SADDLE["D"]), (ABSENT["D"],)),
    ATTRACTING["D"]: ((ATTRACTING["D"],), (SADDLE["D"], ABSENT["D"])),
    QUIET: ((QUIET,), (LOUD,)),
    CAPTURED: ((CAPTURED,), (LOUD,)),
}


@dataclass(frozen=True)
class Share:
    """proved: the part of the plane on which it is proved to hold; of_where: at least so much of where it holds."""

    what: str
    proved: float
    of_where: float

    def __str__(self) -> str:
        """Return a readable description."""
        return f"{self.what}: {self.proved:.2%} of the plane, at least {self.of_where:.2%} of where it holds"


def shares_of_claims(blocks: Iterable[ProvedBlock], area: Fraction) -> list[Share]:
    """Return the shares of a plane of this area, one for each claim.

    Blocks of one claim do not overlap, nor do those of I to V.

    Returns
    -------
    list[Share]
        Exact fractions of the area.
    """
    areas: defaultdict[str, Fraction] = defaultdict(Fraction)
    for block in blocks:
        areas[block.claim] += block.area
    told = sum((areas[region] for region in REGIONS), Fraction(0))
    found = [Share(REGION, float(told / area), float(told / area))]
    for what, (there, absent) in _KINDS.items():
        proved = sum((areas[claim] for claim in there), Fraction(0))
        possible = area - sum((areas[claim] for claim in absent), Fraction(0))
        found.append(Share(what, float(proved / area), float(proved / possible) if possible else 1.0))
    return found
