"""Families: the attractors of a grid, connected between neighbouring cells, so that one motion has one number."""

from rattle.families.family_table import tabulate_families
from rattle.families.join import in_order, joined, together
from rattle.families.pieces import GridPiece, connect_attractors, continue_into_piece, no_attractors
from rattle.families.spread import Rectangle
from rattle.families.sums import NO_FAMILY, QUIET_FAMILY, Sums, add_sums, numbers_of, sums_of

__all__ = [
    "NO_FAMILY",
    "QUIET_FAMILY",
    "GridPiece",
    "Rectangle",
    "Sums",
    "add_sums",
    "connect_attractors",
    "continue_into_piece",
    "in_order",
    "joined",
    "no_attractors",
    "numbers_of",
    "sums_of",
    "tabulate_families",
    "together",
]
