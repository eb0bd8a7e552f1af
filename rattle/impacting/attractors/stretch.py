"""Follow chaotic motions in lanes, after their classification, and sum speeds and impulses of impacts (compiled)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import BATCHES
from rattle.flight.impact_law import impulse_of, velocity_before_reflection
from rattle.flight.lanes.block import (
    GROUP,
    GROUPS,
    LANES,
    NONE,
    ONCE,
    classify_contact_force_of_lanes,
    clear_block,
    prepare_flights,
    put_trajectory_on_lane,
)
from rattle.flight.lanes.stages import advance
from rattle.impacting.attractors.settle import is_certain_to_become_quiet
from rattle.impacting.map.iterate import lane_block_of_thread
from rattle.intensity.visit import COLUMNS, FASTEST, IMPULSE, ON_MINUS, ON_PLUS, SPEED, SQUARE, TIME
from rattle.numerics.compile import inline, kernel

CHUNK = 16  # number of flights between two checks of the lanes
# number of checks of one motion at strong damping; from the first to the last check about 1000 forcing periods pass
LOOKS = 4 * BATCHES


@inline
def add_impacts_to_sums(b, groups, speeds, squares, impulses, fastest):
    """Add the impact that ends each lane's last flight to the lane's sums, and update the lane's `fastest` speed."""
    for i in range(GROUP * groups):
        speed = abs(velocity_before_reflection(b.w[i]))
        speeds[i] += speed
        squares[i] += speed * speed
        impulses[i] += b.wall[i] * impulse_of(speed)
        fastest[i] = max(fastest[i], speed)


@kernel
def follow_and_sum_impacts(memory, lanes, cell, tau, v, checks, cells, sums, paths):
    """Follow motions (n,) that start at (tau, v), and sum over their impacts. Motion i ends after checks[i] checks.

    A check, after every CHUNK flights, also ends a motion that becomes quiet or stays in contact; its sums are NaN.
    `sums` (n, BATCHES, COLUMNS), zero at the start, has the columns of `rattle.intensity.visit.sum_impacts`. The checks
    of a motion are divided into BATCHES equal parts, and row j of the motion's sums holds the impacts of part j.
    `lanes` (4, LANES) is scratch memory. `paths` (2,) counts flights whose first impact needs a scan, and flights whose
    first impact needs the slower safe search.
    """
    speeds, squares, impulses, fastest = lanes[0], lanes[1], lanes[2], lanes[3]
    lanes[:] = 0.0
    b, fresh, groups = memory[0], NONE, GROUPS
    clear_block(b)
    while groups > 0:
        for i in range(GROUP * groups):
            k = b.who[i]
            if k >= 0:
                row = sums[k, int(b.looks[i] * BATCHES / checks[k])]
                row[TIME] += b.time[i]
                row[ON_PLUS] += b.n_plus[i]
                row[ON_MINUS] += b.n_minus[i]
                row[SPEED] += speeds[i]
                row[SQUARE] += squares[i]
                row[IMPULSE] += impulses[i]
                row[FASTEST] = max(row[FASTEST], fastest[i])
                b.time[i], b.n_plus[i], b.n_minus[i] = 0.0, 0.0, 0.0
                b.looks[i] += 1.0
                in_contact = b.stuck[i] > 0.0
                if b.wall[i] > 0.0:
                    in_contact |= is_certain_to_become_quiet(b, i, cells.quiet_invariant[cell[k]])
                if in_contact:
                    sums[k] = math.nan
                if in_contact or b.looks[i] >= checks[k]:
                    b.who[i], b.limit[i] = -1, -1.0
            if b.who[i] < 0 and fresh < cell.size:
                c = cell[fresh]
                put_trajectory_on_lane(
                    b, i, tau[fresh], v[fresh], cells.delta[c], cells.epsilon[c], cells.beta[c], math.inf
                )
                b.who[i] = fresh
                fresh += 1
        groups = prepare_flights(b, groups, fresh == cell.size)
        force = classify_contact_force_of_lanes(b, groups)
        lanes[:] = 0.0
        for _ in range(CHUNK):
            advance(memory, groups, ONCE, force, False, paths)
            add_impacts_to_sums(b, groups, speeds, squares, impulses, fastest)


def stretch(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], longer: NDArray[np.float64], cells: Any
) -> NDArray[np.float64]:
    """Return the sums over the impacts of chaotic motions (n,), which start at (tau, v).

    cell (n,): the number of each motion's cell in the record `cells`. longer (n,): the duration for which each motion
    is followed, relative to the duration at strong damping. The columns of the sums are those of
    `rattle.intensity.visit.sum_impacts`.

    Returns
    -------
    NDArray[np.float64]
        Sums (n, BATCHES, COLUMNS); NaN for a motion that becomes quiet or stays in contact.
    """
    sums, lanes = np.zeros((cell.size, BATCHES, COLUMNS)), np.zeros((4, LANES))
    follow_and_sum_impacts(
        lane_block_of_thread(), lanes, cell, tau, v, np.ceil(LOOKS * longer), cells, sums, np.zeros(2, np.int64)
    )
    return sums
