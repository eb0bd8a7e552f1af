"""Pairs of gears in SI units, as engineers have them."""

from rattle.machine.conversion import Units
from rattle.machine.machine import Machine, MachineIntensity

__all__ = ["Machine", "MachineIntensity", "Units"]
