"""The rows of a table of attractors: what the samples of a cell that go to the same one have in common (compiled)."""

from typing import Any, NamedTuple

import numpy as np

from rattle.numerics.compile import inline, kernel

QUIET, PERIODIC, CHAOTIC, UNDECIDED = range(1, 5)


class Rows(NamedTuple):
    """Rows (n,), cell by cell, in each by kind and number: its cell, kind, number among those of its cell and kind, the
    first of its samples (the last of all, if it has none), how many there are, the impacts of all and the least time of
    one.
    """

    cell: Any
    kind: Any
    which: Any
    one: Any
    number: Any
    impacts: Any
    watched: Any


@inline
def place_of(kind, which, orbits):
    """Where a cell's attractor stands among all that it might have, if so many are orbits."""
    if kind == QUIET:
        return 0
    return 1 + which if kind == PERIODIC else 1 + orbits + which


@kernel
def rows_of(kind, which, impacts, time, known, row):
    """The `Rows` of samples, as many in each cell, cell by cell, with their kind, the number of their attractor among
    those of its cell and kind, impacts and time; every cell also has a row for each of so many known orbits. row is
    filled with that of every sample.
    """
    cells, orbits, sets = known.size, 0, 0
    for i in range(kind.size):
        orbits = max(orbits, which[i] + 1 if kind[i] == PERIODIC else 0)
        sets = max(sets, which[i] + 1 if kind[i] == CHAOTIC else 0)
    most = 0
    for c in range(cells):
        orbits = max(orbits, known[c])
        most += 2 + sets + known[c]
    most = min(most + cells * orbits, kind.size + most)
    places, count = 2 + orbits + sets, kind.size // max(cells, 1)
    whole, watched, n = np.zeros((6, most), np.int64), np.empty(most), 0
    at, seen = np.empty(places, np.int64), np.zeros(places, np.int64)
    for c in range(cells):
        seen[:] = -1
        for i in range(c * count, (c + 1) * count):
            p = place_of(kind[i], which[i], orbits) if kind[i] != UNDECIDED else places - 1
            if seen[p] < 0:
                seen[p] = i
            row[i] = p
        for j in range(known[c]):
            if seen[1 + j] < 0:
                seen[1 + j] = kind.size - 1
        for p in range(places):
            if seen[p] >= 0:
                at[p] = n
                whole[0, n] = c
                whole[1, n] = QUIET if p == 0 else PERIODIC if p <= orbits else CHAOTIC if p < places - 1 else UNDECIDED
                whole[2, n] = 0 if p == 0 or p == places - 1 else p - 1 if p <= orbits else p - 1 - orbits
                whole[3, n] = seen[p]
                watched[n] = np.inf
                n += 1
        for i in range(c * count, (c + 1) * count):
            r = at[row[i]]
            row[i] = r
            whole[4, r] += 1
            whole[5, r] += impacts[i]
            watched[r] = min(watched[r], time[i])
    return Rows(whole[0, :n], whole[1, :n], whole[2, :n], whole[3, :n], whole[4, :n], whole[5, :n], watched[:n])
