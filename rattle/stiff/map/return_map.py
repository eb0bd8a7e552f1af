"""The return map of the stiff gear on Σ⁺, with its tangent map (compiled).

A state (τ, v) is a departure: the motion leaves contact with Σ⁺ at phase τ with velocity −v, as in the impacting model.
In (t, v²/2) the tangent map of a return that takes the time s has determinant e^(−δs).
"""

from typing import NamedTuple

from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.forcing import mean_contact_force
from rattle.flight.impact_law import log_determinant
from rattle.intensity.visit import follow_to_next_departure, mean_contact_force_at_point
from rattle.numerics.compile import implement_for_type, kernel
from rattle.orbits import return_map
from rattle.stiff.map.flow import follow_flight_and_contact, next_departure, pressing_force, previous_departure


class StiffPoint(NamedTuple):
    """A parameter point of the stiff gear."""

    delta: float
    epsilon: float
    beta: float
    kappa: float


@kernel
def acceleration(tau, w, point):
    """Return Φ'' at a departure from Σ⁺ with velocity w, where the depth is 0 and the wall exerts no force."""
    return pressing_force(SIGMA_PLUS, tau, point.delta, point.epsilon) - point.delta * w


@kernel
def step(tau, v, point):
    """Return (status, τ', v', time, number of contacts with Σ⁻) of the next departure (τ', v') = Π(τ, v) from Σ⁺."""
    status, tau1, v1, time, n_minus, _a, _b, _c, _d = next_departure(
        tau, v, point.delta, point.epsilon, point.beta, point.kappa
    )
    return status, tau1, v1, time, n_minus


@kernel
def step_with_tangent(tau, v, point):
    """Return the next departure (τ', v') = Π(τ, v) from Σ⁺, with the tangent map of Π.

    A change (dτ, dv) of the departure is the change (v dτ, −dv − Φ'' dτ) of (Φ, Φ') at time τ, and likewise at the next
    departure.

    Returns
    -------
    tuple
        (status, τ', v', time, number of contacts with Σ⁻, j00, j01, j10, j11, ln det in (t, v²/2)).
    """
    status, tau1, v1, time, n_minus, j00, j01, j10, j11 = next_departure(
        tau, v, point.delta, point.epsilon, point.beta, point.kappa
    )
    if status != OK:
        return status, tau1, v1, time, n_minus, j00, j01, j10, j11, 0.0
    before, after = acceleration(tau, -v, point), acceleration(tau1, -v1, point)
    p_t, w_t = j00 * v - j01 * before, j10 * v - j11 * before
    p_v, w_v = -j01, -j11
    t_t, t_v = p_t / v1, p_v / v1
    return (
        OK,
        tau1,
        v1,
        time,
        n_minus,
        t_t,
        t_v,
        -(w_t + after * t_t),
        -(w_v + after * t_v),
        log_determinant(point.delta, time, 0),
    )


@implement_for_type(return_map.step, StiffPoint)
def _step(tau, v, point):
    return step(tau, v, point)


@implement_for_type(return_map.step_with_tangent, StiffPoint)
def _step_tangent(tau, v, point):
    return step_with_tangent(tau, v, point)


@implement_for_type(return_map.inverse_step, StiffPoint)
def _inverse_step(tau, v, point):
    return previous_departure(tau, v, point.delta, point.epsilon, point.beta, point.kappa)


@implement_for_type(mean_contact_force_at_point, StiffPoint)
def _mean_force_at(point):
    return mean_contact_force(point.delta)


@implement_for_type(follow_to_next_departure, StiffPoint)
def _bounce(wall, tau, w, point):
    return follow_flight_and_contact(wall, tau, w, point.delta, point.epsilon, point.beta, point.kappa)
