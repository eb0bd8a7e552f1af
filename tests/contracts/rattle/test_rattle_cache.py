"""Compiled kernels are found again by the next process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from depth import deep
from waiting import HANG, wait_until

import rattle
from rattle.impacting.map.quiet import largest_eta

PACKAGE = Path(rattle.__file__).parent


PIPES = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
WORK = """
import os, time
from pathlib import Path

HERE = Path(__file__).parent


def held(model):
    return {"all": wait}


def failing(model):
    return {"all": lambda: 1 / 0}


def wait():
    with open(HERE / "began", "a") as began:
        print(os.getpid(), file=began)
    while not (HERE / "go").exists():
        time.sleep(0.01)
"""
COMPILING = """
import logging
from rattle.numerics.compile import compile_in_subprocess

logging.basicConfig(level=logging.INFO, format="%(message)s")
compile_in_subprocess("impacting", "work:held")
print("there")
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return the environment of processes with a cache of their own; their work lasts until a file `go` exists."""
    (tmp_path / "work.py").write_text(WORK)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    return os.environ | {"RATTLE_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": path}


def started(environment: dict[str, str]) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, "-uc", COMPILING], env=environment, **PIPES)


def at_work(tmp_path: Path) -> list[int]:
    """The processes that have begun to compile."""
    began = tmp_path / "began"
    return [int(line) for line in began.read_text().splitlines()] if began.exists() else []


def test_one_process_compiles_and_the_others_wait(environment: dict[str, str], tmp_path: Path) -> None:
    with started(environment) as first, started(environment) as second:
        try:
            wait_until(lambda: at_work(tmp_path))
            (tmp_path / "go").touch()
            said = [each.communicate(timeout=HANG)[0] for each in (first, second)]
        finally:
            first.kill()
            second.kill()
    assert sorted("compiling all of the impacting model, 1 of 1" in each for each in said) == [False, True]
    assert [each.splitlines()[-1] for each in said] == ["there", "there"]
    assert len(at_work(tmp_path)) == 1


def test_what_a_killed_process_had_compiled_ends_and_another_compiles(
    environment: dict[str, str], tmp_path: Path
) -> None:
    with started(environment) as first:
        wait_until(lambda: at_work(tmp_path))
        with started(environment) as second:
            try:
                first.kill()
                wait_until(lambda: len(at_work(tmp_path)) == 2)
                wait_until(lambda: not is_alive(at_work(tmp_path)[0]))
                (tmp_path / "go").touch()
                assert second.communicate(timeout=HANG)[0].splitlines()[-1] == "there"
            finally:
                second.kill()


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_kernels_that_cannot_be_compiled_say_why(environment: dict[str, str], tmp_path: Path) -> None:
    command = [sys.executable, "-c", COMPILING.replace("held", "failing")]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANG)
    assert said.returncode
    assert "RattleError: kernels cannot be compiled: " in said.stderr
    assert "ZeroDivisionError: division by zero" in said.stderr
    assert not list(tmp_path.rglob("*.note"))


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
    said()  # compiled by a process of its own, whose words are not heard here
    kept = {each: each.stat().st_mtime_ns for each in place.rglob("*.nbc")}
    assert kept
    assert place.stat().st_mode & 0o777 == 0o700
    again = said()
    assert "data loaded from" in again
    assert "saved to" not in again
    assert {each: each.stat().st_mtime_ns for each in place.rglob("*.nbc")} == kept
    place.chmod(0o770)  # others may write there, and what is loaded is executed
    assert "data loaded from" not in said()
    place.rename(tmp_path / "theirs")
    (tmp_path / "theirs").chmod(0o700)
    place.symlink_to(tmp_path / "theirs")
    refused = said()
    assert "data loaded from" not in refused
    assert "RATTLE_CACHE_DIR" in refused


LOADED = """
import numpy as np, rattle, rattle.stiff, sys

def stretched():
    found = rattle.stiff.iterate_tangent(0.6, 0.1, np.linspace(0, 1, 64), 4.0, 20, 0.6, 1e4)
    return found.lyapunov.ravel()

def classified():
    table = rattle.stiff.StiffGear(0.6, 0.1, 0.6, 1e4).attractors(16)
    return [x for each in table for x in (each.fraction, *each.lyapunov, each.tau, each.v)]

works = [stretched, classified]
found = {work: work() for work in (works if sys.argv[1] == "forwards" else works[::-1])}
print(*(float(x).hex() for work in works for x in found[work]))
"""


@deep
def test_bits_do_not_depend_on_who_compiles_nor_on_what_is_loaded_first(tmp_path: Path) -> None:
    """The first of these processes has its kernels compiled, by another one; the others load them."""
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path)}

    def bits(order: str) -> str:
        command = [sys.executable, "-c", LOADED, order]
        return subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout

    first = bits("forwards")
    assert len(first.split()) > 128
    assert first == bits("forwards") == bits("backwards")


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
