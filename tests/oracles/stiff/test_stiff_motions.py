"""Periodic motions of the stiff gear against its own flow, scipy's integrator, and the impacting model as its limit."""

from functools import cache

import numpy as np
import pytest
from stiff_high_precision import integrated

import rattle
from rattle.continuation.conditions import EventKind
from rattle.errors import ParameterError, RattleError
from rattle.numerics.complex_step import value_and_jacobian
from rattle.stiff import (
    StiffEvent,
    StiffGear,
    continue_from_limit,
    quiet_limit,
    saddle_node_1,
    stiff_branch,
    stiff_curve,
    stiff_orbit,
)
from rattle.stiff.map.return_map import StiffPoint, step_with_tangent
from rattle.stiff.orbits.period_one import orbits_at

DELTA, EPSILON, BETA = 0.6, 0.075, 0.6
SN2, PD1, G1 = 0.06874679, 0.07615571, 0.144452777  # of the impacting model at δ = 0.6 (paper, section 5)


@cache
def impacting(name, delta=DELTA, epsilon=EPSILON, beta=BETA):
    orbit = next(x for x in rattle.Gear(delta, epsilon, beta).orbits() if x.name == name)
    return rattle.periodic_orbit(delta, epsilon, orbit.tau, orbit.v, 1, beta)


@cache
def branch_of_d(kappa):
    return stiff_branch(continue_from_limit(impacting("D"), kappa), "epsilon", (0.05, 0.2))


@pytest.mark.parametrize("name", "ABCD")
@pytest.mark.parametrize("kappa", [300.0, 1e4, 1e8, 1e10])
def test_a_motion_returns_to_itself_with_its_multipliers(name: str, kappa: float) -> None:
    orbit = continue_from_limit(impacting(name), kappa)
    point = StiffPoint(DELTA, EPSILON, BETA, kappa)
    status, tau, v, time, n_minus, j00, _b, _c, j11, _ln = step_with_tangent(orbit.tau, orbit.v, point)
    assert (status, n_minus) == (0, orbit.walls.count(-1))
    assert orbit.label == (1, 1, n_minus)
    np.testing.assert_allclose(
        [tau, v, time], [orbit.tau, orbit.v, 1.0], atol=1e-12 * abs(orbit.multipliers[0]) + 1e-11
    )
    assert sum(orbit.multipliers).real == pytest.approx(j00 + j11, abs=1e-9 * (1 + np.sqrt(kappa) * 1e-3))
    assert np.prod(orbit.multipliers) == pytest.approx(np.exp(-DELTA), rel=1e-12)
    assert orbit.admissible


@pytest.mark.parametrize("name", "ABCD")
def test_a_motion_closes_for_solve_ivp(name: str) -> None:
    orbit = continue_from_limit(impacting(name), 500.0)
    start = orbit.tau + 1e-3  # in the gap
    position, velocity, *_ = StiffGear(DELTA, EPSILON, BETA, 500.0).flight(BETA, -orbit.v, orbit.tau, 1e-3)
    found = integrated(start, position, velocity, 1.0, DELTA, EPSILON, BETA, 500.0)
    np.testing.assert_allclose(found[:2], [position, velocity], atol=1e-8 * abs(orbit.multipliers[0]))
    assert found[2:] == (1, orbit.walls.count(-1))


@pytest.mark.parametrize("name", "ABCD")
def test_equations_have_their_jacobian_and_multipliers(name: str) -> None:
    orbit = continue_from_limit(impacting(name), 2e3)
    itinerary, x = orbit.itinerary, orbit.unknowns
    value, jacobian = value_and_jacobian(itinerary.residual, x)
    assert np.max(np.abs(value)) < 1e-11
    np.testing.assert_allclose(itinerary.jacobian(x), jacobian[:, :-2], atol=1e-11 * np.abs(jacobian).max())
    off = abs(np.linalg.det(itinerary.jacobian(x, 0.3)))
    for multiplier in orbit.multipliers:
        matrix = itinerary.jacobian(x + 0j, multiplier)
        assert abs(np.linalg.det(matrix)) < 1e-8 * off


