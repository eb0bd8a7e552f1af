"""Initial conditions and the uncertainty of the fractions that they estimate."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from rattle.errors import real_array, require

Z_95 = 1.959963984540054  # 97.5 % point of the normal distribution


@lru_cache(maxsize=8)
def _sobol(count: int) -> NDArray[np.float64]:
    """The first points of the unscrambled Sobol sequence in the unit square, drawn as a full power of two."""
    points = qmc.Sobol(2, scramble=False).random_base2(max(count - 1, 1).bit_length())[:count]
    points.setflags(write=False)
    return points


def initial_conditions(
    count: int, v_max: float, seed: int, parameters: tuple[float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Uniform low-discrepancy sample of (τ, v) ∈ [0, 1) × (0, v_max): two arrays of shape (count,).

    Sobol points, shifted modulo 1 by an amount that depends on the seed and the parameter point alone. So a cell's
    sample depends on nothing but the request and the cell, and cells have independent sampling errors.
    """
    bits = np.asarray(parameters, np.float64).view(np.uint64)
    shift = np.random.default_rng([seed, *(int(b) for b in bits)]).random(2)
    points = (_sobol(count) + shift) % 1.0
    return np.ascontiguousarray(points[:, 0]), np.maximum(v_max * points[:, 1], math.ulp(v_max))


def wilson_interval(successes: ArrayLike, count: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """95 % Wilson score interval (lower, upper) of a fraction, for successes out of count (arrays that broadcast)."""
    n, k = real_array("count", count), real_array("successes", successes)
    require(bool(np.all((n > 0) & (k >= 0) & (k <= n))), "successes must be from 0 to count, and count above 0")
    p = k / n
    z2 = Z_95 * Z_95
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z_95 * np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)
