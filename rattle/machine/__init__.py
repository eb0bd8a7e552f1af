"""Pairs of gears in SI units, as engineers have them."""

from rattle.machine.conversion import DRIVES, Reduced, Units
from rattle.machine.given import RPM, UNITS
from rattle.machine.machine import Machine, MachineIntensity
from rattle.machine.point import point_of

__all__ = ["DRIVES", "RPM", "UNITS", "Machine", "MachineIntensity", "Reduced", "Units", "point_of"]
