"""Small δ, ε and β of one order, as real gears have: orbits, Γ, manifolds, basins, boundary distance and crisis."""

import math

import numpy as np
import pytest
from depth import deep
from high_precision import Flight
from mpmath import mp, mpf

import rattle
from rattle.attractors.samples import Outcome
from rattle.crisis import boundary_crisis
from rattle.impacting.attractors.classifier import ImpactingClassifier, make_elastic_cells
from rattle.impacting.map.quiet import capture_invariant_limits
from rattle.orbits.manifolds import manifold

#: All of A to D; B next to a graze; A, B and D; A and D.
POINTS = [(2.2086e-4, 8.0222e-5, 6.4199e-4), (1.0793e-3, 7.7355e-5, 2.6833e-3), (0.049079, 0.01905, 0.022042)]
POINTS += [(9.4158e-4, 8.4693e-5, 8.1682e-4)]
NATURAL = 1.5 * math.sqrt(16 * math.pi * 0.002 * 0.001) + 2 * math.pi * 0.0005  # speed at the point of steel gears


def departure_and_trace(orbit, delta, epsilon, beta):
    """τ, v and the trace of the return map near an orbit, in 40 digits."""
    walls = (1, 1) if orbit.n_minus == 0 else (1, -1, 1)

    def flown(tau, v, spans):
        time, w, missed = tau, -v, []
        for wall, target, s in zip(walls, walls[1:], spans, strict=False):
            flight = Flight(wall, time, w, delta, epsilon, beta)
            missed.append(flight.position(s) - target * flight.beta)
            time, w = time + s, -flight.velocity(s)
        return time, -w, missed

    def closed(tau, v, *spans):
        time, speed, missed = flown(tau, v, spans)
        return (*missed, time - tau - 1, speed - v)

    first = mpf(rattle.Gear(delta, epsilon, beta).first_impact(1, orbit.tau, -orbit.v).flight_time)
    spans = (mpf(1),) if orbit.n_minus == 0 else (first, 1 - first)
    tau, v, *spans = mp.findroot(closed, (mpf(orbit.tau), mpf(orbit.v), *spans), tol=mpf(10) ** -60, verify=False)

    def returned(t, speed):
        near = mp.findroot(lambda *s: flown(t, speed, s)[2], tuple(spans), tol=mpf(10) ** -60, verify=False)
        return flown(t, speed, tuple(near))[:2]

    h = mpf(10) ** -14
    trace = (returned(tau + h, v)[0] - returned(tau - h, v)[0]) / (2 * h)
    return tau, v, trace + (returned(tau, v + h * v)[1] - returned(tau, v - h * v)[1]) / (2 * h * v)


@pytest.mark.parametrize("point", POINTS)
def test_orbits_are_exact_to_rounding(point):
    orbits = rattle.Gear(*point).orbits()
    assert len(orbits) >= 2
    for orbit in orbits:
        tau, v, trace = departure_and_trace(orbit, *point)
        assert abs(tau - orbit.tau) < 1e-14
        assert abs(v / orbit.v - 1) < 1e-13
        assert abs(trace - sum(orbit.multipliers).real) < 2e-11 * max(1, abs(trace))
        solved = rattle.periodic_orbit(*point[:2], orbit.tau, orbit.v, 1, point[2])
        assert solved.v == pytest.approx(orbit.v, rel=1e-10)


def test_regions_are_those_of_the_orbits_where_the_paper_has_no_name():
    codes = rattle.regions([0.049079, 5.5e-4, 5.5e-4], [0.01905, 6.9e-4, 6.2e-4], [0.022042, 1e-3, 1e-3])
    assert [rattle.REGIONS[code] for code in codes] == ["ABD", "BD", "D"]
    assert len(set(rattle.REGIONS)) == 18  # of 16 sets one is two regions, and none is computed


def test_gamma_is_dense_in_speeds_too():
    """Speeds are below 0.014 here: neighbours count as close in sevenths of the natural speed."""
    gear = rattle.Gear(0.002, 0.0005, 0.001)
    (piece,) = gear.gamma(0.02)
    assert np.hypot(np.diff(piece.tau), np.diff(piece.v) / (NATURAL / 7)).max() <= 0.02
    for i in range(0, piece.tau.size, 60):
        flight = Flight(1, piece.tau[i], -piece.v[i], 0.002, 0.0005, 0.001)
        lowest = mpf(piece.touch[i]) - mpf(piece.tau[i])
        assert abs(flight.position(lowest) / flight.beta + 1) < 1e-10


