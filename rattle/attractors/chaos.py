"""Lyapunov exponents with error bars, from batch sums of a trajectory's tangent vector (compiled).

The module also decides which chaotic trajectories lie on one attractor, by comparing the boxes of the (τ, v) plane that
they visited.

The tangent vector is kept in (t, v²/2), where a flight of duration s has determinant e^(−δs). In these coordinates
λ₁ + λ₂ = −δ holds at finite times too, and tests every tangent matrix. λ₁ comes from the growth of one vector. After
re-orthonormalisation the second diagonal entry of the triangular factor is the determinant over the first entry, so λ₂
needs no second vector. Exponents are per forcing period.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.numerics.compile import inline, kernel

SAME_FOOTPRINT = 0.2  # trajectories are on one attractor if both visit more than this fraction of the smaller bitmap
Array = NDArray[np.float64]
Counts = NDArray[np.int64]
BATCHES = 32
# No further samples are expected to leave a chaotic set if, at the rate so far, this many should have left since the
# last sample left, but none did. By chance this happens with probability e^(−3).
LEAKS_MISSED = 3.0
LEAST_GROWTH = 8.0  # least growth of ln(length of the tangent) over the second half of the batches, in chaotic motion
T_95 = 2.0395  # 97.5 % point of Student's t with 31 degrees of freedom
PAIRS, FOURS, EIGHTS, SUM = (np.uint64(int(x * 8, 16)) for x in ("55", "33", "0f", "01"))
ONE, TWO, FOUR, TOP = (np.uint64(x) for x in (1, 2, 4, 56))


@inline
def count_bits(bits):
    """Return the number of bits that are 1 in a 64-bit word, by sums over growing groups of bits, without branches."""
    bits = bits - ((bits >> ONE) & PAIRS)
    bits = (bits & FOURS) + ((bits >> TWO) & FOURS)
    return np.int64((((bits + (bits >> FOUR)) & EIGHTS) * SUM) >> TOP)


@inline
def do_bitmaps_overlap(boxes, i, j):
    """Return whether bitmaps i and j share more than the fraction SAME_FOOTPRINT of the smaller bitmap's boxes."""
    in_i, in_j, shared = 0, 0, 0
    for k in range(boxes.shape[1]):
        in_i += count_bits(boxes[i, k])
        in_j += count_bits(boxes[j, k])
        shared += count_bits(boxes[i, k] & boxes[j, k])
    return shared > SAME_FOOTPRINT * min(in_i, in_j)


