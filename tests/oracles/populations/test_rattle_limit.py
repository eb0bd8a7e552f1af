"""Design limits against known bifurcations, and against samples with other seeds on either side."""

import math
from typing import Any

import numpy as np
import pytest
from depth import deep

import rattle
from rattle.attractors.speeds import NATURAL
from rattle.populations.limit import damping_at_quiet_limit, design_limit, design_limits

DRAWING = {"inertia": 0.003, "drag": 1.5e-3, "backlash": 300e-6, "radius": 0.05, "rpm": 3000.0}


def quiet(gear: rattle.Gear, seed: int = 91, count: int = 2048) -> float:
    return sum(each.fraction for each in gear.attractors(count, NATURAL, seed) if each.kind == "quiet")


def test_nearly_all_is_quiet_until_soon_after_the_first_motion_is_born() -> None:
    found = design_limit({"delta": 0.6}, "epsilon", 0.99, count=1024)
    born = rattle.Gear(0.6, 0.1).sn1
    assert found.low <= found.value <= found.high
    assert born - 1e-4 < found.low < found.high < born + 0.002
    assert born < found.high
    assert quiet(rattle.Gear(0.6, found.low)) > 0.985
    assert quiet(rattle.Gear(0.6, found.high)) < 0.995


@pytest.mark.parametrize("share", [pytest.param(0.5, marks=deep), 0.8])
def test_the_interval_holds_the_limit_of_other_samples(share: float) -> None:
    found = design_limit({"delta": 0.6}, "epsilon", share, count=512)
    assert found.low <= found.value <= found.high
    error = 2.0 * math.sqrt(share * (1.0 - share) / 2048)
    assert quiet(rattle.Gear(0.6, found.low)) > share - error
    assert quiet(rattle.Gear(0.6, found.high)) < share + error


def test_the_limit_of_a_machine_is_in_its_unit() -> None:
    machine = rattle.Machine(**DRAWING, eccentricity=0.0)
    plain = design_limit({"delta": machine.delta, "beta": machine.beta}, "epsilon", 0.9, count=256)
    found = design_limit(DRAWING, "eccentricity", 0.9, count=256)
    assert found == pytest.approx(tuple(x * machine.units.length for x in plain), rel=1e-3)  # a sample may differ


def test_the_least_damping_is_where_the_largest_eccentricity_is() -> None:
    largest = design_limit({"delta": 0.6}, "epsilon", 0.8, count=512)
    least = design_limit({"epsilon": largest.value}, "delta", 0.8, count=512, between=(0.4, 0.9))
    assert least.low <= least.value <= least.high
    assert least.low - 0.01 <= 0.6 <= least.high + 0.01


@pytest.mark.parametrize("of", ["backlash", "drag", "rpm", "eccentricity"])
def test_every_number_of_a_machine_has_its_limit_and_its_safe_side(of: str) -> None:
    given = DRAWING | {"eccentricity": 25e-6}
    found = design_limit(given, of, 0.8, count=128)
    assert found.low < found.value < found.high
    safe, unsafe = (found.high, found.low) if of == "drag" else (found.low, found.high)
    assert quiet(rattle.Machine(**{**given, of: safe}).gear, count=1024) > 0.8
    assert quiet(rattle.Machine(**{**given, of: unsafe}).gear, count=1024) < 0.8


def test_limits_over_another_number_are_those_one_by_one() -> None:
    found = design_limits({"beta": 0.6}, "epsilon", "delta", (0.5, 0.7), 0.8, count=256)
    assert found == [design_limit({"delta": delta}, "epsilon", 0.8, count=256) for delta in (0.5, 0.7)]
    assert found[0].value < found[1].value


def test_a_limit_that_is_not_between_the_ends_is_none() -> None:
    always = design_limit({"delta": 0.6}, "epsilon", 0.9, between=(0.01, 0.05), count=256)
    never = design_limit({"epsilon": 0.15}, "delta", 0.9, between=(0.4, 0.46), count=256)
    assert np.isnan(always).all()
    assert np.isnan(never).all()


def test_below_the_least_damping_nothing_is_quiet() -> None:
    for epsilon in (1e-4, 0.1, 1.0):
        assert rattle.Gear(damping_at_quiet_limit(epsilon), epsilon).quiet_limit == pytest.approx(epsilon)
    assert damping_at_quiet_limit(2.0) == math.inf


@pytest.mark.parametrize(
    ("given", "of", "more", "says"),
    [
        ({"delta": 0.6}, "epsilon", {"count": 100}, "100 samples are too few for a share of 0.99: give a count of 396"),
        ({"delta": 0.6}, "radius", {}, "of must be one of epsilon"),
        ({"epsilon": 0.1}, "epsilon", {}, "delta must be given too"),
        ({"delta": 0.6}, "epsilon", {"between": (0.2, 0.1)}, r"between must be \(low, high\) with 0 <= low < high"),
        ({"epsilon": 0.0}, "delta", {}, "without an eccentricity all motions become quiet"),
        (DRAWING | {"radius": 50.0}, "eccentricity", {}, "radius must be in metres"),
    ],
)
def test_what_has_no_limit_is_refused(given: dict[str, Any], of: str, more: dict[str, Any], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        design_limit(given, of, **more)
