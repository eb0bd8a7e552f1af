"""Kernels are compiled in parts, which processes divide; together they are all that a survey needs."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from depth import deep
from waiting import HANG, wait_until

from rattle import warm
from rattle.numerics import compile as compiling

NEEDED = """
import logging
import numpy as np
import rattle
from rattle import warm
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import intensities_of, one_by_one
from rattle.impacting.attractors.classifier import cells_of
from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.bifurcations.curves import trace
from rattle.stiff import StiffGear
from rattle.stiff.attractors import classifier

needed = []
log = logging.getLogger("rattle.numerics.compile")
log.setLevel(logging.DEBUG)
log.addFilter(lambda record: record.msg.startswith("needs") and needed.append(record.args[0]))
kappa = KAPPA
warm.warm_up(kappa)
parts = len(needed)
assert parts > 10
delta, epsilon, beta = np.full(3, 0.5), np.array([0.01, 0.1, 0.2]), np.full(3, 0.7)
if kappa is None:
    gear, table = rattle.Gear(0.5, 0.1, 0.7), rattle.attractors_of(delta, epsilon, beta, count=32)
    cells, stretched = cells_of(delta, epsilon, beta), stretch
    trace("G1", 0.7)
    rattle.grazing("G2", delta, 0.7)
else:
    gear, table = StiffGear(0.5, 0.1, 0.7, kappa), classifier.attractors_of(delta, epsilon, beta, kappa, count=32)
    cells, stretched = classifier.cells_of(delta, epsilon, beta, np.full(3, kappa)), one_by_one
gear.orbits()
impulse_balance_errors(table, cells)
intensities_of(table, cells, stretched)
print(needed[parts:])
"""


@pytest.mark.parametrize("kappa", [None, pytest.param(1e4, marks=deep)])
def test_the_parts_are_all_that_a_survey_needs(kappa: float | None) -> None:
    code = NEEDED.replace("KAPPA", repr(kappa))
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout == "[]\n"


@pytest.fixture
def done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The parts that are done here, of three; what is noted of them is in a directory of its own."""
    names: list[str] = []

    def part(name: str) -> Callable[[], None]:
        return lambda: names.append(name)

    monkeypatch.setattr(warm, "_parts", lambda _kappa, _intensities: {name: part(name) for name in "abc"})
    monkeypatch.setattr(compiling, "_cache_directory", lambda: str(tmp_path))
    compiling.can_be_kept.cache_clear()
    return names


def test_a_process_does_what_no_other_is_at(done: list[str]) -> None:
    warm.compile_parts()
    with compiling.unless_elsewhere("b") as is_free:
        assert is_free
        warm.compile_parts()
    with compiling.unless_elsewhere("a"):
        warm.compile_parts()
    assert "".join(done) == "abc" + "ac" + "cb"


def test_another_process_helps_until_all_is_done(
    done: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    helps = tmp_path / "helps"
    told = f"import os, sys, time; open({str(helps)!r}, 'w').write(str(os.getpid())); time.sleep({HANG}) #{{}} {{}}"
    monkeypatch.setattr(warm, "HELP", told)
    monkeypatch.setattr(warm, "_processors", lambda: 2)
    parts = warm._parts(None, True) | {"c": lambda: wait_until(lambda: helps.exists() and helps.read_text())}
    monkeypatch.setattr(warm, "_parts", lambda _kappa, _intensities: parts)
    warm.compile_together()
    with pytest.raises(ProcessLookupError):
        os.kill(int(helps.read_text()), 0)
    assert "".join(done) == "abab"
    warm.compile_together()  # which is noted
    assert "".join(done) == "abab"


def test_one_processor_has_no_help(done: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm, "_processors", lambda: 1)
    monkeypatch.setattr(warm, "HELP", None)  # would be an error
    warm.compile_together()
    assert "".join(done) == "abcabc"


@deep
def test_the_process_that_helps_compiles_what_this_one_does_not(tmp_path: Path) -> None:
    code = "import logging; logging.basicConfig(level=logging.INFO); from rattle import warm; warm.compile_together()"
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    compiled_here = ran.stderr.count(":compiling ")
    assert 0 < compiled_here < len(list(tmp_path.rglob("*.nbi")))
