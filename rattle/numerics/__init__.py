"""Compilation, tables, polynomials, complex-step derivatives, secant steps, sampling: nothing about gears."""

from rattle.numerics.compile import compile_apart, note_of
from rattle.numerics.processes import environment, leave_working_directory
from rattle.numerics.struct_of_arrays import StructOfArrays

__all__ = ["StructOfArrays", "compile_apart", "environment", "leave_working_directory", "note_of"]
