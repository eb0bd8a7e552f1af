"""Sampled motions of the stiff gear against an integrator of the equation of motion, and against its flow."""

import numpy as np
import pytest
from depth import deep
from scipy.integrate import solve_ivp

from rattle import ParameterError, RattleError
from rattle.stiff import StiffGear

POINTS = [(0.603, 0.149, 0.6, 301.0), (0.574, 0.16, 0.6, 1958.0), (0.301, 0.292, 0.3, 786.0), (0.9, 0.02, 1.2, 40.0)]


def integrated(gear: StiffGear, tau: float, v: float, time: np.ndarray) -> np.ndarray:
    def field(t: float, y: np.ndarray) -> list[float]:
        depth = y[0] - np.clip(y[0], -gear.beta, gear.beta)
        force = 4 * np.pi * gear.delta - 4 * np.pi**2 * gear.epsilon * np.cos(2 * np.pi * t)
        force -= 2 * np.pi * gear.delta * gear.epsilon * np.sin(2 * np.pi * t)
        return [y[1], force - gear.delta * y[1] - 2 * gear.kappa * depth]

    found = solve_ivp(
        field, (tau, tau + time[-1]), [gear.beta, -v], "DOP853", tau + time, rtol=1e-12, atol=1e-13, max_step=1e-3
    )
    return found.y


@pytest.mark.parametrize("point", [*POINTS[:2], *(pytest.param(point, marks=deep) for point in POINTS[2:])])
def test_against_an_integrator(point: tuple[float, float, float, float]) -> None:
    gear = StiffGear(*point)
    found = gear.trajectory(0.3, 2.5, 2.0, 300)
    phi, velocity = integrated(gear, 0.3, 2.5, found.time)
    np.testing.assert_allclose(found.phi, phi, atol=3e-9)
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-7)
    end = gear.flight(gear.beta, -2.5, 0.3, 2.0)
    assert [(found.impact_wall == wall).sum() for wall in (1, -1)] == [end.n_plus, end.n_minus]
    assert (found.phi[-1], found.velocity[-1]) == pytest.approx((end.position, end.velocity), abs=1e-12)
    at = [gear.flight(gear.beta, -2.5, 0.3, float(time)) for time in found.impact_time]
    np.testing.assert_allclose([each.position for each in at], gear.beta * found.impact_wall, atol=1e-12)
    np.testing.assert_allclose([abs(each.velocity) for each in at], found.impact_speed, atol=1e-10)


def test_rest_is_when_the_last_contact_begins() -> None:
    gear = StiffGear(0.6, 0.1, 0.6, 1e4)
    found = gear.trajectory(0.7, 0.05, 8.0, 4001)
    assert found.rest == found.impact_time[-1]
    assert found.phi[found.time > found.rest].min() > gear.beta > found.phi[found.time < found.rest].min()
    assert StiffGear(0.6, 0.25, 0.6, 1e4).trajectory(0.7, 0.05, 8.0, 10).rest == np.inf  # above the quiet limit


def test_more_contacts_than_there_is_room_for_at_first() -> None:
    gear = StiffGear(0.6, 0.075)
    orbit = next(each for each in gear.attractors(64) if each.kind == "periodic")
    found = gear.trajectory(orbit.tau, orbit.v, 1500.5 * orbit.m, 50)
    assert (found.impact_wall == 1).sum() == 1500 * orbit.n_plus > 1024
    assert np.all(np.diff(found.impact_time) > 0)


def test_what_cannot_be_followed_is_refused() -> None:
    gear = StiffGear(0.6, 0.1)
    with pytest.raises(ParameterError, match="periods must be at most"):
        gear.trajectory(0.1, 1.0, 1e6)
    with pytest.raises(ParameterError, match="v must be"):
        gear.trajectory(0.1, 0.0)
    with pytest.raises(RattleError, match="beyond double precision"):
        StiffGear(0.6, 0.1, 0.6, 1e300).trajectory(0.1, 1e200)
