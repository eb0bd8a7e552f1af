"""Proved statements about motions hold in 40 digits, and the checker proves everything that the finder proves."""

import json
from dataclasses import replace
from fractions import Fraction

import motions_high_precision as exact
import numpy as np
import pytest
from depth import either
from mpmath import mp, mpf

import rattle
from rattle.proof import check
from rattle.stiff import StiffGear


def number(value):
    """An exact number in 40 digits."""
    return mpf(value.numerator) / mpf(value.denominator)


def within(ends, value):
    low, high = (number(end) for end in ends)
    return low <= value <= high


def attractors(delta, epsilon):
    """Periodic attractors at a point as motions, and A to D."""
    gear = rattle.Gear(delta, epsilon)
    starts = [(each.tau, each.v, 1) for each in gear.orbits()]
    starts += [(each.tau, each.v, each.n_plus) for each in gear.attractors(64) if each.m > 1 or each.n_plus > 1]
    return [gear.orbit(*start) for start in starts]


@pytest.fixture(scope="module")
def motions():
    return [orbit for point in ((0.6, 0.089), (0.48, 0.105)) for orbit in attractors(*point)]


def test_motions_of_all_kinds_are_tried(motions):
    assert {True, False} == {orbit.stable for orbit in motions}
    assert max(len(orbit.walls) for orbit in motions) >= 14
    assert any(len(orbit.walls) > 2 and -1 not in orbit.walls for orbit in motions)


def test_enclosures_hold_the_motions_in_40_digits(motions):
    for orbit in motions:
        proved = rattle.certify(orbit)
        times, velocities, multipliers = exact.known_motion(orbit)
        for centre, time in zip(proved.times, times, strict=True):
            assert abs(number(centre) - time) < number(proved.time_radius)
        for centre, wall, velocity in zip(proved.speeds, orbit.walls, velocities, strict=True):
            assert abs(number(centre) + wall * velocity) < number(proved.speed_radius)
        assert within(proved.trace, mp.re(multipliers[0] + multipliers[1]))
        assert within(proved.determinant, mp.re(multipliers[0] * multipliers[1]))
        for real, imaginary in (proved.multipliers[:2], proved.multipliers[2:]):
            assert any(within(real, mp.re(x)) and within(imaginary, mp.im(x)) for x in multipliers)
        assert all(high - low < Fraction(1, 10**6) for low, high in (proved.trace, *proved.multipliers))
        assert proved.label == orbit.label
        assert proved.verdict == ("attracting" if abs(multipliers[0]) < 1 else "saddle")


def test_the_checker_proves_what_the_finder_does(motions):
    for orbit in either(motions[::2], motions):
        said = check.check(rattle.certify(orbit).json())
        verdict = "attracting" if orbit.stable else "saddle"
        assert said.startswith(f"P({', '.join(map(str, orbit.label))}), {verdict}, at delta = ")


@pytest.mark.parametrize("kappa", [1e2, 1e4, 1e6])
def test_motions_of_the_stiff_gear_are_proved_and_checked(kappa):
    gear = StiffGear(0.6, 0.1, 0.6, kappa)
    starts = [(each.tau, each.v, 1) for each in gear.orbits()]
    starts += [(each.tau, each.v, each.n_plus) for each in gear.attractors(16) if each.n_plus > 1][:1]
    for start in starts:
        orbit = gear.orbit(*start)
        proved = rattle.certify(orbit, kappa=kappa)
        assert proved.label == orbit.label
        assert proved.verdict == ("attracting" if orbit.stable else "saddle")
        assert np.allclose([float(t) for t in proved.times[::2]], orbit.times, rtol=0, atol=1e-10)
        assert sum(map(float, proved.trace)) / 2 == pytest.approx(sum(orbit.multipliers).real, rel=1e-8)
        if len(orbit.walls) < either(8, 99):
            assert f"kappa = {kappa:.0f}" in check.check(proved.json())


def test_motions_of_the_stiff_gear_tend_to_those_of_its_limit():
    """The difference is a series in κ^(−1/2), whose first term is extrapolated away; the limit has no contact."""
    gear = rattle.Gear(0.6, 0.0615)
    limit = gear.orbit(gear.orbits()[0].tau, gear.orbits()[0].v)
    orbits = [rattle.stiff.continue_from_limit(limit, kappa) for kappa in (1e6, 1e8)]
    exactly, soft, hard = (float(rattle.certify(orbit).trace[0]) for orbit in (limit, *orbits))
    assert abs(soft - exactly) > 1e-3
    assert abs((10 * hard - soft) / 9 - exactly) < 0.01 * abs(soft - exactly)


def test_decimals_are_read_exactly_and_doubles_too():
    gear = rattle.Gear(0.6, 0.089)
    orbit = gear.orbit(gear.orbits()[0].tau, gear.orbits()[0].v)
    given = rattle.certify(orbit, delta="0.6", epsilon=Fraction(89, 1000), beta="3/5")
    assert given.parameters == {"delta": Fraction(3, 5), "epsilon": Fraction(89, 1000), "beta": Fraction(3, 5)}
    assert given.document()["parameters"] == {"delta": "0.6", "epsilon": "0.089", "beta": "0.6"}
    double = rattle.certify(orbit)
    assert double.parameters["delta"] == Fraction(0.6)
    assert Fraction(double.document()["parameters"]["delta"]) == Fraction(0.6) != Fraction(3, 5)
    third = rattle.Gear(1 / 3, 0.05)
    orbit = third.orbit(third.orbits()[0].tau, third.orbits()[0].v)
    text = rattle.certify(orbit, delta="1/3").json()
    assert json.loads(text)["parameters"]["delta"] == "1/3"
    assert "1/3" in check.check(text)


def test_what_cannot_be_meant_is_refused_in_a_sentence():
    gear = rattle.Gear(0.6, 0.0615)
    orbit = gear.orbit(gear.orbits()[0].tau, gear.orbits()[0].v)
    for wrong in ("0.6.1", "nan", "1e9999", "", "1/0", True, float("inf")):
        with pytest.raises(rattle.ParameterError, match="delta must"):
            rattle.certify(orbit, delta=wrong)
    with pytest.raises(rattle.ParameterError, match="must equal that of the motion"):
        rattle.certify(orbit, delta="0.600001")
    with pytest.raises(rattle.ParameterError, match="no kappa"):
        rattle.certify(orbit, kappa="1e4")
    with pytest.raises(rattle.NotProvedError, match="stated speeds of the motion differ"):
        rattle.certify(replace(orbit, speeds=orbit.speeds + 1e-6))
    with pytest.raises(rattle.ParameterError, match="periodic motion"):
        rattle.certify(gear)
    stiff = StiffGear(0.6, 0.1)
    soft = replace(stiff.orbit(stiff.orbits()[0].tau, stiff.orbits()[0].v), kappa=0.04)
    with pytest.raises(rattle.NotProvedError, match="overdamped"):
        rattle.certify(soft)
