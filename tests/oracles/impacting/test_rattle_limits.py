"""SN1 and the flip of C are stated where these motions happen, by an oracle that knows the equation of motion alone."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from depth import either

import rattle
from rattle.models import AnalyticLimits, model_of
from rattle.stiff import StiffGear

PAIRS = either(120, 2000)
PHASE = np.linspace(0.0, 1.0, 4001)[1:-1]
WIDE = np.linspace(1.0, 3.0, 25)


def solution(letter: str, delta: float, epsilon: float) -> tuple[float, float] | None:
    """ε sin 2πτ and ε cos 2πτ of A or C from the condition that a flight ends where it began; None without one."""
    sine = 2.0 - delta / math.tanh(delta / 2.0)
    if epsilon < abs(sine):
        return None
    cosine = math.sqrt((epsilon - sine) * (epsilon + sine))
    return sine, cosine if letter == "C" else -cosine


def happens(letter: str, delta: float, epsilon: float, beta: float) -> bool:
    """Return whether the flight of A or C stays between the walls, at 3999 times (paper 2.3, integrated)."""
    found = solution(letter, delta, epsilon)
    if found is None:
        return False
    (y, x), turn = found, 2.0 * math.pi * PHASE
    c = (4.0 * math.pi - 2.0 * math.pi * y + 2.0 * math.pi * delta) / delta
    moved = c * np.expm1(-delta * PHASE) + x * (np.cos(turn) - 1.0) - y * np.sin(turn) + 4.0 * math.pi * PHASE
    return bool((moved < 0.0).all() and (moved > -2.0 * beta).all())


def growth(delta: float, epsilon: float, beta: float) -> float:
    """The larger modulus of C's multipliers, by the tangent of the impact map."""
    found = solution("C", delta, epsilon)
    assert found is not None
    tau = math.atan2(*found) / (2.0 * math.pi) % 1.0
    step = rattle.Gear(delta, epsilon, beta).impact(tau, 2.0 * math.pi * delta)
    assert (step.n_minus, step.time) == (0, pytest.approx(1.0, abs=1e-9))
    return float(np.abs(np.linalg.eigvals(step.tangent)).max())


def names(delta: float, epsilon: float, beta: float) -> set[str]:
    return {orbit.name for orbit in rattle.Gear(delta, epsilon, beta).orbits()}


def assert_flip(delta: float, beta: float, limits: AnalyticLimits) -> str:
    """C loses stability at the flip, or does not at its formula and ends as is said; returns what happens."""
    formula = float(rattle.flip(delta, virtual=True))
    if limits.flip is not None:
        assert limits.flip == formula
        below, above = (limits.flip * (1.0 + off) for off in (-1e-5, 1e-5))
        assert happens("C", delta, below, beta)
        assert happens("C", delta, above, beta)
        assert growth(delta, below, beta) < 1.0 < growth(delta, above, beta)
        return "flip"
    (said,) = (each for each in limits.missing if each.limit == "flip")
    born, last = float(rattle.sn1(delta, virtual=True)), said.epsilon
    if last is None:
        assert said.reason == "none at this damping: C does not exist"
        assert not any(happens("C", delta, born * k, beta) for k in (1.0 + 1e-9, *WIDE[1:], 10.0, 100.0))
        return "no C"
    assert said.reason == "none at this damping: C ends in grazing G1"
    assert born < last < formula
    before = last - 1e-3 * (last - born)
    assert happens("C", delta, before, beta)
    assert growth(delta, before, beta) < 1.0
    assert not any(happens("C", delta, last * k, beta) for k in (1.0 + 1e-5, *WIDE[1:], 10.0))
    assert not happens("C", delta, formula, beta)
    return "G1"


def assert_born(delta: float, beta: float, limits: AnalyticLimits) -> str:
    """A and C are born at SN1, or not, and A begins as is said; returns what happens."""
    formula = float(rattle.sn1(delta, virtual=True))
    above = formula * (1.0 + 1e-9)
    if limits.sn1 is not None:
        assert limits.sn1 == formula
        assert happens("A", delta, above, beta)
        assert happens("C", delta, above, beta)
        assert names(delta, above, beta) >= {"A", "C"}
        assert not names(delta, formula * (1.0 - 1e-9), beta) & {"A", "C"}
        return "SN1"
    (said,) = (each for each in limits.missing if each.limit == "sn1")
    assert not happens("A", delta, above, beta)
    assert not happens("C", delta, above, beta)
    if said.epsilon is None:
        assert said.reason == "none at this damping: A and C do not exist"
        tried = product("AC", (*WIDE, 10.0, 100.0))
        assert not any(happens(letter, delta, formula * k, beta) for letter, k in tried)
        return "none"
    assert said.reason == "none at this damping: C does not exist, A begins in grazing G2"
    assert happens("A", delta, said.epsilon * (1.0 + 1e-5), beta)
    assert not any(happens("A", delta, e, beta) for e in np.linspace(formula, said.epsilon * (1.0 - 1e-5), 20))
    return "G2"


