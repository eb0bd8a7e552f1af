"""Locate anew those impacts that are not yet proved to be the first of their flights (compiled).

These lanes are gathered without gaps. A scan at fixed steps locates each impact anew, and the proof that the impact is
the first of its flight is attempted again. docs/kernel.md has the proofs.
"""

import numpy as np
from numpy import float32 as f32

from rattle.flight.forcing import NegativeArc
from rattle.flight.guess import (
    LONGEST_DECAY32,
    SCAN_STEP,
    SCAN_STEPS,
    UNBOUNDED,
    FlightMinimum,
    ScanState,
    advance_scan,
    estimate_minimum,
    height_at_next_wall,
    refine_time_at_level,
    taylor_coefficients,
    time_step_to_level,
)
from rattle.flight.lanes.block import ARCS, GROUP, ONE, ZERO, convert_flag_to_float
from rattle.flight.law import Flight
from rattle.flight.proof import (
    has_at_most_one_turn,
    is_certain_to_miss_opposite_wall,
    is_certain_to_miss_wall_at_both_minima,
    is_one_final_step_enough,
)
from rattle.numerics.compile import inline, kernel

# `paths[SCANNED]` counts the flights that need a scan, `paths[SAFE]` the flights that also need the safe search.
SCANNED, SAFE = range(2)


@kernel
def rescan_unproved_lanes(b, groups, force, paths):
    """Locate the impacts of lanes without proof again, by a scan at fixed steps, and try the proof again."""
    n = compact_unproved_lanes(b, groups)
    paths[SCANNED] += n
    if n == 0:
        return
    padded = (n + GROUP - 1) // GROUP * GROUP
    scan_flights(b, n, padded)
    locate_impacts(b, padded)
    if force == ARCS:
        withdraw_unproved_scans_with_arcs(b, padded)
    else:
        withdraw_unproved_scans(b, padded)
    for k in range(n):
        i = b.todo[k]
        b.s_[i], b.falls[i], b.proved[i] = b.z_s[k], b.z_falls[k], b.z_proved[k]


@inline
def compact_unproved_lanes(b, groups):
    """Copy the data of the lanes without proof to the first columns of `b.compacted`, and return their number."""
    n = 0
    for i in range(GROUP * groups):
        b.todo[np.uint64(n)] = i  # written without a branch, which the processor could not predict
        n += (b.proved[i] == ZERO) & (b.n_plus[i] < b.limit[i])
    for k in range(n):
        place, lane = np.uint64(k), np.uint64(b.todo[k])
        for field in range(len(b.scanned)):
            b.compacted[field, place] = b.scanned[field, lane]
    return n


@inline
def compacted_flight(b, i):
    """Return the flight in column i of the compacted lanes, in single precision."""
    k = np.uint64(i)  # an unsigned index, because a possibly negative one prevents vectorisation
    return Flight(b.z_w[k], b.z_a[k], b.z_sin0[k], b.z_cos0[k], b.z_delta[k], b.z_epsilon[k])


@inline
def compacted_arc(b, i):
    """Return the arc of negative contact force in column i of the compacted lanes, in single precision."""
    k = np.uint64(i)
    return NegativeArc(not b.z_no_arc[k] > ZERO, b.z_arc_exit[k], b.z_arc_length[k], b.z_sin_entry[k], b.z_sin_exit[k])


@inline
def scan_flights(b, n, padded):
    """Evaluate the n compacted flights at fixed steps until each has ended. padded: n rounded up to whole groups."""
    for k in range(padded):
        from_bottom = b.z_wall[k] < ZERO
        b.z_f[k], b.z_g[k], b.z_turn[k], b.z_end[k] = ZERO, b.z_w[k], ZERO, ZERO
        b.z_turned[k], b.z_ended[k], b.z_falls[k] = convert_flag_to_float(from_bottom), ZERO, ZERO
    for k in range(n, padded):
        b.z_ended[k] = ONE
    for j in range(SCAN_STEPS):
        s0, s1 = SCAN_STEP * f32(j), SCAN_STEP * f32(j + 1)
        for k in range(padded):
            turned, ended, falls = b.z_turned[k] > ZERO, b.z_ended[k] > ZERO, b.z_falls[k] > ZERO
            before = ScanState(b.z_f[k], b.z_g[k], turned, b.z_turn[k], ended, falls, b.z_end[k])
            now = advance_scan(s0, s1, b.z_wall[k], b.z_gap[k], before, compacted_flight(b, k))
            b.z_f[k], b.z_g[k], b.z_turn[k], b.z_end[k] = now.f, now.g, now.turn, now.end
            b.z_turned[k], b.z_ended[k], b.z_falls[k] = (
                convert_flag_to_float(now.turned),
                convert_flag_to_float(now.ended),
                convert_flag_to_float(now.falls),
            )
        left = np.int32(0)
        for k in range(padded):
            # both casts are needed: numba widens the result of `|` to 64 bits, and mixed widths vectorise badly
            left = np.int32(left | np.int32(b.z_ended[k] == ZERO))
        if left == 0:
            break


