"""Bifurcation curves of the library against their 40-digit solutions, at random places.

CURVES_SEED=N takes other places.
"""

import os
from functools import cache
from itertools import pairwise

import curves_high_precision as exact
import numpy as np
import pytest
from depth import either
from mpmath import mp, mpf

import rattle
from rattle import curves
from rattle.continuation.arclength import solve_all_with_fixed_unknown, solve_with_fixed_unknown
from rattle.continuation.conditions import equations_of_bifurcation
from rattle.impacting.bifurcations.registry import CURVES

SEED = int(os.environ.get("CURVES_SEED", 2009))
NAMES = ("SN1", "SN2", "PD1", "PD2", "PDC", "G1", "G2")
PAIRS = either(3, 8)
HIGHEST = 1.0  # ε


@pytest.fixture
def rng(request):
    """A generator of its own for every test, so that one test alone repeats."""
    return np.random.default_rng([SEED, *request.node.name.encode()])


@cache
def traced(name, beta):
    return curves.trace(name, beta, (0.5 * beta, 2.0 * beta), (0.0, HIGHEST))


def betas():
    """One set for all curves of a run, the paper's among them."""
    return (0.6, *(float(b) for b in np.random.default_rng([SEED, 1]).uniform(0.2, 1.2, PAIRS - 1)))


def inside(curve, rng, margin=0.02):
    """A damping of six digits at which a traced curve exists, away from the ends of its range."""
    low, high = curve.delta.min(), curve.delta.max()
    return round(float(rng.uniform(low + margin * (high - low), high - margin * (high - low))), 6)


# The oracle itself


def test_the_oracle_has_the_published_numbers():
    """Table of the model's description; half a unit of its last digit."""
    for name, delta, epsilon, digits in [
        ("SN1", "0.6", "0.0596430582", 10),
        ("SN2", "0.6", "0.06874679", 8),
        ("PD1", "0.6", "0.07615571", 8),
        ("G1", "0.6", "0.144452777", 9),
        ("SN1", "0.762", "0.0958502413", 10),
        ("G1", "0.762", "0.0960576020", 10),
        ("PDC", "0.5", "0.16767", 5),
        ("G1", "0.5", "0.21312", 5),
        ("PD2", "0.4", "0.2395", 4),
    ]:
        found = exact.known_points(name, mpf(delta), mpf("0.6"))
        assert abs(found[0].epsilon - mpf(epsilon)) <= mpf(10) ** -digits, name
    both = exact.known_points("G1", mpf("0.762"), mpf("0.6"))[0].multipliers
    assert [float(x) for x in both] == pytest.approx([0.8349018443, 0.5590262281], abs=5e-11)


@pytest.mark.parametrize("name", ["PD1", "PDC"])
def test_the_oracle_has_the_multipliers_of_the_return_map(name):
    """Differences of sixth order of the impacts themselves, of which the oracle's determinant knows nothing."""
    delta, beta = mpf("0.45"), mpf("0.6")
    cycle = exact.points(name, delta, beta)[0].cycle

    def returned(t, v):
        place, w, spans = t, -v, [t1 - t0 for _, t0, _, _, t1, _ in cycle.legs()]
        for (wall, _, _, following, _, _), span in zip(cycle.legs(), spans, strict=True):
            flight = exact.Flight(wall, place, w, delta, cycle.epsilon, beta)
            s = mp.findroot(lambda s, f=flight, end=following * beta: f.position(s) - end, span, tol=mpf(10) ** -70)
            place, w = place + s, -flight.velocity(s)
        return mp.matrix([place, -w])

    state, h = (cycle.times[0], -cycle.velocities[0]), mpf(10) ** -5
    columns = []
    for axis in range(2):
        total = mp.matrix([0, 0])
        for k, weight in ((1, mpf(3) / 4), (2, mpf(-3) / 20), (3, mpf(1) / 60)):
            ahead, behind = ([x + side * k * h * (i == axis) for i, x in enumerate(state)] for side in (1, -1))
            total += weight * (returned(*ahead) - returned(*behind)) / h
        columns.append(total)
    trace = columns[0][0] + columns[1][1]
    determinant = columns[0][0] * columns[1][1] - columns[1][0] * columns[0][1]
    assert abs(trace - cycle.trace()) < mpf(10) ** -22
    assert abs(trace + 1 + mp.exp(-delta)) < mpf(10) ** -22  # a flip
    assert abs(determinant - mp.exp(-delta)) < mpf(10) ** -22


