"""The boundary crisis by the manifold condition, against the model's number, simulation and transient lifetimes."""

from functools import cache

import numpy as np
import pytest
from depth import deep, either
from transients import crisis_of, escapes

from rattle.crisis import boundary_crisis, crisis_curve
from rattle.errors import ParameterError, RattleError
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.crisis.curve import crisis_at_damping, find_crisis_above_sn1
from rattle.impacting.map.iterate import iterate
from rattle.impacting.orbits.period_one import orbits_at
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.saddles import local_manifold

CRISIS = 0.0974223469577094  # at δ = 0.762, to the last digit by a bisection of its own, below


@cache
def corner():
    """The crisis at 0.762."""
    return boundary_crisis(0.762)


def corner_leaves(delta, epsilon):
    """Return whether the image of the first crossing of Γ by W^u(A) leaves A away from the attractor."""
    saddle = period_one_orbit("A", delta, epsilon)
    local = local_manifold(saddle, stable=False)
    s = local.size * local.multiplier ** np.linspace(-1.0, 0.0, 201)
    j = next(j for j in range(1, 60) if local.map(local.at(s), j)[3].any())
    touches = local.map(local.at(s), j)[3] > 0
    i = int(np.flatnonzero(np.diff(touches.astype(int)))[0])
    low, high, first = s[i], s[i + 1], touches[i]
    while low < (middle := 0.5 * (low + high)) < high:
        same = (local.map(local.at(np.array([middle])), j)[3][0] > 0) == first
        low, high = (middle, high) if same else (low, middle)
    states = local.map(local.at(np.array([high if first else low])), j)[1]
    for n in range(400):
        states = local.map(states, 1)[1]
        if states[1, 0] < 0.8 * saddle.v:
            return True
        if n > 3 and states[0, 0] > saddle.tau + 0.02 and states[1, 0] > saddle.v:
            return False
    raise AssertionError("undecided")


@deep
def test_the_corner_at_0762():
    found = corner()
    assert found.epsilon == pytest.approx(0.0974223487, abs=1e-8)
    assert found.epsilon == pytest.approx(CRISIS, abs=1e-13)
    assert found.contact == "corner"
    assert found.piece == (1, 1)
    assert not corner_leaves(0.762, found.epsilon - 1e-13)
    assert corner_leaves(0.762, found.epsilon + 1e-13)


def test_the_tangency_at_06():
    """The end that simulation brackets from above, by another piece; W^u(A) stays below and leaves above."""
    found = boundary_crisis(0.6)
    assert found.epsilon == pytest.approx(0.1108867568417, abs=1e-11)
    assert found.contact == "tangency"
    assert found.piece == (1, 1)
    for shift, leaves in ((-1e-9, False), (1e-9, True)):
        epsilon = found.epsilon + shift
        saddle = period_one_orbit("A", 0.6, epsilon)
        s = found.parameter * (1.0 + np.linspace(-1e-4, 1e-4, 4001))
        tau, v = local_manifold(saddle, stable=False).image(s, 0)[1]
        gone = escapes(tau % 1.0, v, 0.8 * saddle.v, 60, 0.6, epsilon, 0.6) <= 60
        assert gone.any() == leaves


def test_lifetimes_point_to_the_same_crisis():
    epsilon = CRISIS + np.geomspace(4e-6, 6e-5, 5)
    found, error, exponent, exponent_error, chi = crisis_of(0.762, epsilon, 200, 20_000, seed=1)
    assert abs(found - CRISIS) < 2.5 * error
    assert error < 2e-6
    assert exponent == pytest.approx(1.2, abs=4 * exponent_error)
    assert chi < 5


@deep
def test_lifetimes_at_a_tangency():
    """Grebogi, Ott, Yorke (1987): γ = ln λ_s / (2 ln λ_u λ_s). Lifetimes waver about that law, so ε are many."""
    crisis = 0.1108867568417
    epsilon = crisis + np.geomspace(4e-6, 6e-5, 12)
    found, error, exponent, exponent_error, chi = crisis_of(0.6, epsilon, 200, 20_000, 1)
    assert abs(found - crisis) < 3 * error
    assert error < 3e-6
    large, small = np.abs(period_one_orbit("A", 0.6, crisis).multipliers)
    assert exponent == pytest.approx(np.log(small) / (2 * np.log(large * small)), abs=3 * exponent_error)
    assert exponent_error < 0.3
    assert chi < 5


