"""What a designer gives and gets: a machine in SI units, tolerances, design limits, sounds."""
