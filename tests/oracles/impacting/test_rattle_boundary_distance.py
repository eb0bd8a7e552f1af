"""The distance of quiet motion from other basins: against W^s of a saddle, dense grids, and long simulation."""

import numpy as np
import pytest
from depth import deep

import rattle
from rattle.attractors.basins import classify_plane_states
from rattle.impacting.attractors.boundary_distance import slowest_preimages
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.manifolds import manifold


def more(*points):
    """Points for the deep tests only."""
    return [pytest.param(point, marks=deep) for point in points]


def lowest(point):
    """The least v on W^s(A), where a parabola through its lowest points has it."""
    found = manifold(period_one_orbit("A", *point), "stable", -1, 6.0, spacing=0.002)
    i = int(np.argmin(found.v))
    tau, v = found.tau[i - 1 : i + 2], found.v[i - 1 : i + 2]
    c, b, a = np.polyfit(tau - tau[1], v, 2)
    return a - b * b / (4 * c), (tau[1] - b / (2 * c)) % 1.0


@pytest.mark.parametrize("point", [(0.6, 0.1, 0.6), *more((0.6, 0.0615, 0.6), (0.762, 0.097, 0.6)), (0.6, 0.1, 1.2)])
def test_it_is_the_lowest_place_of_the_stable_manifold(point):
    found = rattle.Gear(*point).boundary_distance()
    v, tau = lowest(point)
    assert found.v == pytest.approx(v, rel=1e-5)
    assert found.v > v * (1 - 1e-9)
    assert found.tau == pytest.approx(tau, abs=3e-3)  # v rises with the square of what τ is off
    assert found.undecided == np.inf


@pytest.mark.parametrize(
    "point",
    [
        (0.6, 0.089, 0.6),
        *more((0.6, 0.125, 0.6), (0.6, 0.15, 0.6), (0.1, 0.01, 0.6), (0.1, 0.02, 0.6), (0.4, 0.1, 0.6)),
        (0.3, 0.06, 0.3),
        (1.2, 0.3, 1.2),
    ],
)
def test_no_state_of_a_dense_grid_is_lower(point):
    gear = rattle.Gear(*point)
    found = gear.boundary_distance()
    low = max(gear.capture_speed, 0.25 * found.v)
    tau, v = (x.ravel() for x in np.meshgrid((np.arange(120) + 0.5) / 120, np.geomspace(low, found.v, 80)[:-1]))
    table, rows, _impacts = classify_plane_states(rattle.Gear(*point).states, tau, v)
    assert set(np.unique(table.kind[rows])) == {rattle.KINDS.index("quiet")}


@pytest.mark.parametrize(
    "point",
    [
        (0.6, 0.18, 0.6),  # P(4,5,1) wins 0.3 % of the plane
        *more((0.45, 0.12, 0.6)),  # P(1,11,0) wins 0.3 %
        *more((0.5, 0.15, 0.6), (0.7, 0.2, 0.6), (0.9, 0.25, 0.6), (1.0, 0.27, 0.6), (0.421, 0.1232, 0.6)),
        *more((0.6, 0.15, 0.4), (0.1858, 0.0507, 0.9), (0.8, 0.22, 0.9)),
    ],
)
def test_thin_basins_are_not_missed(point):
    """Against states that know nothing of it: it is above the lowest that leaves by at most the share it states."""
    gear = rattle.Gear(*point)
    found = gear.boundary_distance()
    assert np.isfinite(found.v)
    rows = np.geomspace(gear.capture_speed, found.v / 1.04, 24)
    tau, v = (x.ravel() for x in np.meshgrid((np.arange(500) + 0.5) / 500, rows))
    table, row, _impacts = classify_plane_states(rattle.Gear(*point).states, tau, v)
    assert set(np.unique(table.kind[row])) == {rattle.KINDS.index("quiet")}
    # among long chaotic transients the last bit of a state decides where it goes: it, or one that is hardly higher
    v = found.v * (1 + np.linspace(0.0, 1e-12, 64))
    end = gear.iterate(found.tau, v[:, None], 30_000 + np.arange(64))
    assert end.v.max() > 2 * gear.capture_speed  # at rest it would be far below it by now


