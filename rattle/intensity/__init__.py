"""The loudness of a motion: its impacts, their sums, their order spectrum, and their sound."""

from rattle.intensity.intensity import natural_energy
from rattle.intensity.sound import wav
from rattle.intensity.table import Intensities

__all__ = [
    "Intensities",
    "natural_energy",
    "wav",
]