def test_limits_are_stated_where_they_hold() -> None:
    rng = np.random.default_rng(2009)
    delta = np.exp(rng.uniform(math.log(0.02), math.log(3.0), PAIRS))
    wide = np.exp(rng.uniform(math.log(0.001), math.log(5.0), PAIRS))
    beta = np.where(np.arange(PAIRS) % 2, wide, delta * rng.uniform(0.3, 1.6, PAIRS))  # half of them where C ends
    seen = set()
    for d, b in zip(delta.tolist(), beta.tolist(), strict=True):
        limits = model_of(b).limits(d)
        gear = rattle.Gear(d, 0.1, b)
        assert (gear.sn1, gear.flip, gear.quiet_limit) == limits[:3]
        assert {each.limit for each in limits.missing} == {
            name for name in ("sn1", "flip") if getattr(limits, name) is None
        }
        seen |= {assert_flip(d, b, limits), assert_born(d, b, limits)}
    assert seen == {"flip", "G1", "no C", "SN1", "G2", "none"}
    for function, name in ((rattle.sn1, "sn1"), (rattle.flip, "flip")):
        stated = [getattr(model_of(b).limits(d), name) for d, b in zip(delta[:40], beta[:40], strict=True)]
        np.testing.assert_array_equal(function(delta[:40], beta[:40]), np.array(stated, float))


def test_the_points_of_the_paper() -> None:
    assert rattle.Gear(0.6, 0.1).flip is None
    (instead,) = model_of(0.6).limits(0.6).missing
    assert instead == ("flip", "none at this damping: C ends in grazing G1", pytest.approx(0.144452777, abs=1e-9))
    corners = {point.name: point.delta for point in rattle.curves.codimension_two(0.6)}
    cod20, cod22 = corners["COD20"], corners["COD22"]
    np.testing.assert_array_equal(np.isnan(rattle.flip([cod20 - 1e-6, cod20 + 1e-6])), [False, True])
    np.testing.assert_array_equal(np.isnan(rattle.sn1([cod22 - 1e-6, cod22 + 1e-6])), [False, True])
    beside = [cod22, *(np.nextafter(cod22, side) for side in (0.0, 1.0))]  # rounding decides which it is
    for limits in (model_of(0.6).limits(float(delta)) for delta in beside):
        said = [each.epsilon for each in limits.missing if each.limit == "sn1"]
        assert (said or [limits.sn1]) == [pytest.approx(0.0978908127, abs=1e-9)]
    assert [each.limit for each in model_of(0.001).limits(0.05).missing] == ["sn1", "flip"]


def test_shapes_and_the_formula() -> None:
    delta, beta = np.array([0.3, 0.6]), np.array([[0.3], [0.6], [2.0]])
    assert rattle.flip(delta, beta).shape == rattle.sn1(delta, beta, virtual=True).shape == (3, 2)
    assert np.isfinite(rattle.flip(delta, beta, virtual=True)).all()
    for function in (rattle.sn1, rattle.flip):
        assert function(0.5).shape == ()
        for delta, beta in ((0.0, 0.6), (0.6, 0.0), (0.6, math.nan), ([0.4, 0.5], [1, 2, 3])):
            with pytest.raises(rattle.ParameterError):
                function(delta, beta)
        assert np.isnan(function([5e-324, 1e200, 1e308])).all()


@pytest.mark.parametrize(("delta", "kappa"), [(0.3, 1e4), (0.6, 1e4), (0.7, 1e6)])
def test_sn1_of_the_stiff_gear(delta: float, kappa: float) -> None:
    limits = model_of(0.6, kappa=kappa).limits(delta)
    assert limits.sn1 is not None
    below, above = (
        {orbit.name for orbit in StiffGear(delta, limits.sn1 * (1 + off), 0.6, kappa).orbits()} for off in (-1e-6, 1e-6)
    )
    assert above >= {"A", "C"}
    assert not below & {"A", "C"}
    assert [each.limit for each in limits.missing] == ["flip"]


def test_where_the_stiff_gear_has_no_sn1() -> None:
    sn1, flip = model_of(0.6, kappa=1e4).limits(1.0).missing
    assert sn1.reason.startswith("none: no saddle-node SN1, the birth of A and C, was found at delta = 1, beta = 0.6")
    assert "PDC" in flip.reason
