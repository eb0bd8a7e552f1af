"""Simple cell mapping: the map of cells that the impact map induces, and its periodic groups (compiled).

Source: C. S. Hsu, Cell-to-Cell Mapping (Springer 1987), chapters 8 and 11.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.contact_phase import is_bounce_captured
from rattle.flight.forcing import DRIFT, contact_force, sine_cosine_at
from rattle.numerics.compile import kernel

# Values in place of the number of a cell's group. UNSEEN: no chain has met the cell yet. ON_THE_WAY: the cell is in the
# chain that is being followed.
UNSEEN, ON_THE_WAY = -1, -2


class PhaseSpeedBox(NamedTuple):
    """A box of states, with its lower and upper ends in phase and in speed."""

    tau_low: float
    tau_high: float
    v_low: float
    v_high: float


@kernel
def find_cell_numbers(tau, v, n, box, delta, epsilon, capture, cell):
    """Write the number of the cell that holds each state to `cell`.

    The number is row-major (v, τ) among the n × n cells of the box, n² if the state is certain to become quiet, −1
    outside the box. capture: the largest v³/g (speed v, contact force g) at which becoming quiet is certain.
    """
    for i in range(tau.size):
        sine, cosine = sine_cosine_at(tau[i])
        speed = v[i]
        if is_bounce_captured(speed, contact_force(sine, cosine, delta, epsilon, DRIFT), capture):
            cell[i] = n * n
        elif not (box.v_low <= speed < box.v_high and box.tau_low <= tau[i] < box.tau_high):
            cell[i] = -1
        else:
            row = int((speed - box.v_low) / (box.v_high - box.v_low) * n)
            column = int((tau[i] - box.tau_low) / (box.tau_high - box.tau_low) * n)
            cell[i] = min(row, n - 1) * n + min(column, n - 1)


@kernel
def find_periodic_groups(image, group, steps):
    """Follow every cell of the map to the periodic group in which it ends.

    For each cell the function writes the number of its group to `group`, and the number of steps of the map until the
    group to `steps`; cells of a group have 0 steps. `group` must hold UNSEEN everywhere before. One pass suffices: a
    chain of images is followed until it meets a cell whose group is known, or one of its own cells. Then the results
    of all its cells are written. While a chain is followed, `steps` holds the positions of its cells in the chain.

    Returns
    -------
    int
        Number of groups. They are numbered in the order in which they are found.
    """
    groups = 0
    for start in range(image.size):
        cell, length = start, 0
        while group[cell] == UNSEEN:
            group[cell], steps[cell] = ON_THE_WAY, length
            cell, length = image[cell], length + 1
        if length == 0:
            continue
        if group[cell] == ON_THE_WAY:  # the chain has closed, so its cells from here on are a new group
            number, end = groups, steps[cell]
            groups += 1
        else:
            number, end = group[cell], length + steps[cell]
        cell = start
        for position in range(length):
            group[cell], steps[cell] = number, max(end - position, 0)
            cell = image[cell]
    return groups


def periodic_groups_of_cell_map(
    image: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the periodic groups of a map of cells 0 … n − 1, numbered in the order of their first cells.

    image (n,): the cell to which the map takes each cell.

    Returns
    -------
    tuple of ndarray of int
        Group of each cell (n,), steps of each cell to its group (n,), and the first cell of each group.
    """
    group, steps = np.full(image.size, UNSEEN), np.zeros(image.size, np.int64)
    n_groups = find_periodic_groups(image, group, steps)
    on_group = np.flatnonzero(steps == 0)
    first = np.full(n_groups, image.size)
    np.minimum.at(first, group[on_group], on_group)
    order = np.argsort(first)
    return np.argsort(order)[group], steps, first[order]
