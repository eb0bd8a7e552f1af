"""The boundary crisis by the manifold condition, against the model's number, simulation and transient lifetimes."""

import numpy as np
import pytest
from transients import crisis_of

from rattle.crisis import boundary_crisis, crisis_curve
from rattle.curves.codimension import codimension_two
from rattle.errors import ParameterError, RattleError
from rattle.images import escapes
from rattle.limits import sn1
from rattle.saddles import local_manifold, period_one_saddle

CRISIS = 0.0974223469577094  # at δ = 0.762, to the last digit by a bisection of its own, below


def corner_leaves(delta, epsilon):
    """Whether the image of the first crossing of Γ by W^u(A) comes back to A and leaves it away from the attractor."""
    saddle = period_one_saddle("A", delta, epsilon)
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


def test_the_corner_at_0762():
    found = boundary_crisis(0.762)
    assert found.epsilon == pytest.approx(0.0974223487, abs=1e-8)
    assert found.epsilon == pytest.approx(CRISIS, abs=1e-14)
    assert found.contact == "corner"
    assert found.piece == (1, 1)
    assert not corner_leaves(0.762, found.epsilon - 1e-14)
    assert corner_leaves(0.762, found.epsilon + 1e-14)


def test_the_tangency_at_06():
    """The end that simulation brackets from above, by another piece; W^u(A) stays below and leaves above."""
    found = boundary_crisis(0.6)
    assert found.epsilon == pytest.approx(0.1108867568417, abs=1e-11)
    assert found.contact == "tangency"
    assert found.piece == (1, 1)
    assert found.approach < 1e-8
    for shift, leaves in ((-1e-9, False), (1e-9, True)):
        epsilon = found.epsilon + shift
        saddle = period_one_saddle("A", 0.6, epsilon)
        s = found.parameter * (1.0 + np.linspace(-1e-4, 1e-4, 4001))
        tau, v = local_manifold(saddle, stable=False).at(s)
        gone = escapes(tau % 1.0, v, 0.8 * saddle.v, 40, 0.6, epsilon, 0.6) <= 30
        assert gone.any() == leaves


def test_lifetimes_point_to_the_same_crisis():
    epsilon = CRISIS + np.geomspace(4e-6, 6e-5, 5)
    found, error, exponent, exponent_error, chi = crisis_of(0.762, epsilon, 200, 20_000, seed=1)
    assert abs(found - CRISIS) < 2.5 * error
    assert error < 2e-6
    assert exponent == pytest.approx(1.2, abs=4 * exponent_error)
    assert chi < 5


def test_the_curve_ends_in_cod22():
    """The crisis closes on SN1 as δ rises to COD22, in proportion to the distance or faster."""
    end = next(point for point in codimension_two() if point.name == "COD22")
    (nearer,) = crisis_curve([0.766])
    gaps = [CRISIS - float(sn1(0.762)), nearer.epsilon - float(sn1(0.766))]
    distances = [end.delta - 0.762, end.delta - 0.766]
    assert 0 < gaps[1] < gaps[0]
    assert gaps[1] / distances[1] < 1.1 * gaps[0] / distances[0]
    with pytest.raises(RattleError, match="COD22"):
        boundary_crisis(end.delta)


def test_what_is_refused():
    with pytest.raises(RattleError, match=r"beta = 0\.5"):
        boundary_crisis(0.6, beta=0.5)
    with pytest.raises(RattleError, match=r"beta = 0\.6 and delta from 0\.6"):
        boundary_crisis(0.5)
    with pytest.raises(ParameterError):
        boundary_crisis(-1.0)
    with pytest.raises(ParameterError):
        crisis_curve(0.7)
