"""Lyapunov exponents per forcing period with error bars, from batch sums of a trajectory's tangent.

Which chaotic trajectories are on one attractor, by the boxes of the (τ, v) plane that they visited (compiled).

The tangent runs in (t, v²/2), where one flight of duration s has determinant e^(−δs), so that λ₁ + λ₂ = −δ holds at
finite time and tests every matrix. λ₁ comes from the growth of one vector; after re-orthonormalisation the second
diagonal entry is the determinant over the first, so λ₂ needs no second vector.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.numerics.compile import inline, kernel

SAME_FOOTPRINT = 0.2  # two trajectories that share this much of the smaller footprint are on one attractor
Array = NDArray[np.float64]
Counts = NDArray[np.int64]
BATCHES = 32
LEAKS_MISSED = 3.0  # a set that loses samples is left by none for so long with probability e^(−3)
LEAST_GROWTH = 8.0
T_95 = 2.0395  # 97.5 % point of Student's t with 31 degrees of freedom
PAIRS, FOURS, EIGHTS, SUM = (np.uint64(int(x * 8, 16)) for x in ("55", "33", "0f", "01"))
ONE, TWO, FOUR, TOP = (np.uint64(x) for x in (1, 2, 4, 56))


@inline
def boxes_in(bits):
    """Return the number of ones, in sums over ever more bits: no branches, which a loop over rows would wait for."""
    bits = bits - ((bits >> ONE) & PAIRS)
    bits = (bits & FOURS) + ((bits >> TWO) & FOURS)
    return np.int64((((bits + (bits >> FOUR)) & EIGHTS) * SUM) >> TOP)


@inline
def same_attractor(boxes, i, j):
    """Return whether two footprints share SAME_FOOTPRINT of the smaller one."""
    in_i, in_j, shared = 0, 0, 0
    for k in range(boxes.shape[1]):
        in_i += boxes_in(boxes[i, k])
        in_j += boxes_in(boxes[j, k])
        shared += boxes_in(boxes[i, k] & boxes[j, k])
    return shared > SAME_FOOTPRINT * min(in_i, in_j)


@kernel
def group_numbers(boxes, size, group):
    """Write the number of each visited-cell bitmap's group to group (k,).

    It is the number of the group's first member among the bitmaps of its cell, which has `size` of the boxes (k, GRID),
    worked in.

    Groups that share SAME_FOOTPRINT of the smaller union are joined, until none do; different attractors are disjoint.
    """
    begin = 0
    for cell in range(size.size):
        end = begin + size[cell]
        for i in range(begin, end):
            group[i] = i - begin
        joined = True
        while joined:
            joined = False
            for i in range(begin, end):
                for j in range(begin, i):
                    if group[i] != i - begin or group[j] != j - begin or not same_attractor(boxes, i, j):
                        continue
                    for k in range(boxes.shape[1]):
                        boxes[j, k] |= boxes[i, k]
                    for k in range(i, end):
                        group[k] = j - begin if group[k] == i - begin else group[k]
                    joined = True
        begin = end


@kernel
def exponents(sums):
    """Return the Lyapunov exponents from rows of time, ln stretch and ln|det|.

    The error bar is that of a ratio estimate over batches, which are long against the correlation.

    Returns
    -------
    result
        (λ₁, λ₂, 95 % half-width of λ₁); NaN if nothing was measured.
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
    """Return whether the first exponent is above its error bar and the growth is not that of shear.

    A vector also grows in regular motion, as ln t: by ln 2 over the second half, where chaos must have more than
    LEAST_GROWTH.

    Returns
    -------
    result
        True if chaotic.
    """
    first, _second, error = exponents(sums)
    later = 0.0
    for i in range(sums.shape[0] // 2, sums.shape[0]):
        later += sums[i, 1]
    return first > error and later > LEAST_GROWTH


@kernel
def fill_chaotic(sums, found):
    """Write to found (k,) whether each of several trajectories is, from sums (k, BATCHES, 3)."""
    for k in range(found.size):
        found[k] = is_chaotic(sums[k])


def are_chaotic(sums: Array) -> NDArray[np.bool_]:
    """Return whether each of several trajectories is, (k,), from sums (k, BATCHES, 3)."""
    found = np.zeros(len(sums), np.bool_)
    fill_chaotic(sums, found)
    return found


@kernel
def fill_exponents(sums, size, found):
    """Write to found (3, n) (λ₁, λ₂, 95 % half-width of λ₁) of rows in sets of so many each."""
    begin = 0
    for i in range(size.size):
        found[0, i], found[1, i], found[2, i] = exponents(sums[begin : begin + size[i]])
        begin += size[i]


def pooled(sums: Sequence[Array]) -> Array:
    """Return the exponents of several attractors, of each from several trajectories on it.

    From sums (trajectories, BATCHES, 3).

    Returns
    -------
    Array
        (λ₁, λ₂, 95 % half-width), (3, n).
    """
    rows = np.concatenate([each.reshape(-1, 3) for each in sums])
    found = np.zeros((3, len(sums)))
    fill_exponents(rows, np.array([each.size // 3 for each in sums]), found)
    return found


@kernel
def fill_standing(cells, status, impacts, first, left, leaks):
    """Fill what `standing` returns; left is zero before."""
    for i in range(cells.size):
        cell, leaked, last, since, before = cells[i], 0, 0, 0, 0
        for k in range(status.shape[1]):
            if status[cell, k] == Outcome.UNRESOLVED:
                left[i] += 1
            elif impacts[cell, k] > first[cell]:
                leaked += 1
                last = max(last, impacts[cell, k])
        for k in range(status.shape[1]):
            before += min(impacts[cell, k], last)
            if status[cell, k] == Outcome.UNRESOLVED:
                since += max(impacts[cell, k] - last, 0)
        leaks[i] = leaked > 0 and leaked * since < LEAKS_MISSED * before


def standing(cells: Counts, status: Counts, impacts: Counts, first: Counts) -> tuple[Counts, NDArray[np.bool_]]:
    """Return the number of unresolved samples in each of these cells (k,), and whether they may still settle.

    Derived from status and impacts (n_cells, count): others settled later than to begin with, within the first impacts
    (n_cells,), and the unresolved samples have not outlasted them by enough since.

    Were it the same leaking set, LEAKS_MISSED more would have left it by now, at the rate until the last one did.

    Returns
    -------
    tuple[Counts, NDArray[np.bool_]]
        Numbers (k,) of unresolved samples, and flags (k,).
    """
    left, leaks = np.zeros(cells.size, np.int64), np.zeros(cells.size, np.bool_)
    fill_standing(cells, status, impacts, first, left, leaks)
    return left, leaks
