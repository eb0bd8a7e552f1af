"""Populations against the gears that they consist of, one by one."""

from typing import Any

import numpy as np
import pytest
from depth import deep

import rattle
from rattle.attractors.speeds import NATURAL
from rattle.populations.gears import FAILS, NOT_ASKED, PASSES, compute_gears, initial_states, judge_gears
from rattle.populations.plan import PopulationPlan, Shock
from rattle.populations.tolerances import Tolerances

DRAWING = {"inertia": 0.003, "drag": 1.5e-3, "backlash": 300e-6, "radius": 0.05, "rpm": 3000.0}  # δ = 0.01
GIVEN = DRAWING | {"eccentricity": rattle.Normal(45e-6, 15e-6, low=0.0)}
PAPER = {"delta": 0.6, "epsilon": rattle.Uniform(0.03, 0.21), "beta": rattle.Uniform(0.55, 0.65)}


def of(given: dict[str, Any], correlation: Any = None, **asked: Any) -> PopulationPlan:
    return PopulationPlan(Tolerances(given, correlation), **asked)


def test_a_gear_is_what_it_is_alone_to_the_bit() -> None:
    plan = of(PAPER, gears=6, count=64, seed=3, pairs=0)
    found = compute_gears(plan, 0, 6)
    for k in range(6):
        gear = rattle.Gear(found.delta[k], found.epsilon[k], found.beta[k])
        energies = []
        for each in gear.attractors(64, NATURAL, seed=3):
            energy = np.nan if each.kind == "undecided" else gear.intensity(each).energy
            energies += [energy] * round(64 * each.fraction)
        exact = gear.attractors(64, NATURAL, seed=3)
        assert (found.energy[k] == 0.0).mean() == sum(x.fraction for x in exact if x.kind == "quiet")
        assert found.energy[k] == pytest.approx(np.sort(energies), rel=0.1, nan_ok=True)


def test_rows_do_not_depend_on_the_others_that_are_computed() -> None:
    plan = of(PAPER, gears=12, count=8, pairs=5, share=0.7, judged=4)
    whole = compute_gears(plan, 0, plan.rows)
    for start, stop in ((0, 5), (5, 14), (14, plan.rows)):
        part = compute_gears(plan, start, stop)
        for a, b in zip(part, whole, strict=True):
            assert np.array_equal(a, b[start:stop], equal_nan=True)
    assert np.flatnonzero(whole.verdict != NOT_ASKED).tolist() == [0, 3, 6, 9]


def test_parts_share_what_they_say() -> None:
    plan = of(PAPER, [[1.0, 0.4], [0.4, 1.0]], gears=12, pairs=5)
    values = plan.values(np.arange(plan.rows))
    assert plan.rows == 12 + 5 * (1 + 2 * 2)
    assert np.array_equal(values[plan.rows_of_part(1)], values[:5])
    for i in range(2):
        assert np.array_equal(values[plan.rows_of_part(plan.part_that_keeps_number(i)), i], values[:5, i])
        assert np.array_equal(values[plan.rows_of_part(plan.part_that_redraws_number(i)), 1 - i], values[:5, 1 - i])
        assert not (values[plan.rows_of_part(plan.part_that_keeps_number(i)), 1 - i] == values[:5, 1 - i]).any()
    assert np.array_equal(np.unique(plan.parts(np.arange(plan.rows))), np.arange(6))
    more = of(PAPER, [[1.0, 0.4], [0.4, 1.0]], gears=40, pairs=5)
    assert np.array_equal(more.values(np.arange(12)), values[:12])


def test_the_probability_of_quiet_is_that_of_a_plain_loop_with_other_seeds() -> None:
    found = rattle.population(GIVEN, gears=400, count=4)
    random, quiet = np.random.default_rng(11), []
    while len(quiet) < 120:
        eccentricity = random.normal(45e-6, 15e-6)
        if eccentricity > 0.0:
            machine = rattle.Machine(**DRAWING, eccentricity=eccentricity)
            each = machine.gear.attractors(8, NATURAL, seed=1000 + len(quiet))
            quiet.append(sum(x.fraction for x in each if x.kind == "quiet"))
    loop, error = float(np.mean(quiet)), 1.96 * float(np.std(quiet)) / np.sqrt(len(quiet))
    assert found.undecided < 0.02
    assert found.quiet.low - error <= loop <= found.quiet.high + error
    assert 0.01 < found.quiet.high - found.quiet.low < 0.1


def test_gears_above_the_quiet_limit_never_run_quietly_and_far_below_always() -> None:
    limit = rattle.Gear(0.6, 0.1).quiet_limit
    for ends, share in (((1.01 * limit, 1.1 * limit), 0.0), ((0.001, 0.05), 1.0)):
        found = rattle.population({"delta": 0.6, "epsilon": rattle.Uniform(*ends)}, gears=40, count=4)
        assert found.quiet.value == share
        assert found.indices()["epsilon"].first.value == 1.0


def test_the_powers_are_those_of_the_machines() -> None:
    found = rattle.population(GIVEN | {"rpm": rattle.Normal(3000.0, 200.0)}, gears=12, count=16, pairs=0)
    worst = found.worst(1)[0]
    machine = rattle.Machine(**{**GIVEN, **worst.numbers})
    of_gear = found.gears.energy[worst.row]
    assert worst.energy == pytest.approx(np.nanmean(of_gear) * machine.units.power)
    assert worst.energy == pytest.approx(max(np.nanmean(found.gears.energy, axis=1) * found.watts_per_power_unit))
    watts = found.intensity((0.9,))[0.9]
    assert watts.low <= watts.value <= watts.high
    assert watts.value in found.gears.energy * np.asarray(found.watts_per_power_unit)[:, None]


