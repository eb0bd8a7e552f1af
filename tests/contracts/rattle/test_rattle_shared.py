"""Kernels that others call by name are compiled once, and there for whoever needs them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from compiled import compiled
from numba.core.errors import NumbaError
from numba.core.types import float64, int64
from waiting import HANG

from rattle.numerics.shared import shared

MODULE = """
import logging, sys
from numba.core.types import float64, int64
from rattle.numerics.compile import kernel
from rattle.numerics.shared import shared

logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)


@shared(float64(float64, int64), "test half")
def half(x, n):
    return 0.5 * x * n


@kernel
def one(x):
    return half(x, 1)


@kernel
def other(x):
    return half(x, 3) + half(2, 2)
"""
CALLS = "from halves import one, other, half; print(one(3.0), other(1.0), half(5.0, 1))"
AT_ONCE = """
import threading
import rattle.numerics.compile as c
from halves import half, one

waits, begun, provide = threading.Event(), threading.Event(), half.provide


def late():
    begun.set()
    waits.wait(1)  # what compiles `half` from Python has its lock by then, if it can have it
    provide()


half.provide = late
compiling = threading.Thread(target=one, args=(3.0,))
compiling.start()
begun.wait()
print(half(5.0, 1), flush=True)
compiling.join()
print(one(3.0))
"""


@pytest.fixture
def run(tmp_path: Path):
    """What a process prints that has the cache and the modules of this directory."""
    (tmp_path / "halves.py").write_text(MODULE)
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path / "cache")}

    def run(code: str) -> list[str]:
        command = [sys.executable, "-c", code]
        return subprocess.run(
            command, check=True, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=HANG
        ).stdout.splitlines()

    return run


def test_it_is_compiled_once_for_all_that_call_it(run, tmp_path):
    *said, found = run(CALLS)
    assert said == ["compiling one", "compiling half", "compiling other"]
    assert found == "1.5 3.5 2.5"
    assert run(CALLS) == [found]
    # Its own file is lost: who calls it is loaded, and it is compiled.
    (lost,) = {path.parent for path in tmp_path.rglob("halves.half-*")}
    for path in lost.glob("halves.half-*"):
        path.unlink()
    assert run(CALLS) == ["compiling half", found]
    shutil.rmtree(tmp_path / "cache")
    assert run("from halves import half; print(half(5.0, 1))") == ["compiling half", "2.5"]
    assert run(CALLS) == ["compiling one", "compiling other", found]


def test_two_threads_that_come_to_it_from_two_sides_do_not_wait_for_each_other(run):
    assert not [line for line in run(AT_ONCE) if line.startswith("waiting")]


def test_what_does_not_suit_its_signature_is_refused():
    @shared(int64(float64), "test wrong")
    def wrong(x):
        return 0.5 * x

    @compiled
    def calls(x):
        return wrong(x)

    with pytest.raises(NumbaError):
        calls("a")
    with pytest.raises((TypeError, NumbaError), match="test wrong returns float64, not int64"):
        calls(1.0)