def test_a_manifold_is_dense_and_smooth_in_speeds_too():
    point = (0.003632, 5.8468e-4, 0.0047582)
    gear = rattle.Gear(*point)
    a = next(orbit for orbit in gear.orbits() if orbit.name == "A")
    unit = (1.5 * np.sqrt(16 * np.pi * point[0] * point[2]) + 2 * np.pi * point[1]) / 7
    found = manifold(gear.saddle(a), "stable", 1, 8.0, unit=unit)
    for start, end in zip(found.pieces, found.pieces[1:], strict=False):
        assert np.hypot(np.diff(found.tau[start:end]), np.diff(found.v[start:end]) / unit).max(initial=0) <= 0.02
    assert found.length == pytest.approx(8.0, abs=0.05)
    coarse = manifold(gear.saddle(a), "stable", 1, found.tau.max() - found.tau.min())
    assert coarse.tau.size < found.tau.size


@pytest.mark.parametrize(
    ("point", "least"),
    [
        pytest.param((0.064223, 0.0021966, 0.12535), 0.3326, marks=deep),
        ((0.0065641, 4.3347e-4, 0.005052), 0.012196),
    ],
)
def test_the_margin_is_that_of_a_grid_of_long_simulations(point, least):
    gear = rattle.Gear(*point)
    found = gear.boundary_distance()
    assert found.v == pytest.approx(least, rel=2e-3)
    cells = [np.array([x]) for x in point]
    nothing = np.zeros((1, 0))
    follow = ImpactingClassifier(
        make_elastic_cells(*cells, capture_invariant_limits(*cells)), nothing, nothing
    ).outcomes_of_states
    speeds = found.v * np.array([0.5, 0.8, 0.95, 0.999, 1.0001])
    tau, v = (x.ravel() for x in np.meshgrid(np.append((np.arange(60) + 0.5) / 60, found.tau), speeds))
    rests = (
        follow(np.zeros(tau.size, int), tau, v, np.full(tau.size, 100_000)).reshape(speeds.size, -1) == Outcome.QUIET
    )
    assert rests[:-1].all()
    assert not rests[-1].all()


def test_basins_by_cells_are_those_of_the_trajectories():
    """At a step of 16 impacts, whatever the damping, a third of the plane went to an orbit that wins a thirtieth."""
    gear = rattle.Gear(0.014053, 0.0013469, 0.014995)
    found, direct = (gear.basins(40, method=method) for method in ("cells", "direct"))
    assert found.v_max == pytest.approx(1.5 * np.sqrt(16 * np.pi * 0.014053 * 0.014995) + 2 * np.pi * 0.0013469)
    for attractor in direct.attractors[:4]:
        name = attractor.kind, attractor.m, attractor.n_plus, attractor.n_minus
        same = sum(x.fraction for x in found.attractors if (x.kind, x.m, x.n_plus, x.n_minus) == name)
        assert same == pytest.approx(attractor.fraction, abs=0.06), name


@pytest.mark.parametrize("beta", [pytest.param(0.1, marks=deep), 0.15])
def test_the_crisis_and_the_side_of_it_agree_at_weak_damping(beta):
    delta = 0.98 * 4 * beta / np.pi
    crisis = boundary_crisis(delta, beta)
    sides = rattle.crisis_side(delta, crisis.epsilon * np.array([0.999, 0.9999, 1.0001, 1.001]), beta)
    assert [rattle.CRISIS_SIDES[side] for side in sides] == ["inside", "inside", "escapes", "escapes"]


def test_a_side_is_told_where_rest_takes_thousands_of_impacts_and_a_crisis_is_refused():
    assert rattle.CRISIS_SIDES[int(rattle.crisis_side(0.003632, 5.8468e-4, 0.0047582))] == "escapes"
    with pytest.raises(rattle.RattleError, match="damping is too weak"):
        boundary_crisis(0.0126, 0.01)
