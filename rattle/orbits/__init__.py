"""Tools for any return map: iterates and tangents, periodic orbits, saddles, manifolds."""

from rattle.orbits.period_one_orbits import PAPER_REGIONS, region_in_words

__all__ = [
    "PAPER_REGIONS",
    "region_in_words",
]
