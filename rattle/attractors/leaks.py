"""Whether what is left of a cell's samples may still settle (compiled)."""

import numpy as np

from rattle.attractors.samples import LEFT
from rattle.numerics.compile import kernel

LEAKS_MISSED = 3.0  # a set that loses samples is left by none for so long with probability e^(−3)


@kernel
def standing(cells, status, impacts, first):
    """How many samples are left in each of these cells (k,), and whether they may still settle, from status and impacts
    (n_cells, count): others settled later than to begin with, within the first impacts (n_cells,), and what is left has
    not outlasted them by enough since.

    Were it the same leaking set, LEAKS_MISSED more would have left it by now, at the rate until the last one did.
    """
    left, leaks = np.zeros(cells.size, np.int64), np.zeros(cells.size, np.bool_)
    for i in range(cells.size):
        cell, leaked, last, since, before = cells[i], 0, 0, 0, 0
        for k in range(status.shape[1]):
            if status[cell, k] == LEFT:
                left[i] += 1
            elif impacts[cell, k] > first[cell]:
                leaked += 1
                last = max(last, impacts[cell, k])
        for k in range(status.shape[1]):
            before += min(impacts[cell, k], last)
            if status[cell, k] == LEFT:
                since += max(impacts[cell, k] - last, 0)
        leaks[i] = leaked > 0 and leaked * since < LEAKS_MISSED * before
    return left, leaks
