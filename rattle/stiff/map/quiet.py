"""Quiet motion of the stiff gear: permanent contact with Σ⁺, a periodic solution of a linear equation.

For the forcing of one cosine the depth is

    x = 2πδ/κ + ε (P cos 2πt + Q sin 2πt),
    D = (2κ − 4π²)² + (2πδ)²,    P = −4π² (2κ − 4π² − δ²)/D,    Q = −4πδκ/D.

This motion exists if x ≥ 0 at all times, that is, if and only if ε ≤ 2πδ/(κ √(P² + Q²)). It then attracts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, require, require_real_array
from rattle.flight.forcing import TWO_PI


def quiet_limit(delta: ArrayLike, kappa: ArrayLike) -> NDArray[np.float64]:
    """Return the ε above which permanent contact with Σ⁺ is lost: (δ/κ) √((2κ − 4π²)² + 4π²δ²)/√(4π² + δ²).

    Damping δ > 0 and stiffness κ > 0 are dimensionless and broadcast. For large κ the limit is about
    `rattle.quiet_limit` times 1 − 2π²/κ.

    Returns
    -------
    NDArray[np.float64]
        The limit, of the broadcast shape.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    try:
        d, k = np.broadcast_arrays(require_real_array("delta", delta), require_real_array("kappa", kappa))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"the shapes of delta and kappa do not broadcast: {error}") from None
    for name, array in (("delta", d), ("kappa", k)):
        require(bool(np.all(np.isfinite(array) & (array > 0))), f"{name} must be finite and greater than 0")
    return d / k * np.hypot(2.0 * k - TWO_PI**2, TWO_PI * d) / np.hypot(TWO_PI, d)


def quiet_depth(
    delta: float, epsilon: float, kappa: float, time: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the depth x = Φ − β and x' in permanent contact with Σ⁺, at times (of any shape) in forcing periods."""
    a, b = 2.0 * kappa - TWO_PI**2, TWO_PI * delta
    size = np.hypot(a, b)
    p = -(TWO_PI**2) * ((a - delta**2) / size) / size
    q = -2.0 * TWO_PI * delta * (kappa / size) / size
    angle = TWO_PI * np.asarray(time, np.float64)
    depth = TWO_PI * delta / kappa + epsilon * (p * np.cos(angle) + q * np.sin(angle))
    return depth, TWO_PI * epsilon * (q * np.cos(angle) - p * np.sin(angle))


def becomes_quiet_late(delta: NDArray[np.float64], *_: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return False for each cell (n,): no cell needs many impacts before its quiet motion is recognised."""
    return np.zeros(delta.size, np.bool_)
