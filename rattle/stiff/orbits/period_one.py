"""The counterparts of A, B, C and D in the stiff gear, at one point or over arrays of points, and their regions."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.continuation.arclength import plane_scale
from rattle.errors import RattleError, broadcast_parameters, require_number
from rattle.flight.impact_law import ELASTIC
from rattle.orbits.orbits_a_to_d import NAMES, PeriodOne, classify_regions, multipliers_from_trace
from rattle.stiff.orbits.closure import (
    ContactCycle,
    departure_after_first_contact,
    is_admissible,
    softness,
    tangent_map_trace,
)
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.families import (
    NO_LETTER,
    PLUS,
    FamilyMember,
    families_without_letter,
    family_of_a_and_c,
    find_family_members,
    highest_followed_epsilon,
)
from rattle.stiff.orbits.periodic import StiffOrbit, orbit_of

LARGEST_SPAN = 64.0  # ε up to which SN1 is sought, in units of `plane_scale`


class NamedStiffOrbit(NamedTuple):
    """A period-one motion of the stiff gear.

    name: the letter A to D of its counterpart in the impacting model, or "P" if it has none.
    """

    name: str
    orbit: StiffOrbit


def orbits_at(delta: float, epsilon: float, beta: float, kappa: float) -> tuple[NamedStiffOrbit, ...]:
    """Return all admissible counterparts of A to D at a point, and all other P(1,1,0), named "P", sorted by name."""
    cycle, span = ContactCycle(PLUS, 1, delta, beta, kappa), highest_followed_epsilon(delta, epsilon)
    others = (member for family in families_without_letter(cycle, span) for member in family.motions_at(epsilon))
    found = [
        NamedStiffOrbit(member.name, _orbit_of_member(member))
        for member in (*find_family_members(delta, epsilon, beta, kappa), *others)
    ]
    return tuple(sorted(found, key=lambda named: (named.name, named.orbit.tau)))


def _orbit_of_member(member: FamilyMember) -> StiffOrbit:
    """Return a motion of a family as a `StiffOrbit`."""
    itinerary = StiffItinerary(tuple(member.cycle.walls.tolist()), 1, member.cycle.beta, softness(member.cycle.kappa))
    return orbit_of(itinerary, np.insert(member.y, member.y.size - 1, member.cycle.delta))


def period_one(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, kappa: ArrayLike) -> PeriodOne:
    """Return the admissible counterparts of A to D for every element of the broadcast, dimensionless parameters.

    The fields are those of `rattle.period_one`; tau and v belong to the departure from Σ⁺. The result at a point
    depends on the parameters of this point only. If several motions have the same letter, a P(1,1,0) is preferred, then
    the motion with the longest time from Σ⁺ to Σ⁻. Motions whose family `rattle.stiff.orbits.families` does not find
    are missing (docs/stiff.md says which).

    Returns
    -------
    PeriodOne
        Existence, states and multipliers, (4, …).

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If a family of motions cannot be followed.
    """
    arrays = broadcast_parameters(delta, epsilon, beta, kappa=kappa)
    shape = arrays[0].shape
    cells = np.array([array.ravel() for array in arrays]).T
    exists = np.zeros((len(NAMES), len(cells)), np.bool_)
    tau, v, trace = (np.full(exists.shape, np.nan) for _ in range(3))
    # cells with equal δ, β and κ are adjacent in this order, so that `families` finds their families in its cache
    for i in np.lexsort(cells.T):
        for member in find_family_members(*cells[i].tolist()):
            if member.name == NO_LETTER:
                continue
            letter = NAMES.index(member.name)
            if not exists[letter, i]:
                exists[letter, i] = True
                tau[letter, i], v[letter, i] = departure_after_first_contact(member.y, member.cycle)
                trace[letter, i] = tangent_map_trace(member.y, member.cycle)
    decay = ELASTIC.determinant(cells[:, 0], 1, 1)
    with np.errstate(invalid="ignore"):
        multipliers = np.moveaxis(multipliers_from_trace(trace, decay), 0, 1)
        stable = exists & (np.abs(trace) < 1 + decay)
    multipliers[~exists[:, None].repeat(2, axis=1)] = complex(np.nan, np.nan)
    return PeriodOne(*(x.reshape(*x.shape[:-1], *shape) for x in (exists, stable, tau, v, multipliers)))


def regions(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, kappa: ArrayLike) -> NDArray[np.int8]:
    """Return the region of every element of the broadcast parameters: the set of A to D whose counterparts exist.

    Regions I to V are 1 to 5; other sets of motions have their numbers in `rattle.REGIONS`.

    Returns
    -------
    NDArray[np.int8]
        The numbers of the regions, of the broadcast shape.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If a family of motions cannot be followed.
    """
    return classify_regions(period_one(delta, epsilon, beta, kappa))


def saddle_node_1(delta: float, kappa: float, beta: float = 0.6) -> StiffOrbit:
    """Return the motion of the stiff gear at SN1, where A and C are born.

    Returns
    -------
    StiffOrbit
        The motion; its `epsilon` is the ε of SN1 at this δ, κ and β.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If SN1 does not exist at these parameters.
    """
    delta, beta = require_number("delta", delta, positive=True), require_number("beta", beta, positive=True)
    cycle = ContactCycle(PLUS, 1, delta, beta, require_number("kappa", kappa, positive=True))
    for family in family_of_a_and_c(cycle, LARGEST_SPAN * plane_scale(delta)):
        for fold, letters in zip(family.folds, pairwise(family.letters), strict=True):
            y = family.points[fold]
            if set(letters) == set("AC") and is_admissible(y, cycle):
                return _orbit_of_member(FamilyMember("SN1", cycle, y))
    raise RattleError(
        f"no saddle-node SN1, the birth of A and C, was found at delta = {delta:g}, beta = {beta:g}, kappa = {kappa:g}"
    )
