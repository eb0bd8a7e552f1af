"""Orbits A–D over arrays of parameters, with multipliers and stability.

The module also has the regions that the sets of orbits define, the grazing curves G1 (C touches Σ⁻) and G2 (A touches
Σ⁻), and SN1 and the flip of C where the motions that bifurcate there are admissible.

On the family of P(1,1,1) in `rattle.impacting.orbits.closed_form` an orbit grazes Σ⁻ if its speed there is 0. This
orbit is also A or C, so its speed v on Σ⁺ is 2πδ. The multipliers of A or C, which misses Σ⁻, have the sum 1 + E − 4π(1
− E) ε cos 2πτ/δ² and the product E = e^(−δ).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import broadcast_parameters, require_one_of
from rattle.flight.impact_law import ELASTIC
from rattle.impacting.orbits import closed_form
from rattle.impacting.orbits.limits import epsilon_sine_of_single_impact, flip_formula, sn1_formula
from rattle.orbits.orbits_a_to_d import (
    NAMES,
    MissingLimit,
    Orbit,
    PeriodOne,
    classify_regions,
    existing_orbits,
    multipliers_from_trace,
)

CURVES = ("G1", "G2")
# ε of SN1 times JUST_ABOVE gives a point just above SN1; LARGEST, the largest double, limits this product
JUST_ABOVE, LARGEST = 1.0 + 1e-9, np.finfo(np.float64).max


class GrazingPoints(NamedTuple):
    """Points of a grazing curve at dampings of shape S: ε (*S), phase τ and speed v at Σ⁺ (*S), multipliers (2, *S).

    All fields are NaN where the curve does not exist.
    """

    epsilon: NDArray[np.float64]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]


def grazing(curve: str, delta: ArrayLike, beta: ArrayLike = 0.6) -> GrazingPoints:
    """Return the orbits on the grazing curve G1 or G2 at every element of the broadcast damping and half-backlash.

    Raises ParameterError if an argument is outside its domain. Source: paper, section 5.2.

    Returns
    -------
    GrazingPoints
        The grazing orbits; NaN where the curve does not exist at this damping.
    """
    require_one_of("curve", curve, CURVES)
    d, _, b = broadcast_parameters(delta, 0.0, beta)
    flat = closed_form.grazing_curve(CURVES.index(curve), *(np.array(x, order="C").ravel() for x in (d, b)))
    epsilon, tau, trace = (x.reshape(d.shape) for x in flat)
    multipliers = multipliers_from_trace(trace, ELASTIC.determinant(d, 1, 1))
    multipliers[:, np.isnan(epsilon)] = complex(np.nan, np.nan)
    return GrazingPoints(epsilon, tau, np.where(np.isnan(epsilon), np.nan, 2 * np.pi * d), multipliers)


def period_one(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> PeriodOne:
    """Return the admissible period-one orbits A, B, C, D for every element of the broadcast parameters (dimensionless).

    An orbit is admissible if each flight of its closed form ends at a true first impact. A and C are P(1,1,0), born at
    SN1. B and D are P(1,1,1). The time s from Σ⁺ to Σ⁻ is the parameter of one family of P(1,1,1), on which ε(s) has a
    closed form. Each s with ε(s) = ε is a B where ε(s) falls and a D where ε(s) rises. At large ε and small δ or β
    there can be several orbits of one letter; the orbit with the largest s is returned
    (docs/decisions/0002-regions.md). Raises ParameterError if an argument is outside its domain. Source: Mason and
    Piiroinen (2009), sections 4 and 5.

    Returns
    -------
    PeriodOne
        Existence, stability, states and multipliers of A, B, C and D, arrays (4, …).
    """
    d, e, b = broadcast_parameters(delta, epsilon, beta)
    shape = d.shape
    d, e, b = (np.array(x, order="C").ravel() for x in (d, e, b))
    order = np.lexsort((d, b))
    exists, tau, v, trace = closed_form.closed_form_orbits(order, d, e, b, epsilon_sine_of_single_impact(d))
    decay = ELASTIC.determinant(d, 1, 1)
    multipliers = np.moveaxis(multipliers_from_trace(trace, decay), 0, 1)
    multipliers[~exists[:, None].repeat(2, axis=1)] = complex(np.nan, np.nan)
    with np.errstate(invalid="ignore"):
        stable = exists & (np.abs(trace) < 1 + decay)
    return PeriodOne(
        exists.reshape(4, *shape),
        stable.reshape(4, *shape),
        tau.reshape(4, *shape),
        v.reshape(4, *shape),
        multipliers.reshape(4, 2, *shape),
    )


def orbits_at(delta: float, epsilon: float, beta: float) -> tuple[Orbit, ...]:
    """Return the admissible orbits at one parameter point, in the order A, B, C, D."""
    return existing_orbits(period_one(delta, epsilon, beta), delta, epsilon, beta, {})


def regions(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Return the region, 1 to 5 for I to V of the paper, of every element of the broadcast parameters.

    Outside the paper's plane there are other sets of orbits; their numbers are indices in `rattle.REGIONS`. δ > 0, ε ≥
    0 and β > 0 are dimensionless. Raises ParameterError if an argument is outside its domain. Source: paper, section
    5.2 and Figure 7.

    Returns
    -------
    NDArray[np.int8]
        Number of each region, of the broadcast shape.
    """
    return classify_regions(period_one(delta, epsilon, beta))


