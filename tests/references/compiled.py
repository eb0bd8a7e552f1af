"""Compiled functions of the tests, kept on disk between runs: an edit of the library or of an oracle compiles anew."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from rattle.numerics.compile import source_hash


def _directory() -> str:
    digest = hashlib.sha256(source_hash().encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    root = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return os.path.join(root, "rattle", f"oracles-{digest.hexdigest()[:24]}")


DIRECTORY = _directory()


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as numba does by default; its own cache sees no edit in what a function calls."""
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, DIRECTORY
    try:
        return numba.njit(cache=True)(function)
    finally:
        config.CACHE_DIR = before
