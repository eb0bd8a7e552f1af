"""Compiled kernels are found again by the next process."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from depth import deep
from waiting import HANG

import rattle
from rattle.impacting.map.quiet import largest_eta

PACKAGE = Path(rattle.__file__).parent


def warm_up(root: Path) -> str:
    """What numba says of its cache while every kernel is run, of the package in this directory. The last line says
    whether the impacting gear's needed what they are compiled with, and where the package is.
    """
    code = "import sys, rattle; rattle.warm_up(); compiler = 'numba.np.linalg' in sys.modules"
    code += "; rattle.warm_up(kappa=1e4); print(compiler, rattle.__file__)"
    environment = os.environ | {"NUMBA_DEBUG_CACHE": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=environment, cwd=root).stdout


def test_a_second_process_compiles_nothing_wherever_its_sources_are(tmp_path: Path) -> None:
    warm_up(PACKAGE.parent)
    shutil.copytree(PACKAGE, tmp_path / "rattle", ignore=shutil.ignore_patterns("__pycache__"))
    said = warm_up(tmp_path)
    assert said.splitlines()[-1] == f"False {tmp_path / 'rattle' / '__init__.py'}"
    assert "data loaded from" in said
    assert "saved to" not in said


HOLDING = """
import sys, time
import rattle.numerics.compile as c
from rattle.impacting.map.quiet import largest_eta

inside = c._SharedCache.save_overload


def save(self, *arguments):
    print("holds", flush=True)
    sys.stdin.readline()
    inside(self, *arguments)


c._SharedCache.save_overload = save
largest_eta(0.6)
"""
LOADING = HOLDING.replace("save", "load").replace("inside(self", "return inside(self")
WAITING = """
import logging
from rattle.impacting.map.quiet import largest_eta

logging.basicConfig(level=logging.INFO, format="%(message)s")
largest_eta(0.6)
"""


PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Of processes that have a cache of their own, and say what they do with it."""
    return os.environ | {"RATTLE_CACHE_DIR": str(tmp_path), "NUMBA_DEBUG_CACHE": "1"}


@pytest.fixture
def at_work(environment: dict[str, str]) -> Iterator[tuple[subprocess.Popen[str], subprocess.Popen[str]]]:
    """Two processes that need the same kernel: one compiles it until it is told to go on, the other waits for that."""
    with subprocess.Popen([sys.executable, "-uc", HOLDING], env=environment, **PIPES) as holding:
        try:
            assert any(line == "holds\n" for line in holding.stdout)
            with subprocess.Popen([sys.executable, "-uc", WAITING], env=environment, **PIPES) as waiting:
                try:
                    assert next(waiting.stdout) == "waiting for another process to compile largest_eta\n"
                    yield holding, waiting
                finally:
                    waiting.kill()
        finally:
            holding.kill()


Processes = tuple["subprocess.Popen[str]", "subprocess.Popen[str]"]


def test_no_two_processes_compile_the_same_kernel(at_work: Processes, environment: dict[str, str]) -> None:
    holding, waiting = at_work
    said, _ = holding.communicate("go on\n", HANG)
    assert "saved to" in said
    said, _ = waiting.communicate(timeout=HANG)
    assert waiting.returncode == 0
    assert "data loaded from" in said
    assert "compiling" not in said
    # One that is suspended while it loads what they have left holds nobody up.
    with subprocess.Popen([sys.executable, "-uc", LOADING], env=environment, **PIPES) as suspended:
        try:
            assert any(line == "holds\n" for line in suspended.stdout)
            command = [sys.executable, "-uc", WAITING]
            said = subprocess.run(command, env=environment, check=True, timeout=HANG, **PIPES).stdout
        finally:
            suspended.kill()
    assert "data loaded from" in said
    assert "waiting" not in said


def test_a_kernel_whose_process_is_killed_is_compiled_by_who_waits(at_work: Processes) -> None:
    holding, waiting = at_work
    holding.kill()
    said, _ = waiting.communicate(timeout=HANG)
    assert waiting.returncode == 0
    assert "compiling largest_eta" in said


def test_without_a_cache_every_process_compiles_and_says_how_to_have_one(tmp_path: Path) -> None:
    package = tmp_path / "rattle"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    code = "from rattle.impacting.map.quiet import largest_eta; print(largest_eta(0.6))"
    environment = os.environ | {"RATTLE_CACHE_DIR": "/proc/nowhere", "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", code]
    ran = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout) == largest_eta(0.6)
    assert ran.stderr.count("RATTLE_CACHE_DIR") == 1
    assert not list(package.rglob("*.nbi"))  # beside the sources it could be stale


def test_where_the_home_directory_cannot_be_written_this_user_has_a_cache_elsewhere(tmp_path: Path) -> None:
    code = "from rattle.impacting.map.quiet import largest_eta; print(largest_eta(0.6))"
    without = {name: value for name, value in os.environ.items() if name not in ("RATTLE_CACHE_DIR", "XDG_CACHE_HOME")}
    environment = without | {"HOME": "/proc/nowhere", "TMPDIR": str(tmp_path), "NUMBA_DEBUG_CACHE": "1"}

    def said() -> str:
        command = [sys.executable, "-c", code]
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANG)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout + ran.stderr

    place = tmp_path / f"rattle-cache-{os.getuid()}"
    assert "saved to" in said()
    assert place.stat().st_mode & 0o777 == 0o700
    again = said()
    assert "data loaded from" in again
    assert "saved to" not in again
    place.chmod(0o770)  # others may write there, and what is loaded is executed
    assert "data loaded from" not in said()
    place.rename(tmp_path / "theirs")
    (tmp_path / "theirs").chmod(0o700)
    place.symlink_to(tmp_path / "theirs")
    refused = said()
    assert "data loaded from" not in refused
    assert "RATTLE_CACHE_DIR" in refused


STRETCHED = """
import numpy as np, rattle.stiff
found = rattle.stiff.iterate_tangent(0.6, 0.1, np.linspace(0, 1, 64), 4.0, 20, 0.6, 1e4)
print(*(float(x).hex() for x in found.lyapunov.ravel()))
"""


@deep
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
    shutil.copytree(PACKAGE, package)

    def version() -> str:
        command = [sys.executable, "-c", "from rattle.numerics.compile import source_hash; print(source_hash())"]
        return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout

    before = version()
    for folder in ("plot", "paper", "proof"):
        (package / folder / "new.py").write_text("changed = True\n")
    assert version() == before
    (package / "orbits" / "new.py").write_text("changed = True\n")
    assert version() != before