@kernel
def write_attractor_numbers(boxes, size, group):
    """Write the number of the attractor of each visited-cell bitmap to group (k,).

    `boxes` (k, GRID) holds the bitmaps and is overwritten; parameter cell i has size[i] consecutive bitmaps. Two
    bitmaps of one parameter cell are joined if they share more than the fraction SAME_FOOTPRINT of the smaller bitmap,
    until no two can be joined. The number of an attractor is the index of its first bitmap among those of its cell.
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
                    if group[i] != i - begin or group[j] != j - begin or not do_bitmaps_overlap(boxes, i, j):
                        continue
                    for k in range(boxes.shape[1]):
                        boxes[j, k] |= boxes[i, k]
                    for k in range(i, end):
                        group[k] = j - begin if group[k] == i - begin else group[k]
                    joined = True
        begin = end


@kernel
def lyapunov_exponents_from_batches(sums):
    """Return the Lyapunov exponents from batch sums: a row of time, ln stretch and ln|det| for each batch.

    The error bar is that of a ratio estimate over batches, which are long compared with the correlation time.

    Returns
    -------
    tuple[float, float, float]
        λ₁, λ₂ and the 95 % half-width of λ₁; NaN if fewer than two batches were measured.
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
    """Return whether a trajectory is chaotic: λ₁ exceeds its error bar, and tangents grow faster than by shear.

    sums: a row of time, ln stretch and ln|det| for each batch, one of BATCHES successive parts of a trajectory. In
    regular motion the logarithm of a tangent vector's length grows as ln t, by ln 2 over the second half of the
    batches. In chaotic motion it must grow by more than LEAST_GROWTH over that half.

    Returns
    -------
    bool
        True if λ₁ exceeds its error bar, and tangents grow by more than LEAST_GROWTH.
    """
    first, _second, error = lyapunov_exponents_from_batches(sums)
    later = 0.0
    for i in range(sums.shape[0] // 2, sums.shape[0]):
        later += sums[i, 1]
    return first > error and later > LEAST_GROWTH


@kernel
def fill_chaos_flags(sums, found):
    """Write to found (k,) whether each trajectory is chaotic.

    sums (k, BATCHES, 3): the time, ln stretch and ln|det| of each batch, one of successive parts of a trajectory.
    """
    for k in range(found.size):
        found[k] = is_chaotic(sums[k])


def are_chaotic(sums: Array) -> NDArray[np.bool_]:
    """Return flags (k,) of chaotic trajectories. sums (k, BATCHES, 3): time, ln stretch and ln|det| of each batch."""
    found = np.zeros(len(sums), np.bool_)
    fill_chaos_flags(sums, found)
    return found


@kernel
def fill_exponents(sums, size, found):
    """Write λ₁, λ₂ and the 95 % half-width of λ₁ of n attractors to found (3, n).

    sums (rows, 3): batch sums of time, ln stretch and ln|det|. Attractor i has size[i] consecutive rows.
    """
    begin = 0
    for i in range(size.size):
        found[0, i], found[1, i], found[2, i] = lyapunov_exponents_from_batches(sums[begin : begin + size[i]])
        begin += size[i]


def pool_exponents(sums: Sequence[Array]) -> Array:
    """Return the Lyapunov exponents of n attractors, pooled over several trajectories on each attractor.

    Parameters
    ----------
    sums : sequence of ndarray, (trajectories, BATCHES, 3)
        Batch sums of time, ln stretch and ln|det| for each attractor.

    Returns
    -------
    ndarray, (3, n)
        λ₁, λ₂ and the 95 % half-width of λ₁, per forcing period.
    """
    rows = np.concatenate([each.reshape(-1, 3) for each in sums])
    found = np.zeros((3, len(sums)))
    fill_exponents(rows, np.array([each.size // 3 for each in sums]), found)
    return found


@kernel
def fill_unresolved_counts(cells, status, impacts, first, unresolved, leaks):
    """Fill the arrays that `count_unresolved` returns, in a compiled loop.

    unresolved (k,): receives the numbers of unresolved samples; must be zero before. leaks (k,): receives the flags.
    """
    for i in range(cells.size):
        cell, leaked, last, since, before = cells[i], 0, 0, 0, 0
        for k in range(status.shape[1]):
            if status[cell, k] == Outcome.UNRESOLVED:
                unresolved[i] += 1
            elif impacts[cell, k] > first[cell]:
                leaked += 1
                last = max(last, impacts[cell, k])
        for k in range(status.shape[1]):
            before += min(impacts[cell, k], last)
            if status[cell, k] == Outcome.UNRESOLVED:
                since += max(impacts[cell, k] - last, 0)
        leaks[i] = leaked > 0 and leaked * since < LEAKS_MISSED * before


def count_unresolved(cells: Counts, status: Counts, impacts: Counts, first: Counts) -> tuple[Counts, NDArray[np.bool_]]:
    """Return the numbers (k,) of unresolved samples in these cells, and flags of cells whose number may still fall.

    A cell is flagged if some of its samples reached attractors after the first stage, and further samples are expected
    to reach one. The expectation is a rate: the samples that reached attractors per impact, up to the latest such
    event. If at this rate LEAKS_MISSED or more samples should have followed since that event, but none did, the cell is
    not flagged.

    Parameters
    ----------
    cells : ndarray of int, (k,)
        Numbers of the cells.
    status, impacts : ndarray of int, (n_cells, count)
        Outcome and impacts of each sample.
    first : ndarray of int, (n_cells,)
        Limit of impacts of a sample in the first stage.

    Returns
    -------
    tuple of ndarray, (k,)
        Numbers of unresolved samples, and flags of cells where more of them are expected to reach an attractor.
    """
    unresolved, leaks = np.zeros(cells.size, np.int64), np.zeros(cells.size, np.bool_)
    fill_unresolved_counts(cells, status, impacts, first, unresolved, leaks)
    return unresolved, leaks
