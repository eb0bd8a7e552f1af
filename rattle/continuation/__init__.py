"""Pseudo-arclength continuation, curves in the plane, the search for branches, sweeps, diagrams. Knows no gear."""

from rattle.continuation.arclength import plane_scale
from rattle.continuation.curves import FARTHEST

__all__ = [
    "FARTHEST",
    "plane_scale",
]
