"""Which chaotic trajectories are on one attractor, by the boxes of the (τ, v) plane that they visited."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

SAME_FOOTPRINT = 0.2  # two trajectories that share this much of the smaller footprint are on one attractor


def _boxes(footprint: NDArray[np.uint64]) -> Any:
    return np.bitwise_count(footprint).sum()


def _overlap(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> bool:
    """Different attractors are disjoint sets."""
    return bool(_boxes(a & b) > SAME_FOOTPRINT * min(_boxes(a), _boxes(b)))


def groups_of(footprints: NDArray[np.uint64]) -> list[list[int]]:
    """Group footprints (n, GRID) that overlap, transitively, with the union of their group: lists of indices."""
    groups: list[tuple[list[int], NDArray[np.uint64]]] = [([i], each) for i, each in enumerate(footprints)]
    joined = True
    while joined:
        joined, rest = False, groups
        groups = []
        for members, boxes in rest:
            for i, (others, theirs) in enumerate(groups):
                if _overlap(boxes, theirs):
                    groups[i] = (sorted(others + members), boxes | theirs)
                    joined = True
                    break
            else:
                groups.append((members, boxes))
    return [members for members, _ in groups]
