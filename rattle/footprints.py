"""Which chaotic trajectories are on one attractor, by the boxes of the (τ, v) plane that they visited (compiled)."""

import numpy as np
from numpy.typing import NDArray

from rattle._compile import kernel

SAME_FOOTPRINT = 0.2  # two trajectories that share this much of the smaller footprint are on one attractor


@kernel
def overlap(a, b):
    """True if two footprints, rows of bits, share enough boxes; different attractors are disjoint sets."""
    in_a, in_b, shared = 0, 0, 0
    for k in range(a.size):
        for bits, j in ((a[k], 0), (b[k], 1), (a[k] & b[k], 2)):
            n = 0
            while bits:
                bits &= bits - np.uint64(1)
                n += 1
            in_a += n if j == 0 else 0
            in_b += n if j == 1 else 0
            shared += n if j == 2 else 0
    return shared > SAME_FOOTPRINT * min(in_a, in_b)


@kernel
def group_numbers(footprints):
    """The group of each footprint (n, GRID), by the first of its members: those that overlap the union of their group.

    Groups that overlap are joined, until none do.
    """
    n = footprints.shape[0]
    group, boxes = np.arange(n), footprints.copy()
    joined = True
    while joined:
        joined = False
        for i in range(n):
            for j in range(i):
                if group[i] == i and group[j] == j and overlap(boxes[i], boxes[j]):
                    boxes[j] |= boxes[i]
                    for k in range(i, n):
                        group[k] = j if group[k] == i else group[k]
                    joined = True
    return group


def groups_of(footprints: NDArray[np.uint64]) -> list[list[int]]:
    """Group footprints (n, GRID) that overlap, transitively, with the union of their group: lists of indices."""
    group = group_numbers(footprints)
    return [[int(i) for i in np.flatnonzero(group == first)] for first in np.unique(group)]
