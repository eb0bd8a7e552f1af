"""Continuation for any gear: pseudo-arclength, curves in the plane, the search for branches, sweeps, diagrams."""

from rattle.continuation.arclength import plane_scale
from rattle.continuation.curve_continuation import FARTHEST

__all__ = [
    "FARTHEST",
    "plane_scale",
]
