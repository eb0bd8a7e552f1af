"""Kernels that others call are compiled once, and there for whoever needs them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from depth import deep
from waiting import HANG

MODULE = """
import logging, sys
import numba
from numba.core.types import float64, int64
from rattle.numerics.compile import kernel
from rattle.numerics.shared import shared

logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)


@shared(float64(float64, int64))
def half(x, n):
    return 0.5 * x * n


@kernel
def one(x):
    return half(x, 1)


@kernel
def other(x):
    return half(x, 3) + half(2, 2)


@numba.njit(cache=True)
def another(x):
    return half(x, 5)


@kernel
def of_words(x):
    return half("words", 1)


@shared(int64(float64))
def wrong(x):
    return 0.5 * x


@kernel
def of_wrong(x):
    return wrong(x)
"""
CALLS = "from halves import one, other; print(one(3.0), other(1.0))"


@pytest.fixture
def run(tmp_path: Path):
    """What a process prints that has the cache and the module of this directory, and what it dies of."""
    (tmp_path / "halves.py").write_text(MODULE)
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path / "cache")}

    def run(code: str) -> tuple[list[str], str]:
        command = [sys.executable, "-c", code]
        said = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=HANG)
        return said.stdout.splitlines(), said.stderr

    return run


def test_it_is_compiled_once_for_all_that_call_it(run, tmp_path):
    found = "1.5 3.5"
    assert run(CALLS) == (["compiling one", "compiling half", "compiling other", found], "")
    # Its own file is lost: those that call it are loaded, and it is compiled.
    (lost,) = {path.parent for path in tmp_path.rglob("halves.half-*")}
    for path in lost.glob("halves.half-*"):
        path.unlink()
    assert run(CALLS) == (["compiling half", found], "")
    assert run(CALLS) == ([found], "")


@deep
def test_a_function_that_only_numba_keeps_finds_it_too(run):
    code = "from halves import another; print(another(1.0), sum(another.stats.cache_hits.values()))"
    run(code)
    assert run(code) == (["2.5 1"], "")


def test_what_does_not_suit_its_signature_is_refused(run):
    code = """
from halves import of_words, of_wrong
try:
    of_words(1.0)
except Exception as error:
    print(type(error).__module__)
try:
    of_wrong(1.0)
except RuntimeError as error:
    print(error)
"""
    said, complaint = run(code)
    assert [line for line in said if not line.startswith("compiling")] == [
        "numba.core.errors",
        "halves.wrong cannot be compiled",
    ]
    assert "TypeError: halves.wrong returns float64, not int64" in complaint