def test_closed_forms_and_grazing(rng):
    for beta, delta in zip(betas()[:5], rng.uniform(0.2, 2.2, min(PAIRS, 5)), strict=True):
        delta = round(float(delta), 6)
        for name, form in (("SN1", rattle.sn1), ("PDC", rattle.flip)):
            stated = float(form(delta, beta))  # NaN where no motion happens there
            expected = [float(point.epsilon) for point in exact.known_points(name, delta, beta, 3.0)]
            assert ([] if np.isnan(stated) else [stated]) == pytest.approx(expected, abs=1e-13), (name, delta, beta)
        epsilon, _ = exact.quiet_limit(delta)
        assert abs(epsilon - float(rattle.quiet_limit(delta))) < 1e-14, delta
        for name in ("G1", "G2"):
            found = [p.epsilon for p in exact.known_points(name, delta, beta)]
            ours = float(rattle.grazing(name, delta, beta).epsilon)
            assert min((abs(e - ours) for e in found), default=0 if not ours <= HIGHEST else 1) < 1e-12, (delta, beta)


# The curves


@pytest.mark.parametrize("name", NAMES)
def test_every_epsilon_of_a_curve(name, rng):
    """All ε at random dampings, none missing and none too many."""
    seen = 0
    for beta in betas():
        curve = traced(name, beta)
        for delta in [inside(curve, rng)] if len(curve.delta) else [round(float(rng.uniform(0.5, 2.0)) * beta, 6)]:
            ours = curve.at(delta)
            found = [float(p.epsilon) for p in exact.known_points(name, delta, beta, HIGHEST)]
            assert len(ours) == len(found), (name, delta, beta, ours, found)
            assert ours == pytest.approx(found, abs=1e-10), (name, delta, beta)
            seen += len(found)
    assert seen >= PAIRS / 2


@pytest.mark.parametrize("name", [*NAMES, "quiet_limit"])
def test_a_smaller_window_cuts_the_curve_and_loses_none_of_it(name, rng):
    """The fold that joins two parts of a curve may be outside, as on PD2."""
    for beta in betas()[: either(1, 2)]:
        curve = traced(name, beta)
        delta = inside(curve, rng) if len(curve.delta) else beta
        whole = curve.at(delta)
        narrow = curves.trace(name, beta, (0.9 * delta, 1.02 * delta), (0.0, HIGHEST))
        assert narrow.at(delta) == pytest.approx(whole, abs=1e-12), (name, delta, beta)
        for epsilon in whole:
            small = curves.trace(name, beta, (0.9 * delta, 1.02 * delta), (0.98 * epsilon, 1.01 * epsilon))
            assert small.at(delta) == pytest.approx([epsilon], abs=1e-12), (name, delta, beta, epsilon)


@pytest.mark.parametrize("name", NAMES)
def test_the_motion_on_a_curve(name, rng):
    """A random point of each trace: ε, phase, speed, multipliers; and the sum rule on all its points."""
    for beta in betas():
        curve = traced(name, beta)
        n = len(curve.delta)
        if not n:
            continue
        product = curve.multipliers[0] * curve.multipliers[1]
        assert abs(product - np.exp(-curve.delta)).max() < 1e-12, (name, beta)
        i = int(rng.choice([k for k in range(1, n - 1) if all(abs(k - fold) > 1 for fold in curve.folds)]))
        delta, epsilon = float(curve.delta[i]), float(curve.epsilon[i])
        place = (name, beta, delta, epsilon)
        # twelve digits: another rounding on the way there asks for the same place
        point = exact.known_point_near(name, round(delta, 12), beta, round(epsilon, 6), 1.2 * HIGHEST)
        assert abs(point.epsilon - epsilon) < 1e-10, place
        turned = float(point.phase - mpf(float(curve.tau[i])))
        assert abs(turned - round(turned)) < 1e-8, place
        assert abs(float(point.speed) - curve.v[i]) < 1e-8, place
        theirs = np.array([complex(x) for x in point.multipliers])
        apart = abs(theirs[0] - theirs[1])  # where they meet, half the digits are lost
        ours = curve.multipliers[:, i]
        difference = min(abs(ours - theirs).max(), abs(ours[::-1] - theirs).max())
        assert difference < 1e-8 / min(1, max(apart, 1e-6)), (*place, ours, theirs)


