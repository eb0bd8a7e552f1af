"""Compiled kernels are found again by the next process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import rattle


def warm_up() -> str:
    """What numba says of its cache while every kernel is run."""
    command = [sys.executable, "-c", "import rattle; rattle.warm_up(kappa=1e4)"]
    environment = os.environ | {"NUMBA_DEBUG_CACHE": "1"}
    return subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout


def test_a_second_process_compiles_nothing() -> None:
    warm_up()
    said = warm_up()
    assert "data loaded from" in said
    assert "saved to" not in said


STRETCHED = """
import numpy as np, rattle.stiff
found = rattle.stiff.iterate_tangent(0.6, 0.1, np.linspace(0, 1, 64), 4.0, 20, 0.6, 1e4)
print(*(float(x).hex() for x in found.lyapunov.ravel()))
"""


def test_the_process_that_compiles_computes_the_same_bits_as_the_next(tmp_path: Path) -> None:
    """Of functions that several kernels call, each has to use its own copy in either."""
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path), "NUMBA_DEBUG_CACHE": "1"}

    def lines(*marks: str) -> tuple[list[str], list[bool]]:
        command = [sys.executable, "-c", STRETCHED]
        said = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
        return said.splitlines()[-1].split(), [mark in said for mark in marks]

    compiled, saved = lines("saved to")
    loaded, kept = lines("data loaded from", "saved to")
    assert saved == [True]
    assert kept == [True, False]
    assert len(loaded) == 128
    assert compiled == loaded


def test_only_modules_that_compute_decide_which_version_it_is(tmp_path: Path) -> None:
    package = tmp_path / "rattle"
    shutil.copytree(Path(rattle.__file__).parent, package)

    def version() -> str:
        command = [sys.executable, "-c", "from rattle._compile import source_hash; print(source_hash())"]
        return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout

    before = version()
    (package / "plot" / "colours.py").write_text("changed = True\n")
    assert version() == before
    (package / "curves" / "new.py").write_text("changed = True\n")
    assert version() != before
