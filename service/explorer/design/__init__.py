"""Inputs and results of a designer: a machine in SI units, tolerances, design limits, sounds."""
