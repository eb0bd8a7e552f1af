"""Points of bifurcation curves and of codimension two: enclosures hold what 40 digits say; false ones are refused."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import curves_high_precision as exact
import pytest
from depth import either
from mpmath import mpf

import rattle
from rattle.paper.numbers import PROVED, epsilon_on_curve
from rattle.proof.balls import arb, ball, precision
from rattle.proof.bifurcations import prove, systems
from rattle.proof.bifurcations.check_points import check
from rattle.proof.check import Refusal
from rattle.proof.flights import ModelPoint, enclose_flight

DOCUMENT = Path(__file__).parents[3] / "docs" / "paper.md"
PLACES = {"SN1": "0.6", "SN2": "0.6", "PD1": "0.6", "G1": "0.6", "PDC": "0.5", "G2": "0.8"}


def within(ends, value):
    low, high = (mpf(end.numerator) / mpf(end.denominator) for end in ends)
    return low <= value <= high and high - low < mpf(10) ** -14


def point_of(name):
    """A point of a curve, proved."""
    return prove.certify_curve_point(name, PLACES[name], float(known(name).epsilon))


def known(name):
    """The same in 40 digits."""
    return exact.known_points(name, mpf(PLACES[name]), mpf("0.6"))[0]


@pytest.fixture(scope="module")
def points():
    return {name: point_of(name) for name in PLACES}


@pytest.fixture(scope="module")
def certificates():
    return {point.name: point for point in prove.certify_codimension_two(0.6)}


@pytest.mark.parametrize("name", PLACES)
def test_an_enclosure_holds_the_point_in_40_digits(points, name):
    assert points[name].known["delta"] == Fraction(PLACES[name])
    assert within(points[name].solved["epsilon"], known(name).epsilon)


@pytest.mark.parametrize("name", ["COD20", "COD21", "COD22", "COD23"])
def test_points_of_codimension_two_are_enclosed(certificates, name):
    delta, epsilon, phase, *_ = exact.known_codimension_two(name, 0.6)
    point = certificates[name]
    assert within(point.solved["delta"], delta)
    assert within(point.solved["epsilon"], epsilon)
    assert abs((float(point.times[0]) - float(phase) + 0.5) % 1 - 0.5) < 1e-9


@pytest.mark.parametrize("beta", either(("1/3",), ("0.1", "0.3", "0.6", "1/3", "1.2")))
def test_they_are_enclosed_at_the_very_half_backlash(beta):
    found = prove.certify_codimension_two(beta)
    assert [each.name for each in found] == ["COD20", "COD21", "COD23", "COD22"]
    assert all(each.known["beta"] == Fraction(beta) and each.width < Fraction(1, 10**14) for each in found)


def test_the_checker_proves_what_the_finder_does(points, certificates):
    for point in [*points.values(), *certificates.values()]:
        assert check(point.json()).startswith(f"{point.name} of ")


def test_every_point_of_a_curve_is_proved():
    """PD2 too, around its fold, where δ is solved for, and beside COD23, where PD1 ends."""
    solved = set()
    for name, window in (("PD2", (0.6, 0.7)), ("PD1", (0.75, 0.8))):
        curve = rattle.curves.trace(name, delta=window)
        for i in range(0, len(curve), either(4, 1)):
            motion = curve.tau[i], curve.v[i]
            point = prove.certify_curve_point(name, curve.delta[i], curve.epsilon[i], curve.beta, motion)
            solved |= set(point.solved)
            assert point.width < 1e-14
    assert solved == {"delta", "epsilon"}


def test_a_bifurcation_of_any_motion_is_proved():
    """The flip of P(2, 2, 1) on its branch, which the checker proves too; elsewhere on the branch there is none."""
    gear = rattle.Gear(0.6, 0.089)
    found = next(each for each in gear.attractors(256) if (each.m, each.n_plus) == (2, 2))
    branch = rattle.branch(gear.orbit(found.tau, found.v, 2), span=(0.085, 0.095))
    events = [event for event in branch.events if event.admissible]
    assert events
    for event in events[:2]:
        point = prove.certify_event(event)
        assert point.name == event.kind
        assert (
            within(point.solved["epsilon"], mpf(event.epsilon))
            or abs(float(sum(point.solved["epsilon"]) / 2) - event.epsilon) < 1e-12
        )
        assert check(point.json()).startswith(f"{event.kind} of ")


@pytest.mark.parametrize("name", PLACES)
def test_a_point_beside_its_curve_is_refused(points, name):
    epsilon = float(sum(points[name].solved["epsilon"]) / 2)
    for wrong in (epsilon * (1 + 1e-6), epsilon * (1 - 1e-6)):
        with pytest.raises(rattle.NotProvedError, match="has no point within rounding of"):
            prove.certify_curve_point(name, PLACES[name], wrong)


def shifted(texts, by):
    return [str(float(text) + by) for text in texts]


def altered(point, **changes):
    return json.dumps({**point.document(), **changes})


@pytest.mark.parametrize("name", PLACES)
def test_false_claims_of_a_point_are_refused_by_the_checker(points, name):
    point = points[name]
    ends, times = point.document()["solved"]["epsilon"], point.document()["times"]
    others = {"SN": "PD", "PD": "SN", "GR": "SN"}
    wrong = [
        {"solved": {"epsilon": shifted(ends, 1e-6)}},
        {"solved": {"epsilon": [ends[1], ends[1]]}},
        {"solved": {"epsilon": [ends[0], ends[0]]}},
        {"known": {**point.document()["known"], "delta": str(float(PLACES[name]) + 1e-6)}},
        {"times": shifted(times, 1e-6)},
        {"kind": others[point.motion.kind], "name": others[point.motion.kind], "impact": None},
        {"name": "G1" if name != "G1" else "G2"},
        {"name": "COD20"},
        {"walls": [1, 1] if len(times) == 2 else [-1]},
        {"m": 2},
        {"radius": "0"},
        {"model": "stiff"},
        {"theorem": "other"},
    ]
    if len(times) == 2:  # what meets Σ⁻ depends on the backlash
        wrong.append({"known": {**point.document()["known"], "beta": "0.600001"}})
    for changes in wrong:
        with pytest.raises(Refusal):
            check(altered(point, **changes))


def test_a_point_of_codimension_two_is_not_taken_for_another(certificates):
    for name, point in certificates.items():
        for other in {*certificates, "G1", "SN1"} - {name}:
            with pytest.raises(Refusal):
                check(altered(point, name=other))
        moved = {key: shifted(ends, 1e-6) for key, ends in point.document()["solved"].items()}
        with pytest.raises(Refusal):
            check(altered(point, solved=moved))


def test_a_curve_of_a_motion_that_passes_a_wall_is_refused():
    """Beyond COD22 the motion of SN1 passes Σ⁻, and the flip PDC beyond COD20: the equations hold all the same."""
    for name, delta, limit in (("SN1", 0.9, rattle.sn1), ("PDC", 0.6, rattle.flip)):
        with pytest.raises(rattle.NotProvedError, match="may touch Σ⁻"):
            prove.certify_curve_point(name, delta, float(limit(delta, virtual=True)))


def test_a_flight_that_turns_before_the_wall_does_not_touch_it(points):
    """The graze of G1 in a gap that is wider, or at a time before the flight."""
    graze = points["G1"]
    with precision():
        epsilon = ball(sum(graze.solved["epsilon"]) / 2)
        point = ModelPoint(ball(graze.known["delta"]), epsilon, ball(graze.known["beta"]))
        start, touch = (ball(t) for t in graze.times)
        turn = (2 * start).sin_cos_pi()

        def touches(gap, time):
            here = replace(point, beta=gap)
            return systems.require_only_graze(
                enclose_flight(here, start, start + 1, turn, turn, arb(0)), 1, 1, -1, time, "the flight"
            )

        touches(point.beta, touch)
        with pytest.raises(rattle.NotProvedError, match="is not proved to touch a wall only at its graze"):
            touches(point.beta + arb("1e-6"), touch)
        with pytest.raises(rattle.NotProvedError, match="and to turn at its graze"):
            touches(point.beta, start - arb("0.01"))


def test_what_cannot_be_meant_is_said():
    with pytest.raises(rattle.ParameterError, match="is a formula"):
        prove.certify_curve_point("quiet_limit", 0.6, 0.1)
    with pytest.raises(rattle.ParameterError, match="must be positive"):
        prove.certify_curve_point("SN1", -0.6, 0.1)
    with pytest.raises(rattle.ParameterError, match="Event"):
        prove.certify_event(3)


def test_what_the_paper_table_calls_proved_is(certificates):
    """Each number as docs/paper.md has it, in an enclosure."""
    rows = [line.split(" | ") for line in DOCUMENT.read_text().splitlines() if ", proved | " in line]
    assert {row[1] for row in rows} == set(PROVED)
    for row in rows:
        name, where = PROVED[row[1]]
        said = row[3].removesuffix(", proved")
        if name in certificates:
            ends = certificates[name].solved[where]
        else:
            ends = prove.certify_curve_point(name, where, epsilon_on_curve(name, float(where))).solved["epsilon"]
        assert ends[1] - ends[0] < Fraction(1, 10**14)
        assert abs(sum(ends) / 2 - Fraction(said)) < Fraction(1, 10**10)
