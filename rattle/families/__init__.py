"""Families: the attractors of a grid, connected between neighbouring cells, so that one motion has one number."""

from rattle.families.family_table import tabulate_families
from rattle.families.join import argsort_attractors, concat_tables, join_attractors
from rattle.families.pieces import GridPiece, connect_attractors, continue_into_piece, no_attractors
from rattle.families.spread import CellRectangle
from rattle.families.sums import (
    NO_FAMILY,
    QUIET_FAMILY,
    ComponentSums,
    assign_family_numbers,
    merge_component_sums,
    sum_over_components,
)

__all__ = [
    "NO_FAMILY",
    "QUIET_FAMILY",
    "CellRectangle",
    "ComponentSums",
    "GridPiece",
    "argsort_attractors",
    "assign_family_numbers",
    "concat_tables",
    "connect_attractors",
    "continue_into_piece",
    "join_attractors",
    "merge_component_sums",
    "no_attractors",
    "sum_over_components",
    "tabulate_families",
]
