"""Bifurcation curves of the stiff gear: against its return map, scipy's integrator, the regions, and its limit."""

from functools import cache

import numpy as np
import pytest
from depth import deep
from stiff_high_precision import integrated

import rattle
from rattle.errors import ParameterError
from rattle.stiff import NAMES, StiffGear, period_one, quiet_limit, trace
from rattle.stiff.map.return_map import StiffPoint, step_with_tangent

BETA, KAPPA = 0.6, 1e4
FOLDS = ("SN1", "SN2", "G1", "G2")
#: Exists below and above in ε, and stable D: A, B, C, D.
CHANGES = {
    **{"SN1": ("", "AC"), "SN2": ("AC", "ABCD"), "G1": ("ABCD", "AD"), "G2": ("", "AD")},
    **dict.fromkeys(("PD1", "PDC"), ("ABCD", "ABCD")),
}
#: What a flip changes in the stability of which motion, with growing ε.
FLIPS = {"PD1": ("D", [True, False]), "PD2": ("D", [False, True]), "PDC": ("C", [True, False])}


@cache
def curve(name, beta=BETA, kappa=KAPPA, delta=(0.4, 1.0), epsilon=(0.005, 0.3)):
    return trace(name, beta, kappa, delta, epsilon)


@pytest.mark.parametrize("name", [*FOLDS, *FLIPS])
def test_on_a_curve_the_return_map_bifurcates(name: str) -> None:
    found = curve(name)
    rng = np.random.default_rng(0)
    for i in rng.choice(np.arange(1, len(found) - 1), 12, replace=False):
        point = StiffPoint(found.delta[i], found.epsilon[i], BETA, KAPPA)
        status, tau, v, time, _below, j00, _b, _c, j11, _ln = step_with_tangent(found.tau[i], found.v[i], point)
        assert status == 0
        np.testing.assert_allclose([tau, v, time], [found.tau[i], found.v[i], 1.0], atol=1e-11)
        sign = -1 if name in FLIPS else 1
        _s, _t, _v, _time, _below, k00, _b, _c, k11, _ln = step_with_tangent(found.tau[i], found.v[i] + 1e-13, point)
        rounding = abs(k00 + k11 - j00 - j11)  # at a slight contact the tangent varies fast
        assert rounding < 1e-3
        assert j00 + j11 == pytest.approx(sign * (1 + np.exp(-found.delta[i])), abs=1e-8 + rounding)
        assert min(abs(found.multipliers[:, i] - sign)) < 1e-7


@pytest.mark.parametrize(("name", "multiplier"), [("SN2", 1.0), ("PD1", -1.0), pytest.param("PDC", -1.0, marks=deep)])
def test_on_a_curve_the_monodromy_of_solve_ivp_has_the_multiplier(name: str, multiplier: float) -> None:
    found = curve(name, kappa=500.0, delta=(0.55, 0.65))
    i, kappa, h = len(found) // 2, 500.0, 1e-5
    delta, epsilon, tau, v = found.delta[i], found.epsilon[i], found.tau[i], found.v[i]
    start = StiffGear(delta, epsilon, BETA, kappa).flight(BETA, -v, tau, 1e-3)  # in the gap
    place = np.array([start.position, start.velocity])

    def after(off):
        return np.array(integrated(tau + 1e-3, *(place + off), 1.0, delta, epsilon, BETA, kappa)[:2])

    np.testing.assert_allclose(after(np.zeros(2)), place, atol=1e-8)
    columns = [(after(h * each) - after(-h * each)) / (2 * h) for each in np.eye(2)]
    assert min(abs(np.linalg.eigvals(np.array(columns).T) - multiplier)) < 2e-4


