"""Pairs of gears in SI units, with the numbers that engineers know."""

from rattle.machine.conversion import DRIVES, ReducedPair, Units
from rattle.machine.given import RPM, UNITS
from rattle.machine.machine import Machine, MachineIntensity
from rattle.machine.point import machine_point
from rattle.machine.transmission_error import TransmissionError, read_transmission_error, transmission_error
from rattle.machine.verdict import VERDICTS, MachineVerdict

__all__ = [
    "DRIVES",
    "RPM",
    "UNITS",
    "VERDICTS",
    "Machine",
    "MachineIntensity",
    "MachineVerdict",
    "ReducedPair",
    "TransmissionError",
    "Units",
    "machine_point",
    "read_transmission_error",
    "transmission_error",
]
