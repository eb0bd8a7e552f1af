"""Diagrams of the stiff gear: branches against the flow and scipy, labels that change at grazes, the limit."""

from functools import cache

import numpy as np
import pytest
from depth import deep
from stiff_high_precision import integrated

import rattle
from rattle.attractors.table import KINDS
from rattle.continuation.conditions import EventKind
from rattle.errors import ParameterError
from rattle.stiff import StiffGear, continue_from_limit, diagram, saddle_node_1, trace

PERIODIC = KINDS.index("periodic")
BETA = 0.6


@cache
def along_epsilon(kappa=1e4):
    return diagram((0.6, 0.07), (0.6, 0.095), BETA, kappa, 12, 12, impacts=6)


@cache
def with_long_contacts():
    """Near the quiet limit at low stiffness, where contacts split and merge."""
    return diagram((0.55, 0.12), (0.55, 0.2), BETA, 2138.0, 10, 8, impacts=3, most=30)


@cache
def along_kappa():
    return diagram((0.6, 0.075), (0.6, 0.075), BETA, (1e2, 1e6), 6, 4)


def closes(orbit, atol):
    """The return map comes back, with the multipliers of its own tangent map."""
    gear = StiffGear(orbit.delta, orbit.epsilon, orbit.beta, orbit.kappa)
    tau, v, time, below, product = orbit.tau, orbit.v, 0.0, 0, np.eye(2)
    for _ in range(orbit.label[1]):
        step = gear.impact(tau, v)
        tau, v, time, below, product = step.tau, step.v, time + step.time, below + step.n_minus, step.tangent @ product
    scale = 1.0 + np.abs(product).max()
    assert below == orbit.label[2]
    assert time == pytest.approx(orbit.m, abs=atol * scale)
    assert (tau, v) == pytest.approx((orbit.tau, orbit.v), abs=atol * scale)
    assert np.trace(product) == pytest.approx(sum(orbit.multipliers).real, abs=1e-6 * scale)


@pytest.mark.parametrize("found", [along_epsilon, with_long_contacts, along_kappa])
def test_branches_are_of_true_motions(found) -> None:
    """At random points, by the kernel of the flow, which has no part in the equations that were solved."""
    rng, seen = np.random.default_rng(3), 0
    for branch in found().branches:
        for i in rng.integers(0, len(branch), 4):
            orbit = branch.orbit(i)
            if branch.unknowns[i, len(branch.walls) : -3].min() > 1e-2 and orbit.speeds.min() > 1e-2:
                closes(orbit, 1e-9)  # at a graze rounding decides whether a contact is made
                assert bool(branch.stable[i]) == orbit.stable or abs(abs(orbit.multipliers[0]) - 1.0) < 1e-6
                seen += 1
    assert seen > 10


