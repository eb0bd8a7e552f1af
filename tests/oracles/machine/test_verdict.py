"""The verdict of a machine against what is known of it: closed forms, attractors, and the margin of quiet running."""

import math

import pytest

import rattle

DRAWING = {"inertia": 0.003, "drag": 5e-4, "backlash": 100e-6, "radius": 0.05, "rpm": 3000}


def test_above_the_quiet_limit_a_machine_always_rattles() -> None:
    for eccentricity in (53.2e-6, 60e-6):  # the limit is δ 4π/(2π √(4π² + δ²)) · r = 53.05 µm
        found = rattle.Machine(**DRAWING, eccentricity=eccentricity).verdict()
        assert (found.kind, found.share, found.knock) == ("always_rattles", 1.0, 0.0)
    assert rattle.Machine(**DRAWING, eccentricity=52.9e-6, restitution=0.2).verdict(32).kind != "always_rattles"


def test_a_share_is_that_of_the_attractors_and_a_knock_the_margin_of_quiet_running() -> None:
    machine = rattle.Machine(**DRAWING, eccentricity=15e-6)
    found = machine.verdict(256)
    quiet = sum(each.fraction for each in machine.attractors(256) if each.kind == "quiet")
    assert found.kind == "rattles_sometimes"
    assert found.share == pytest.approx(1 - quiet, abs=0.01)
    assert found.low < found.share < found.high
    margin = machine.gear.boundary_distance("natural").v * machine.units.velocity  # type: ignore[attr-defined]
    assert margin * 0.99 <= found.knock <= 1.5 * margin
    assert str(found).startswith("rattles from 4")


def test_a_stable_motion_that_no_start_reaches_takes_a_knock() -> None:
    machine = rattle.Machine(**{**DRAWING, "rpm": 1500}, eccentricity=15e-6)  # P(1, 3, 0) is stable there
    found = machine.verdict(16)
    if found.kind == "quiet_unless_knocked":
        assert math.isfinite(found.knock)
        assert "unless knocked with" in str(found)
    else:
        assert found.share > 0.0


def test_losses_make_it_quiet() -> None:
    found = rattle.Machine(**DRAWING, eccentricity=15e-6, restitution=0.8).verdict(64)
    assert (found.kind, found.share, found.knock) == ("quiet", 0.0, math.inf)
    assert "no knock up to" in str(found)
