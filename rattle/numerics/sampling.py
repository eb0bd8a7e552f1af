"""Samples of initial conditions, and the uncertainty of fractions that are estimated from them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import require, require_real_array

GOLDEN_INCREMENT = np.array([0x9E3779B97F4A7C15], np.uint64)  # increment of the random number generator SplitMix64
SOBOL_BITS = 32  # number of bits of a coordinate of a Sobol point
LAST_PHASE = float(np.nextafter(1.0, 0.0))  # largest double below 1
Z_95 = 1.959963984540054  # a standard normal variable lies within ±Z_95 with probability 95 %


@lru_cache(maxsize=8)
def sobol_points(count: int) -> NDArray[np.float64]:
    """Return the first `count` points of the unscrambled Sobol sequence in the unit square, in Gray code order.

    The points equal those of `scipy.stats.qmc.Sobol`, which takes a quarter of a second to load in every computing
    process. The direction numbers of the first two coordinates follow from the polynomials 1 and x + 1 (Joe and Kuo
    2008).

    Returns
    -------
    NDArray[np.float64]
        Points (count, 2).
    """
    index = np.arange(count, dtype=np.uint64)
    gray = index ^ (index >> np.uint64(1))
    numerators = np.zeros((count, 2), np.uint64)
    second = 1  # direction number of the second coordinate divided by that of the first, for the current bit
    for bit in range(max(count - 1, 1).bit_length()):
        place = SOBOL_BITS - 1 - bit
        directions = np.array([1 << place, second << place], np.uint64)
        numerators ^= (gray >> np.uint64(bit) & np.uint64(1))[:, None] * directions
        second ^= second << 1
    points = numerators / 2.0**SOBOL_BITS
    points.setflags(write=False)
    return points


def _mix_bits(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Mix bits by SplitMix64's finaliser: every output bit depends on all input bits (Steele, Lea and Flood 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def draw_uniforms(seed: int, stream: int, rows: NDArray[np.int64], columns: int) -> NDArray[np.float64]:
    """Return independent uniform random numbers in [0, 1): chosen rows (n,) of an endless table.

    The seed (up to 128 bits) and the number `stream` select the table. Each number depends on the seed, the
    stream, and the number's row and column only, so that rows may be computed in any order.

    Returns
    -------
    NDArray[np.float64]
        The numbers (n, columns).
    """
    state = np.zeros(rows.size, np.uint64)
    words: list[NDArray[np.uint64]] = [*_split_seed(seed), np.array([stream], np.uint64), rows.astype(np.uint64)]
    for word in words:
        state = _mix_bits((state ^ word) + GOLDEN_INCREMENT)
    steps = GOLDEN_INCREMENT * np.arange(1, columns + 1, dtype=np.uint64)
    drawn = _mix_bits(np.asarray(state[:, None] + steps, np.uint64))
    return (drawn >> np.uint64(11)) / 2.0**53


def _split_seed(seed: int) -> list[NDArray[np.uint64]]:
    """Return the lower and the upper 64 bits of a seed of at most 128 bits, each as an array (1,)."""
    return [np.array([half], np.uint64) for half in (seed & (2**64 - 1), seed >> 64)]


def _random_shifts(seed: int, *parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two numbers in [0, 1) for each of n cells, (n, 2), from the seed and the cell's parameters (n,) alone."""
    state = np.zeros(parameters[0].size, np.uint64)
    words: list[NDArray[np.uint64]] = [*_split_seed(seed), *((p + 0.0).view(np.uint64) for p in parameters)]
    for word in words:
        state = _mix_bits((state ^ word) + GOLDEN_INCREMENT)
    drawn = np.stack(
        [_mix_bits(state + GOLDEN_INCREMENT), _mix_bits(state + GOLDEN_INCREMENT + GOLDEN_INCREMENT)], axis=1
    )
    return (drawn >> np.uint64(11)) / 2.0**53


def initial_conditions(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    beta: NDArray[np.float64],
    count: int,
    v_max: ArrayLike,
    seed: int,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return uniform low-discrepancy samples of (τ, v) ∈ [0, 1) × (0, v_max) for cells (n,).

    Phases may be limited to the range `tau`, and speeds begin at `v_min`. The samples are Sobol points, shifted modulo
    1 by an amount that depends on the seed and the cell's parameters alone. So a cell's samples depend on nothing
    but the request and the cell, and cells have independent sampling errors.

    Returns
    -------
    tuple[NDArray[np.float64], NDArray[np.float64]]
        τ and v, each (n, count).
    """
    shifts, points = _random_shifts(seed, delta, epsilon, beta), sobol_points(count)
    x, y = (points[:, i] + shifts[:, i, None] for i in range(2))
    x -= x >= 1.0  # the exact remainder modulo 1, because x is below 2: a sum of a point and a shift in [0, 1)
    y -= y >= 1.0
    speeds = np.broadcast_to(np.asarray(v_max, np.float64), delta.shape)[:, None]
    phases = np.minimum(tau[0] + (tau[1] - tau[0]) * x, LAST_PHASE)
    return phases, np.maximum(v_min + (speeds - v_min) * y, np.spacing(speeds))


def wilson_interval(
    successes: ArrayLike, count: ArrayLike, z: float = Z_95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Wilson score interval of a fraction, for successes out of count (arrays that broadcast).

    `z` is the quantile of the normal distribution; its default gives 95 %.

    Returns
    -------
    tuple[NDArray[np.float64], NDArray[np.float64]]
        Lower and upper ends.
    """
    n, k = require_real_array("count", count), require_real_array("successes", successes)
    require(bool(np.all((n > 0) & (k >= 0) & (k <= n))), "successes must be from 0 to count, and count above 0")
    p = k / n
    z2 = z * z
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = z * np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return np.where(k > 0, np.maximum(centre - half, 0.0), 0.0), np.where(k < n, np.minimum(centre + half, 1.0), 1.0)
