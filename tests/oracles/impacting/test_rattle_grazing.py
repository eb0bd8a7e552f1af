"""Grazing curves and codimension-two points against published values and an independent condition in 40 digits."""

import numpy as np
import pytest
from high_precision import Flight
from mpmath import mp, mpf

import rattle
from rattle import curves


def point(name, beta=0.6):
    """One codimension-two point."""
    return next(found for found in curves.codimension_two(beta) if found.name == name)


def deepest(delta, beta, sign, epsilon):
    """Height above Σ⁻ of the minimum of the closed-form A (sign −1) or C (+1) at this ε, and its time."""
    offset = 2 - delta * mp.coth(delta / 2)
    tau = mp.atan2(offset, sign * mp.sqrt(epsilon**2 - offset**2)) / (2 * mp.pi)
    flight = Flight(1, tau, -2 * mp.pi * delta, delta, epsilon, beta)
    s = mp.findroot(flight.velocity, mpf("0.5"))
    return flight.position(s) + beta


@pytest.mark.parametrize("curve", ["G1", "G2"])
@pytest.mark.parametrize("beta", [0.25, 0.6, 0.9])
def test_grazing_by_the_depth_of_the_flight(curve, beta):
    """A minimum exactly on Σ⁻, found from the single-impact orbit alone; the library uses the two-impact family."""
    fold = point("COD22", beta).delta
    delta = np.linspace(0.75 * fold, 0.99 * fold, 5) if curve == "G1" else np.linspace(1.01 * fold, 1.25 * fold, 5)
    found = rattle.grazing(curve, delta, beta)
    assert np.isfinite(found.epsilon).all()
    sign = 1 if curve == "G1" else -1
    for d, e in zip(delta, found.epsilon, strict=True):
        exact = mp.findroot(lambda x, d=d: deepest(mpf(float(d)), mpf(beta), sign, x), mpf(float(e)))
        assert e == pytest.approx(float(exact), abs=1e-10)


def test_published_grazing_values():
    found = rattle.grazing("G1", [0.6, 0.762])
    assert found.epsilon == pytest.approx([0.144452777, 0.0960576020], abs=5e-10)
    assert found.multipliers[:, 1] == pytest.approx([0.8349018443, 0.5590262281], abs=1e-9)
    assert found.v == pytest.approx(2 * np.pi * np.array([0.6, 0.762]))


@pytest.mark.parametrize(
    ("name", "delta", "epsilon"),
    [
        ("COD20", 0.541770361380, 0.183233639592),
        ("COD21", 0.759042986991, 0.095502531889),
        ("COD22", 0.770147130934, 0.097890812717),
    ],
)
def test_codimension_two_points(name, delta, epsilon):
    found = point(name)
    assert (found.delta, found.epsilon) == pytest.approx((delta, epsilon), abs=1e-10)


@pytest.mark.parametrize("beta", [0.2, 0.6, 0.8, 1.2])
def test_what_defines_the_codimension_two_points(beta):
    d21, e21 = point("COD21", beta).delta, point("COD21", beta).epsilon
    at = rattle.grazing("G1", d21, beta)
    assert abs(at.multipliers) == pytest.approx(np.exp(-d21 / 2), abs=1e-6)  # a double root: half the digits
    assert at.epsilon == pytest.approx(e21, abs=1e-12)
    d22, e22 = point("COD22", beta).delta, point("COD22", beta).epsilon
    assert e22 == pytest.approx(float(rattle.sn1(d22, virtual=True)), abs=1e-12)  # where SN1, G1 and G2 meet
    assert rattle.grazing("G1", d22 - 1e-9, beta).tau == pytest.approx(0.75, abs=1e-6)
    assert rattle.grazing("G2", d22 + 1e-9, beta).tau == pytest.approx(0.75, abs=1e-6)
    assert np.isnan(rattle.grazing("G1", d22 + 1e-6, beta).epsilon)
    assert np.isnan(rattle.grazing("G2", d22 - 1e-6, beta).epsilon)


def test_robust_chaos_interval():
    assert rattle.robust_chaos_interval() == pytest.approx((0.759042986991, 0.770147130934), abs=1e-10)
    for beta in (0.3, 0.6, 0.8, 1.1):
        lower, upper = rattle.robust_chaos_interval(beta)
        inside = rattle.grazing("G1", np.linspace(lower, upper, 12)[1:-1], beta).multipliers
        assert (inside.imag == 0).all()
        assert ((inside[0].real > 2 / 3) & (inside[0].real < 1)).all()
    lower, _ = rattle.robust_chaos_interval(0.8)  # large backlash: from the multiplier 2/3 on, not from COD21
    assert rattle.grazing("G1", lower, 0.8).multipliers[0].real == pytest.approx(2 / 3, abs=1e-9)


def test_multipliers_on_g1_below_cod20_are_real_and_beyond_minus_one():
    """The paper reports complex multipliers for all smaller δ."""
    found = rattle.grazing("G1", [0.50, 0.54, 0.545, 0.7])
    assert (abs(found.multipliers[0, :2]) > 1).all()
    assert (found.multipliers[0, :2].imag == 0).all()
    assert (abs(found.multipliers[0, 2:]) < 1).all()


def test_unknown_names_are_refused():
    with pytest.raises(rattle.ParameterError, match="G1, G2"):
        rattle.grazing("G3", 0.6)
    with pytest.raises(rattle.ParameterError, match="PDC"):
        curves.trace("G3")
