"""Pairs of gears in SI units, as engineers have them."""

from rattle.machine.machine import Machine, MachineIntensity, Units

__all__ = ["Machine", "MachineIntensity", "Units"]