@pytest.mark.parametrize("name", "ABCD")
def test_motions_converge_as_the_root_of_the_stiffness(name: str) -> None:
    """Analytic in κ^(−1/2): differences fall tenfold from κ to 100κ, and what is left after that twice as fast."""
    limit = impacting(name)
    truth = np.array([limit.tau, limit.v, sum(limit.multipliers).real])
    softer, stiffer, last = (
        np.array([orbit.tau, orbit.v, sum(orbit.multipliers).real])
        for orbit in (continue_from_limit(limit, kappa) for kappa in (1e6, 1e8, 1e10))
    )
    scale = np.abs(softer - truth)
    moved = scale > 1e-4  # D's speed has almost no term of first order
    np.testing.assert_allclose(np.abs(stiffer - truth)[moved], 0.1 * scale[moved], rtol=0.1)
    np.testing.assert_allclose(np.abs(last - truth)[moved], 0.01 * scale[moved], rtol=0.1)
    extrapolated = (10 * stiffer - softer) / 9
    assert np.all(np.abs(extrapolated - truth)[moved] < 0.01 * scale[moved])


@pytest.mark.parametrize("delta", [0.3, 0.6, 0.75])
def test_sn1_converges(delta: float) -> None:
    limit = float(rattle.sn1(delta))
    off = np.array([saddle_node_1(delta, kappa).epsilon - limit for kappa in (1e4, 1e6, 1e8, 1e10)])
    np.testing.assert_allclose(off[1:] / off[:-1], 0.1, rtol=0.05)
    assert abs((10 * (off[2]) - off[1]) / 9) < 1e-3 * abs(off[1])
    orbit = saddle_node_1(delta, 1e6)
    assert orbit.multipliers[0] == pytest.approx(1.0, abs=1e-9)


def test_sn2_pd1_and_the_graze_converge() -> None:
    """SN2, PD1 and the fold that G1's square root becomes, to the published values, as κ^(−1/2)."""
    found = []
    for kappa in (1e5, 1e7, 1e9):
        branch = branch_of_d(kappa)
        kinds = [str(event.kind) for event in branch.events]
        assert kinds == ["SN", "SN", "PD"]
        assert branch.ends == ("graze: contact 1 with Σ⁻ is lost", "span")
        found.append([event.orbit.epsilon for event in branch.events])
    off = np.array(found) - [G1, SN2, PD1]
    np.testing.assert_allclose(off[1:, [0, 2]] / off[:-1, [0, 2]], 0.1, rtol=0.12)
    assert np.abs(off[2, 1]) < 2e-7  # SN2 hardly depends on κ
    extrapolated = (10 * off[2] - off[1]) / 9
    np.testing.assert_allclose(extrapolated, 0.0, atol=3e-6)
    events = branch_of_d(1e7).events
    for event, multiplier in zip(events, (1.0, 1.0, -1.0), strict=True):
        assert min(abs(m - multiplier) for m in event.orbit.multipliers) < 1e-6


def test_the_limit_is_not_uniform_at_a_graze() -> None:
    """If a contact with Σ⁻ is light, the slope of the motion's response is of order √κ, without a square root."""
    steepest = []
    for kappa in (1e5, 1e7, 1e9):
        branch = branch_of_d(kappa)
        light = branch.unknowns[:, 3] < 0.5
        assert light.sum() > 3
        steepest.append(np.abs(branch.multipliers[0, light]).max())
    np.testing.assert_allclose(np.diff(np.log10(steepest)), 1.0, atol=0.25)


def test_the_quiet_limit_converges_as_one_over_the_stiffness() -> None:
    kappa = 10.0 ** np.arange(2, 11)
    off = 1 - quiet_limit(0.6, kappa) / rattle.quiet_limit(0.6)
    assert np.all(np.abs(off * kappa - 2 * np.pi**2) < 40 / kappa + 1e-15 * kappa)


@pytest.mark.parametrize("kappa", [3e3, 1e6])
@pytest.mark.parametrize("epsilon", [0.05, 0.075, 0.2])
def test_regions_and_letters_are_those_of_the_limit(kappa: float, epsilon: float) -> None:
    gear, limit = StiffGear(DELTA, epsilon, BETA, kappa), rattle.Gear(DELTA, epsilon, BETA)
    found = [named for named in orbits_at(DELTA, epsilon, BETA, kappa) if named.name != "P"]
    if kappa > 1e4:
        assert [named.name for named in found] == [orbit.name for orbit in limit.orbits()]
        assert [named.orbit.stable for named in found] == [orbit.stable for orbit in limit.orbits()]
        assert gear.region() == limit.region()
    for named in found:
        orbit = continue_from_limit(impacting(named.name, DELTA, epsilon), kappa) if kappa > 1e4 else named.orbit
        assert (named.orbit.tau, named.orbit.v) == pytest.approx((orbit.tau, orbit.v), abs=1e-8)
        assert named.orbit.admissible


