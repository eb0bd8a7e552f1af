"""Starting points of bifurcation curves: solutions at one damping, from closed forms of the period-one motions."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rattle.continuation.conditions import EventKind
from rattle.impacting.orbits import closed_form
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.limits import epsilon_sine_of_single_impact, flip_formula, sn1_formula
from rattle.numerics.complex_step import Array

# FINER: number of members of the family that a refinement computes, from the member before a zero to the member after
# it. FINEST: largest number of refinements.
FINER, FINEST = 33, 12
# a zero needs no further refinement if its two neighbours, members of the family on either side of it, differ by less
# than this, both in their impact times (in forcing periods) and in ε (relative to ε)
CLOSE = 0.02


class TwoImpactFamily(NamedTuple):
    """The P(1,1,1) motions at one damping: k members, by rising time 1/2 + σ of the flight from Σ⁺ to Σ⁻, σ > 0.

    Attributes
    ----------
    sigma : (k,)
        Rising values of σ, in forcing periods.
    unknowns : (k, 4)
        Unknowns: both impact times, δ and ε.
    speed_on_minus : (k,)
        Speed at Σ⁻.
    saddle_node_determinant, flip_determinant : (k,)
        det J(1), which vanishes at a saddle-node and is positive on D, and det J(−1), which vanishes at a flip and is
        negative where D is stable. J(λ) is the Jacobian of the impact equations; det J(λ) is 0 if λ is a multiplier.
    """

    sigma: Array
    unknowns: Array
    speed_on_minus: Array
    saddle_node_determinant: Array
    flip_determinant: Array


def family_members(sigma: Array, delta: float, beta: float) -> TwoImpactFamily:
    """Return the P(1,1,1) motions at one damping that have the rising values sigma (k,) of σ (`TwoImpactFamily`)."""
    closed = np.array([closed_form.closure_numerators(each, delta, beta) for each in sigma]).reshape(-1, 5)
    x, y = closed[:, 0] / closed[:, 4], closed[:, 1] / closed[:, 4]
    tau = np.arctan2(y, x) / (2 * np.pi)
    unknowns = np.column_stack([tau, tau + 0.5 + sigma, np.full_like(sigma, delta), np.hypot(x, y)])
    itinerary = Itinerary((1, -1), 1, beta)
    at_one, at_minus_one = (np.linalg.det(itinerary.jacobian(unknowns, multiplier)) for multiplier in (1.0, -1.0))
    return TwoImpactFamily(sigma, unknowns, closed[:, 3] / closed[:, 4], at_one, at_minus_one)


@lru_cache(maxsize=256)
def two_impact_family(delta: float, beta: float) -> TwoImpactFamily:
    """Return the P(1,1,1) motions (B and D) at one damping, at the nodes σ > 0 of `closed_form.nodes_of_family`."""
    sigma, epsilon = closed_form.nodes_of_family(delta, beta)
    return family_members(sigma[(sigma > 0.0) & np.isfinite(epsilon)], delta, beta)


def find_zeros_along_family(
    values: Callable[[TwoImpactFamily], Array], coarse: TwoImpactFamily, members_at: Callable[[Array], TwoImpactFamily]
) -> list[Array]:
    """Find the roots of a function along a family of motions, close enough to start Newton's method.

    Parameters
    ----------
    values : callable
        The function: it takes members (k,) of the family and returns values (k,).
    coarse : TwoImpactFamily
        Members between which sign changes are searched.
    members_at : callable
        A function that returns the members at given values of σ.

    Returns
    -------
    list of ndarray
        Unknowns at the roots, in the order of σ.
    """
    at, found = values(coarse), []
    for i in np.flatnonzero(at[:-1] * at[1:] < 0):
        low, high = coarse.sigma[i], coarse.sigma[i + 1]
        for _ in range(FINEST):
            fine = members_at(np.linspace(low, high, FINER))
            at_fine = values(fine)
            changes = np.flatnonzero(at_fine[:-1] * at_fine[1:] <= 0)
            k = int(changes[0]) if changes.size else FINER // 2
            apart = np.abs(fine.unknowns[k + 1] - fine.unknowns[k])
            if not changes.size or (apart[:2].max() < CLOSE and apart[3] < CLOSE * fine.unknowns[k, 3]):
                break
            low, high = fine.sigma[k], fine.sigma[k + 1]
        found.append(fine.unknowns[k])
    return found


def _motions_at_zeros(values: Callable[[TwoImpactFamily], Array], delta: float, beta: float) -> list[Array]:
    """Return the unknowns at the roots of a function along the P(1,1,1) motions at one damping."""
    return find_zeros_along_family(
        values, two_impact_family(delta, beta), lambda sigma: family_members(sigma, delta, beta)
    )


def two_impact_folds(delta: float, beta: float) -> list[Array]:
    """Return the unknowns at the saddle-nodes of B and D, close enough to start Newton's method."""
    return _motions_at_zeros(lambda at: at.saddle_node_determinant, delta, beta)


@lru_cache(maxsize=256)
def two_impact_grazes(delta: float, beta: float) -> tuple[Array, ...]:
    """Return the unknowns of each P(1,1,1) whose speed at Σ⁻ is 0, close enough to start Newton's method."""
    return tuple(_motions_at_zeros(lambda at: at.speed_on_minus, delta, beta))


@lru_cache(maxsize=256)
def two_impact_flips(delta: float, beta: float) -> tuple[Array, ...]:
    """Return the unknowns at the flips of B and D, close enough to start Newton's method."""
    return tuple(_motions_at_zeros(lambda at: at.flip_determinant, delta, beta))


def loses_stability_at_flip(x: Array, beta: float) -> bool:
    """Return whether D loses stability, as ε grows, at the flip of D whose times, δ and ε are x (4,)."""
    at = two_impact_family(float(x[-2]), beta)
    # ε grows with σ along D, and `flip_determinant` is negative where D is stable
    return bool(at.flip_determinant[np.searchsorted(at.sigma, x[1] - x[0] - 0.5) - 1] < 0)


def find_single_impact_starting_points(kind: EventKind, delta: float) -> list[Array]:
    """Return the unknowns (τ, δ, ε) of SN1 or of PDC, the flip of C; an empty list if the formula gives no ε > 0."""
    offset = float(epsilon_sine_of_single_impact(delta))
    epsilon = float(sn1_formula(delta) if kind is EventKind.SADDLE_NODE else flip_formula(delta))
    if not np.isfinite(epsilon) or epsilon == 0.0:
        return []
    cosine = np.sqrt((epsilon - offset) * (epsilon + offset)) if kind is EventKind.FLIP else 0.0
    return [np.array([np.arctan2(offset, cosine) / (2 * np.pi), delta, epsilon])]
