"""The first departure from Σ⁺ of a motion of the stiff gear, from any state."""

import math

from rattle.errors import RattleError
from rattle.flight.first_impact import OK, SIGMA_MINUS, SIGMA_PLUS
from rattle.flight.law import fold_phase
from rattle.stiff.map.flow import GAP, MOST_PIECES, QUIET, follow_piece, is_contact_over

#: Message for a motion that cannot be followed, with all causes.
CANNOT_FOLLOW = (
    f"the motion cannot be followed: it makes more than {MOST_PIECES:,} flights and contacts, one of them has no end "
    "that is found, or its parameters or its state are beyond double precision"
)


def find_departure(
    delta: float, epsilon: float, beta: float, kappa: float, tau: float, position: float, velocity: float
) -> tuple[float, float]:
    """Return the first departure (τ, v) from Σ⁺ of a motion from any state: see `rattle.stiff.StiffGear.departure`."""
    wall, x, w = GAP, position, velocity
    if abs(position) >= beta:
        wall, x = (SIGMA_PLUS if position > 0.0 else SIGMA_MINUS), abs(position) - beta
    for _ in range(MOST_PIECES):
        if wall == SIGMA_PLUS and is_contact_over(wall, tau, x, w, delta, epsilon):
            return float(tau), float(-w)
        status, time, wall, x, w, *_ = follow_piece(wall, tau, x, w, delta, epsilon, beta, kappa, math.inf)
        if status == QUIET:
            return float(tau), 0.0
        if status != OK:
            break
        tau = fold_phase(tau + time)
    raise RattleError(CANNOT_FOLLOW)
