"""How the large chaotic attractor appears at δ = 0.6: P(2,2,1) doubles, and the P(4,4,2) that is born grazes Σ⁻."""

from functools import cache
from typing import NamedTuple

from rattle.continuation.conditions import Kind
from rattle.errors import RattleError
from rattle.impacting.bifurcations.branches import branch
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.periodic import periodic_orbit

DELTA = 0.6
FROM, TO = 0.0945, 0.0985  # ε of Figure 4(h), and where chaos is found


class Birth(NamedTuple):
    """ε at which P(2,2,1) doubles, and at which the doubled orbit, with as many impacts on each wall, grazes Σ⁻.

    persists: whether P(2,2,1) itself exists at all ε that were followed.
    """

    flip: float
    graze: float
    n_plus: int
    n_minus: int
    persists: bool


@cache
def birth_of_chaos() -> Birth:
    """Return the fate of the P(2,2,1) that attracts at ε = 0.0945 as ε grows."""
    for seen in Gear(DELTA, FROM).attractors(count=256):
        if (seen.m, seen.n_plus, seen.n_minus) == (2, 2, 1):
            break
    else:
        raise RattleError(f"P(2,2,1) does not attract at delta = {DELTA}, epsilon = {FROM}")
    orbit = periodic_orbit(DELTA, FROM, seen.tau, seen.v, seen.n_plus)
    events = cascade(orbit, "epsilon", (FROM, TO))
    kinds = [event.kind for event in events]
    if kinds != [Kind.FLIP, Kind.GRAZING] or events[1].wall != -1:
        raise RattleError(f"P(2,2,1) was expected to double and then to graze, not {kinds}")
    flip, graze = events
    persists = bool(branch(orbit, "epsilon", (FROM, TO)).admissible.all())
    walls = graze.itinerary.walls  # with the graze counted as an impact
    return Birth(flip.epsilon, graze.epsilon, walls.count(1), walls.count(-1) - 1, persists)