@deep
def test_gears_pass_whose_share_of_quiet_runs_is_large_enough() -> None:
    plan = of(PAPER, gears=24, count=1, pairs=0, share=0.8, judged=24)
    found = compute_gears(plan, 0, 24)
    told = 0
    for k in range(24):
        exact = rattle.Gear(found.delta[k], found.epsilon[k], found.beta[k]).attractors(2048, NATURAL, seed=77)
        share = sum(each.fraction for each in exact if each.kind == "quiet")
        if abs(share - 0.8) > 0.1:
            told += 1
            assert found.verdict[k] == (PASSES if share > 0.8 else FAILS)
    assert told > 12


@pytest.mark.parametrize(("gears", "judged"), [(10, 3), (1000, 256), (7, 7), (5, 100)])
def test_as_many_gears_are_judged_as_was_asked(gears: int, judged: int) -> None:
    plan = of(PAPER, gears=gears, judged=judged, share=0.5)
    asked = plan.flag_judged_rows(np.arange(plan.rows))
    assert asked.sum() == min(gears, judged)
    assert not asked[gears:].any()
    assert not of(PAPER, gears=gears).flag_judged_rows(np.arange(gears)).any()


def test_gears_pass_whose_margin_is_large_enough() -> None:
    plan = of(PAPER, gears=8, count=1, pairs=0, margin=1.5, judged=8)
    found = compute_gears(plan, 0, 8)
    for k in range(8):
        margin = rattle.Gear(found.delta[k], found.epsilon[k], found.beta[k]).boundary_distance(NATURAL).v
        assert found.verdict[k] == (PASSES if margin > 1.5 else FAILS)
    assert {PASSES, FAILS} <= set(found.verdict)


@deep
def test_a_margin_of_a_machine_is_a_speed_in_metres_a_second() -> None:
    plan = of(GIVEN, gears=2, count=1, pairs=0, margin=1e-3, judged=2)
    points = plan.tolerances.points(plan.values(np.arange(1)))
    assert points.units is not None
    plain = of(GIVEN, gears=2, count=1, pairs=0, margin=float(1e-3 / points.units.velocity), judged=2)
    assert np.array_equal(judge_gears(plan, points), judge_gears(plain, points._replace(units=None)))


def test_a_shock_is_where_gears_begin() -> None:
    gear = rattle.Gear(0.6, 0.1)
    margin = gear.boundary_distance()
    at = {"delta": 0.6, "epsilon": rattle.Uniform(0.1, 0.1 + 1e-9)}
    below = rattle.population(at, gears=20, count=4, shock=Shock(rattle.Uniform(0.1 * margin.v, 0.98 * margin.v)))
    beyond = rattle.population(at, gears=4, count=1, shock=Shock(1.000001 * margin.v, margin.tau))
    assert below.quiet.value == 1.0
    assert beyond.quiet.value == 0.0


def test_a_shock_of_a_machine_is_in_metres_a_second() -> None:
    plan = of(GIVEN, gears=4, count=8, pairs=0, shock=Shock("uniform:0.001:0.01", 0.25))
    points = plan.tolerances.points(plan.values(np.arange(4)))
    tau, v = initial_states(plan, points, 8, 0)
    assert points.units is not None
    speeds = v * np.broadcast_to(points.units.velocity, 4)[:, None]
    assert (tau == 0.25).all()
    assert 0.001 < speeds.min() < 0.003
    assert 0.008 < speeds.max() < 0.01


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"speed": 0.0}, "speed must be greater than 0"),
        ({"speed": "normal:1:1"}, "the speed of a shock must be above 0"),
        ({"speed": 1.0, "phase": -0.5}, "phase must not be negative"),
        ({"speed": "gamma:1:1"}, "is no distribution"),
    ],
)
def test_a_shock_that_cannot_be_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        Shock(**given)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"gears": 10_000_000}, "exceed the limit of 16,777,216 samples: make `count` smaller first"),
        ({"gears": 1}, "gears must be an integer from 2"),
        ({"share": 1.0}, "share must be at most 0.9999"),
        ({"share": 0.9, "margin": 0.1}, "give either share or margin, not both"),
        ({"margin": 0.0}, "margin must be greater than 0"),
    ],
)
def test_what_cannot_be_asked_is_refused(asked: dict[str, Any], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        of(PAPER, **asked)


def test_teeth_that_give_way_are_followed_too() -> None:
    given = {"delta": 0.6, "epsilon": rattle.Uniform(0.02, 0.2), "kappa": rattle.LogNormal(1e3, 0.1)}
    plan = of(given, gears=3, count=4, pairs=0)
    found = compute_gears(plan, 0, 3)
    values = plan.values(np.arange(3))
    for k in range(3):
        gear = rattle.stiff.StiffGear(0.6, values[k, 0], 0.6, values[k, 1])
        share = sum(x.fraction for x in gear.attractors(4, NATURAL, seed=0) if x.kind == "quiet")
        assert (found.energy[k] == 0.0).mean() == share
    with pytest.raises(rattle.ParameterError, match="only for the impacting model"):
        of(given, margin=0.1)
