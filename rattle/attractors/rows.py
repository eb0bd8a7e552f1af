"""The rows of a table of attractors: sums over the samples of a cell that reach the same attractor (compiled)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.numerics.compile import inline, kernel

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


class AttractorRows(NamedTuple):
    """The rows (n,) of a table of attractors, ordered by cell, and within a cell by kind and number.

    Attributes
    ----------
    cell, kind
        Number of the cell, and the attractor's kind, an `Outcome`.
    number_in_kind
        Number of the attractor among the attractors of its cell and kind.
    first_sample
        Number of the first sample that reached the attractor. If none did, this is an arbitrary sample.
    sample_count
        Number of samples that reached the attractor.
    impacts
        Sum of the impacts of the samples that reached the attractor.
    watched
        Shortest time, in forcing periods, for which a sample that reached the attractor was followed; inf without one.
    """

    cell: Any
    kind: Any
    number_in_kind: Any
    first_sample: Any
    sample_count: Any
    impacts: Any
    watched: Any


@inline
def attractor_index_in_cell(kind, which, orbits):
    """Return an attractor's index in its cell: 0 if quiet, 1 + which if periodic, 1 + orbits + which if chaotic."""
    if kind == Outcome.QUIET:
        return 0
    return 1 + which if kind == Outcome.PERIODIC else 1 + orbits + which


@kernel
def fill_attractor_rows(kind, which, impacts, time, known, orbits, scratch, integers, watched, row):
    """Fill the columns of `AttractorRows`, and write the row of each sample to `row`.

    kind, which, impacts, time, known: as in `attractor_rows`. orbits: the largest number of orbits of a cell. scratch
    (2, most attractors of a cell): memory for the attractors of one cell. integers (6, n): receives the columns `cell`
    to `impacts` in order, and must be zero before. watched (n,): receives the column `watched`.

    Returns
    -------
    int
        Number of filled rows.
    """
    at, seen, n = scratch[0], scratch[1], 0
    cells, places = known.size, at.size
    count = kind.size // max(cells, 1)
    for c in range(cells):
        seen[:] = -1
        for i in range(c * count, (c + 1) * count):
            p = attractor_index_in_cell(kind[i], which[i], orbits) if kind[i] != Outcome.UNDECIDED else places - 1
            if seen[p] < 0:
                seen[p] = i
            row[i] = p
        for j in range(known[c]):
            if seen[1 + j] < 0:
                seen[1 + j] = kind.size - 1
        for p in range(places):
            if seen[p] >= 0:
                at[p] = n
                integers[0, n] = c
                integers[1, n] = (
                    Outcome.QUIET
                    if p == 0
                    else Outcome.PERIODIC
                    if p <= orbits
                    else Outcome.CHAOTIC
                    if p < places - 1
                    else Outcome.UNDECIDED
                )
                integers[2, n] = 0 if p == 0 or p == places - 1 else p - 1 if p <= orbits else p - 1 - orbits
                integers[3, n] = seen[p]
                watched[n] = np.inf
                n += 1
        for i in range(c * count, (c + 1) * count):
            r = at[row[i]]
            row[i] = r
            integers[4, r] += 1
            integers[5, r] += impacts[i]
            watched[r] = min(watched[r], time[i])
    return n


def attractor_rows(
    kind: Counts, which: Counts, impacts: Counts, time: Array, known: Counts, row: Counts
) -> AttractorRows:
    """Return the rows of all attractors that samples reach.

    The samples (n,) are ordered by cell, and every cell has the same number of samples.

    kind (n,): the kind of each sample's attractor.
    which (n,): the attractor's number among the attractors of its kind in its cell.
    impacts, time (n,): the impacts and forcing periods for which each sample was followed.
    known (n_cells,): cell i has rows also for its orbits 0 to known[i] − 1, even if no sample reached them.
    row (n,): receives the row of each sample.

    Returns
    -------
    AttractorRows
        Columns of the table.
    """
    orbits = int(max(which[kind == Outcome.PERIODIC].max(initial=-1) + 1, known.max(initial=0)))
    sets = int(which[kind == Outcome.CHAOTIC].max(initial=-1) + 1)
    most = kind.size + int(known.sum())  # room for all rows, because each row has a sample or a known orbit
    integers, watched, scratch = (
        np.zeros((6, most), np.int64),
        np.zeros(most),
        np.zeros((2, 2 + orbits + sets), np.int64),
    )
    n = fill_attractor_rows(kind, which, impacts, time, known, orbits, scratch, integers, watched, row)
    return AttractorRows._make([*integers[:, :n], watched[:n]])
