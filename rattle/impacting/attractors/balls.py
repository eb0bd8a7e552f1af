"""Compute the radii of capture regions in lanes, with a group of lanes for each region (compiled).

A region has a stable periodic point as its centre. A lane follows the state at one radius and in one direction from the
centre. The direction fails at this radius if the state does not meet the conditions of `rattle.attractors.ball` over
the orbit's period. The radius of the region is the largest tried radius at which no direction fails. A radius that is
too large mostly fails in many directions. So a group first tries four directions at four radii, and then all directions
at the largest radius that passed.
"""

import math

import numpy as np

from rattle.attractors.ball import DIRECTIONS, LARGEST, SMALLEST, is_contraction, state_on_ellipse
from rattle.flight.forcing import DRIFT, sine_cosine_at
from rattle.flight.impact_law import velocity_before_reflection
from rattle.flight.lanes.block import (
    GROUP,
    GROUPS,
    LANES,
    NONE,
    ONCE,
    SMOOTH,
    classify_contact_force_of_lanes,
    clear_block,
    put_trajectory_on_lane,
    stop_lane_at_limit,
)
from rattle.flight.lanes.stages import advance
from rattle.flight.law import LONGEST_DECAY, decay_remainder64, flight_from_sine_cosine
from rattle.flight.tangent import flight_tangent
from rattle.numerics.compile import inline, kernel

# Number of directions that are tried at once, one on each lane of a group: DIRECTIONS on the ellipse of the tried
# radius, and DIRECTIONS on the ellipse of half that radius.
ALL = 2 * DIRECTIONS
FEW = 4  # the first attempt for a region tries FEW directions, a quarter turn apart, at FEW radii
RADII = int(math.log2(LARGEST / SMALLEST)) + 1  # number of radii to try, each half the previous one

#: For each lane: w, sine and cosine of 2πτ at the departure of its flight, 1 − e^(−δs) of the flight (`lost`), and the
#: tangent matrix [[a, b], [c, d]] of its flights so far. For each group: the number of its centre (`of`, −1: none), the
#: number of halvings of the radius (`level`), and whether it tries few directions at several radii (`few`).
WORK = np.dtype(
    [(name, np.float64, (LANES,)) for name in ("w", "sin0", "cos0", "lost", "a", "b", "c", "d")]
    + [(name, np.int64, (int(GROUPS),)) for name in ("of", "level", "few")]
)