def test_a_motion_that_folds_back_says_so() -> None:
    """B and D meet in a saddle-node at κ = 229.5: neither exists below."""
    event = next(e for e in stiff_branch(continue_from_limit(impacting("D"), 1e3), "kappa", (100.0, 1e4)).events)
    assert str(event.kind) == "SN"
    assert event.orbit.kappa == pytest.approx(229.5, abs=0.5)
    for name in "BD":
        with pytest.raises(RattleError, match="folds back"):
            continue_from_limit(impacting(name), 0.9 * event.orbit.kappa)
        assert continue_from_limit(impacting(name), 1.1 * event.orbit.kappa).admissible


def test_a_branch_in_each_parameter_is_of_true_motions() -> None:
    start = continue_from_limit(impacting("C"), 1e4)
    for parameter, span in (("epsilon", (0.06, 0.1)), ("delta", (0.55, 0.65)), ("kappa", (1e3, 1e6))):
        branch = stiff_branch(start, parameter, span, 10)
        assert len(branch) > 5
        for i in range(0, len(branch), 3):
            orbit = branch.orbit(i)
            again = stiff_orbit(orbit.delta, orbit.epsilon, orbit.kappa, orbit.tau, orbit.v)
            assert (again.tau, again.v) == pytest.approx((orbit.tau, orbit.v), abs=1e-9)
            assert orbit.admissible


def test_curves_in_two_parameters_hold_the_saddle_nodes_of_branches() -> None:
    kappa = 1e4
    event = branch_of_d(kappa).events[1]
    points = stiff_curve(event, (0.5, 0.7), (0.04, 0.12), 12)
    assert points[:, -2].min() < 0.52
    assert points[:, -2].max() > 0.68
    near = points[np.argmin(np.abs(points[:, -2] - 0.65))]
    delta, epsilon = near[-2:]
    beside = continue_from_limit(impacting("D", delta, epsilon + 0.005), kappa)
    folds = [e.orbit.epsilon for e in stiff_branch(beside, "epsilon", (epsilon - 0.01, epsilon + 0.02)).events]
    assert min(abs(fold - epsilon) for fold in folds) < 1e-9
    line = stiff_curve(StiffEvent(EventKind.SADDLE_NODE, saddle_node_1(0.6, kappa), 0), (0.5, 0.7), (0.02, 0.12), 12)
    for x in line[:: max(len(line) // 4, 1)]:
        assert saddle_node_1(float(x[-2]), kappa).epsilon == pytest.approx(x[-1], abs=1e-10)


@pytest.mark.parametrize(("delta", "beta", "kappa"), [(5.0, 0.1, 1.0), (0.2, 0.6, 30.0), (5.0, 2.0, 1e10)])
def test_orbits_at_hostile_corners_are_true(delta: float, beta: float, kappa: float) -> None:
    for epsilon in (0.0, 0.3):
        for _name, orbit in orbits_at(delta, epsilon, beta, kappa):
            assert orbit.admissible
            assert np.prod(orbit.multipliers) == pytest.approx(np.exp(-delta), rel=1e-10)
            status, tau, v, *_ = step_with_tangent(orbit.tau, orbit.v, StiffPoint(delta, epsilon, beta, kappa))
            assert status == 0
            error = 1e-9 * (1 + abs(orbit.multipliers[0])) * (1 + 1 / orbit.v)
            assert abs((tau - orbit.tau + 0.5) % 1 - 0.5) < error
            assert v == pytest.approx(orbit.v, abs=error)


def test_hostile_input_is_refused() -> None:
    for bad in ({"kappa": 0.0}, {"kappa": np.inf}, {"kappa": np.nan}, {"delta": -1.0}, {"beta": 0.0}, {"kappa": "1"}):
        with pytest.raises(ParameterError):
            StiffGear(**({"delta": 0.6, "epsilon": 0.1} | bad))
    gear = StiffGear(0.6, 0.05)
    with pytest.raises(ParameterError, match="time"):
        gear.flight(0.0, 1.0, 0.0, 1e9)
    with pytest.raises(ParameterError, match="v must"):
        gear.impact(0.1, 0.0)
    with pytest.raises(RattleError, match="quiet"):
        gear.impact(0.1, 1e-9)
    with pytest.raises(RattleError, match="quiet"):
        gear.orbit(0.1, 1e-9)
    with pytest.raises(ParameterError, match="parameter must"):
        stiff_branch(continue_from_limit(impacting("A"), 1e4), "beta")
    with pytest.raises(ParameterError, match="span"):
        stiff_branch(continue_from_limit(impacting("A"), 1e4), "epsilon", (0.1, 0.2))
