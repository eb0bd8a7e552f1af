"""Curves and codimension-two points where real gears are: small damping, backlash and eccentricity of one order."""

import curves_high_precision as exact
import numpy as np
import pytest
from depth import deep
from high_precision import Flight
from mpmath import mp, mpf

import rattle
from rattle import curves
from rattle.impacting.bifurcations.branches import continue_to

BETAS = (1e-2, 1e-3, 1e-4)
ENDS = (1e-2, pytest.param(1e-3, marks=deep), 1e-4)
#: The condition on the trace of the grazing motion, E = e^(−δ).
TRACES = {"COD20": lambda e: -1 - e, "COD21": lambda e: 2 * mp.sqrt(e), "COD22": lambda e: 1 + e}


@pytest.mark.parametrize("beta", ENDS)
@pytest.mark.parametrize(("name", "ratio"), [("PD1", 0.67), ("PD2", 0.93), ("PDC", 0.68), ("G1", 0.79), ("G2", 1.63)])
def test_a_curve_is_its_solution_in_40_digits(name, ratio, beta):
    delta = ratio * beta
    curve = curves.trace(name, beta, (0.5 * beta, 2 * beta), (0.0, 3 * beta))
    expected = [float(point.epsilon) for point in exact.points(name, delta, beta, 3 * beta)]
    assert expected
    assert curve.at(delta) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("beta", ENDS)
def test_curves_end_in_their_points_and_are_in_one_piece(beta):
    """Here COD21 to COD23 are closer together than 1e-4 of δ, at β = 1e-4 than 1e-9."""
    window = (0.5 * beta, 2 * beta), (0.0, 3 * beta)
    for name, point in (("SN1", "COD22"), ("SN2", "COD23"), ("PD1", "COD23"), ("PDC", "COD20"), ("G1", "COD22")):
        curve = curves.trace(name, beta, *window)
        assert [end.reason.split(":")[0] for end in curve.ends] == ["window", point], (name, curve.ends)
    sn1, g2 = (curves.trace(name, beta, *window) for name in ("SN1", "G2"))
    np.testing.assert_allclose(sn1.epsilon, rattle.sn1(sn1.delta, virtual=True), rtol=1e-10)
    assert [end.reason.split(":")[0] for end in g2.ends] == ["COD22", "window"]


def grazes(trace, delta, beta):
    """How far the P(1,1,0) with this trace stays from Σ⁻, over β."""
    decay = mp.exp(-delta)
    x = (1 + decay - trace(decay)) * delta**2 / (4 * mp.pi * (1 - decay))
    y = 2 - delta * mp.coth(delta / 2)
    flight = Flight(1, mp.atan2(y, x) / (2 * mp.pi), -2 * mp.pi * delta, delta, mp.hypot(x, y), beta)
    lowest = mp.findroot(flight.velocity, mpf("0.5"), tol=mpf(10) ** -60, verify=False)
    return flight.position(lowest) / flight.beta + 1


@pytest.mark.parametrize("beta", [*BETAS, 1e-5, 1e-6])
def test_codimension_two_points_graze_in_40_digits(beta):
    found = {point.name: point for point in curves.codimension_two(beta)}
    for name, trace in TRACES.items():
        delta = mpf(found[name].delta)
        exactly = mp.findroot(lambda d, t=trace: grazes(t, d, beta), delta, tol=mpf(10) ** -60, verify=False)
        assert abs(exactly / delta - 1) < 1e-12, name
    assert found["COD21"].delta < found["COD23"].delta < found["COD22"].delta or beta < 1e-5


@pytest.mark.parametrize("beta", [*BETAS, 1e-5])
def test_curves_touch_in_the_same_orders_at_every_backlash(beta):
    orders = {pair: order for point in curves.codimension_two(beta) for pair, order in point.tangency.items()}
    assert orders == {
        ("PDC", "G1"): pytest.approx(1, abs=0.01),
        **{pair: pytest.approx(2, abs=0.01) for pair in orders if pair != ("PDC", "G1")},
    }
    assert len(orders) == 6


def test_below_1e_5_curves_are_refused():
    with pytest.raises(rattle.ParameterError, match="delta must reach above 1e-05"):
        curves.trace("SN1", 1e-6, (1e-7, 9e-6))


def test_a_motion_is_not_taken_for_its_neighbour_beyond_a_fold():
    """B and D are a hundredth apart in phase above the fold in which this B is born, and D alone goes on below it."""
    delta, beta = 0.0009166666666666668, 1e-3
    b = next(orbit for orbit in rattle.Gear(delta, 6.97e-4, beta).orbits() if orbit.name == "B")
    event = continue_to(rattle.periodic_orbit(delta, 6.97e-4, b.tau, b.v, 1, beta), delta, 6.59e-4)
    assert event.kind == "SN"
    assert event.epsilon == pytest.approx(6.837226515e-4, rel=1e-9)


def test_the_diagram_of_a_branch_spans_as_much_as_there_is_to_see():
    orbit = next(each for each in rattle.Gear(0.0036, 5.8e-4, 0.0047).orbits() if each.name == "C")
    c = rattle.periodic_orbit(0.0036, 5.8e-4, orbit.tau, orbit.v, 1, 0.0047)
    found = rattle.branch(c)
    assert np.ptp(found.epsilon) == pytest.approx(2 * 0.02 * 0.0036 / 0.25)
    at = float(rattle.grazing("G1", 0.0036, 0.0047).epsilon)
    assert min(abs(event.epsilon - at) for event in rattle.branch(c, "epsilon", (1e-4, 3e-3)).events) < 1e-12
