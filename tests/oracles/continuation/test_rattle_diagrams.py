"""Bifurcation diagrams: branches against closed forms, attractors against branches and back, hysteresis, corners."""

from functools import cache

import numpy as np
import pytest
from depth import deep, either

import rattle
from rattle.attractors.table import KINDS
from rattle.curves import curve_name_of_event
from rattle.impacting.bifurcations.branches import beyond, branch
from rattle.impacting.bifurcations.diagram import diagram
from rattle.impacting.orbits.periodic import orbit_of
from rattle.orbits.periodic_motions import solve_at_parameters

STEPS = either(50, 100)
PERIODIC, CHAOTIC, UNDECIDED = (KINDS.index(name) for name in ("periodic", "chaotic", "undecided"))
SEGMENTS = {  # start, end, beta: along ε and δ, slanted, through COD22, other half-backlashes
    "Figure 5": ((0.6, 0.055), (0.6, 0.105), 0.6),
    "Figure 9": ((0.762, 0.0956), (0.762, 0.0976), 0.6),
    "slanted": ((0.5, 0.05), (0.62, 0.09), 0.6),
    "COD22": ((0.76, 0.0955), (0.780294261868, 0.100281785434), 0.6),
    "along delta": ((0.7, 0.08), (0.55, 0.08), 0.6),
    "small gap": ((0.3, 0.01), (0.3, 0.05), 0.3),
    "large gap": ((0.7, 0.08), (0.7, 0.16), 1.2),
}
#: The last three only repeat what the others show, at other places.
EVERY_SEGMENT = [*list(SEGMENTS)[:4], *(pytest.param(name, marks=deep) for name in list(SEGMENTS)[4:])]
UNMISSED = 3  # steps between a known end of chaos and what is seen of it


@cache
def along(name):
    start, end, beta = SEGMENTS[name]
    return diagram(start, end, beta, 100 if name == "Figure 9" else STEPS)


def label_of(points, i):
    return int(points.m[i]), int(points.n_plus[i]), int(points.n_minus[i])


def solutions(found, which, step):
    """The motions of a branch at the parameters of a step: Newton from between its points."""
    at, times = found.positions(which), np.array(which.times)
    times = times - times[:, :1] + np.unwrap(times[:, 0], period=1.0)[:, None]
    d = at - found.position[step]
    for k in np.flatnonzero(d[:-1] * d[1:] <= 0):
        share = d[k] / (d[k] - d[k + 1])
        guess = times[k] + share * (times[k + 1] - times[k])
        x = solve_at_parameters(which.itinerary, np.append(guess, [found.delta[step], found.epsilon[step]]))
        if x is not None:
            yield orbit_of(which.itinerary, x)


def distance(orbit, tau, v):
    """From the states (τ, v) (n,) to the nearest impacts of a motion, the largest."""
    upper = np.array(orbit.walls) > 0
    phase = (tau[:, None] - orbit.times[upper] + 0.5) % 1.0 - 0.5
    return np.hypot(phase, v[:, None] - orbit.speeds[upper]).min(axis=1).max()


@pytest.mark.parametrize("name", EVERY_SEGMENT)
def test_period_one_branches_agree_with_closed_forms(name):
    found, beta, seen = along(name), SEGMENTS[name][2], 0
    for each in found.branches:
        called = np.array(each.names)
        known = rattle.period_one(each.delta, each.epsilon, beta)
        for i, orbit in enumerate("ABCD"):
            off_graze = np.abs(each.speeds).min(axis=1) > 1e-5
            on = (called == orbit) & each.admissible & off_graze
            if not known.exists[i][on].all():  # one of several P(1,1,1): period_one has the first
                assert orbit in "BD"
                continue
            tau = (each.tau[on] - known.tau[i][on] + 0.5) % 1.0 - 0.5
            turning = np.abs(1.0 - known.multipliers[i][0][on]) < 1e-4  # at saddle-nodes τ is a square root
            assert np.abs(each.v[on] - known.v[i][on]).max(initial=0) < 1e-10
            assert np.abs(tau[~turning]).max(initial=0) < 1e-10
            seen += int(on.sum())
    assert seen > 20


