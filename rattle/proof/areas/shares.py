"""The share of a plane on which each claim is proved, as exact sums of the areas of blocks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock

#: The statement that the region of a point, one of I to V, is proved. Blocks of all five regions count.
REGION = "the region"
#: {statement: (claims that prove it, claims that disprove it)}. Where neither is proved, the statement is open.
_CLAIMS_BY_STATEMENT: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
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
class ProvedShare:
    """The share of a plane on which a statement is proved.

    statement: the statement in words, such as "C attracts".
    proved: the proved area over the area of the plane.
    proved_where_true: a lower bound of the ratio of the proved area to the area on which the statement holds.
    """

    statement: str
    proved: float
    proved_where_true: float

    def __str__(self) -> str:
        """Return the statement and its shares in per cent."""
        return (
            f"{self.statement}: {self.proved:.2%} of the plane, at least {self.proved_where_true:.2%} of where it holds"
        )


def shares_of_claims(blocks: Iterable[ProvedBlock], area: Fraction) -> list[ProvedShare]:
    """Return the proved share of a plane for each statement.

    Parameters
    ----------
    blocks : Iterable[ProvedBlock]
        Blocks in the plane. Blocks with the same claim do not overlap, and blocks of different regions do not overlap.
    area : Fraction
        The area of the plane.

    Returns
    -------
    list[ProvedShare]
        The share on which a region I to V is proved, then one share for each other statement, such as "C attracts".
    """
    areas: defaultdict[str, Fraction] = defaultdict(Fraction)
    for block in blocks:
        areas[block.claim] += block.area
    regions = sum((areas[region] for region in REGIONS), Fraction(0))
    found = [ProvedShare(REGION, float(regions / area), float(regions / area))]
    for statement, (there, absent) in _CLAIMS_BY_STATEMENT.items():
        proved = sum((areas[claim] for claim in there), Fraction(0))
        possible = area - sum((areas[claim] for claim in absent), Fraction(0))
        found.append(ProvedShare(statement, float(proved / area), float(proved / possible) if possible else 1.0))
    return found
