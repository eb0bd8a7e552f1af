"""Join chaotic attractors of neighbouring cells whose visited-cell bitmaps (footprints) overlap."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import SAME_FOOTPRINT, count_bits
from rattle.attractors.classify import create_trajectories
from rattle.attractors.recurrence import mark_states_in_bitmaps
from rattle.attractors.samples import GRID
from rattle.numerics.compile import kernel

#: Number of impacts that mark the first footprint of an attractor. Footprints of this length overlap for 99 % of the
#: pairs of attractors that are one motion, and for no other pair.
STRETCH = 128
#: Number of impacts that mark the second footprint of an attractor. If the first footprints of two attractors do not
#: overlap, their second footprints are compared.
LONGER = 2048


@kernel
def write_overlaps(one, other, prints, overlap):
    """Write to overlap[i] whether footprints number one[i] and other[i] overlap.

    Two footprints overlap if their common visited cells are more than the share SAME_FOOTPRINT of the visited cells of
    the smaller footprint. prints (k, GRID): all footprints, which are visited-cell bitmaps.
    """
    for i in range(one.size):
        in_one, in_other, shared = 0, 0, 0
        for row in range(prints.shape[1]):
            a, b = prints[one[i], row], prints[other[i], row]
            in_one += count_bits(a)
            in_other += count_bits(b)
            shared += count_bits(a & b)
        overlap[i] = shared > SAME_FOOTPRINT * min(in_one, in_other)


def pairs_with_overlapping_footprints(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], shape: tuple[int, int], cells: Any
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of chaotic attractors in neighbouring cells whose visited-cell bitmaps overlap.

    cell (k,): the cells of the attractors, in rising order. tau, v (k,): a state on each attractor. shape: numbers of
    rows and columns of the grid. cells: the parameters of all cells, as kernels take them.

    Returns
    -------
    tuple[NDArray[np.int64], NDArray[np.int64]]
        The numbers (pairs,) of the first and of the second attractor of each pair.
    """
    prints = np.zeros((cell.size, GRID), np.uint64)
    states = create_trajectories(cell, tau, v, 0)
    mark_states_in_bitmaps(np.arange(cell.size), STRETCH, cells, states, prints)
    ones, others = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for step, inside in ((1, cell % shape[1] < shape[1] - 1), (shape[1], cell < (shape[0] - 1) * shape[1])):
        first, end = (np.searchsorted(cell, cell + step, side) for side in ("left", "right"))
        number = np.where(inside, end - first, 0)
        one = np.repeat(np.arange(cell.size), number)
        ones.append(one)
        others.append(np.arange(one.size) - np.repeat(np.cumsum(number) - number, number) + first[one])
    one, other = np.concatenate(ones), np.concatenate(others)
    overlap = np.zeros(one.size, np.bool_)
    write_overlaps(one, other, prints, overlap)
    apart = np.flatnonzero(~overlap)
    again = np.unique(np.append(one[apart], other[apart]))
    longer = np.zeros((again.size, GRID), np.uint64)
    mark_states_in_bitmaps(again, LONGER, cells, states, longer)
    prints[again] = longer
    later = np.zeros(apart.size, np.bool_)
    write_overlaps(one[apart], other[apart], prints, later)
    overlap[apart] = later
    return one[overlap], other[overlap]
