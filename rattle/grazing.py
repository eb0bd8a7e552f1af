"""Grazing of the single-impact orbits: G1 (C touches Σ⁻), G2 (A touches), their multipliers, and robust chaos between
COD21 and COD22.

On the P(1,1,1) family of `rattle.family` the orbit grazes where its speed at Σ⁻ vanishes. There it is also A or C, so
v = 2πδ, and the multipliers on the non-square-root side are those of A or C: trace 1 + E − 4π(1 − E) ε cos 2πτ/δ²,
determinant E = e^(−δ).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle import family
from rattle.errors import RattleError, require, require_number
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


class CodimensionTwo(NamedTuple):
    """A codimension-two point of the (δ, ε) plane."""

    delta: float
    epsilon: float


def grazing(curve: str, delta: ArrayLike, beta: ArrayLike = 0.6) -> Grazing:
    """G1 or G2 at every element of the broadcast damping and half-backlash (dimensionless).

    NaN where the curve does not exist at that damping. Raises ParameterError. Source: paper, section 5.2.
    """
    require(isinstance(curve, str) and curve in CURVES, f"curve must be one of {', '.join(CURVES)}, got {curve!r}")
    d, _, b = parameters(delta, 0.0, beta)
    flat = family.grazing_cells(CURVES.index(curve), np.ascontiguousarray(d).ravel(), np.ascontiguousarray(b).ravel())
    epsilon, tau, trace = (x.reshape(d.shape) for x in flat)
    multipliers = multipliers_of(trace, np.exp(-d))
    multipliers[:, np.isnan(epsilon)] = complex(np.nan, np.nan)
    return Grazing(epsilon, tau, np.where(np.isnan(epsilon), np.nan, 2 * np.pi * d), multipliers)


def _equal_multipliers(delta: float, beta: float) -> float:
    """COD21: trace = 2 e^(−δ/2), so that both multipliers are e^(−δ/2)."""
    return _scaled_cosine(delta, beta) - (1 - math.exp(-delta / 2)) ** 2


def _fold(delta: float, beta: float) -> float:
    """COD22: cos 2πτ = 0, where A, C and the grazing meet at τ = 3/4 and SN1."""
    return _scaled_cosine(delta, beta)


def _flip(delta: float, beta: float) -> float:
    """COD20: trace = −1 − e^(−δ), where PDC meets G1. Not in the paper."""
    return _scaled_cosine(delta, beta) - 2 * (1 + math.exp(-delta))


def _scaled_cosine(delta: float, beta: float) -> float:
    """1 + E − trace of the grazing orbit."""
    cosine, _ = family.grazing_cosine(delta, beta)
    return 4 * math.pi * -math.expm1(-delta) * cosine / delta**2


def _two_thirds(delta: float, beta: float) -> float:
    """Larger multiplier 2/3: trace = 2/3 + 3/2 e^(−δ)."""
    return _scaled_cosine(delta, beta) - (1 / 3 - math.exp(-delta) / 2)


CONDITIONS = {"COD20": _flip, "COD21": _equal_multipliers, "COD22": _fold}


def codimension_two(name: str, beta: float = 0.6) -> CodimensionTwo:
    """COD20, COD21 or COD22 of Figure 8 for half-backlash beta, to about 1e-13.

    All lie on G1 at and below COD22, whose damping is near 4β/π (where a speed of 2πδ just crosses the gap). Raises
    ParameterError, and RattleError if this backlash has no such point.
    """
    require(isinstance(name, str) and name in CONDITIONS, f"name must be one of {', '.join(CONDITIONS)}, got {name!r}")
    return _on_grazing(name, CONDITIONS[name], require_number("beta", beta, positive=True))


def _on_grazing(name: str, residual: Callable[[float, float], float], beta: float) -> CodimensionTwo:
    """The first point at which a residual that is positive at small damping vanishes along the grazing curve."""
    from scipy.optimize import brentq  # a quarter of a second to load, and only needed here

    scan = np.geomspace(0.05, 8.0, 400) * 4 * beta / np.pi
    values = np.array([residual(x, beta) for x in scan])
    falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    if not falls.size:
        raise RattleError(f"there is no {name} for beta = {beta}")
    lo, hi = scan[falls[0]], scan[falls[0] + 1]
    delta = float(brentq(residual, lo, hi, args=(beta,), xtol=1e-15, rtol=4 * np.finfo(float).eps))
    return CodimensionTwo(delta, float(family.grazing_cosine(delta, beta)[1]))


def robust_chaos_interval(beta: float = 0.6) -> tuple[float, float]:
    """Damping interval in which the larger multiplier of the grazing C is real and in (2/3, 1): robust chaos is born
    at G1.

    From COD21 to COD22; at large backlash, where both multipliers at COD21 are still e^(−δ/2) < 2/3, from where the
    larger reaches 2/3. Raises as `codimension_two`. Source: paper, section 5.2 (one-dimensional square-root map).
    """
    beta = require_number("beta", beta, positive=True)
    lower, upper = codimension_two("COD21", beta).delta, codimension_two("COD22", beta).delta
    if math.exp(-lower / 2) < 2 / 3:
        lower = _on_grazing("multiplier 2/3", _two_thirds, beta).delta
    return lower, upper
