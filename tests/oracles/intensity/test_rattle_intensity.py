"""Intensities against closed forms, exact balances, quadrature, and sampled motions; chaos against longer watches."""

import math

import numpy as np
import pytest
from pieces import CELLS, contact_force, nodes, stable_orbits

import rattle
from rattle.attractors import SampleSpec
from rattle.impacting.orbits.limits import flip_formula, sn1_formula
from rattle.models import model_of
from rattle.stiff import StiffGear, continue_from_limit

CHAOTIC = {"impacting": rattle.Gear(0.6, 0.1), "stiff": StiffGear(0.4, 0.2)}


def chaos(name: str) -> rattle.Attractor:
    """The chaotic attractor of a cell."""
    return next(each for each in CHAOTIC[name].attractors(32) if each.kind == "chaotic")


@pytest.mark.parametrize("delta", [2e-3, 0.1, 0.6, 0.75])
def test_a_and_c_have_one_impact_of_speed_2_pi_delta(delta: float) -> None:
    gear = rattle.Gear(delta, 0.5 * float(sn1_formula(delta) + flip_formula(delta)), 5 * delta)
    found = {orbit.name: gear.intensity(orbit) for orbit in gear.orbits() if orbit.n_minus == 0}
    assert set(found) == {"A", "C"}
    speed = 2 * math.pi * delta
    for each in found.values():
        assert (each.impacts_plus, each.impacts_minus, each.contact) == (1.0, 0.0, 0.0)
        assert each.mean_speed == each.largest_speed
        assert each.largest_speed == pytest.approx(speed, rel=1e-11)
        assert each.energy == pytest.approx(speed**2 / 2, rel=1e-11)
        assert each.level(2 * math.pi**2 * delta**2) == pytest.approx(0.0, abs=1e-9)
        assert set(each.errors) == {0.0}


@pytest.mark.parametrize("name", CELLS)
def test_impulses_and_work_balance(name: str) -> None:
    gear = CELLS[name]
    orbits = [*stable_orbits(gear), *gear.orbits()]
    assert orbits
    for each in orbits:
        found, at = gear.intensity(each), nodes(gear, each)
        assert found.impulse == pytest.approx(2 * math.pi * gear.delta, rel=1e-10)
        assert (found.impacts_plus * each.m, found.impacts_minus * each.m) == (each.n_plus, each.n_minus)
        assert at.weight.sum() == pytest.approx(each.m, rel=1e-12)
        work = at.weight @ (contact_force(gear, at.time) * at.velocity)
        assert work == pytest.approx(gear.delta * (at.weight @ at.velocity**2), rel=1e-9)
        outside = at.weight[np.abs(at.phi) > gear.beta].sum() / each.m
        assert found.contact == pytest.approx(outside, abs=1e-9)


@pytest.mark.parametrize("name", ["stiff", "soft"])
def test_impulses_of_contacts_are_those_of_the_spring(name: str) -> None:
    gear = CELLS[name]
    for each in stable_orbits(gear):
        at, impacts = nodes(gear, each), gear.impacts(each)
        for i in range(impacts.time.size):
            during = (at.time > impacts.time[i]) & (at.time < impacts.time[i] + impacts.duration[i])
            depth = np.abs(at.phi[during]) - gear.beta
            assert depth.min() > 0.0
            assert 2 * gear.kappa * (at.weight[during] @ depth) == pytest.approx(impacts.impulse[i], rel=1e-10)


@pytest.mark.parametrize("name", CELLS)
def test_impacts_are_those_of_the_sampled_motion(name: str) -> None:
    gear = CELLS[name]
    for each in stable_orbits(gear):
        one, many = gear.impacts(each), gear.impacts(each, 3.5 * each.m)
        known = gear.trajectory(each.tau, each.v, 3.5 * each.m, 2)
        np.testing.assert_array_equal(many.wall, known.impact_wall)
        np.testing.assert_allclose(many.time, each.tau + known.impact_time, rtol=0, atol=1e-8)
        np.testing.assert_allclose(many.speed, known.impact_speed, rtol=1e-6)
        assert one.time.size == each.n_plus + each.n_minus
        energy = (one.speed**2).sum() / (2 * each.m)
        assert gear.intensity(each).energy == pytest.approx(energy, rel=1e-12)


def test_an_orbit_is_as_loud_as_its_attractor() -> None:
    gear = CELLS["the paper's"]
    for each in stable_orbits(gear):
        found = gear.intensity(gear.orbit(each.tau, each.v, each.n_plus))
        assert found.energy == pytest.approx(gear.intensity(each).energy, rel=1e-10)


def test_the_stiff_gear_tends_to_the_impacting_one() -> None:
    gear = rattle.Gear(0.6, 0.075)
    for orbit in gear.orbits():
        whole = gear.intensity(orbit).energy
        limit = rattle.periodic_orbit(0.6, 0.075, orbit.tau, orbit.v)
        first, second = (
            StiffGear(0.6, 0.075, kappa=kappa).intensity(continue_from_limit(limit, kappa)).energy - whole
            for kappa in (1e6, 1e8)
        )
        assert first / second == pytest.approx(10.0, rel=0.15)  # κ^(−1/2)


