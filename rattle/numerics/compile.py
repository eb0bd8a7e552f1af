"""How kernels are compiled: one decorator, and a disk cache that an edit can never leave stale.

Numba's own cache looks only at the file that holds a function, so it misses an edit in a helper that the function
imports. Ours is keyed by the sources of the whole library, the compiler's versions and the processor. Processes share
it: the first that needs a kernel compiles it, the others wait for its file.
"""

import hashlib
import inspect
import logging
import os
import platform
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from numba.extending import overload, register_jitable

from rattle.errors import RattleError

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise RattleError("NUMBA_DISABLE_JIT is set, and without the compiler nothing can be computed: unset it")

log = logging.getLogger(__name__)  # INFO: a kernel that is compiled, not loaded

LOCK_POLL_SECONDS, SAID_SECONDS, SUSPENDED_SECONDS = 0.05, 1.0, 120.0
OBJECTS = 50_000  # that are made between two collections of garbage; Python's own default is 700

COMPUTE_NOTHING = {"plot", "paper", "proof", "resilience", "notebook.py", "warm.py"}  # of what a survey holds


@cache
def source_hash() -> str:
    """Hex SHA-256 over the sources that compute: two equal hashes give bit-identical numbers on one machine."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in COMPUTE_NOTHING:
            digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def toolchain() -> dict[str, str]:
    """What the last bits of numbers depend on beside the sources: versions, and the processor with its features."""
    features = binding.get_host_cpu_features()
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "processor": f"{platform.machine()} {binding.get_host_cpu_name()}",
        "processor_features": " ".join(sorted(name for name, there in features.items() if there)),
    }


@cache
def _default_root(usual: str) -> str:
    """Return the usual directory or, where it cannot be written, a directory for temporary files of this user only."""
    for root in (usual, os.path.join(tempfile.gettempdir(), f"rattle-cache-{os.getuid()}")):
        with suppress(OSError):
            os.makedirs(root, 0o700, exist_ok=True)
            found = os.lstat(root)
            private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
            if os.access(root, os.W_OK | os.X_OK) and (root == usual or private):  # what is loaded is executed
                return root
    return usual


def _cache_directory() -> str:
    root = os.environ.get("RATTLE_CACHE_DIR") or _default_root(
        os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "rattle")
    )
    toolchain = (sys.version, platform.machine(), numba.__version__, llvmlite.__version__, np.__version__)
    key = hashlib.sha256(repr((source_hash(), toolchain)).encode()).hexdigest()[:24]
    return os.path.join(root, key)


def note_in_cache(name: str) -> Path:
    """Where a note about this cache may be left, such as that it is complete; of this processor, as its kernels are."""
    processor = f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"
    return Path(_cache_directory(), f"{name}-{hashlib.sha256(processor.encode()).hexdigest()[:12]}.note")


#: IEEE arithmetic but for fused multiply-add and the sign of zero; 1/0 is inf, not an exception. Reassociation would
#: break the rounding trick of `rattle.flight.law` and the sums that avoid cancellation.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "nsz"},
    "no_cfunc_wrapper": True,
}
_KERNEL: dict[str, Any] = _OPTIONS | {"_nrt": True, "forceinline": False}
_INLINE: dict[str, Any] = _OPTIONS | {"_nrt": False, "forceinline": True, "no_cpython_wrapper": True}


@cache
def can_be_kept() -> bool:
    """Whether the cache can be written; says so if not. Numba would take a directory beside the sources, where code can
    be stale.
    """
    try:
        os.makedirs(_cache_directory(), exist_ok=True)
        tempfile.TemporaryFile(dir=_cache_directory()).close()
    except OSError as error:
        log.warning(
            "kernels cannot be kept, and every process compiles them (%s): let RATTLE_CACHE_DIR name a directory "
            "that can be written",
            error,
        )
        return False
    return True


def for_type(function: Callable[..., Any], kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Say what a function is, inside kernels, whose last argument is a named tuple of this kind: the decorated one."""

    def register(implementation: Callable[..., Any]) -> Callable[..., Any]:
        def choose(*arguments: Any) -> Any:
            return implementation if getattr(arguments[-1], "instance_class", None) is kind else None

        chooser: Any = choose
        chooser.__signature__ = inspect.signature(implementation)  # numba matches arguments by their names
        options = _KERNEL | {"no_cpython_wrapper": True}
        overload(function, strict=False, jit_options=options)(chooser)
        return implementation

    return register


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a kernel on first call, and cache it on disk; other threads run meanwhile."""
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, _cache_directory()
    try:
        return numba.njit(nogil=True, cache=can_be_kept(), **_KERNEL)(function)
    finally:
        config.CACHE_DIR = before


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small function into its callers: a loop over it stays one straight line, which LLVM vectorises."""
    return register_jitable(**_INLINE)(function)
