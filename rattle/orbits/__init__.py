"""Tools for any return map: iterates and tangents, periodic orbits, saddles, manifolds."""

from rattle.orbits.orbits_a_to_d import PAPER_REGIONS, region_in_words

__all__ = [
    "PAPER_REGIONS",
    "region_in_words",
]
