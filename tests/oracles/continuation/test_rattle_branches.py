"""Branches of periodic motions, their events and what becomes of them, against 40-digit solutions, closed forms and
simulation.
"""

from functools import cache

import motions_high_precision as exact
import numpy as np
import pytest
from depth import either
from mpmath import mpf

import rattle
from rattle.curves import bifurcation_curve, codimension_two
from rattle.impacting.bifurcations.branches import beyond, branch, continue_to, doubled
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.periodic import PeriodicOrbit, orbit_of, periodic_orbit

DELTA, BETA = 0.6, 0.6
FLIPS = (0.0761557116, 0.0783442320, 0.0786063064, 0.0786551004, 0.0786654050, 0.0786676134)
G1_AT_0762 = np.array([0.7604594925243812, 1.2912463908749803, 0.762, 0.09605760200295944])  # times, δ, ε
STARTS = {  # ε, τ, v, impacts on Σ⁺, as `Gear.attractors` finds them
    (3, 3, 2): (0.0835, 0.60209043, 4.49212657, 3),
    (4, 4, 2): (0.0835, 0.57923715, 4.50735714, 4),
    (8, 8, 6): (0.089, 0.61032916, 4.62573903, 8),
    (5, 5, 2): (0.089, 0.69867770, 4.59599139, 5),
    (2, 2, 1): (0.0945, 0.58498755, 4.62190900, 2),
}


@cache
def period_one(name, epsilon):
    orbit = next(orbit for orbit in rattle.Gear(DELTA, epsilon).orbits() if orbit.name == name)
    return periodic_orbit(DELTA, epsilon, orbit.tau, orbit.v)


@cache
def followed(label):
    epsilon, tau, v, n_plus = STARTS[label]
    found = branch(periodic_orbit(DELTA, epsilon, tau, v, n_plus))
    assert found.label == label
    return found


@cache
def flips():
    return cascade(period_one("D", 0.07), "epsilon", (0.069, 0.1), len(FLIPS))


def of_kind(found, kind):
    return [event.epsilon for event in found.events if event.kind == kind]


def tangent(orbit):
    """Product of the impact map's tangent matrices, and the (τ, v) arrived at."""
    gear, product, tau, v = rattle.Gear(orbit.delta, orbit.epsilon, orbit.beta), np.eye(2), orbit.tau, orbit.v
    for _ in range(orbit.walls.count(1)):
        step = gear.impact(tau, v)
        product, tau, v = step.tangent @ product, step.tau, step.v
    return product, tau, v


def happens(orbit):
    """Return whether each flight, recomputed, ends at the time of the motion."""
    gear, ends = rattle.Gear(orbit.delta, orbit.epsilon, orbit.beta), [*orbit.times, orbit.times[0] + orbit.m]
    for i, wall in enumerate(orbit.walls):
        if orbit.speeds[i] <= 0:
            return False
        flight = gear.first_impact(wall, ends[i], -wall * orbit.speeds[i])
        if flight.next_wall != orbit.walls[(i + 1) % len(orbit.walls)]:
            return False
        if abs(flight.flight_time - (ends[i + 1] - ends[i])) > 1e-6:
            return False
    return True


# Period-one motions


def test_branches_of_period_one_have_the_events_of_the_closed_forms():
    c, d = branch(period_one("C", 0.07), span=(0.05, 0.16)), branch(period_one("D", 0.07), span=(0.05, 0.16))
    assert of_kind(c, "SN") == pytest.approx([float(rattle.sn1(DELTA))], abs=1e-12)
    grazes = [event for event in c.events if event.kind == "GR"]
    assert [event.epsilon for event in grazes] == pytest.approx([0.144452777], abs=1e-9)
    assert grazes[0].itinerary.walls == (1, -1)
    assert of_kind(d, "SN") == pytest.approx([0.06874679], abs=1e-8)
    assert of_kind(d, "PD")[0] == pytest.approx(0.07615571, abs=1e-8)
    assert of_kind(d, "GR") == pytest.approx([0.144452777], abs=1e-9)  # B is the other end of D's branch
    (fold,) = (event for event in d.events if event.kind == "SN")
    epsilon, *_ = exact.known_event(fold.unknowns[:-2], (1, -1), 1, DELTA, fold.epsilon, BETA, 1)
    assert abs(epsilon - fold.epsilon) < 1e-12


def test_a_and_c_are_one_branch():
    a, c = (branch(period_one(name, 0.07), span=(0.055, 0.1)) for name in "AC")
    assert of_kind(a, "SN") == pytest.approx(of_kind(c, "SN"), abs=1e-13)


# Motions of several impacts


