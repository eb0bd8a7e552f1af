"""The precompiled kernels are all that a survey needs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from depth import deep
from waiting import HANG

NEEDED = """
import logging
import sys
import numpy as np
import rattle
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import intensities_of, follow_motions_one_by_one
from rattle.impacting.attractors.classifier import cells_of
from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.bifurcations.curve_tracing import trace
from rattle.parameters import Parameters
from rattle.stiff import StiffGear
from rattle.stiff.attractors import classifier

logging.basicConfig(level=logging.INFO, stream=sys.stdout)
kappa = KAPPA
rattle.precompile(kappa=kappa, preload=True, optional=True)
print("precompiled", flush=True)
delta, epsilon, beta = np.full(3, 0.5), np.array([0.01, 0.1, 0.2]), np.full(3, 0.7)
if kappa is None:
    gear, table = rattle.Gear(0.5, 0.1, 0.7), rattle.attractors_of(delta, epsilon, beta, count=32)
    cells, stretched = cells_of(Parameters.from_values("impacting", delta, epsilon, beta)), stretch
    trace("G1", 0.7)
    rattle.grazing("G2", delta, 0.7)
else:
    gear, table = StiffGear(0.5, 0.1, 0.7, kappa), classifier.attractors_of(delta, epsilon, beta, kappa, count=32)
    cells = classifier.cells_of(Parameters.from_values("stiff", delta, epsilon, beta, kappa=kappa))
    stretched = follow_motions_one_by_one
gear.orbits()
impulse_balance_errors(table, cells)
intensities_of(table, cells, stretched)
"""


@pytest.mark.parametrize("kappa", [None, pytest.param(1e4, marks=deep)])
def test_what_is_precompiled_is_all_that_a_survey_needs(kappa: float | None, tmp_path: Path) -> None:
    """In an empty cache, nothing is compiled elsewhere in the plane once the kernels of surveys are there."""
    command = [sys.executable, "-c", NEEDED.replace("KAPPA", repr(kappa))]
    environment = os.environ | {"RATTLE_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    before, after = ran.stdout.split("precompiled\n")
    assert before.count("compiling") >= 5
    assert after == ""
