"""Limits as formulas in the (δ, ε) plane: SN1, the flip of C (PDC), and the quiet limit.

All functions take the damping δ > 0 (scalar or array, dimensionless) and return ε of the same shape. The quiet limit is
valid everywhere. The formulas of SN1 and of the flip solve the equations of A and C even where the motion is virtual
because it would pass Σ⁻; `rattle.impacting.orbits.period_one` restricts both to admissible motions. All three formulas
hold for forcing by one cosine, and SN1 and the flip for elastic impacts only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import require, require_real_array
from rattle.flight.forcing import quiet_eccentricity
from rattle.numerics.compile import inline

SMALL = 0.05  # damping below which the series of `epsilon_sine_series` is exact to rounding
FloatArray = NDArray[np.float64]


def _require_valid_damping(delta: ArrayLike) -> FloatArray:
    """Return the damping as an array. Raises ParameterError unless all values are finite and greater than 0."""
    value = require_real_array("delta", delta)
    require(bool(np.all(np.isfinite(value) & (value > 0))), "delta must be finite and greater than 0")
    return value


@inline
def epsilon_sine_series(q: Any) -> Any:
    """Return 2 − δ coth(δ/2) as a series in q = δ²."""
    return -q / 6 * (1 - q / 60 * (1 - q / 42 * (1 - q / 40)))


def epsilon_sine_of_single_impact(delta: ArrayLike) -> FloatArray:
    """Return 2 − δ coth(δ/2) ≤ 0, which is ε sin 2πτ of A and C. At small δ a series avoids cancellation."""
    d = np.asarray(delta, dtype=np.float64)
    # floating-point errors occur only in values that np.where does not choose
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        series, exact = epsilon_sine_series(d * d), 2.0 - d / np.tanh(d / 2)
    return np.where(d < SMALL, series, exact)


def sn1_formula(delta: ArrayLike) -> FloatArray:
    """Return the eccentricity ε = |2 − δ coth(δ/2)| of the saddle-node SN1 of A and C (paper, equation 4.1).

    Returns
    -------
    FloatArray
        ε, also where the motion is virtual because it would have to pass Σ⁻.
    """
    return np.abs(epsilon_sine_of_single_impact(_require_valid_damping(delta)))


def flip_formula(delta: ArrayLike) -> FloatArray:
    """Return the eccentricity ε of the flip PDC of C, ε² = SN1² + (δ² coth(δ/2)/2π)²; the paper does not have it.

    Returns
    -------
    FloatArray
        ε, also where C is virtual because it would have to pass Σ⁻.
    """
    d = _require_valid_damping(delta)
    with np.errstate(over="ignore"):  # δ² coth(δ/2) overflows from δ = 1.3e154 on
        return np.hypot(sn1_formula(d), d * (2.0 - epsilon_sine_of_single_impact(d)) / (2 * np.pi))


def quiet_limit(delta: ArrayLike) -> FloatArray:
    """Return the quiet limit ε = 2δ/√(4π² + δ²).

    Permanent contact needs 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt > 0 for all t, which holds if and only if ε is below the
    quiet limit.

    Returns
    -------
    float or ndarray
        ε, of the shape of delta.
    """
    d = _require_valid_damping(delta)
    return quiet_eccentricity(d)
