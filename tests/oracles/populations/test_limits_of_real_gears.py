"""Design limits of load, restitution and orders: where impacts lose most, teeth come together until the force turns."""

import math
from typing import Any

import numpy as np
import pytest

import rattle

LOSSY = {"delta": 0.5, "beta": 0.05, "restitution": 0.2}
DRAWING = {"inertia": 0.003, "drag": 5e-4, "backlash": 100e-6, "eccentricity": 15e-6, "radius": 0.05, "rpm": 3000}
FEW: dict[str, Any] = {"count": 32, "share": 0.8}
TURN = 2 * math.pi


def least_force(delta: float, parts: list[tuple[int, float]], load: float = 0.0) -> float:
    """The least contact force of a period, on a fine grid: δq + e'' + δe'."""
    t = np.linspace(0, 1, 400_001)
    force = np.full(t.size, 4 * math.pi * delta * (1 + load))
    for order, size in parts:
        turn = TURN * order
        force -= size * turn * (turn * np.cos(turn * t) + delta * np.sin(turn * t))
    return float(force.min())


def test_the_load_that_keeps_one_cosine_quiet_is_that_of_the_quiet_limit() -> None:
    epsilon = 0.4
    found = rattle.design_limit({**LOSSY, "epsilon": epsilon}, "load", **FEW)
    wanted = epsilon * TURN * math.hypot(TURN, 0.5) / (4 * math.pi * 0.5) - 1
    assert found.value == pytest.approx(wanted, rel=2e-3)


def test_the_largest_amplitude_of_an_order_is_where_the_force_turns() -> None:
    found = rattle.design_limit({**LOSSY, "epsilon": 0.05}, "harmonic_12", **FEW)
    size = 0.05 * found.value
    assert least_force(0.5, [(1, 0.05), (12, size * 0.99)]) > 0 > least_force(0.5, [(1, 0.05), (12, size * 1.01)])


def test_the_largest_mesh_error_of_a_machine() -> None:
    pair = DRAWING | {"restitution": 0.2, "teeth": 20, "driven_teeth": 20}
    found = rattle.design_limit(pair, "mesh_error", **FEW)
    by_order = rattle.design_limit({k: v for k, v in pair.items() if "teeth" not in k}, "error_20", **FEW)
    assert by_order.value == pytest.approx(found.value, rel=1e-9)
    least = least_force(5e-4 * 0.02 / 0.003, [(1, 15e-6 / 0.05), (20, found.value * 1.01 / 0.05)])
    assert least < 0 < least_force(5e-4 * 0.02 / 0.003, [(1, 15e-6 / 0.05), (20, found.value * 0.97 / 0.05)])


def test_the_load_torque_of_a_machine_is_its_load_times_the_drag_torque() -> None:
    pair = DRAWING | {"restitution": 0.2, "teeth": 20, "mesh_error": 0.5e-6}
    found = rattle.design_limit(pair, "load_torque", **FEW)
    delta = 5e-4 * 0.02 / 0.003
    parts = [(1, 15e-6 / 0.05), (20, 0.5e-6 / 0.05)]
    load = found.value / (5e-4 * 100 * math.pi)
    assert least_force(delta, parts, load * 1.02) > 0 > least_force(delta, parts, load * 0.97)


def test_a_restitution_keeps_a_gear_quiet_up_to_a_limit() -> None:
    found = rattle.design_limit(DRAWING, "restitution", 0.9, count=64)
    assert 0.9 < found.value < 1.0
    for restitution, quiet in ((0.9 * found.value, True), (1.0, False)):
        machine = rattle.Machine(**DRAWING, restitution=restitution)
        share = sum(each.fraction for each in machine.attractors(256) if each.kind == "quiet")
        assert (share > 0.9) == quiet


def test_limits_of_a_gear_with_harmonics_begin_at_its_own_quiet_limit() -> None:
    for of, better in (("epsilon", 0.99), ("delta", 1.01)):
        given = {**LOSSY, "epsilon": 0.05, "harmonic_7": 0.02}
        found = rattle.design_limit(given, of, **FEW).value
        for factor, holds in ((better, True), (1 / better, False)):
            numbers = {**given, of: found * factor}
            parts = [(1, numbers["epsilon"]), (7, 0.02 * numbers["epsilon"])]
            assert (least_force(numbers["delta"], parts) > 0) == holds


@pytest.mark.parametrize(
    ("given", "of", "said"),
    [
        ({**LOSSY, "epsilon": 3.0}, "harmonic_5", "the teeth cannot stay in contact at any harmonic_5"),
        ({**LOSSY, "epsilon": 0.1}, "harmonic_0", "of must be one of"),
        ({**LOSSY, "epsilon": 0.1}, "mesh_error", "both define the gear"),
    ],
)
def test_what_has_no_limit_says_so(given: dict[str, Any], of: str, said: str) -> None:
    with pytest.raises(rattle.ParameterError, match=said):
        rattle.design_limit(given, of, **FEW)