def test_the_quiet_limit(rng):
    beta = betas()[1]
    curve = traced("quiet_limit", beta)
    for i in rng.integers(0, len(curve.delta), PAIRS):
        epsilon, phase = exact.quiet_limit(float(curve.delta[i]))
        assert abs(epsilon - curve.epsilon[i]) < 1e-10
        assert abs(phase - curve.tau[i]) < 1e-8
    assert np.isnan(curve.multipliers).all()
    delta = inside(curve, rng)
    assert curve.at(delta) == pytest.approx([float(rattle.quiet_limit(delta))], abs=1e-10)


@pytest.mark.parametrize("delta", [0.6, 0.75])
def test_the_paper_s_curves_at_two_dampings(delta):
    for name in ("SN1", "SN2", "PD1", "G1"):
        found = exact.known_points(name, delta, 0.6)
        assert len(found) == 1
        assert traced(name, 0.6).at(delta) == pytest.approx([float(found[0].epsilon)], abs=1e-12)


# Where curves meet


def test_codimension_two_points():
    for beta in (0.2, *betas()[:4], 1.2):
        ours = {point.name: point for point in curves.codimension_two(beta)}
        assert set(ours) >= {"COD20", "COD21", "COD22", "COD23"}, beta
        for name in ("COD20", "COD21", "COD22", "COD23"):
            point = exact.known_codimension_two(name, beta)
            assert abs(ours[name].delta - point.delta) < 1e-11, (name, beta)
            assert abs(ours[name].epsilon - point.epsilon) < 1e-11, (name, beta)


@pytest.mark.parametrize("beta", [1e-6, 9e-6, 1e-5, 1e-4, 1e-3])
def test_codimension_two_points_of_a_small_backlash(beta):
    """The velocity 2πδ of A just crosses the gap at COD22, where δ → 4β/π with an error of order β³."""
    points = {point.name: point for point in curves.codimension_two(beta)}
    assert points["COD22"].delta == pytest.approx(4 * beta / np.pi, abs=0.03 * beta**3 + 1e-13)
    assert points["COD20"].delta / beta == pytest.approx(0.906, abs=1e-3)


def test_a_backlash_too_small_for_its_points_has_none():
    """At 3e-7 the search of COD22 failed."""
    for beta in (3e-7, 1e-8, 1e-300):
        assert curves.codimension_two(beta) == ()


def test_saddle_node_and_flip_outlive_the_double_multiplier():
    """SN2 and PD1 do not end at COD21, as the paper has it: between COD21 and COD23, B and D are born before G1."""
    at = {name: exact.known_codimension_two(name, 0.6) for name in ("COD21", "COD23", "COD22")}
    assert at["COD21"].delta < at["COD23"].delta - mpf("1e-3") < at["COD22"].delta
    delta = float(at["COD21"].delta + at["COD23"].delta) / 2
    fold, flip, graze = (exact.points(name, delta, 0.6)[0] for name in ("SN2", "PD1", "G1"))
    assert fold.epsilon < flip.epsilon < graze.epsilon - mpf("1e-7")
    for i, (_, t0, _, wall, t1, _) in enumerate(fold.cycle.legs()):  # the slow and sure search finds the same impacts
        reached, met, _ = fold.cycle.flight(i).first_impact()
        assert met == wall
        assert abs(reached - (t1 - t0)) < mpf("1e-30")
    letters = [
        exact.region(delta, float(e), 0.6)[0]
        for e in (2 * fold.epsilon - flip.epsilon, (fold.epsilon + flip.epsilon) / 2)
    ]
    assert letters == [2, 3]
    assert [rattle.Gear(delta, float(e)).region() for e in (fold.epsilon - 1e-8, fold.epsilon + 1e-8)] == [2, 3]


@pytest.mark.parametrize(
    ("name", "point"),
    [("SN1", "COD22"), ("G1", "COD22"), ("G2", "COD22"), ("PDC", "COD20"), ("SN2", "COD23"), ("PD1", "COD23")],
)
def test_where_a_curve_ends(name, point):
    for beta in betas()[:2]:
        curve, at = traced(name, beta), exact.known_codimension_two(point, beta)
        ends = [end for end in curve.ends if point in end.reason]
        assert len(ends) == 1, (name, beta, curve.ends)
        i = ends[0].index
        assert abs(curve.delta[i] - at.delta) < 1e-6, (name, beta)
        assert abs(curve.epsilon[i] - at.epsilon) < 1e-6, (name, beta)
        side = 1 if name == "G2" else -1
        assert not curve.at(float(at.delta) - side * 1e-5), (name, beta)
        assert len(curve.at(float(at.delta) + side * 1e-5)) == 1, (name, beta)


