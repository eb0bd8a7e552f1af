"""Grazing of the single-impact orbits over whole arrays: G1 (C touches Σ⁻), G2 (A touches), and their multipliers.

On the P(1,1,1) family of `rattle.family` the orbit grazes where its speed at Σ⁻ vanishes. There it is also A or C, so
v = 2πδ, and the multipliers on the non-square-root side are those of A or C: trace 1 + E − 4π(1 − E) ε cos 2πτ/δ²,
determinant E = e^(−δ).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle import family
from rattle.errors import require
from rattle.orbits import multipliers_of, parameters

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
    require(isinstance(curve, str) and curve in CURVES, f"curve must be one of {', '.join(CURVES)}, got {curve!r}")
    d, _, b = parameters(delta, 0.0, beta)
    flat = family.grazing_cells(CURVES.index(curve), *(np.array(x, order="C").ravel() for x in (d, b)))
    epsilon, tau, trace = (x.reshape(d.shape) for x in flat)
    multipliers = multipliers_of(trace, np.exp(-d))
    multipliers[:, np.isnan(epsilon)] = complex(np.nan, np.nan)
    return Grazing(epsilon, tau, np.where(np.isnan(epsilon), np.nan, 2 * np.pi * d), multipliers)