@inline
def direction_and_halvings(lane, few):
    """Return the direction and the radius that a lane of a group tries.

    lane: number of the lane within its group, from 0. few: True if the group tries four directions at four radii, False
    if it tries all directions at one radius.

    Returns
    -------
    tuple of int
        The number of the direction, and a number k: the radius of the lane is the largest radius of the group / 2^k.
    """
    return (lane % FEW * (ALL // FEW), lane // FEW) if few else (lane, 0)


@inline
def load_cell_parameters_onto_lanes(b, group, i, centres, cells):
    """Load into all lanes of a group the parameters of the cell in which capture region i of `centres` lies."""
    first, cell = group * GROUP, centres.cell[i]
    put_trajectory_on_lane(b, first, 0.0, 1.0, cells.delta[cell], cells.epsilon[cell], cells.beta[cell], -1.0)
    for field in range(len(b.carried)):
        for lane in range(first + 1, first + GROUP):
            b.carried[field, lane] = b.carried[field, first]
    for field in range(len(b.carried_)):
        for lane in range(first + 1, first + GROUP):
            b.carried_[field, lane] = b.carried_[field, first]


@inline
def load_states_onto_lanes(b, work, group, i, level, few, centres):
    """Put on each lane of a group the state that the lane tries next around the centre of capture region i.

    level: number of halvings; the largest radius of the group is LARGEST / 2^level. few: True if the group tries four
    directions at four radii, False if it tries all directions at one radius.
    """
    for j in range(GROUP):
        lane = group * GROUP + j
        direction, halvings = direction_and_halvings(j, few)
        tau, v = state_on_ellipse(centres, i, direction, math.ldexp(LARGEST, -level - halvings))
        b.sin0[lane], b.cos0[lane] = sine_cosine_at(tau)
        b.tau[lane], b.w[lane], b.wall[lane] = tau, -v, 1.0
        b.n_plus[lane], b.n_minus[lane], b.stuck[lane] = 0.0, 0.0, 0.0
        b.limit[lane] = centres.n_plus[i] if v > 0.0 else -1.0
        work.a[lane], work.b[lane], work.c[lane], work.d[lane] = 1.0, 0.0, 0.0, 1.0


@inline
def advance_lanes_by_flight(memory, work, groups, force, paths):
    """Advance the state of every unfinished lane by one flight, and multiply the lane's tangent matrix by the flight's.

    force: the result of `classify_contact_force_of_lanes`, SMOOTH, ROUGH or ARCS, which decides how first impacts are
    guessed and proved. `work` holds the tangent matrices. `paths` (2,) counts flights whose first impact needs a scan,
    and flights whose first impact needs the slower safe search.
    """
    b = memory[0]
    for i in range(GROUP * groups):
        work.w[i], work.sin0[i], work.cos0[i], b.time[i] = b.w[i], b.sin0[i], b.cos0[i], 0.0
    advance(memory, groups, ONCE, force, False, paths)
    for i in range(GROUP * groups):
        x = b.delta[i] * b.time[i]
        work.lost[i] = x * (1.0 - x * decay_remainder64(min(x, LONGEST_DECAY)))
    for i in range(GROUP * groups):
        if b.delta[i] * b.time[i] > LONGEST_DECAY:
            work.lost[i] = -math.expm1(-b.delta[i] * b.time[i])
    for i in range(GROUP * groups):
        flight = flight_from_sine_cosine(work.w[i], work.sin0[i], work.cos0[i], b.delta[i], b.epsilon[i], DRIFT)
        w1 = velocity_before_reflection(b.w[i])
        k00, k01, k10, k11 = flight_tangent(w1, work.lost[i], b.sin0[i], b.cos0[i], flight)
        flew, a0, b0, c0, d0 = b.time[i] > 0.0, work.a[i], work.b[i], work.c[i], work.d[i]
        work.a[i] = k00 * a0 + k01 * c0 if flew else a0
        work.b[i] = k00 * b0 + k01 * d0 if flew else b0
        work.c[i] = k10 * a0 + k11 * c0 if flew else c0
        work.d[i] = k10 * b0 + k11 * d0 if flew else d0


@inline
def stop_lanes_with_excess_impacts(b, group, most):
    """Stop the lanes of a group with more than `most` impacts on Σ⁻, and return whether some lane still flies."""
    left = False
    for lane in range(group * GROUP, (group + 1) * GROUP):
        if b.n_minus[lane] > most:
            b.limit[lane] = -1.0
        left |= not stop_lane_at_limit(b, lane)
    return left


@inline
def meets_capture_conditions(b, work, lane, i, centres):
    """Return whether a lane's motion, which starts on a tried ellipse around centre i, meets the capture conditions.

    Returns
    -------
    bool
        True if the motion made as many impacts on each wall as the periodic orbit of capture region i, and the motion's
        tangent map contracts.
    """
    arrived = b.n_plus[lane] == centres.n_plus[i] and b.n_minus[lane] == centres.n_minus[i]
    # the tangent matrix in (τ, v): two of its elements change sign, because v = −w at both ends
    a, b_, c, d = work.a[lane], -work.b[lane], -work.c[lane], work.d[lane]
    return arrived and is_contraction(a, b_, c, d, centres.m00[i], centres.m01[i], centres.m11[i])


@inline
def halvings_without_failure(b, work, group, i, level, few, centres):
    """Return the k of the largest radius at which no direction of a group failed; the radii are LARGEST / 2^k.

    level: the k of the largest radius that the group tried. few: True if the group tried four directions at
    four radii, False if it tried all directions at one radius.

    Returns
    -------
    int
        k. If at every tried radius some direction failed, it is the k of half the smallest tried radius.
    """
    radii = FEW if few else 1
    for halvings in range(radii):
        good = True
        for j in range(GROUP):
            if direction_and_halvings(j, few)[1] == halvings:
                good = good and meets_capture_conditions(b, work, group * GROUP + j, i, centres)
        if good:
            return level + halvings
    return level + radii


@kernel
def write_outer_radii(memory, work, centres, cells, paths):
    """Write to `centres.radius` the largest tried radius that meets the capture conditions; 0 if no radius does.

    A radius meets them if `meets_capture_conditions` is True for the motions from all directions of its ellipse.
    Centres whose radius is 0 before the call are skipped.

    The written radius is that of the outer ellipse, twice that of the capture region (`CaptureCentres.radius`).
    `work` is scratch memory (`WORK`). `paths` (2,) counts flights whose first impact needs a scan, and flights whose
    first impact needs the slower safe search.
    """
    b, n, fresh, force = memory[0], centres.radius.size, NONE, SMOOTH
    of, level, few = work.of, work.level, work.few
    of[:] = -1
    clear_block(b)
    while True:
        groups, begun = NONE, False
        for group in range(GROUPS):
            i = of[group]
            if i >= 0:
                if stop_lanes_with_excess_impacts(b, group, centres.n_minus[i]):
                    groups = group + 1
                    continue
                tried = level[group]
                level[group] = halvings_without_failure(b, work, group, i, tried, few[group], centres)
                if not few[group] and level[group] == tried:
                    centres.radius[i], of[group] = math.ldexp(LARGEST, -tried), -1
                elif level[group] >= RADII:
                    centres.radius[i], of[group] = 0.0, -1
                else:
                    few[group] = not few[group] or level[group] == tried + FEW
            while of[group] < 0 and fresh < n:
                if centres.radius[fresh] > 0.0:
                    of[group], level[group], few[group] = fresh, 0, True
                    load_cell_parameters_onto_lanes(b, group, fresh, centres, cells)
                fresh += 1
            if of[group] >= 0:
                load_states_onto_lanes(b, work, group, of[group], level[group], few[group], centres)
                groups, begun = group + 1, True
        if groups == 0:
            break
        if begun:
            force = classify_contact_force_of_lanes(b, groups)
        advance_lanes_by_flight(memory, work, groups, force, paths)


def find_capture_radii_in_lanes(memory, centres, cells):
    """Compute in lanes the radii of the outer ellipses around `centres`, and write them to `centres.radius`.

    The radius of a capture region is half that of its outer ellipse (`CaptureCentres.radius`).
    """
    write_outer_radii(memory, np.zeros(1, WORK)[0], centres, cells, np.zeros(2, np.int64))