def sn1(delta: ArrayLike, beta: ArrayLike = 0.6, virtual: bool = False) -> NDArray[np.float64]:
    """Return the eccentricity of the saddle-node SN1, at which A and C are born as ε grows.

    Parameters
    ----------
    delta, beta : array_like
        Damping and half-backlash, both > 0 and dimensionless; they broadcast.
    virtual : bool, default False
        Return the value of the formula even where the motion of SN1 is virtual because it would have to pass Σ⁻. The
        formula does not depend on beta.

    Returns
    -------
    ndarray
        ε, of the broadcast shape. NaN where A and C are not born in SN1: beyond COD22, A begins at the graze
        `grazing("G2", delta, beta)`, if at all, and C does not exist.

    Raises
    ------
    ParameterError
        If a number is not finite or not greater than 0, or the shapes do not broadcast.

    Notes
    -----
    ε = δ coth(δ/2) − 2, Mason and Piiroinen (2009), equation (4.1).
    """
    return _mask_inadmissible_c(sn1_formula(delta), delta, beta, virtual)


def flip(delta: ArrayLike, beta: ArrayLike = 0.6, virtual: bool = False) -> NDArray[np.float64]:
    """Return the eccentricity of the flip PDC, at which C loses stability as ε grows.

    Parameters
    ----------
    delta, beta : array_like
        Damping and half-backlash, both > 0 and dimensionless; they broadcast.
    virtual : bool, default False
        Return the value of the formula even where C is virtual because it would have to pass Σ⁻. The formula does not
        depend on beta.

    Returns
    -------
    ndarray
        ε, of the broadcast shape. NaN where C does not flip: beyond COD20 C ends, still stable, at the graze
        `grazing("G1", delta, beta)`, and beyond COD22 C does not exist.

    Raises
    ------
    ParameterError
        If a number is not finite or not greater than 0, or the shapes do not broadcast.

    Notes
    -----
    ε² = SN1² + (δ² coth(δ/2)/2π)². The paper does not have this curve.
    """
    return _mask_inadmissible_c(flip_formula(delta), delta, beta, virtual)


def _mask_inadmissible_c(epsilon: ArrayLike, delta: ArrayLike, beta: ArrayLike, virtual: bool) -> NDArray[np.float64]:
    """Return epsilon with NaN where C is not admissible; with `virtual` return all of epsilon unchanged."""
    d, _, b = broadcast_parameters(delta, 0.0, beta)
    e = np.broadcast_to(epsilon, d.shape)
    if virtual:
        return e.copy()
    exists = period_one(d, np.where(np.isfinite(e), e, 0.0), b).exists[NAMES.index("C")]
    return np.where(exists, e, np.nan)


def missing_limits(delta: float, beta: float) -> tuple[MissingLimit, ...]:
    """Return a `MissingLimit` for each of SN1 and the flip of C that does not exist at this damping."""
    born, end = not np.isnan(sn1(delta, beta)), float(grazing("G1", delta, beta).epsilon)
    found = []
    if not born:
        begin, formula = float(grazing("G2", delta, beta).epsilon), float(sn1_formula(delta))
        if np.isnan(begin) and period_one(delta, min(formula * JUST_ABOVE, LARGEST), beta).exists[NAMES.index("A")]:
            begin = formula  # at COD22 rounding decides whether the motion of SN1 grazes
        found.append(
            MissingLimit("sn1", "none at this damping: A and C do not exist", None)
            if np.isnan(begin)
            else MissingLimit("sn1", "none at this damping: C does not exist, A begins in grazing G2", begin)
        )
    if np.isnan(flip(delta, beta)):
        if not born:
            found.append(MissingLimit("flip", "none at this damping: C does not exist", None))
        elif np.isnan(end):
            found.append(MissingLimit("flip", "none at this damping: C ends before it", None))
        else:
            found.append(MissingLimit("flip", "none at this damping: C ends in grazing G1", end))
    return tuple(found)
