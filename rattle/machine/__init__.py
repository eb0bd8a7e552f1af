"""Pairs of gears in SI units, as engineers have them."""

from rattle.machine.conversion import DRIVES, Units
from rattle.machine.given import RPM, UNITS
from rattle.machine.machine import Machine, MachineIntensity

__all__ = ["DRIVES", "RPM", "UNITS", "Machine", "MachineIntensity", "Units"]
