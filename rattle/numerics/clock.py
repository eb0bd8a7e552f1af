"""A clock that compiled code reads, for measuring what a part of a kernel takes."""

from __future__ import annotations

import time
from typing import Any

from numba import types
from numba.core.typing import signature

from rattle.numerics.compile import inline

_SECOND, _MONOTONIC = 1_000_000_000, time.CLOCK_MONOTONIC

#: Of the C library of every POSIX system: by its name, so that kernels that read the clock can be kept.
_clock_gettime: Any = types.ExternalFunction("clock_gettime", signature(types.int32, types.int32, types.voidptr))


@inline
def nanoseconds(room: Any) -> Any:
    """Nanoseconds of wall time since some moment; room (2,): integers to work with. Compiled code only."""
    _clock_gettime(_MONOTONIC, room.ctypes)
    return room[0] * _SECOND + room[1]
