"""How kernels are compiled: one decorator, and a disk cache that an edit can never leave stale.

Numba's own cache looks only at the file that holds a function, so it misses an edit in a helper that the function
imports. Ours is keyed by the sources of the whole library, the compiler's versions and the processor.
"""

import hashlib
import os
import platform
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.extending import register_jitable

config: Any = numba.config  # its options are made at run time


@cache
def source_hash() -> str:
    """Hex SHA-256 over the library's sources: two equal hashes compute bit-identical numbers on one machine."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _cache_directory() -> str:
    root = os.environ.get("RATTLE_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "rattle"
    )
    toolchain = (sys.version, platform.machine(), numba.__version__, llvmlite.__version__, np.__version__)
    key = hashlib.sha256(repr((source_hash(), toolchain)).encode()).hexdigest()[:24]
    return os.path.join(root, key)


#: IEEE arithmetic but for fused multiply-add and the sign of zero; 1/0 is inf, not an exception. Reassociation would
#: break the rounding trick of `rattle.flight` and the sums that avoid cancellation.
_ARITHMETIC: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel on first call, and cache it on disk; other threads run meanwhile."""
    before = config.CACHE_DIR
    config.CACHE_DIR = _cache_directory()
    try:
        return numba.njit(cache=True, nogil=True, no_cfunc_wrapper=True, **_ARITHMETIC)(function)
    finally:
        config.CACHE_DIR = before


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small function into its callers: a loop over it stays one straight line, which LLVM vectorises.

    From Python it stays the plain function: compiled entries that nobody calls cost a sixth of a cold start.
    """
    return register_jitable(forceinline=True, no_cfunc_wrapper=True, **_ARITHMETIC)(function)
