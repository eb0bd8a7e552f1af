"""The share of the plane on which each claim is proved: exact sums of the blocks' areas."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock

REGION = "the region"
#: For each statement, the claims of the blocks where it holds and of those where it fails. It is undecided elsewhere.
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
    """Proved shares of one statement.

    Attributes
    ----------
    proved : Fraction
        Share of the plane on which the statement is proved.
    of_where : Fraction
        Lower bound of the proved share of the area where the statement holds.
    """

    what: str
    proved: float
    of_where: float

    def __str__(self) -> str:
        """Return both shares as percentages in one sentence."""
        return f"{self.what}: {self.proved:.2%} of the plane, at least {self.of_where:.2%} of where it holds"


def shares_of_claims(blocks: Iterable[ProvedBlock], area: Fraction) -> list[Share]:
    """Return the proved shares of each statement over a plane of the given area.

    Returns
    -------
    list[Share]
        One share for each statement. Blocks with the same claim, and blocks of regions, must not overlap.
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
