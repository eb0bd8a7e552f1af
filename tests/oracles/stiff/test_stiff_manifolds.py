"""Manifolds of saddles of the stiff gear: the inverse map, what defines them, basins, and the impacting limit."""

from functools import cache

import numpy as np
import pytest
from manifold_fates import fates_beside

import rattle
from rattle.errors import ParameterError
from rattle.orbits.images import apply_unfolded_map_power
from rattle.orbits.manifolds import manifold
from rattle.orbits.saddles import eigenvectors, local_manifold
from rattle.stiff import StiffGear, continue_from_limit
from rattle.stiff.map.flow import previous_departure
from rattle.stiff.map.return_map import StiffPoint, step

DELTA, EPSILON, BETA = 0.6, 0.1, 0.6


@cache
def impacting(name):
    orbit = next(x for x in rattle.Gear(DELTA, EPSILON, BETA).orbits() if x.name == name)
    return rattle.periodic_orbit(DELTA, EPSILON, orbit.tau, orbit.v, 1, BETA)


@pytest.mark.parametrize("kappa", [5.0, 20.0, 1e3, 1e6, 1e9])
def test_the_inverse_map_undoes_a_return(kappa: float) -> None:
    rng, seen = np.random.default_rng(2), 0
    for _ in range(60):
        delta, epsilon, tau, v = rng.uniform(0.2, 3.0), rng.uniform(0.0, 0.5), rng.random(), rng.uniform(0.1, 8.0)
        code, tau1, v1, time, n_minus, *_ = step(tau, v, StiffPoint(delta, epsilon, BETA, kappa))
        if code != 0 or time > 6.0:
            continue
        back = previous_departure(tau1, v1, delta, epsilon, BETA, kappa)
        error = 1e-12 * np.exp(delta * time) * (1 + 1 / v1) * (1 + 1 / v) * (10 + n_minus * np.sqrt(kappa))
        assert (back[0], back[4]) == (0, n_minus)
        assert back[3] == pytest.approx(time, abs=error)
        assert (abs((back[1] - tau + 0.5) % 1 - 0.5), back[2]) == pytest.approx((0.0, v), abs=error)
        seen += 1
    assert seen > 10


@pytest.mark.parametrize(("name", "kappa"), [("A", 1e3), ("B", 1e4), ("D", 1e6)])
@pytest.mark.parametrize("kind", ["stable", "unstable"])
def test_points_go_back_to_the_saddle(name: str, kappa: float, kind: str) -> None:
    """The inverse of F^j takes a point to the place t of the fundamental domain that made it, on the local series; and
    there the multiplier is that of the flow.
    """
    orbit = continue_from_limit(impacting(name), kappa)
    local = local_manifold(orbit, kind == "stable")
    vector = eigenvectors(orbit)[kind == "stable"]
    multiplier = float(np.real(orbit.multipliers[kind == "stable"]))
    assert StiffGear(DELTA, EPSILON, BETA, kappa).impact(orbit.tau, orbit.v).tangent @ vector == pytest.approx(
        multiplier * vector, abs=1e-9 * max(1.0, abs(orbit.multipliers[0]))
    )
    contraction = np.exp(DELTA * orbit.m) * abs(orbit.multipliers[0])
    growth = (contraction if kind == "unstable" else abs(orbit.multipliers[0])) ** local.steps
    for side in (1, -1):
        found, checked = manifold(orbit, kind, side, 1.0), 0
        assert found.length == pytest.approx(1.0, abs=0.03)
        assert np.hypot(np.diff(found.tau), np.diff(found.v)).max() < 0.0201
        for j in range(1, int(found.images.max()) + 1):
            if growth**j * 1e-15 > 1e-9:  # beyond, rounding alone takes the way back away from the manifold
                break
            at = (found.images == j) & (found.parameter != 0)
            _, tau, v, _, _ = apply_unfolded_map_power(
                found.tau[at], found.v[at], j * local.steps, j * local.turns, not local.backwards, orbit.point
            )
            off = np.hypot(*(np.stack([tau, v]) - local.states_at(found.parameter[at])))
            assert off.max(initial=0.0) < 1e-8
            checked += off.size
        assert checked > 5


@pytest.mark.parametrize("name", ["A", "B"])
def test_stable_manifolds_bound_basins(name: str) -> None:
    """States 1e-5 to either side of W^s go to different attractors, for nine in ten of its points."""
    gear = StiffGear(DELTA, EPSILON, BETA, 2e3)
    found = manifold(continue_from_limit(impacting(name), 2e3), "stable", 1, 3.0)
    fates = fates_beside(gear, found, 1200)
    assert np.mean(fates[0] != fates[1]) > 0.9


def test_unstable_manifolds_converge_to_those_of_the_limit() -> None:
    """Distances of points beside the saddle, before any light contact, from the limit's curve fall as κ^(−1/2)."""
    limit, off = manifold(impacting("A"), "unstable", -1, 1.0, spacing=0.001), []
    start, chord = np.stack([limit.tau, limit.v])[:, :-1], np.diff(np.stack([limit.tau, limit.v]), axis=1)
    for kappa in (1e6, 1e8):
        found = manifold(continue_from_limit(impacting("A"), kappa), "unstable", -1, 0.8)
        away = np.stack([found.tau, found.v])[:, 5:, None] - start[:, None]
        share = np.clip((away * chord[:, None]).sum(axis=0) / (chord**2).sum(axis=0), 0.0, 1.0)
        off.append(np.hypot(*(away - share * chord[:, None])).min(axis=1).max())
    assert 1e-5 < off[1] < 1e-3
    assert off[0] / off[1] == pytest.approx(10.0, rel=0.1)


def test_what_is_no_saddle_is_refused() -> None:
    with pytest.raises(ParameterError, match="no saddle"):
        manifold(continue_from_limit(impacting("C"), 1e4), "stable", 1, 1.0)
