"""What numba does beside compiling, done for less while a kernel is compiled or loaded; the code comes out the same.

A third of a process's start was garbage that is not there, and a twentieth of compiling are lists of variables and
options that numba makes anew each time it asks for them.
"""

from __future__ import annotations

import gc
import threading
from typing import Any

from numba.core import ir
from numba.core.targetconfig import TargetConfig

OBJECTS = 50_000  # that are made between two collections of garbage; Python's own default is 700
PLAIN = {str, int, float, bool, type(None), ir.Loc}  # of what a statement consists of and what holds no variables


def _collect(part: Any, found: list[ir.Var]) -> None:
    """Add the variables of a part of a statement in their order, as `Inst._rec_list_vars` lists them."""
    kind = type(part)
    if kind in PLAIN:
        return
    if kind is ir.Var or isinstance(part, ir.Var):
        found.append(part)
    elif isinstance(part, ir.Inst):
        found += part.list_vars()
    elif isinstance(part, (list, tuple)):
        for each in part:
            _collect(each, found)
    elif isinstance(part, dict):
        for each in part.values():
            _collect(each, found)


def _variables(_self: ir.Inst, part: Any) -> list[ir.Var]:
    found: list[ir.Var] = []
    _collect(part, found)
    return found


def _values(self: Any) -> dict[str, Any]:
    given = self._values
    return {name: given.get(name, option.default) for name, option in self.options.items()}


def _equal(self: TargetConfig, other: object) -> bool:
    if self is other:
        return True
    return self.values() == other.values() if isinstance(other, TargetConfig) else NotImplemented


OURS = (ir.Inst, "_rec_list_vars", _variables), (TargetConfig, "values", _values), (TargetConfig, "__eq__", _equal)


class _Frugal:
    """Numba's own ways and Python's collections are back when the last thread has left."""

    def __init__(self) -> None:
        self._lock, self._inside = threading.Lock(), 0
        self._before = gc.get_threshold()
        self._theirs: list[tuple[type, str, Any]] = []

    def __enter__(self) -> None:
        with self._lock:
            self._inside += 1
            if self._inside > 1:
                return
            self._before = gc.get_threshold()
            if 0 < self._before[0] < OBJECTS:  # 0: never
                gc.set_threshold(OBJECTS, *self._before[1:])
            for owner, name, ours in OURS:
                if name in vars(owner):  # else this numba has another way
                    self._theirs.append((owner, name, vars(owner)[name]))
                    setattr(owner, name, ours)

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside > 0:
                return
            gc.set_threshold(*self._before)
            while self._theirs:
                setattr(*self._theirs.pop())


frugal = _Frugal()
