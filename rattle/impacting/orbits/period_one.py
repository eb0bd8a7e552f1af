"""A–D over whole parameter arrays, with multipliers and stability; the regions that they make; their grazing curves G1
(C touches Σ⁻) and G2 (A touches).

On the P(1,1,1) family of `rattle.impacting.orbits.closed_form` the orbit grazes where its speed at Σ⁻ vanishes. There
it is also A or C, so v = 2πδ, and the multipliers on the non-square-root side are those of A or C: trace 1 + E − 4π(1 −
E) ε cos 2πτ/δ², determinant E = e^(−δ).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import parameters, require_one_of
from rattle.impacting.orbits import closed_form
from rattle.impacting.orbits.limits import sine_offset
from rattle.orbits.period_one import N_MINUS, NAMES, Orbit, PeriodOne, classify, multipliers_of

CURVES = ("G1", "G2")


class Grazing(NamedTuple):
    """Points of a grazing curve for damping of shape S: ε, phase τ and speed v at Σ⁺ (*S), multipliers (2, *S); NaN
    where absent.
    """

    epsilon: NDArray[np.float64]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]


def grazing(curve: str, delta: ArrayLike, beta: ArrayLike = 0.6) -> Grazing:
    """G1 or G2 at every element of the broadcast damping and half-backlash (dimensionless).

    NaN where the curve does not exist at that damping. Raises ParameterError. Source: paper, section 5.2.
    """
    require_one_of("curve", curve, CURVES)
    d, _, b = parameters(delta, 0.0, beta)
    flat = closed_form.grazing_cells(CURVES.index(curve), *(np.array(x, order="C").ravel() for x in (d, b)))
    epsilon, tau, trace = (x.reshape(d.shape) for x in flat)
    multipliers = multipliers_of(trace, np.exp(-d))
    multipliers[:, np.isnan(epsilon)] = complex(np.nan, np.nan)
    return Grazing(epsilon, tau, np.where(np.isnan(epsilon), np.nan, 2 * np.pi * d), multipliers)


def period_one(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> PeriodOne:
    """The admissible period-one orbits A, B, C, D for every element of the broadcast parameters (dimensionless).

    Admissible: each flight of the closed form is a true first impact. A, C: P(1,1,0), born at SN1; B, D: P(1,1,1), at
    given ε the roots of ε(s) on one explicit family, B where it falls and D where it rises. At large ε and small δ or
    β there can be several of one letter; the one with the largest s is given (docs/decisions/0002-regions.md). Raises
    ParameterError. Source: Mason and Piiroinen (2009), sections 4 and 5.
    """
    d, e, b = parameters(delta, epsilon, beta)
    shape = d.shape
    d, e, b = (np.array(x, order="C").ravel() for x in (d, e, b))
    order = np.lexsort((d, b))
    exists, tau, v, trace = closed_form.period_one_cells(order, d, e, b, sine_offset(d))
    decay = np.exp(-d)
    multipliers = np.moveaxis(multipliers_of(trace, decay), 0, 1)
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
    """The admissible orbits at one parameter point, in the order A, B, C, D."""
    found = period_one(delta, epsilon, beta)
    return tuple(
        Orbit(
            name,
            1,
            1,
            N_MINUS[i],
            float(found.tau[i]),
            float(found.v[i]),
            (complex(found.multipliers[i, 0]), complex(found.multipliers[i, 1])),
            bool(found.stable[i]),
            delta,
            epsilon,
            beta,
            np.inf,
        )
        for i, name in enumerate(NAMES)
        if found.exists[i]
    )


def regions(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Region 1…5 (I…V) of every element of the broadcast parameters, int8; another set of orbits, as it is beside the
    paper's plane, by its number in `rattle.REGIONS`.

    δ > 0, ε ≥ 0, β > 0, dimensionless. Raises ParameterError. Source: paper, section 5.2 and Figure 7.
    """
    return classify(period_one(delta, epsilon, beta))