@pytest.mark.parametrize("name", EVERY_SEGMENT)
def test_periodic_attractors_lie_on_stable_branches(name):
    found = along(name)
    points, followed = found.points, {each.label for each in found.branches}
    visits = np.unique(np.stack([points.step, points.forward, points.m, points.n_plus, points.n_minus]), axis=1).T
    checked = 0
    for step, forward, *label in visits[(visits[:, 2] > 0)]:
        at = (points.step == step) & (points.forward == forward) & (points.n_plus == label[1])
        at &= (points.m == label[0]) & (points.n_minus == label[2]) & (points.kind == PERIODIC)
        if tuple(label) not in followed:
            assert tuple(label) in found.left_out
            continue
        if label[1] + label[2] > 8 or tuple(label) in found.left_out:
            continue
        motions = [m for each in found.branches if each.label == tuple(label) for m in solutions(found, each, step)]
        stable = [motion for motion in motions if motion.stable]
        for tau, v in zip(points.tau[at], points.v[at], strict=True):
            nearest = min(distance(motion, np.array([tau]), np.array([v])) for motion in stable)
            assert nearest < 1e-6, (label, found.position[step])
            checked += 1
    assert checked


@pytest.mark.parametrize("name", EVERY_SEGMENT)
def test_stable_branches_are_seen_or_said_to_be_small(name):
    found, seen = along(name), 0
    points = found.points
    for i, each in enumerate(found.branches):
        at = found.positions(each)
        for step, position in enumerate(found.position):
            near = (np.minimum(at[:-1], at[1:]) <= position) & (position <= np.maximum(at[:-1], at[1:]))
            if not (near & each.stable[:-1] & each.stable[1:]).any():
                continue
            if any(piece.branch == i and piece.low <= position <= piece.high for piece in found.small):
                continue
            motions = [motion for motion in solutions(found, each, step) if motion.stable]
            here = (points.step == step) & (points.n_plus == each.label[1]) & (points.n_minus == each.label[2])
            assert here.any(), (each.label, position)
            for motion in motions:
                away = [distance(motion, points.tau[[k]], points.v[[k]]) for k in np.flatnonzero(here)]
                assert min(away) < 1e-6, (each.label, position)
            seen += 1
    assert seen


