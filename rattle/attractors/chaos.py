"""Lyapunov exponents per forcing period with error bars, from batch sums of a trajectory's tangent; which chaotic
trajectories are on one attractor, by the boxes of the (τ, v) plane that they visited (compiled).

The tangent runs in (t, v²/2), where one flight of duration s has determinant e^(−δs), so that λ₁ + λ₂ = −δ holds at
finite time and tests every matrix. λ₁ comes from the growth of one vector; after re-orthonormalisation the second
diagonal entry is the determinant over the first, so λ₂ needs no second vector.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.numerics.compile import inline, kernel

SAME_FOOTPRINT = 0.2  # two trajectories that share this much of the smaller footprint are on one attractor
BATCHES = 32
LEAST_GROWTH = 8.0
T_95 = 2.0395  # 97.5 % point of Student's t with 31 degrees of freedom


@inline
def boxes_in(bits):
    """The number of ones."""
    n = 0
    while bits:
        bits &= bits - np.uint64(1)
        n += 1
    return n


@kernel
def group_numbers(boxes, group):
    """Write to group the number of each footprint's group, that of its first member; boxes (n, GRID) is worked in.

    Groups that share SAME_FOOTPRINT of the smaller union are joined, until none do; different attractors are disjoint.
    """
    n, rows = boxes.shape
    for i in range(n):
        group[i] = i
    joined = True
    while joined:
        joined = False
        for i in range(n):
            for j in range(i):
                if group[i] != i or group[j] != j:
                    continue
                in_i, in_j, shared = 0, 0, 0
                for k in range(rows):
                    in_i += boxes_in(boxes[i, k])
                    in_j += boxes_in(boxes[j, k])
                    shared += boxes_in(boxes[i, k] & boxes[j, k])
                if shared > SAME_FOOTPRINT * min(in_i, in_j):
                    for k in range(rows):
                        boxes[j, k] |= boxes[i, k]
                    for k in range(i, n):
                        group[k] = j if group[k] == i else group[k]
                    joined = True


def groups_of(footprints: NDArray[np.uint64]) -> list[list[int]]:
    """Group footprints (n, GRID) that overlap, transitively, with the union of their group: lists of indices."""
    group = np.zeros(len(footprints), np.int64)
    group_numbers(footprints.copy(), group)
    if len(group) and not group.any():
        return [list(range(len(group)))]
    return [[int(i) for i in np.flatnonzero(group == first)] for first in np.unique(group)]


@kernel
def exponents(sums):
    """(λ₁, λ₂, 95 % half-width of λ₁) from rows of time, ln stretch and ln|det|; NaN if nothing was measured.

    The error bar is that of a ratio estimate over batches, which are long against the correlation time.
    """
    time, stretch, contraction, used = 0.0, 0.0, 0.0, 0
    for i in range(sums.shape[0]):
        time += sums[i, 0]
        stretch += sums[i, 1]
        contraction += sums[i, 2]
        used += sums[i, 0] > 0.0
    if used < 2:
        return math.nan, math.nan, math.nan
    first = stretch / time
    spread = 0.0
    for i in range(sums.shape[0]):
        spread += (sums[i, 1] - first * sums[i, 0]) ** 2
    error = T_95 * math.sqrt(spread * used / (used - 1.0)) / time
    return first, contraction / time - first, error


@kernel
def is_chaotic(sums):
    """True if the first exponent is above its error bar and the growth is not that of shear.

    A vector also grows in regular motion, as ln t: by ln 2 over the second half, where chaos must have more than
    LEAST_GROWTH.
    """
    first, _second, error = exponents(sums)
    later = 0.0
    for i in range(sums.shape[0] // 2, sums.shape[0]):
        later += sums[i, 1]
    return first > error and later > LEAST_GROWTH


def pooled(sums: np.ndarray) -> tuple[float, float, float]:
    """(λ₁, λ₂, 95 % half-width) of several trajectories on one attractor: sums (trajectories, batches, 3)."""
    first, second, error = exponents(np.ascontiguousarray(sums.reshape(-1, 3)))
    return float(first), float(second), float(error)
