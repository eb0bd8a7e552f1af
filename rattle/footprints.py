"""Which chaotic trajectories are on one attractor, by the boxes of the (τ, v) plane that they visited (compiled)."""

import numpy as np
from numpy.typing import NDArray

from rattle.numerics.compile import inline, kernel

SAME_FOOTPRINT = 0.2  # two trajectories that share this much of the smaller footprint are on one attractor


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
    return [[int(i) for i in np.flatnonzero(group == first)] for first in np.unique(group)]
