"""Inputs and results for a designer of gears: a machine in SI units, tolerances, design limits, sounds."""