@pytest.mark.parametrize("label", STARTS)
def test_events_against_high_precision(label):
    found = followed(label)
    assert found.events
    seen = {}
    for event in found.events:
        itinerary, times = event.itinerary, event.unknowns[:-2]
        multiplier = {"SN": 1, "PD": -1}.get(event.kind)
        if itinerary.n > 10 and multiplier:
            assert np.min(np.abs(event.multipliers - multiplier)) < 1e-6  # 5 s in high precision
            continue
        epsilon, solved, multipliers = exact.known_event(
            times, itinerary.walls, itinerary.m, DELTA, event.epsilon, BETA, multiplier, event.impact
        )
        assert abs(epsilon - event.epsilon) < 1e-13, event
        assert max(abs(x - mpf(float(t))) for x, t in zip(solved, times, strict=True)) < 1e-9, event
        if multiplier:
            assert min(abs(x - multiplier) for x in multipliers) < 1e-15, event
        seen[event.kind, event.after] = epsilon
    if label == (4, 4, 2):  # a fold so near to its graze that no simulation could tell them apart
        graze, fold = (min(e for (kind, _), e in seen.items() if kind == which) for which in ("GR", "SN"))
        assert 5e-13 < graze - fold < 6e-13


@pytest.mark.parametrize("label", STARTS)
def test_points_against_the_impact_map(label):
    """Existence and stability at every point, by flights recomputed and tangent matrices multiplied."""
    found = followed(label)
    assert found.admissible.any()
    for i in range(len(found)):
        orbit = found.orbit(i)
        assert happens(orbit) == found.admissible[i], (i, orbit)
        if found.admissible[i] and orbit.speeds.min() > 1e-3:
            product, tau, v = tangent(orbit)
            assert np.trace(product) == pytest.approx(found.multipliers[:, i].sum().real, rel=1e-7, abs=1e-7)
            assert (abs((tau - orbit.tau + 0.5) % 1 - 0.5), v) == (pytest.approx(0, abs=1e-9), pytest.approx(orbit.v))
            assert found.stable[i] == (max(abs(np.linalg.eigvals(product))) < 1)
        else:
            assert not found.stable[i] or found.admissible[i]


@pytest.mark.parametrize("label", STARTS)
def test_every_change_along_a_branch_has_its_event(label):
    """On a branch that is much finer: existence and stability change where events are, and nowhere else."""
    found = followed(label)
    fine = branch(found.orbit(found.start), resolution=either(200, 500))
    assert [(e.kind, round(e.epsilon, 9)) for e in fine.events] == [(e.kind, round(e.epsilon, 9)) for e in found.events]
    at = {event.after for event in fine.events}
    for k in range(len(fine) - 1):
        if fine.admissible[k] != fine.admissible[k + 1] or fine.stable[k] != fine.stable[k + 1]:
            assert k in at, (k, fine.epsilon[k])


# Doubling


def test_the_cascade_of_d():
    found = flips()
    assert [event.kind for event in found] == ["PD"] * len(FLIPS)
    assert [event.epsilon for event in found] == pytest.approx(FLIPS, abs=1e-10)
    assert [event.itinerary.m for event in found] == [1, 2, 4, 8, 16, 32]
    gaps = np.diff([event.epsilon for event in found])
    ratios = gaps[:-1] / gaps[1:]
    assert ratios[-1] == pytest.approx(4.6692, abs=0.01)
    assert abs(ratios[-1] - 4.6692) < abs(ratios[-2] - 4.6692)


def test_the_first_flips_in_high_precision():
    for event in flips()[:3]:
        itinerary = event.itinerary
        epsilon, *_ = exact.known_event(
            event.unknowns[:-2], itinerary.walls, itinerary.m, DELTA, event.epsilon, BETA, -1
        )
        assert abs(epsilon - event.epsilon) < 1e-12