@inline
def locate_impacts(b, n):
    """Compute the impact of each of n compacted flights in single precision, from the result of the scan.

    For the proof the function also computes a lower bound of F at the last turning point that the scan found.
    """
    for k in range(n):
        wall, gap, flight = b.z_wall[k], b.z_gap[k], compacted_flight(b, k)
        turn, end, scanned_fall = b.z_turn[k], b.z_end[k], b.z_falls[k]
        series = taylor_coefficients(turn, flight)
        lowest, minimum = estimate_minimum(turn, series, flight)
        b.z_f[k] = minimum.bound if flight.delta * turn < LONGEST_DECAY32 else UNBOUNDED
        # `misses`: the flight is below Σ⁻ at its minimum, which the scan may overlook between two of its points
        misses = (turn > ZERO) & (wall > ZERO) & (lowest < -gap)
        falls = convert_flag_to_float(misses | (scanned_fall > ZERO))
        level = height_at_next_wall(wall, falls > ZERO, gap)
        near_turn = turn + time_step_to_level(falls == ZERO, level, series)
        from_turn = (end < ZERO) | (misses & (scanned_fall == ZERO))
        s = near_turn if from_turn else end
        s, _u, _speed = refine_time_at_level(s, level, flight)
        s, step, speed = refine_time_at_level(s, level, flight)
        b.z_s[k], b.z_falls[k], b.z_g[k], b.z_turn[k] = s, falls, minimum.tilt, minimum.time
        b.z_proved[k] = convert_flag_to_float(is_one_final_step_enough(s, step, speed, flight))


@inline
def withdraw_unproved_scans(b, n):
    """Withdraw the flag `z_proved` of scanned flights that may have met Σ⁻ before their impact.

    Use this function if the contact force changes sign on no lane of the block, otherwise
    `withdraw_unproved_scans_with_arcs`.
    """
    for k in range(n):
        rising, minimum = b.z_falls[k] == ZERO, FlightMinimum(b.z_f[k], b.z_g[k], b.z_turn[k])
        clear = is_certain_to_miss_opposite_wall(
            b.z_wall[k], rising, b.z_s[k], minimum, b.z_gap[k], compacted_flight(b, k)
        )
        b.z_proved[k] = b.z_proved[k] if clear else ZERO


@inline
def withdraw_unproved_scans_with_arcs(b, n):
    """Withdraw the flag `z_proved` of scanned flights that may have met Σ⁻ before their impact.

    Use this function if the contact force changes sign on some lane of the block, otherwise `withdraw_unproved_scans`.
    """
    for k in range(n):
        wall, gap, rising, tau, s = b.z_wall[k], b.z_gap[k], b.z_falls[k] == ZERO, b.z_tau[k], b.z_s[k]
        flight, arc, minimum = (
            compacted_flight(b, k),
            compacted_arc(b, k),
            FlightMinimum(b.z_f[k], b.z_g[k], b.z_turn[k]),
        )
        once = has_at_most_one_turn(wall, rising, tau, s, minimum.time, flight, arc)
        once &= is_certain_to_miss_opposite_wall(wall, rising, s, minimum, gap, flight)
        twice = is_certain_to_miss_wall_at_both_minima(wall, rising, tau, s, minimum, gap, flight, arc)
        b.z_proved[k] = b.z_proved[k] if once | twice else ZERO
