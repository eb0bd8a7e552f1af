"""Populations whose restitution and error once a tooth differ, against the machines that they consist of."""

from typing import Any

import numpy as np
import pytest

import rattle
from rattle.attractors.speeds import NATURAL
from rattle.populations.gears import compute_gears
from rattle.populations.plan import PopulationPlan
from rattle.populations.tolerances import Tolerances

#: The drawing of docs/engineers.md.
PAIR: dict[str, Any] = {
    "inertia": 0.003, "drag": 5e-4, "radius": 0.05, "teeth": 20, "backlash": 100e-6, "drive": "speed", "rpm": 1500.0,
    "driven_inertia": 0.02, "driven_drag": 4e-3, "driven_teeth": 35, "eccentricity": 15e-6,
}  # fmt: skip
RESTITUTION, MESH_ERROR = 0.9, 0.06e-6
COUNT = 64


def quiet_share(**changed: float) -> float:
    machine = rattle.Machine(**PAIR | changed)
    return sum(each.fraction for each in machine.gear.attractors(COUNT, NATURAL, 3) if each.kind == "quiet")


def near(value: float) -> rattle.Uniform:
    return rattle.Uniform(value * (1 - 1e-12), value * (1 + 1e-12))


def test_each_gear_is_the_machine_that_it_is_alone() -> None:
    varied = {"restitution": rattle.Uniform(0.85, 0.95), "mesh_error": rattle.Uniform(0.03e-6, 0.09e-6)}
    plan = PopulationPlan(Tolerances(PAIR | varied), gears=5, count=COUNT, seed=3, pairs=0)
    found = compute_gears(plan, 0, 5)
    shares = []
    for k, values in enumerate(plan.values(np.arange(5))):
        numbers = dict(zip(plan.tolerances.names, values.tolist(), strict=True))
        shares.append(quiet_share(**numbers))
        assert (found.energy[k] == 0.0).mean() == shares[-1], numbers
    assert len(set(shares)) > 2


def test_gears_that_hardly_differ_are_the_single_gear() -> None:
    given = PAIR | {"restitution": near(RESTITUTION), "mesh_error": near(MESH_ERROR)}
    found = rattle.population(given, gears=6, count=COUNT, seed=3, pairs=0)
    expected = quiet_share(restitution=RESTITUTION, mesh_error=MESH_ERROR)
    assert 0.4 < expected < 0.8
    assert found.quiet.value == pytest.approx(expected, abs=1 / COUNT)


def test_the_yield_falls_as_the_mesh_error_grows() -> None:
    def answers(mesh_error: float) -> tuple[float, float]:
        varied = {"restitution": rattle.Uniform(0.85, 0.9), "mesh_error": rattle.Uniform(0.5 * mesh_error, mesh_error)}
        found = rattle.population(PAIR | varied, gears=24, count=8, share=0.6, judged=12, pairs=0, budget=20_000)
        return found.quiet.value, found.passing.value

    quiet, passing = np.transpose([answers(each) for each in (0.02e-6, 0.06e-6, 0.12e-6, 0.2e-6)])
    assert quiet[0] == passing[0] == 1.0
    assert (np.diff(quiet) < -0.05).all()
    assert (np.diff(passing) <= 0.0).all()
    assert passing[-1] < 0.3


def test_less_restitution_makes_more_gears_pass() -> None:
    def quiet(restitution: float) -> float:
        varied = {"restitution": rattle.Uniform(restitution - 0.02, restitution + 0.02)}
        given = PAIR | varied | {"mesh_error": MESH_ERROR}
        return float(rattle.population(given, gears=24, count=16, pairs=0).quiet.value)

    assert 1.0 == quiet(0.75) > quiet(0.9) > quiet(0.97)
