"""The loudness of a motion: its impacts one by one, what they sum up to, their order spectrum, their sound."""

from rattle.intensity.intensity import natural_energy
from rattle.intensity.sound import wav
from rattle.intensity.table import Intensities

__all__ = [
    "Intensities",
    "natural_energy",
    "wav",
]