def test_every_flip_by_tangent_matrices():
    for event in flips():
        x, n = event.unknowns, event.itinerary.n
        v = -event.itinerary.flights(x).w0[0]
        orbit = periodic_orbit(DELTA, event.epsilon, float(x[0]), float(v), n // 2)
        values = np.linalg.eigvals(tangent(orbit)[0])
        assert np.min(np.abs(values + 1)) < 1e-5, event.epsilon


def test_doubled_branches_start_at_their_flip_and_attract():
    for event in flips()[:3]:
        found = doubled(event, span=(event.epsilon - 0.001, event.epsilon + 0.001))
        assert found.itinerary.m == 2 * event.itinerary.m
        assert found.start == 0
        assert found.ends[0] == "flip"
        assert found.epsilon[0] == pytest.approx(event.epsilon, abs=1e-14)
        stable = np.flatnonzero(found.stable)
        orbit = found.orbit(int(stable[len(stable) // 2]))
        per_period = orbit.walls.count(1)
        gear = rattle.Gear(DELTA, orbit.epsilon)
        settled = gear.iterate(orbit.tau + 1e-5, orbit.v, 4000 * per_period)
        assert abs(settled.tau - orbit.tau) < 1e-7, event.epsilon
        assert abs(settled.v - orbit.v) < 1e-6, event.epsilon
        half = gear.iterate(orbit.tau, orbit.v, per_period // 2)
        assert abs(half.v - orbit.v) > 1e-4, "it is the motion of half the period"


def test_a_doubled_motion_ends_at_its_flip_and_not_in_its_copy():
    found = followed((8, 8, 6))
    halves = [end for end in found.ends if "halves" in end]
    assert len(halves) == 1
    origin = [event for event in found.events if event.itinerary.m == 4]
    assert len(origin) == 1
    assert origin[0].epsilon == pytest.approx(0.0889043713116383, abs=1e-13)


# Grazing


@pytest.mark.parametrize("label", [(2, 2, 1), (3, 3, 2), (4, 4, 2), (8, 8, 6)])
def test_both_itineraries_meet_at_a_graze(label):
    event = next(event for event in followed(label).events if event.kind == "GR")
    misses, touches = beyond(event)
    assert misses.itinerary.n == touches.itinerary.n - 1 == event.itinerary.n - 1
    for found in (misses, touches):
        assert found.epsilon[found.start] == pytest.approx(event.epsilon, abs=1e-13)
        assert found.delta[found.start] == DELTA
    assert touches.speeds[touches.start, event.impact] == pytest.approx(0, abs=1e-9)
    assert np.delete(touches.speeds[touches.start], event.impact) == pytest.approx(misses.speeds[misses.start])
    for found in (misses, touches):
        near = np.flatnonzero((np.abs(found.epsilon - event.epsilon) < 5e-3) & (np.arange(len(found)) != found.start))
        for i in near:
            orbit = found.orbit(int(i))
            assert happens(orbit) == found.admissible[i]
    sides = {bool(found.admissible[found.start + k]) for found in (misses, touches) for k in (-1, 1)}
    assert sides == {True, False}


@pytest.mark.filterwarnings("error")
def test_the_multipliers_of_a_graze_are_infinite_and_come_without_a_warning():
    """Terms of the monodromy are infinite there, with opposite signs if the motion is one of the figures'."""
    assert np.isinf(orbit_of(Itinerary((1, -1), 1, BETA), G1_AT_0762).multipliers[0])
    for label in ((2, 2, 1), (4, 4, 2), (5, 5, 2)):
        for event in followed(label).events:
            if event.kind == "GR":
                large, small = event.orbit.multipliers
                assert abs(large) > 1e13  # rounding of the graze's speed, which is 0, makes it finite
                assert abs(small) < 1e-13
                assert np.isfinite(event.multipliers).all()  # of the motion that misses the wall


def test_grazing_curves_of_several_motions_end_at_cod23():
    """SN2 and PD1 end there: the motions become the grazing C, m times over.

    Their speeds at Σ⁻ all vanish in proportion to the distance, so that less than 1e-7 before it they are below the
    rounding of existence.
    """
    point = next(p for p in codimension_two(BETA) if p.name == "COD23")
    for label in ((2, 2, 1), (3, 3, 2), (4, 4, 2)):
        for event in followed(label).events:
            if event.kind != "GR":
                continue
            curve = bifurcation_curve(event)
            last = curve.ends[-1].index
            assert curve.delta[last] == pytest.approx(point.delta, abs=2e-7), label
            assert curve.epsilon[last] == pytest.approx(point.epsilon, abs=1e-7), label


# Fate


def test_fate():
    d = period_one("D", 0.07)
    same = continue_to(d, DELTA, 0.075)
    assert isinstance(same, PeriodicOrbit)
    assert same.stable
    assert same.epsilon == 0.075
    assert tangent(same)[1:] == (pytest.approx(same.tau, abs=1e-9), pytest.approx(same.v, abs=1e-9))
    for target, kind, place in ((0.08, "PD", FLIPS[0]), (0.065, "SN", 0.06874679)):
        event = continue_to(d, DELTA, target)
        assert isinstance(event, Event)
        assert event.kind == kind
        assert event.epsilon == pytest.approx(place, abs=1e-8)
    event = continue_to(period_one("C", 0.14), DELTA, 0.15)
    assert isinstance(event, Event)
    assert event.kind == "GR"
    assert event.epsilon == pytest.approx(float(rattle.grazing("G1", DELTA).epsilon), abs=1e-12)


@pytest.mark.parametrize("label", STARTS)
def test_fate_agrees_with_the_branch(label):
    """Up and down from a stable motion: the nearest change of existence or stability on its branch."""
    found = followed(label)
    orbit = found.orbit(found.start)
    assert orbit.stable
    changes = [e.epsilon for e in found.events for k in [e.after] if found.stable[k] != found.stable[k + 1]]
    above, below = ([e for e in changes if (e > orbit.epsilon) == up] for up in (True, False))
    for nearest, step in ((min(above, default=None), 1e-4), (max(below, default=None), -1e-4)):
        if nearest is not None:
            event = continue_to(orbit, DELTA, nearest + step)
            assert isinstance(event, Event)
            assert event.epsilon == pytest.approx(nearest, abs=1e-11)
            before = continue_to(
                orbit, DELTA, nearest - 0.5 * step if abs(nearest - orbit.epsilon) > 1e-4 else orbit.epsilon
            )
            assert isinstance(before, PeriodicOrbit)
