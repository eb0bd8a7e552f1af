"""Find the next departure from Σ⁺ of a motion that is given by its phase, position and velocity."""

from rattle.errors import RattleError, require
from rattle.flight.first_impact import LONGEST, OK, SIGMA_MINUS, SIGMA_PLUS, find_first_crossing, first_impact
from rattle.flight.forcing import DRIFT
from rattle.flight.impact_law import reflected_velocity
from rattle.flight.law import evaluate, flight_from_phase, fold_phase


def find_departure(
    delta: float, epsilon: float, beta: float, tau: float, position: float, velocity: float
) -> tuple[float, float]:
    """Return the first departure (τ, v) from Σ⁺ of the motion that has Φ = position and Φ' = velocity at phase tau.

    tau is in [0, 1). v is 0 if the motion rests on Σ⁺. On a wall, the velocity before and the velocity after the impact
    give the same result.

    Returns
    -------
    tuple[float, float]
        Phase τ in [0, 1) and speed v ≥ 0.
    """
    require(abs(position) <= beta, f"position must be from {-beta} to {beta}, between the walls, got {position}")
    wall = SIGMA_PLUS if position > 0.0 else SIGMA_MINUS
    w = abs(velocity) if wall == SIGMA_PLUS else -abs(velocity)  # on a wall, use the velocity before the impact
    if abs(position) < beta:
        flight = flight_from_phase(tau, velocity, delta, epsilon, DRIFT)
        status, target, time = find_first_crossing(tau, flight, -beta - position, beta - position)
        _require_departure_found(status)
        wall, tau, w = SIGMA_PLUS if target > 0 else SIGMA_MINUS, fold_phase(tau + time), evaluate(time, flight)[1]
    while wall == SIGMA_MINUS:
        status, time, wall, w, *_ = first_impact(wall, tau, reflected_velocity(w), delta, epsilon, beta, DRIFT)
        _require_departure_found(status)
        tau = fold_phase(tau + time)
    return float(tau), max(float(w), 0.0)


def _require_departure_found(status: int) -> None:
    if status != OK:
        raise RattleError(
            f"the motion cannot be followed: a flight has no impact within {LONGEST:g} forcing periods, or parameters "
            "or state are beyond double precision"
        )
