"""Sums over the impacts of a motion with contact phases, whose chatters have infinitely many impacts.

A run of impacts on one wall that ends in contact counts as one impact, as in labels, and contributes its largest speed
to the mean speed. Squares of speeds, and impulses, are summed over all impacts of the run.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.intensity.impacts import collect_impacts
from rattle.intensity.visit import (
    COLUMNS,
    CONTACT,
    FASTEST,
    IMPULSE,
    ON_MINUS,
    ON_PLUS,
    SPEED,
    SQUARE,
    TIME,
    Impacts,
    write_impacts_of_motion,
)
from rattle.numerics.compile import kernel
from rattle.orbits.return_map import point_of_cell


@kernel
def list_impacts_in_cell(
    cell: int, tau: float, v: float, returns: int, periods: float, cells: Any, impacts: Impacts
) -> tuple[int, float, float, int]:
    """Follow a motion in cell number `cell`, as `write_impacts_of_motion` does, and return the same tuple."""
    return write_impacts_of_motion(tau, v, returns, periods, point_of_cell(cell, cells), impacts)


def _list_impacts_of_cell(
    cell: int, cells: Any, tau: float, v: float, returns: int, periods: float, arrays: Impacts
) -> Any:
    return list_impacts_in_cell(cell, tau, v, returns, periods, cells, arrays)


def collect_impacts_in_cell(
    cell: int, cells: Any, tau: float, v: float, returns: int, periods: float
) -> tuple[int, float, float, Impacts]:
    """Follow a motion in the cell with the number `cell`; return its status, final state and impacts."""
    return collect_impacts(tau, v, returns, periods, partial(_list_impacts_of_cell, cell, cells))


def sum_impacts_with_contacts(impacts: Impacts, m: int) -> NDArray[np.float64]:
    """Return the sums (COLUMNS,) over the impacts of one period of a motion with contact phases.

    Parameters
    ----------
    impacts : Impacts
        All impacts of the period, beginning with any of them.
    m : int
        Number of forcing periods in the period.

    Returns
    -------
    ndarray, (COLUMNS,)
        The sums of `rattle.intensity.visit.sum_impacts`, in which each run that ends in contact counts as one impact.
    """
    held = np.flatnonzero(impacts.duration > 0.0)
    first = held[-1] + 1 if held.size else 0  # begin the period after a contact phase, so that no run is cut
    wall, speed, duration, impulse = (
        np.roll(x, -first) for x in (impacts.wall, impacts.speed, impacts.duration, impacts.impulse)
    )
    starts = np.flatnonzero(np.append(True, (wall[1:] != wall[:-1]) | (duration[:-1] > 0.0)))
    ends = np.append(starts[1:], wall.size) - 1
    merged = duration[ends] > 0.0
    count = np.where(merged, 1, ends - starts + 1)
    total = np.where(merged, np.maximum.reduceat(speed, starts), np.add.reduceat(speed, starts))
    sums = np.zeros(COLUMNS)
    sums[TIME], sums[SPEED], sums[SQUARE] = m, total.sum(), np.square(speed).sum()
    sums[ON_PLUS], sums[ON_MINUS] = count[wall[starts] > 0].sum(), count[wall[starts] < 0].sum()
    sums[CONTACT], sums[IMPULSE], sums[FASTEST] = duration.sum(), (wall * impulse).sum(), speed.max()
    return sums
