"""Manifolds against what defines them: their points go to the saddle, and W^s bounds basins."""

import numpy as np
import pytest
from depth import deep
from manifold_fates import fates_beside
from scipy.ndimage import distance_transform_edt

import rattle
from rattle.attractors.basins import flag_boundary_cells
from rattle.errors import ParameterError, RattleError
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.images import apply_unfolded_map_power
from rattle.orbits.manifolds import manifold
from rattle.orbits.saddles import eigenvectors, local_manifold

GEAR = rattle.Gear(0.6, 0.1)


def saddle(name):
    return period_one_orbit(name, GEAR.delta, GEAR.epsilon)


@pytest.mark.parametrize("name", ["A", "B", "D"])
@pytest.mark.parametrize("kind", ["stable", "unstable"])
@pytest.mark.parametrize("side", [1, -1])
def test_points_go_back_to_the_saddle(name, kind, side):
    """The inverse of F^j takes a point to the place t of the fundamental domain that made it, on the local series."""
    orbit = saddle(name)
    local = local_manifold(orbit, kind == "stable")
    found = manifold(orbit, kind, side, 1.0)
    contraction = np.exp(GEAR.delta * orbit.m) * abs(orbit.multipliers[0])  # of W^u's other direction, per Π^k
    growth = (contraction if kind == "unstable" else abs(orbit.multipliers[0])) ** local.steps
    ends = np.zeros(found.tau.size, bool)
    ends[found.pieces[:-1]] = ends[found.pieces[1:] - 1] = True  # at a corner the way back takes the root of rounding
    checked = 0
    for j in range(1, int(found.images.max()) + 1):
        if growth**j * 1e-15 > 1e-9:  # beyond, rounding alone takes the way back away from the manifold
            break
        at = (found.images == j) & (found.parameter != 0)
        _, tau, v, _, _ = apply_unfolded_map_power(
            found.tau[at], found.v[at], j * local.steps, j * local.turns, not local.backwards, orbit.point
        )
        off = np.hypot(*(np.stack([tau, v]) - local.states_at(found.parameter[at])))
        assert off[~ends[at]].max(initial=0.0) < 1e-8
        assert off.max(initial=0.0) < 1e-5
        checked += off.size
    assert checked > 5


@pytest.mark.parametrize("kind", ["stable", "unstable"])
def test_it_leaves_the_saddle_along_its_eigenvector(kind):
    orbit = saddle("A")
    found = manifold(orbit, kind, 1, 0.3)
    assert (found.tau[0], found.v[0]) == (orbit.tau, orbit.v)
    vector = eigenvectors(orbit)[kind == "stable"]
    step = rattle.Gear(0.6, 0.1).impact(orbit.tau, orbit.v).tangent @ vector
    multiplier = float(np.real(orbit.multipliers[1 if kind == "stable" else 0]))
    assert step == pytest.approx(multiplier * vector, abs=1e-12)
    local = local_manifold(orbit, kind == "stable")
    chord = (local.states_at(np.array([1e-6])) - local.states_at(np.array([-1e-6])))[:, 0] / 2e-6
    assert chord == pytest.approx(vector, abs=1e-8)


def test_spacing_angle_and_corners():
    """No step is longer than asked for, and neighbouring pieces share their corner, where the next flight grazes."""
    found = manifold(saddle("A"), "unstable", 1, 6.0, spacing=0.01)
    assert 5.9 < found.length <= 6.0
    assert found.pieces[0] == 0
    assert found.pieces[-1] == found.tau.size
    assert found.pieces.size > 4
    shared = found.pieces[1:-1][found.gap == 0.0]
    assert shared.size >= found.gap.size - 1
    assert np.array_equal(found.tau[shared], found.tau[shared - 1])
    step = np.hypot(np.diff(found.tau), np.diff(found.v))
    assert step.max() < 0.0101


@pytest.mark.parametrize(("name", "kinds"), [("A", {"quiet"}), ("B", {"P(1,1,0)"})])
def test_stable_manifolds_bound_basins(name, kinds):
    """States 1e-5 to the left and to the right of W^s go to different attractors, for nine in ten of its points."""
    found = manifold(saddle(name), "stable", 1, 3.0)
    fates = fates_beside(GEAR, found, 500)
    apart = fates[0] != fates[1]
    assert np.mean(apart) > 0.9
    assert kinds <= set(fates[0][apart]) | set(fates[1][apart])
    for one, other in zip(fates[0][apart], fates[1][apart], strict=True):
        assert kinds & {one, other}


def cells_of(found, n, v_max):
    """The cells (row of v, column of τ) that a manifold passes through below v_max, by steps shorter than a cell."""
    cells = [np.zeros((2, 0), int)]
    for first, end in zip(found.pieces[:-1], found.pieces[1:], strict=True):
        tau, v = n * found.tau[first:end], n / v_max * found.v[first:end]
        walked = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(tau), np.diff(v)))])
        at = np.arange(0.0, walked[-1], 0.7)
        row, column = np.interp(at, walked, v).astype(int), np.interp(at, walked, tau)
        cells.append(np.stack([row, np.floor(column).astype(int) % n])[:, row < n])
    return np.concatenate(cells, axis=1)


@deep  # as above, and in the contract of Figure 6
def test_the_stable_manifolds_of_a_and_b_bound_the_basins():
    """Fewer than 0.1 % of the cells at a boundary, among a million, are further than two cells from the manifolds."""
    n = 1000
    edge = flag_boundary_cells(GEAR.basins(n, method="refined").labels)
    on = np.zeros((n, n), bool)
    for name in "AB":
        for side in (1, -1):
            on[tuple(cells_of(manifold(saddle(name), "stable", side, 200.0, spacing=0.05, angle=1.0), n, 7.0))] = True
    apart = distance_transform_edt(~np.tile(on, 3))[:, n : 2 * n]
    assert edge.sum() > 30_000
    assert np.mean(apart[edge] > 2) < 0.001
    assert np.mean(apart <= 2) < 0.07  # they are thin themselves: few cells could be near them by chance


def test_what_is_refused():
    with pytest.raises(ParameterError, match="no saddle"):
        manifold(saddle("C"), "stable", 1, 1.0)
    with pytest.raises(ParameterError, match="kind"):
        manifold(saddle("A"), "centre", 1, 1.0)
    with pytest.raises(ParameterError, match="side"):
        manifold(saddle("A"), "stable", 0, 1.0)
    with pytest.raises(RattleError, match="the orbit B does not exist"):
        period_one_orbit("B", 0.762, 0.0974)