@pytest.mark.parametrize(
    ("point", "one", "other", "order"),
    [
        ("COD20", "PDC", "G1", 1),
        ("COD22", "SN1", "G1", 2),
        ("COD22", "SN1", "G2", 2),
        ("COD23", "SN2", "G1", 2),
        ("COD23", "PD1", "G1", 2),
    ],
)
def test_how_curves_touch(point, one, other, order):
    """Order p of |ε₁ − ε₂| ∝ |Δδ|^p: halving the distance divides the gap by 2^p; three gaps take out the next term."""
    beta, gaps = 0.6, []
    at = exact.known_codimension_two(point, beta)
    side = 1 if other == "G2" else -1
    for k in (6, 7, 8):
        delta = at.delta * (1 + side * mpf(2) ** -k)
        first = next(exact.guesses(one, delta, beta, 0.6))[0] if (one, side) == ("SN1", 1) else None  # virtual there
        first = mpf(float(first)) if first else exact.known_points(one, delta, beta, 0.6)[0].epsilon
        gaps.append(abs(first - exact.known_points(other, delta, beta, 0.6)[0].epsilon))
    orders = [float(mp.log(x / y, 2)) for x, y in pairwise(gaps)]
    assert 2 * orders[1] - orders[0] == pytest.approx(order, abs=0.02)
    theirs = next(p for p in curves.codimension_two(beta) if p.name == point).tangency
    ours = theirs.get((one, other), theirs.get((other, one)))
    assert ours == pytest.approx(order, abs=0.05)


# Regions


@pytest.mark.parametrize("name", ["SN1", "SN2", "PD1", "PD2", "G1", "G2"])
def test_regions_beside_a_curve(name, rng):
    """1e-6 below and above a curve: the region, its orbits and the stability of D, which differ, are the oracle's."""
    for beta in betas()[:5]:
        curve = traced(name, beta)
        if not len(curve.delta):
            continue
        delta = inside(curve, rng, 0.03)
        found = exact.known_points(name, delta, beta, HIGHEST)
        epsilon = float(found[int(rng.integers(len(found)))].epsilon)
        both = exact.regions_beside(name, delta, beta, epsilon)
        if both is None:
            continue
        place = (name, beta, delta, epsilon, both)
        assert both[0] != both[1], place
        for side, (region, letters, stable) in zip((-1e-6, 1e-6), both, strict=True):
            gear = rattle.Gear(delta, epsilon + side, beta)
            assert gear.region() == (region or rattle.REGIONS.index(letters)), place
            orbits = gear.orbits()
            assert "".join(orbit.name for orbit in orbits) == letters, place
            assert any(orbit.name == "D" and orbit.stable for orbit in orbits) == stable, place
        if beta == 0.6 and epsilon < 0.3:  # the paper's plane: by definition of the regions
            steps = {"SN1": [(1, 2)], "SN2": [(2, 3)], "PD1": [(3, 4)], "PD2": [(4, 3), (3, 4), (5, 5)]}
            steps |= {"G1": [(2, 5), (3, 5), (4, 5)], "G2": [(1, 5)]}
            assert (both[0][0], both[1][0]) in steps[name], place


@pytest.mark.parametrize("name", ["SN2", "PD1", "G1"])
def test_solutions_near_several_guesses_are_those_near_each(name, rng):
    """One that leads nowhere has none, and changes none of the others."""
    definition = CURVES[name]
    problem = equations_of_bifurcation(definition.itinerary(0.6), definition.kind, definition.impact)
    guesses = np.array([x for d in np.linspace(0.42, 0.7, 8) for x in definition.starting_points_at(d, 0.6)])
    guesses = np.concatenate([guesses + size * rng.standard_normal(guesses.shape) for size in (0.0, 1e-3, 0.1, 0.3)])
    found = solve_all_with_fixed_unknown(problem, guesses, -2)
    alone = [solve_with_fixed_unknown(problem, guess, -2, guess[-2]) for guess in guesses]
    assert [x is None for x in alone] == np.isnan(found).any(axis=-1).tolist()
    assert 0 < sum(x is None for x in alone) < len(guesses) / 2
    for one, x in zip(alone, found, strict=True):
        if one is not None:
            np.testing.assert_allclose(x, one, rtol=0, atol=1e-12)
            assert x[-2] == one[-2]
