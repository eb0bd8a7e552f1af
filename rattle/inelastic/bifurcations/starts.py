"""Starting points of curves: bifurcations of the inelastic gear at one damping, from closed forms of its motions.

This is `rattle.impacting.bifurcations.starts` with a restitution r. The load is 0, because a load only changes the unit
of length (`rattle.inelastic.orbits.equations`). Starting points are unknowns: times of impacts, δ and ε.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from rattle.continuation.conditions import EventKind
from rattle.flight.forcing import DRIFT
from rattle.impacting.bifurcations.starts import TwoImpactFamily, find_zeros_along_family
from rattle.inelastic.orbits.closed_form import epsilon_of_flip_of_c, epsilon_of_saddle_node, forcing_slope_at_departure
from rattle.inelastic.orbits.equations import InelasticItinerary
from rattle.inelastic.orbits.family import tabulate_epsilon_of_family, two_impact_family_numerators
from rattle.numerics.complex_step import Array

TWO_IMPACT_WALLS = (1, -1)  # walls of P(1,1,1), in order


def inelastic_family_members(sigma: Array, delta: float, beta: float, r: float) -> TwoImpactFamily:
    """Return the motions P(1,1,1) whose times from Σ⁺ to Σ⁻ are 1/2 + σ, for increasing σ (k,)."""
    closed = np.array([two_impact_family_numerators(each, delta, beta, r) for each in sigma]).reshape(-1, 5)
    x, y = closed[:, 0] / closed[:, 4], closed[:, 1] / closed[:, 4]
    tau = np.arctan2(y, x) / (2 * np.pi)
    unknowns = np.column_stack([tau, tau + 0.5 + sigma, np.full_like(sigma, delta), np.hypot(x, y)])
    itinerary = InelasticItinerary(TWO_IMPACT_WALLS, 1, beta, r)
    at_one, at_minus_one = (np.linalg.det(itinerary.jacobian(unknowns, multiplier)) for multiplier in (1.0, -1.0))
    return TwoImpactFamily(sigma, unknowns, closed[:, 3] / closed[:, 4], at_one, at_minus_one)


@lru_cache(maxsize=256)
def inelastic_two_impact_family(delta: float, beta: float, r: float) -> TwoImpactFamily:
    """Return motions P(1,1,1) whose times from Σ⁺ to Σ⁻ are 1/2 + σ with σ > 0.

    The values of σ are those of `tabulate_epsilon_of_family` at which ε(σ) is finite.

    Returns
    -------
    TwoImpactFamily
        The motions, in the order of increasing σ.
    """
    sigma, epsilon = tabulate_epsilon_of_family(delta, beta, r)
    return inelastic_family_members(sigma[(sigma > 0.0) & np.isfinite(epsilon)], delta, beta, r)


def _zeros_on_family(values: Callable[[TwoImpactFamily], Array], delta: float, beta: float, r: float) -> list[Array]:
    """Return the unknowns of the motions P(1,1,1) at one damping for which the function `values` is 0.

    values: a function of the motions, such as the determinant of the equations' Jacobian, which is 0 at saddle-nodes.

    Returns
    -------
    list of ndarray
        The unknowns of each motion.
    """
    coarse = inelastic_two_impact_family(delta, beta, r)
    return find_zeros_along_family(values, coarse, lambda sigma: inelastic_family_members(sigma, delta, beta, r))


def saddle_node_guesses(delta: float, beta: float, r: float) -> list[Array]:
    """Return the unknowns of each saddle-node of B and D at one damping, close enough to start Newton's method."""
    return _zeros_on_family(lambda at: at.saddle_node_determinant, delta, beta, r)


@lru_cache(maxsize=256)
def graze_guesses(delta: float, beta: float, r: float) -> tuple[Array, ...]:
    """Return the unknowns of each P(1,1,1) at one damping that arrives at Σ⁻ with speed 0, to start Newton's method."""
    return tuple(_zeros_on_family(lambda at: at.speed_on_minus, delta, beta, r))


@lru_cache(maxsize=256)
def flip_guesses(delta: float, beta: float, r: float) -> tuple[Array, ...]:
    """Return the unknowns of each flip of B and D at one damping, close enough to start Newton's method."""
    return tuple(_zeros_on_family(lambda at: at.flip_determinant, delta, beta, r))


def flip_next_to_sn2(delta: float, beta: float, r: float) -> Sequence[Array]:
    """Return a sequence with the unknowns of the flip next to SN2; empty if D does not lose stability at this flip.

    D loses stability if it is stable at smaller ε and unstable at larger ε.

    Returns
    -------
    Sequence[Array]
        One array of unknowns (both times, δ, ε), or an empty sequence.
    """
    found = flip_guesses(delta, beta, r)
    if not found:
        return ()
    at, x = inelastic_two_impact_family(delta, beta, r), found[0]
    loses = at.flip_determinant[np.searchsorted(at.sigma, x[1] - x[0] - 0.5) - 1] < 0
    return found[:1] if loses else ()


def flips_except_next_to_sn2(delta: float, beta: float, r: float) -> Sequence[Array]:
    """Return the unknowns of all flips of B and D at one damping, except the flip that `flip_next_to_sn2` returns."""
    return flip_guesses(delta, beta, r)[len(flip_next_to_sn2(delta, beta, r)) :]


def one_impact_guesses(kind: EventKind, delta: float, r: float) -> list[Array]:
    """Return a list of the unknowns (τ, δ, ε) of SN1 or, if `kind` is FLIP, of the flip of C; empty if none exists."""
    offset = -forcing_slope_at_departure(delta, r, DRIFT) / (2 * np.pi)
    epsilon = (
        epsilon_of_saddle_node(delta, r, DRIFT)
        if kind is EventKind.SADDLE_NODE
        else epsilon_of_flip_of_c(delta, r, DRIFT)
    )
    if not np.isfinite(epsilon) or epsilon == 0.0:
        return []
    cosine = math.sqrt((epsilon - offset) * (epsilon + offset)) if kind is EventKind.FLIP else 0.0
    return [np.array([math.atan2(offset, cosine) / (2 * np.pi), delta, epsilon])]