@pytest.mark.parametrize("name", EVERY_SEGMENT)
def test_nothing_is_listed_twice(name):
    found = along(name)
    for i, one in enumerate(found.branches):
        middle = one.orbit(len(one) // 2)
        for other in found.branches[:i]:
            if other.label != one.label:
                continue
            on = np.hypot(*(np.array([other.delta - middle.delta, other.epsilon - middle.epsilon]))) < 1e-3
            states = zip(other.times[on], other.speeds[on], strict=True)
            assert all(np.abs(np.sort(t % 1) - np.sort(middle.times % 1)).max() > 1e-9 for t, _ in states)
    places = [(e.kind, e.itinerary.n, round(e.delta, 9), round(e.epsilon, 9)) for e in found.events]
    times = [tuple(np.round(np.sort(e.unknowns[:-2] % 1), 5)) for e in found.events]
    assert len(set(zip(places, times, strict=True))) == len(found.events)
    assert all(event.admissible for event in found.events)


def test_the_papers_events_have_their_names_and_values():
    found = along("Figure 5")
    named = {curve_name_of_event(event): event.epsilon for event in found.events if curve_name_of_event(event)}
    assert named == {
        "SN1": pytest.approx(0.0596430582, abs=1e-10),
        "SN2": pytest.approx(0.06874679, abs=1e-8),
        "PD1": pytest.approx(0.07615571, abs=1e-8),
    }
    named = {
        curve_name_of_event(event): event.epsilon for event in along("Figure 9").events if curve_name_of_event(event)
    }
    assert named == {
        "SN1": pytest.approx(0.0958502413, abs=1e-10),
        "G1": pytest.approx(0.0960576020, abs=1e-10),
    }


def test_through_cod22_c_grazes_and_then_a():
    named = {curve_name_of_event(event): event for event in along("COD22").events}
    assert set(named) == {"G1", "G2"}
    for name, event in named.items():
        assert event.epsilon == pytest.approx(float(rattle.grazing(name, event.delta).epsilon), abs=1e-9)
    assert named["G1"].delta < 0.770147130934 < named["G2"].delta


def test_chaos_between_g1_and_the_crisis():
    found = along("Figure 9")
    size = found.epsilon[1] - found.epsilon[0]
    for forward in (True, False):
        on = (found.points.kind == CHAOTIC) & (found.points.forward == forward)
        epsilon = found.epsilon[found.points.step[on]]
        assert 0 < epsilon.min() - 0.0960576020 < UNMISSED * size
        assert abs(epsilon.max() - 0.0974223487) < UNMISSED * size
        steps = np.unique(found.points.step[on])
        untold = np.setdiff1d(np.arange(steps[0], steps[-1]), steps)
        kinds = found.points.kind[np.isin(found.points.step, untold) & (found.points.forward == forward)]
        assert (kinds == UNDECIDED).all()  # robust: no window
        assert untold.size <= 1  # near G1, where transients are long
        assert np.bincount(found.points.step[on])[steps].min() >= 200
        spread = [np.ptp(found.points.v[on & (found.points.step == step)]) for step in steps]
        assert spread[-1] > 5 * spread[0]  # it grows


@deep
def test_hysteresis():
    """P(2,2,1) ends at its graze at 0.08707; from below it is not reached before P(3,3,2) ends, at 0.0876 or later."""
    found = diagram((0.6, 0.0855), (0.6, 0.0905), steps=50)
    points = found.points

    def on(label, forward):
        same = (points.m == label[0]) & (points.n_plus == label[1]) & (points.n_minus == label[2])
        return set(points.step[same & (points.forward == forward)].tolist())

    only_back = on((2, 2, 1), False) - on((2, 2, 1), True)
    assert len(only_back) >= 3
    between = [step for step in only_back if 0.0871 < found.epsilon[step] < 0.0875]
    assert len(between) >= 3
    assert set(between) <= on((3, 3, 2), True)
    orbit = next(a for a in rattle.Gear(0.6, 0.0865).attractors(512) if a.m == 3)
    for step in between:  # as an experiment would have it: the motion stays when ε is raised to there from below
        tau, v = orbit.tau, orbit.v
        for epsilon in np.linspace(0.0865, found.epsilon[step], 20):
            tau, v, *_ = rattle.Gear(0.6, epsilon).iterate(tau, v, 3000)
        again = rattle.Gear(0.6, found.epsilon[step]).iterate(tau, v, 3)
        assert abs(float(again.v) - float(v)) < 1e-6


def test_turned_round_it_is_the_same():
    start, end, beta = SEGMENTS["slanted"]
    one, other = along("slanted"), diagram(end, start, beta, STEPS)
    assert sorted(each.label for each in one.branches) == sorted(each.label for each in other.branches)
    mirrored = sorted(1.0 - float(other.positions(event)) for event in other.events)
    assert sorted(float(one.positions(event)) for event in one.events) == pytest.approx(mirrored, abs=1e-9)


def test_a_quiet_segment_is_empty():
    found = diagram((0.6, 0.0), (0.6, 0.05), steps=10)
    assert (found.branches, found.events, found.points.tau.size, found.small) == ((), (), 0, ())
    assert {KINDS[kind] for kind in found.sampled.kind} == {"quiet"}


def test_above_the_quiet_limit_there_is_chaos_at_every_step():
    found = diagram((0.6, 0.25), (0.6, 0.252), steps=6, impacts=4)
    chaotic = found.points.kind == CHAOTIC
    assert set(found.points.step[chaotic & found.points.forward]) == set(range(7))
    assert {each.names[0] for each in found.branches} >= {"A", "D"}


def test_limits_are_kept_and_said():
    few = diagram((0.6, 0.075), (0.6, 0.09), steps=15, impacts=4, most=2)
    assert len(few.branches) <= 2
    assert few.left_out
    short = diagram((0.6, 0.075), (0.6, 0.09), steps=15, impacts=3)
    assert max(each.itinerary.n for each in short.branches) <= 3
    assert (2, 2, 2) in short.left_out


def test_a_branch_begun_at_a_graze_has_it():
    c = next(orbit for orbit in rattle.Gear(0.6, 0.14).orbits() if orbit.name == "C")
    (graze,) = (e for e in branch(rattle.periodic_orbit(0.6, 0.14, c.tau, c.v)).events if e.kind == "GR")
    for each in beyond(graze, "epsilon", (0.14, 0.15)):
        assert [event.epsilon for event in each.events if event.kind == "GR"] == [pytest.approx(graze.epsilon)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": (0.6, 0.1), "end": (0.6, 0.1)}, "farther apart"),
        ({"start": (0.0, 0.1), "end": (0.6, 0.1)}, "δ of start must be greater than 0"),
        ({"start": (0.6, 0.1), "end": (-0.1, 0.1)}, "δ of end must be greater than 0"),
        ({"start": (0.6, -0.1), "end": (0.6, 0.1)}, "ε of start must not be negative"),
        ({"start": (0.6, np.nan), "end": (0.6, 0.1)}, "start must be a pair"),
        ({"start": 0.6, "end": (0.6, 0.1)}, "start must be a pair"),
        ({"start": (0.6, 0.1), "end": (0.6, 0.2), "beta": 0.0}, "beta must be greater than 0"),
        ({"start": (0.6, 0.1), "end": (0.6, 0.2), "steps": 0}, "steps must be an integer"),
        ({"start": (0.6, 0.1), "end": (0.6, 0.2), "impacts": 2.5}, "impacts must be an integer"),
        ({"start": (0.6, 0.1), "end": (0.6, 0.2), "most": -1}, "most must be an integer"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(rattle.ParameterError, match=message):
        diagram(**arguments)
