"""Orbits A to D of the inelastic gear under forcing by one cosine, and regions, for arrays of parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import broadcast_parameters
from rattle.inelastic.orbits.family import fill_family_orbits
from rattle.orbits.orbits_a_to_d import N_MINUS, NAMES, PeriodOne, classify_regions, multipliers_from_trace


def period_one(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
) -> PeriodOne:
    """Return the orbits A to D under forcing by one cosine, for every element of the broadcast parameters.

    Parameters
    ----------
    delta, epsilon, beta, restitution, load : array_like
        Damping, eccentricity, half-backlash, restitution in (0, 1] and load ≥ 0. All are dimensionless and broadcast.

    Returns
    -------
    PeriodOne
        Existence, stability, states and multipliers, (4, …). If several orbits have the same letter, the orbit with the
        longest time from Σ⁺ to Σ⁻ is given, as by `rattle.period_one`.

    Raises
    ------
    ParameterError
        If a number is outside its domain, or the shapes do not broadcast.

    Notes
    -----
    A and C, P(1,1,0), have closed forms. For P(1,1,1) the eccentricity ε(σ) is an explicit function of σ, the time from
    Σ⁺ to Σ⁻ minus half a period (`rattle.inelastic.orbits.family`). Where ε(σ) equals the given ε, the orbit is B if
    ε(σ) falls and D if ε(σ) rises. A load ℓ only changes the unit of length: the gear is equivalent to one without load
    at (ε, β)/(1 + ℓ).
    """
    arrays = broadcast_parameters(delta, epsilon, beta, restitution=restitution, load=load)
    shape, unit = arrays[0].shape, 1.0 + arrays[4]
    d, e, b, r, unit = (
        np.array(x, order="C").ravel() for x in (arrays[0], arrays[1] / unit, arrays[2] / unit, arrays[3], unit)
    )
    exists = np.zeros((len(NAMES), d.size), np.bool_)
    tau, v, trace = np.full((3, *exists.shape), np.nan)
    fill_family_orbits(np.lexsort((d, b, r)), d, e, b, r, exists, tau, v, trace)
    multipliers = np.full((len(NAMES), 2, d.size), complex(np.nan, np.nan))
    stable = np.zeros(exists.shape, np.bool_)
    for i, n_minus in enumerate(N_MINUS):
        determinant = np.exp(-d) * r ** (2 * (1 + n_minus))
        multipliers[i] = np.where(exists[i], multipliers_from_trace(trace[i], determinant), multipliers[i])
        with np.errstate(invalid="ignore"):
            stable[i] = exists[i] & (np.abs(trace[i]) < 1.0 + determinant)
    return PeriodOne(
        exists.reshape(4, *shape),
        stable.reshape(4, *shape),
        tau.reshape(4, *shape),
        (v * unit).reshape(4, *shape),
        multipliers.reshape(4, 2, *shape),
    )


def regions(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
) -> NDArray[np.int8]:
    """Return the number of the region, as in `rattle.REGIONS`, for every element of the broadcast parameters."""
    return classify_regions(period_one(delta, epsilon, beta, restitution, load))