@deep
def test_the_curve_is_followed_through_the_change_of_contact():
    """A fresh search, which knows no neighbour, agrees; the contact changes where the root's coefficient vanishes."""
    curve = crisis_curve(low=(low := either(0.756, 0.75)), high=0.762, resolution=0.006)
    assert (np.diff(curve.delta) > 0).all()
    assert curve.delta[0] == low
    assert curve.points[-1].delta == 0.762
    assert curve.epsilon[-1] == pytest.approx(CRISIS, abs=1e-13)
    (change,) = curve.changes
    assert change.delta == pytest.approx(0.7585932, abs=1e-6)
    assert [point.contact for point in curve.points] == [
        "tangency" if point.delta < change.delta else "corner" for point in curve.points
    ]
    for shift, contact in ((-3e-4, "tangency"), (3e-4, "corner")):
        assert crisis_at_damping([change], change.delta + shift).contact == contact
    fresh = boundary_crisis(low)
    assert fresh.epsilon == pytest.approx(curve.epsilon[0], abs=1e-10)


@deep
def test_without_an_end_it_is_followed_to_so_far_from_cod22(monkeypatch):
    monkeypatch.setattr("rattle.impacting.crisis.curve.CLOSEST", 1e-2)
    found = crisis_curve(low=0.762, resolution=0.006)
    assert found.points[0].epsilon == pytest.approx(CRISIS, abs=1e-13)
    assert found.points[-1].epsilon_above_sn1 == pytest.approx(0.999e-2 * CRISIS, rel=1e-9)
    assert "into COD22" in found.high_end


def test_chaos_ends_at_another_backlash():
    """Half-backlash 0.45, for which nothing was tuned: no orbit leaves below the crisis, and all do above."""
    found = boundary_crisis(0.518, beta=0.45)
    gap = found.epsilon_above_sn1
    at = found.epsilon + np.array([-0.01, 0.05]) * gap
    left = []
    for epsilon in at:
        (a,) = [orbit for orbit in orbits_at(0.518, float(epsilon), 0.45) if orbit.name == "A"]
        rng = np.random.default_rng(1)
        tau, v = a.tau + rng.uniform(0.0, 0.01, 100), a.v + rng.uniform(0.01, 0.03, 100)
        near = iterate(0.518, epsilon, tau, v, 300, 0.45)
        inside = near.v > 0.8 * a.v
        end = iterate(0.518, epsilon, near.tau[inside], near.v[inside], 30_000, 0.45)
        left.append(np.mean(end.v < 0.2 * a.v))
    assert left[0] == 0.0
    assert left[1] == 1.0


@deep
def test_it_passes_beside_cod22():
    """At COD22's damping the crisis is 4e-5 above SN1; it does not close on SN1 there, but goes on to larger δ."""
    end = next(point for point in codimension_two() if point.name == "COD22").delta
    points = [corner()]
    while points[-1].epsilon_above_sn1 > 3.5e-5:
        points.append(find_crisis_above_sn1(points, 0.75 * points[-1].epsilon_above_sn1, end))
    delta, gap = (np.array(x) for x in zip(*((point.delta, point.epsilon_above_sn1) for point in points), strict=True))
    assert (np.diff(delta) > 0).all()
    assert delta[-1] > end + 2e-5
    assert np.interp(end, delta, gap) == pytest.approx(4.2e-5, abs=5e-6)


def test_what_is_refused():
    with pytest.raises(RattleError, match="not chaotic"):
        boundary_crisis(0.64)  # P(3,3,1) attracts there, and outlives the contact
    with pytest.raises(RattleError, match="quiet limit"):
        boundary_crisis(1.99, beta=1.5)
    with pytest.raises(ParameterError):
        boundary_crisis(-1.0)
    with pytest.raises(ParameterError):
        crisis_curve(low=0.7, high=0.6)