@pytest.mark.parametrize("point", [(0.6, 0.078, 0.6), *more((0.6, 0.1, 0.6), (0.6, 0.11, 0.6)), (0.3, 0.06, 0.3)])
def test_the_state_leaves_and_those_just_below_do_not(point):
    gear = rattle.Gear(*point)
    found = gear.boundary_distance()
    fastest = max(a.v for a in gear.attractors(64) if a.kind != "quiet")
    end = gear.iterate(found.tau, found.v, 4000 + np.arange(8))
    assert end.v.max() > 0.2 * fastest
    below = gear.iterate((found.tau + np.linspace(-0.05, 0.05, 101)) % 1.0, found.v * (1 - 1e-4), 4000)
    assert below.v.max() < 0.02 * fastest


@pytest.mark.parametrize("point", [(0.6, 0.18, 0.6), (0.3, 0.06, 0.3)])
def test_the_slowest_preimages_lead_to_the_states(point):
    gear = rattle.Gear(*point)
    tau, v = np.random.default_rng(5).random((2, 40))
    v = 1 + 4 * v
    found = slowest_preimages(tau, v, np.full(40, 5), np.full(40, 25.0), *(np.full(40, x) for x in point))
    each = np.stack([gear.iterate(*found, k) for k in range(6)])
    off = np.hypot((each[:, 0] - tau + 0.5) % 1.0 - 0.5, each[:, 1] - v)
    assert off.min(axis=0).max() < 1e-8
    by_one = [[(tau, v)] for tau, v in zip(tau, v, strict=True)]
    for path in by_one:
        while len(path) < 6 and path[-1][1] <= 25:
            back = gear.inverse_impact(*path[-1])
            path.append((back.tau, back.v))
    assert found[1] == pytest.approx([min(w for _t, w in path) for path in by_one], rel=1e-9)
    assert (found[1] < v).any()


def test_what_it_says_where_there_is_no_boundary():
    alone = rattle.Gear(0.6, 0.056)
    assert [a.kind for a in alone.attractors()] == ["quiet"]
    v, tau, undecided = alone.boundary_distance()
    assert (v, undecided) == (np.inf, np.inf)
    assert np.isnan(tau)
    gone = rattle.Gear(0.6, 0.2)
    assert gone.epsilon > gone.quiet_limit
    v, tau, undecided = gone.boundary_distance()
    assert v == 0
    assert np.isnan(tau)
    late = rattle.Gear(0.45, 0.1425)  # 0.998 of the quiet limit: 200 000 impacts do not tell what comes to rest
    assert np.isnan([*late.boundary_distance()[:2]]).all()
    assert late.boundary_distance().undecided == 0
    assert rattle.Gear(0.6, 0.1).boundary_distance(v_max=2.5).v == np.inf  # its boundary begins at 2.512
    assert rattle.Gear(0.6, 0.1).boundary_distance(v_max=2.8).v == pytest.approx(2.51241, rel=1e-4)


def test_a_cell_does_not_depend_on_the_others():
    delta, epsilon = np.array([0.3, 0.6, 0.4]), np.array([[0.05], [0.1], [0.3]])
    whole = rattle.boundary_distances(delta, epsilon, 0.5)
    for (i, j), v in np.ndenumerate(whole.v):
        one = rattle.Gear(delta[j], epsilon[i, 0], 0.5).boundary_distance()
        assert np.array_equal([one.v, one.tau, one.undecided], [v, whole.tau[i, j], whole.undecided[i, j]], True)


def test_what_is_refused():
    with pytest.raises(rattle.ParameterError):
        rattle.Gear(0.6, 0.1).boundary_distance(v_max=0)
    with pytest.raises(rattle.ParameterError):
        rattle.boundary_distances(-0.6, 0.1)
