"""The gear whose walls do not give way (paper 2.3, 2.4)."""

from rattle.impacting.attractors.plane import ImpactingPlane

__all__ = [
    "ImpactingPlane",
]
