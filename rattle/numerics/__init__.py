"""Compiling, polynomials, complex-step derivatives, the secant method, sampling: nothing of the gear."""

from rattle.numerics.compile import note_in_cache
from rattle.numerics.processes import environment, leave_working_directory

__all__ = [
    "environment",
    "leave_working_directory",
    "note_in_cache",
]
