"""The birth of the large chaotic attractor at δ = 0.6: P(2,2,1) doubles its period, and the doubled orbit grazes Σ⁻."""

from functools import cache
from typing import NamedTuple

from rattle.continuation.conditions import EventKind
from rattle.errors import RattleError
from rattle.impacting.bifurcations.branches import branch
from rattle.impacting.bifurcations.cascade import cascade
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.periodic import periodic_orbit

DELTA = 0.6
#: ε of Figure 4(h), at which P(2,2,1) attracts, and an ε at which the attractor is chaotic.
PERIODIC_EPSILON, CHAOTIC_EPSILON = 0.0945, 0.0985


class BirthOfChaos(NamedTuple):
    """The birth of the chaotic attractor as ε grows.

    flip: the ε at which P(2,2,1) doubles its period.
    graze: the ε at which the doubled orbit grazes Σ⁻.
    n_plus, n_minus: the numbers of impacts of the doubled orbit on Σ⁺ and on Σ⁻, without the graze.
    persists: whether P(2,2,1) itself exists at all ε from PERIODIC_EPSILON to CHAOTIC_EPSILON.
    """

    flip: float
    graze: float
    n_plus: int
    n_minus: int
    persists: bool


@cache
def find_birth_of_chaos() -> BirthOfChaos:
    """Follow the P(2,2,1) that attracts at ε = 0.0945 to its flip, and the doubled orbit to its graze on Σ⁻.

    Returns
    -------
    BirthOfChaos
        Both ε, and the impacts of the doubled orbit.

    Raises
    ------
    RattleError
        If P(2,2,1) does not attract there, or its events are not a flip and then a graze on Σ⁻.
    """
    for seen in Gear(DELTA, PERIODIC_EPSILON).attractors(count=256):
        if (seen.m, seen.n_plus, seen.n_minus) == (2, 2, 1):
            break
    else:
        raise RattleError(
            f"P(2,2,1) does not attract at delta = {DELTA}, epsilon = {PERIODIC_EPSILON}: report this as a bug"
        )
    orbit = periodic_orbit(DELTA, PERIODIC_EPSILON, seen.tau, seen.v, seen.n_plus)
    events = cascade(orbit, "epsilon", (PERIODIC_EPSILON, CHAOTIC_EPSILON))
    kinds = [event.kind for event in events]
    if kinds != [EventKind.FLIP, EventKind.GRAZING] or events[1].wall != -1:
        raise RattleError(
            f"P(2,2,1) must have a flip and then a graze on Σ⁻, but has {', '.join(kinds) or 'no event'}: report this "
            "as a bug"
        )
    flip, graze = events
    persists = bool(branch(orbit, "epsilon", (PERIODIC_EPSILON, CHAOTIC_EPSILON)).admissible.all())
    walls = graze.itinerary.walls  # includes the impact of speed 0, so 1 is subtracted on Σ⁻
    return BirthOfChaos(flip.epsilon, graze.epsilon, walls.count(1), walls.count(-1) - 1, persists)