@pytest.mark.parametrize("name", CHAOTIC)
def test_chaos_balances_and_its_errors_are_errors(name: str) -> None:
    gear, attractor = CHAOTIC[name], chaos(name)
    periods = 4000.0
    found, longer = gear.intensity(attractor, periods), gear.intensity(attractor, 16 * periods)
    assert abs(found.impulse - 2 * math.pi * gear.delta) < 2 * found.largest_speed / periods
    for quantity in ("impacts_minus", "mean_speed", "energy"):
        error = getattr(found.errors, quantity)
        assert 0.0 < error < 0.05 * getattr(found, quantity)
        assert abs(getattr(found, quantity) - getattr(longer, quantity)) < 2 * error
        assert getattr(longer.errors, quantity) < 0.5 * error
    impacts = gear.impacts(attractor, periods)
    assert found.energy == pytest.approx((impacts.speed**2).sum() / (2 * periods), rel=1e-3)
    assert found.largest_speed == pytest.approx(impacts.speed.max(), rel=1e-12)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    gear, attractor = CHAOTIC["impacting"], chaos("impacting")
    truth = gear.intensity(attractor, 400_000.0).energy
    starts = gear.iterate(attractor.tau, attractor.v, np.arange(1, 121) * 1000)
    hits = 0
    for tau, v in zip(starts.tau.tolist(), starts.v.tolist(), strict=True):
        found = gear.intensity(rattle.Attractor("chaotic", 0, 0, 0, 1.0, (0, 1), (0, 0), 0.0, tau, v), 1000.0)
        hits += abs(found.energy - truth) < found.errors.energy
    assert 106 <= hits <= 120  # 114 ± 2.4


def test_quiet_is_nothing_and_undecided_is_not_known() -> None:
    for gear in (rattle.Gear(0.6, 0.05), StiffGear(0.6, 0.05)):
        (quiet,) = gear.attractors(8)
        found = gear.intensity(quiet)
        assert (found.impacts, found.mean_speed, found.largest_speed, found.energy, found.contact) == (0, 0, 0, 0, 1)
        assert found.impulse == pytest.approx(2 * math.pi * 0.6)
        assert found.level(1.0) == -math.inf
        assert gear.impacts(quiet).time.size == 0
    undecided = rattle.Attractor("undecided", 0, 0, 0, 1.0, (0, 1), (0, 0), 0.0, 0.1, 1.0)
    found = rattle.Gear(0.6, 0.05).intensity(undecided)
    assert math.isnan(found.energy)
    assert math.isnan(found.errors.energy)
    assert math.isnan(found.level(1.0))


def test_what_is_no_motion_of_the_gear_is_refused() -> None:
    gear = rattle.Gear(0.6, 0.1)
    (c,) = (each for each in gear.orbits() if each.name == "C")
    with pytest.raises(rattle.RattleError, match="give a periodic motion of this gear"):
        rattle.Gear(0.6, 0.12).intensity(c)
    with pytest.raises(rattle.RattleError, match="give a periodic motion of this gear"):
        gear.impacts(c._replace(v=c.v + 1e-4))
    with pytest.raises(rattle.ParameterError, match="must leave Σ⁺ with a speed v above 0"):
        gear.intensity(c._replace(v=-1.0))
    with pytest.raises(rattle.ParameterError, match="reference"):
        gear.intensity(c).level(0.0)
    with pytest.raises(rattle.ParameterError, match="periods"):
        gear.impacts(chaos("impacting"))
    for gear in (rattle.Gear(0.6, 0.05), StiffGear(0.6, 0.05)):
        for watch in (gear.intensity, lambda motion, gear=gear: gear.impacts(motion, 500.0)):
            with pytest.raises(rattle.RattleError, match="comes to rest"):
                watch(chaos("impacting"))


@pytest.mark.parametrize("model", [model_of(0.6), model_of(0.6, kappa=1e4)], ids=["impacting", "stiff"])
def test_the_impulses_of_a_cells_attractors_balance(model):
    """An audit of surveys: to rounding on periodic motions, within (largest speed)/T on chaos."""
    delta, epsilon = np.full(4, 0.6), np.array([0.05, 0.078, 0.089, 0.1])
    table = model.attractors_of(delta, epsilon, SampleSpec(32))
    errors = model.impulse_balance_errors(delta, epsilon, table)
    periodic, chaotic = (table.kind == rattle.KINDS.index(kind) for kind in ("periodic", "chaotic"))
    assert periodic.sum() >= 5
    assert errors[periodic].max() < 1e-10
    assert np.isnan(errors[~periodic & ~chaotic]).all()
    bound = 2.0 * 7.0 / (2.0 * np.pi * 0.6 * 64.0)
    assert ((errors[chaotic] > 0.0) & (errors[chaotic] < bound)).all()
