"""Compilation, tables, polynomials, complex-step derivatives, secant steps, sampling: nothing about gears."""

from rattle.numerics.compile import compile_in_subprocess, completion_note_path
from rattle.numerics.processes import child_process_environment, remove_working_directory_from_path
from rattle.numerics.struct_of_arrays import StructOfArrays

__all__ = [
    "StructOfArrays",
    "child_process_environment",
    "compile_in_subprocess",
    "completion_note_path",
    "remove_working_directory_from_path",
]
