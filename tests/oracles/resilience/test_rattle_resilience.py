"""Convergence times, shocks, edge states and tipping against the adiabatic law, multipliers and closed forms."""

import numpy as np
import pytest

import rattle
from rattle import stiff

GEAR = rattle.Gear(0.6, 0.0615)  # quiet motion and C, with the saddle A on the boundary between their basins
HIT = (0.0, 7.0)


def orbit(gear, name: str) -> rattle.Orbit:
    return next(each for each in gear.orbits() if each.name == name)


@pytest.fixture(scope="module")
def two() -> tuple[rattle.Attractor, rattle.Attractor]:
    quiet, c = GEAR.attractors(64)
    assert (quiet.kind, c.m, c.n_plus, c.n_minus) == ("quiet", 1, 1, 0)
    return quiet, c


def distance(tau, v, to) -> float:
    return float(np.hypot((tau - to.tau + 0.5) % 1.0 - 0.5, v - to.v))


def test_quiet_motion_is_approached_by_the_adiabatic_law() -> None:
    """v shrinks by e^(−δ/3) a period, on average over the phases of the force (shared/design: v³ e^(δt)/g)."""
    near, far = (rattle.convergence(GEAR, 64, within=within) for within in (0.025, 0.2))
    quiet = near.which == 0
    took = near.time[quiet] - far.time[quiet]
    assert np.median(took) == pytest.approx(3.0 / 0.6 * np.log(8.0), rel=0.07)


def test_c_is_approached_by_its_multipliers() -> None:
    c = orbit(GEAR, "C")
    rate = -np.log(abs(np.array(c.multipliers)).max())
    near, far = (rattle.convergence(GEAR, 128, within=within) for within in (0.003, 0.03))
    one = next(i for i, each in enumerate(near.attractors) if each.kind == "periodic")
    took = (near.time - far.time)[near.which == one]
    assert took.size > 10
    assert np.median(took) == pytest.approx(np.log(10.0) / rate, abs=1.6)
    assert near.median[one] >= far.median[one]
    assert near.largest[one] >= near.median[one]


def test_finite_time_stability_grows_to_the_share_of_the_basin() -> None:
    found = rattle.convergence(GEAR, 128)
    share, low, high = found.stability([0.0, 5.0, 20.0, 1e9])
    assert share.shape == (2, 4)
    assert (np.diff(share, axis=1) >= 0.0).all()
    assert share[:, -1] == pytest.approx([each.fraction for each in found.attractors])
    assert ((low <= share) & (share <= high)).all()
    for i, periods in enumerate((5.0, 20.0)):
        assert share[0, 1 + i] == np.mean((found.which == 0) & (found.time <= periods))


def test_a_shock_to_quiet_motion_is_its_boundary_distance(two) -> None:
    found, known = rattle.smallest_shock(GEAR, two[0]), GEAR.boundary_distance()
    assert -found.change == pytest.approx(known.v, rel=0.02)
    assert -found.change >= known.v * (1.0 - 1e-6)
    assert found.to.kind == "periodic"


def test_the_least_shock_to_c_ends_on_the_stable_manifold_of_the_saddle(two) -> None:
    """Just short of it the motion comes back, and both pass A, which is on the boundary."""
    c, a = two[1], orbit(GEAR, "A")
    found = rattle.smallest_shock(GEAR, c)
    assert (found.tau, -found.velocity) == (pytest.approx(c.tau), pytest.approx(c.v))
    assert found.to.kind == "quiet"
    assert found.error < 1e-8
    v = c.v - found.change
    fates = GEAR.reached(c.tau, [v, v + 1.01 * found.error * np.sign(found.change)])
    assert [fates.attractors[i].kind for i in fates.which] == ["quiet", "periodic"]
    way = GEAR.iterate(c.tau, v, np.arange(40))
    assert min(distance(tau, v, a) for tau, v in zip(way.tau, way.v, strict=True)) < 1e-3


def test_a_shock_at_a_phase_leads_to_the_same_boundary(two) -> None:
    c, a = two[1], orbit(GEAR, "A")
    for phase in (0.1, 0.55):
        found = rattle.smallest_shock(GEAR, c, phase)
        assert found.tau == phase
        assert -0.6 <= found.position <= 0.6
        tau, v = GEAR.departure(phase, found.position, found.velocity + found.change)
        way = GEAR.iterate(tau, v, np.arange(40))
        assert min(distance(t, w, a) for t, w in zip(way.tau, way.v, strict=True)) < 1e-3


def test_quiet_motion_hit_at_a_phase(two) -> None:
    found = rattle.smallest_shock(GEAR, two[0], 0.3)
    fates = GEAR.reached(0.3, -found.change * np.array([1.0, 1.0 - 1e-6]))
    assert [fates.attractors[i].kind for i in fates.which] == ["periodic", "quiet"]


@pytest.mark.parametrize("time", [0.15, 0.4, 1.7, 3.3])
def test_a_motion_in_the_gap_departs_where_its_trajectory_does(time) -> None:
    gear = rattle.Gear(0.6, 0.1)
    moving = gear.trajectory(0.2, 3.1, time, 2)
    found = gear.departure(0.2 + time, float(moving.phi[-1]), float(moving.velocity[-1]))
    after = gear.trajectory(0.2, 3.1, time + 4.0, 2)
    i = np.flatnonzero((after.impact_time > time) & (after.impact_wall > 0))[0]
    assert found[0] == pytest.approx((0.2 + after.impact_time[i]) % 1.0, abs=1e-11)
    assert found[1] == pytest.approx(after.impact_speed[i], abs=1e-11)