@pytest.mark.parametrize("name", [*FOLDS, *FLIPS])
def test_motions_change_across_a_curve(name: str) -> None:
    found, rng = curve(name), np.random.default_rng(1)
    inside = np.flatnonzero((found.delta < 0.78) | (name == "G2"))[1:-1]  # beyond, PD1 is next to G2
    for i in rng.choice(inside, 6, replace=False):
        sides = period_one(found.delta[i], found.epsilon[i] + np.array([-1e-7, 1e-7]), BETA, KAPPA)
        names = tuple("".join(np.array(list("ABCD"))[side]) for side in sides.exists.T)
        assert names == CHANGES.get(name, (names[0], names[0]))  # PD2 crosses G1
        if name in FLIPS:
            letter, stable = FLIPS[name]
            assert letter in names[0]
            np.testing.assert_array_equal(sides.stable["ABCD".index(letter)], stable)


#: Of SN1 and PD1 the events of diagrams say the same (`test_events_converge_to_those_of_the_impacting_model`).
SOME = ("SN2", "G2", "quiet_limit")


@pytest.mark.parametrize("name", [pytest.param(name, marks=[] if name in SOME else deep) for name in NAMES])
def test_curves_converge_to_those_of_the_impacting_model(name: str) -> None:
    delta = {"G2": 0.9, "PDC": 0.45, "PD2": 0.5}.get(name, 0.6)
    limit = rattle.curves.trace(name, BETA, (delta - 0.02, delta + 0.02)).at(delta)[0]
    window = {"delta": (delta - 0.02, delta + 0.02), "epsilon": (0.01, 0.5)}
    off = [curve(name, kappa=kappa, **window).at(delta)[0] - limit for kappa in (1e6, 1e8)]
    assert abs(off[0]) < 5e-3
    rate = {"SN2": 0.0, "quiet_limit": 0.01}.get(name, 0.1)  # SN2 hardly depends on κ
    assert abs(off[1]) < 1.3 * rate * abs(off[0]) + 4e-7


@deep
def test_curves_go_on_through_the_codimension_two_points() -> None:
    """SN1 becomes G2 where A and C are born grazing, and G1 and SN2 meet in a cusp; both tend to COD22 and COD23."""
    off = []
    for kappa in (KAPPA, 1e6):
        sn1, sn2, g1, g2 = (curve(name, kappa=kappa) for name in FOLDS)
        assert (sn1.ends[1].reason, g2.ends[0].reason) == (
            "graze: contact with Σ⁻ is made, it goes on as G2",
            "graze: contact with Σ⁻ is lost, it goes on as SN1",
        )
        born = np.array([sn1.delta[-1], sn1.epsilon[-1]])
        np.testing.assert_allclose([g2.delta[0], g2.epsilon[0]], born, atol=1e-5)
        assert sn2.ends[1].reason == g1.ends[1].reason == "cusp: SN2 and G1 meet"
        cusp = np.array([sn2.delta[-1], sn2.epsilon[-1]])
        np.testing.assert_allclose([g1.delta[-1], g1.epsilon[-1]], cusp, atol=1e-6)
        points = {point.name: (point.delta, point.epsilon) for point in rattle.curves.codimension_two(BETA)}
        off.append([np.hypot(*(born - points["COD22"])), np.hypot(*(cusp - points["COD23"]))])
    np.testing.assert_allclose(np.divide(*off), 10.0, rtol=0.1)


def test_the_quiet_limit_is_that_of_the_closed_form() -> None:
    for kappa in (30.0, KAPPA):
        found = curve("quiet_limit", kappa=kappa)
        np.testing.assert_allclose(found.epsilon, quiet_limit(found.delta, kappa), rtol=1e-12)


def test_what_is_not_there_is_empty_and_what_is_wrong_is_refused() -> None:
    assert len(trace("G2", 1.2, KAPPA, (0.5, 0.6), (0.0, 0.1))) == 0
    for bad in ({"name": "COD20"}, {"beta": 0.0}, {"kappa": np.inf}, {"delta": (1.0, 0.5)}, {"epsilon": (0.1,)}):
        with pytest.raises(ParameterError):
            trace(**({"name": "SN1"} | bad))