def test_monodromy_is_that_of_solve_ivp() -> None:
    labels = (1, 2, 0), (2, 2, 1)
    orbits = [each.orbit(len(each) // 2) for each in with_long_contacts().branches if each.label in labels]
    for label in labels:
        orbit = max((each for each in orbits if each.label == label), key=lambda each: each.speeds.min())
        h, arguments = 1e-7, (orbit.delta, orbit.epsilon, orbit.beta, orbit.kappa)
        begun = 0.1 * (orbit.times[1] - orbit.departures[0])  # in the gap
        position, velocity, *_ = StiffGear(*arguments).flight(BETA, -orbit.v, orbit.tau, begun)
        ends = [
            integrated(orbit.tau + begun, position + x, velocity + y, float(orbit.m), *arguments)
            for x, y in ((h, 0.0), (-h, 0.0), (0.0, h), (0.0, -h))
        ]
        assert ends[0][2:] == label[1:]
        columns = (np.array(ends[i][:2]) - ends[i + 1][:2] for i in (0, 2))
        monodromy = np.array(list(columns)).T / (2 * h)
        error = 1e-5 * (1 + abs(orbit.multipliers[0])) ** 2
        assert np.trace(monodromy) == pytest.approx(sum(orbit.multipliers).real, abs=error)
        assert np.linalg.det(monodromy) == pytest.approx(np.exp(-orbit.delta * orbit.m), abs=error)


@pytest.mark.parametrize("found", [along_epsilon, with_long_contacts])
def test_a_motion_goes_on_through_a_graze_with_another_label(found) -> None:
    """Two branches end at a graze, at one place in (τ, v), with one contact more or less and the same multipliers."""
    ends = [(each, k) for each in found().branches for k in (0, -1) if "graze" in each.ends[k]]
    grazes = [event for event in found().events if event.kind is EventKind.GRAZING]
    joined, merged = 0, 0
    for event in grazes:
        here = []
        for branch, k in ends:
            orbit = branch.orbit(k)
            near = [
                abs((tau - t + 0.5) % 1 - 0.5) + abs(v - w) for tau, v in upper(orbit) for t, w in upper(event.orbit)
            ]
            if np.abs(branch.parameters[k] - event.parameters).max() < 1e-8 and min(near, default=1.0) < 1e-6:
                here.append(orbit)
        if len(here) != 2:  # the other branch is among those left out
            assert found().left_out
            continue
        fewer, more = sorted(here, key=lambda orbit: len(orbit.walls))
        assert more.m == fewer.m == event.orbit.m
        assert len(more.walls) == len(fewer.walls) + 1 == len(event.orbit.walls) + 1
        np.testing.assert_allclose(sum(more.multipliers), sum(fewer.multipliers), atol=1e-3 * abs(more.multipliers[0]))
        joined, merged = joined + 1, merged + (more.durations.min() > 1e-4)
    assert joined >= (5 if found is with_long_contacts else 1)
    assert (merged > 0) == (found is with_long_contacts)


def upper(orbit):
    on = np.array(orbit.walls) > 0
    return list(zip(orbit.departures[on], orbit.speeds[on], strict=True))


def test_attractors_lie_on_stable_branches() -> None:
    found, checked = along_epsilon(), 0
    points = found.points
    for i in np.flatnonzero(points.kind == PERIODIC)[::3]:
        label = int(points.m[i]), int(points.n_plus[i]), int(points.n_minus[i])
        if label in found.left_out:
            continue
        if points.step[i] in (0, found.position.size - 1):  # the ends of branches
            continue
        gear = StiffGear(0.6, float(found.epsilon[points.step[i]]), BETA, 1e4)
        orbit = gear.orbit(points.tau[i], points.v[i], label[1])
        branches = [each for each in found.branches if each.label == label]
        at = [(each, x) for each in branches for _, x in each.crossings(-2, gear.epsilon)]
        assert any(
            abs(((x[0] + x[-1] * x[len(b.walls)]) - t + 0.5) % 1 - 0.5) < 1e-7 for b, x in at for t, _ in upper(orbit)
        )
        assert orbit.stable
        checked += 1
    assert checked > 15
    assert {(2, 2, 2), (3, 3, 2)} <= {each.label for each in found.branches}


@pytest.mark.parametrize(("name", "delta"), [pytest.param("PDC", 0.45, marks=deep), ("PD2", 0.5)])
def test_flips_that_are_not_next_to_a_birth_are_named(name: str, delta: float) -> None:
    at = trace(name, BETA, 1e4, (delta - 0.02, delta + 0.02)).at(delta)[0]
    found = diagram((delta, at - 0.004), (delta, at + 0.004), BETA, 1e4, 4, 2)
    named = {branch.curve_of(event): event.orbit.epsilon for branch in found.branches for event in branch.events}
    assert named[name] == pytest.approx(at, abs=1e-9)
    assert "PD1" not in named


def test_saddle_nodes_flips_and_letters() -> None:
    """SN1 by its explicit curve; a doubled branch begins at its flip, and stays on one side of it at first."""
    found = diagram((0.6, 0.055), (0.6, 0.09), BETA, 1e4, 4, 2)
    first = next(event for event in found.events if event.orbit.label == (1, 1, 0))
    assert first.orbit.epsilon == pytest.approx(saddle_node_1(0.6, 1e4).epsilon, abs=1e-10)
    flips = [event.orbit for event in found.events if event.kind is EventKind.FLIP and event.orbit.m == 1]
    named = {branch.curve_of(event): event.orbit.epsilon for branch in found.branches for event in branch.events}
    assert named.items() >= {"SN1": first.orbit.epsilon, "PD1": flips[0].epsilon}.items()
    assert named["SN2"] == pytest.approx(0.0688360290, abs=1e-9)  # docs/stiff.md
    doubled = next(each for each in found.branches if each.m == 2)
    assert doubled.epsilon[0] == pytest.approx(flips[0].epsilon, abs=1e-12)
    size = np.abs(doubled.unknowns[:, 2] - doubled.unknowns[:, 0] - 1.0)[1:6]
    ratio = size**2 / (doubled.epsilon[1:6] - doubled.epsilon[0])
    np.testing.assert_allclose(ratio, ratio[0], rtol=0.05)
    for name in "ABCD":
        limit = next(orbit for orbit in rattle.Gear(0.6, 0.075).orbits() if orbit.name == name)
        there = continue_from_limit(rattle.periodic_orbit(0.6, 0.075, limit.tau, limit.v), 1e4)
        states = [
            (x[0], x[2 if len(b.walls) > 1 else 1])
            for b in found.branches
            for k, x in b.crossings(-2, 0.075)
            if b.names[k] == name
        ]
        assert min(abs((t - there.times[0] + 0.5) % 1 - 0.5) for t, _ in states) < 1e-9


@pytest.mark.parametrize(
    ("span", "kinds"), [((0.055, 0.0795), {"SN": 1, "PD": 3}), pytest.param((0.14, 0.15), {"GR": 1}, marks=deep)]
)
def test_events_converge_to_those_of_the_impacting_model(span, kinds) -> None:
    """The difference falls as κ^(−1/2): SN1, SN2, PD1, flips of twice and four times the period, and C's graze (G1)."""
    ends = (0.6, span[0]), (0.6, span[1])
    limit = rattle.diagram(*ends, BETA, 2, 1)
    softer, stiffer = (diagram(*ends, BETA, kappa, 2, 1) for kappa in (1e6, 1e8))
    compared = dict.fromkeys(kinds, 0)
    for event in limit.events:
        itinerary = event.itinerary if event.impact is None else event.itinerary.without_impact(event.impact)
        kind, label = str(event.kind), (itinerary.m, itinerary.walls.count(1), itinerary.walls.count(-1))
        if kind in kinds and label in {(1, 1, 0), (1, 1, 1), (2, 2, 2), (4, 4, 4)}:
            off = [
                min(
                    abs(e.orbit.epsilon - event.epsilon)
                    for e in each.events
                    if (e.kind, e.orbit.label) == (kind, label)
                )
                for each in (softer, stiffer)
            ]
            if off[0] > 1e-5:  # SN2 has almost no first term
                assert off[0] / off[1] == pytest.approx(10.0, rel=0.1), (kind, label)
                compared[kind] += 1
    assert compared == kinds


def test_along_kappa() -> None:
    """B and D meet at κ = 229.5 (docs/stiff.md); at κ = 1e4 the branches are where the limit leads to."""
    found = along_kappa()
    assert found.added["kappa"][[0, -1]] == pytest.approx([1e2, 1e6])
    np.testing.assert_allclose(np.diff(found.added["kappa"] ** -0.5), (1e-3 - 1e-1) / 6)
    fold = next(
        event for event in found.events if event.kind is EventKind.SADDLE_NODE and event.orbit.label == (1, 1, 1)
    )
    assert fold.orbit.kappa == pytest.approx(229.5, abs=0.5)
    assert found.positions(fold) == pytest.approx((fold.orbit.kappa**-0.5 - 1e-1) / (1e-3 - 1e-1))
    branch = next(each for each in found.branches if each.label == (1, 1, 1))
    for name in "BD":
        limit = next(orbit for orbit in rattle.Gear(0.6, 0.075).orbits() if orbit.name == name)
        there = continue_from_limit(rattle.periodic_orbit(0.6, 0.075, limit.tau, limit.v), 1e4)
        crossed = [x for _, x in branch.crossings(-1, 5e3**-0.5 / 2)]
        assert min(abs(x[0] - np.rint(x[0] - there.times[0]) - there.times[0]) for x in crossed) < 1e-9


def test_turned_round_it_is_the_same() -> None:
    """On a slanted segment through C's graze."""
    one, other = (
        diagram(start, end, BETA, 1e4, 2, 1, impacts=2)
        for start, end in (((0.6, 0.14), (0.62, 0.175)), ((0.62, 0.175), (0.6, 0.14)))
    )
    here, there = ([(e.kind, e.orbit.label) for e in each.events] for each in (one, other))
    assert sorted(here) == sorted(there)
    assert (EventKind.GRAZING, (1, 1, 0)) in here
    mirrored = sorted(1.0 - float(other.positions(event)) for event in other.events)
    assert sorted(float(one.positions(event)) for event in one.events) == pytest.approx(mirrored, abs=1e-9)


def test_hostile_input_is_refused() -> None:
    for bad, message in (
        ({"kappa": 0.0}, "kappa must"),
        ({"kappa": (1e3, np.nan)}, "kappa must"),
        ({"kappa": (1e3, 1e4, 1e5)}, "kappa must"),
        ({"end": (0.6, 0.1)}, "farther apart"),
        ({"end": (0.0, 0.1)}, "δ of end"),
        ({"steps": 0}, "steps must"),
    ):
        with pytest.raises(ParameterError, match=message):
            diagram(**({"start": (0.6, 0.1), "end": (0.6, 0.2)} | bad))