@pytest.mark.parametrize("gear", [rattle.Gear(0.6, 0.1), stiff.StiffGear(0.6, 0.1, 0.6, 1e3)])
def test_every_state_of_a_flight_departs_alike(gear) -> None:
    """On the wall, in the gap and, of the stiff gear, in contact."""
    once = gear.impact(0.2, 3.1)
    assert gear.departure(0.2, 0.6, -3.1) == pytest.approx((0.2, 3.1), abs=1e-15)
    for share in (0.05, 0.3, 0.6, 0.95, 0.999):
        moving = gear.trajectory(0.2, 3.1, share * once.time, 2)
        found = gear.departure(0.2 + share * once.time, float(moving.phi[-1]), float(moving.velocity[-1]))
        assert found == pytest.approx((once.tau, once.v), abs=1e-9)


def test_a_motion_that_comes_to_rest_departs_no_more() -> None:
    assert stiff.StiffGear(0.6, 0.05, 0.6, 1e3).departure(0.3, 0.6038, 0.0)[1] == 0.0
    with pytest.raises(rattle.ParameterError, match="position must be from"):
        GEAR.departure(0.3, 0.7, 0.0)


def test_a_shock_at_a_phase_of_the_stiff_gear() -> None:
    """Just short of it the motion comes back to C."""
    gear = stiff.StiffGear(0.6, 0.0615, 0.6, 1e4)
    c = next(each for each in gear.attractors(64) if each.kind == "periodic")
    found = rattle.smallest_shock(gear, c, 0.4)
    assert found.to.kind == "quiet"
    after = [gear.departure(0.4, found.position, found.velocity + found.change * x) for x in (1.0, 1.0 - 1e-6)]
    fates = gear.reached(*np.transpose(after))
    assert [fates.attractors[i].kind for i in fates.which] == ["quiet", "periodic"]


def test_there_may_be_nowhere_to_go() -> None:
    gear = rattle.Gear(0.6, 0.05)
    (quiet,) = gear.attractors(64)
    found = rattle.smallest_shock(gear, quiet)
    assert found.change == np.inf
    assert found.to is None


def test_the_edge_between_quiet_motion_and_c_is_a(two) -> None:
    a = orbit(GEAR, "A")
    found = rattle.edge_state(GEAR, (0.5, 0.01), (two[1].tau, two[1].v))
    assert distance(found.tau, found.v, a) < 1e-9
    assert np.sort(np.abs(found.orbit.multipliers)) == pytest.approx(np.sort(np.abs(a.multipliers)))
    assert found.distance < 1e-5


def test_the_edge_of_the_stiff_gear() -> None:
    gear = stiff.StiffGear(0.6, 0.0615, 0.6, 1e4)
    a, c = orbit(gear, "A"), orbit(gear, "C")
    found = rattle.edge_state(gear, (0.5, 0.05), (c.tau, c.v))
    assert distance(found.tau, found.v, a) < 1e-6
    assert not found.orbit.stable


def test_states_of_one_basin_have_no_edge() -> None:
    with pytest.raises(rattle.ParameterError, match="both states go to the same attractor"):
        rattle.edge_state(GEAR, (0.5, 0.01), (0.6, 0.01))


def test_tipping_to_itself_is_the_identity() -> None:
    found = rattle.tipping(GEAR, GEAR, 256)
    assert np.array_equal(found.probability, np.eye(2))
    assert np.array_equal(found.goes, [0, 1])


def test_tipping_counts_what_goes_where() -> None:
    """At ε = 0.078 D has a basin too, at 0.056 there is quiet motion alone, and above its limit there is none."""
    after = rattle.Gear(0.6, 0.078)
    found = rattle.tipping(GEAR, after, 512)
    low, high = found.interval
    assert found.number.sum() == 512
    assert found.probability.sum(axis=1) == pytest.approx([1.0, 1.0])
    assert ((low <= found.probability) & (found.probability <= high)).all()
    assert found.number.sum(axis=1) / 512 == pytest.approx([each.fraction for each in found.before])
    assert found.number.sum(axis=0) / 512 == pytest.approx([each.fraction for each in found.after], abs=0.01)
    labels = [(each.kind, each.m, each.n_plus, each.n_minus) for each in found.after]
    assert labels[found.goes[0]] == ("quiet", 0, 0, 0)
    assert labels[found.goes[1]] == ("periodic", 1, 1, 0)
    alone = rattle.tipping(GEAR, rattle.Gear(0.6, 0.056), 64)
    assert alone.probability.tolist() == [[1.0], [1.0]]
    shaken = rattle.tipping(GEAR, rattle.Gear(0.6, 0.22), 64)
    assert all(each.kind != "quiet" for each in shaken.after)
    assert shaken.number.shape == (2, len(shaken.after))


def test_gears_of_two_kinds_do_not_tip() -> None:
    with pytest.raises(rattle.ParameterError, match="both gears must be of the same model"):
        rattle.tipping(GEAR, stiff.StiffGear(0.6, 0.0615, 0.6, 1e4), 16)
