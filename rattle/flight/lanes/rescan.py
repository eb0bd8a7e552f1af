"""The lanes of a block that the first guess left without proof, located afresh (compiled).

They are compacted, scanned at fixed steps, and proved from what the scan saw. docs/kernel.md has the proofs.
"""

import numpy as np
from numpy import float32 as f32

from rattle.flight.guess import (
    SCAN_STEP,
    SCAN_STEPS,
    TOO_FAR,
    UNBOUNDED,
    depth,
    level_of,
    local_root,
    refined,
    scanned,
    taylor,
)
from rattle.flight.lanes.block import GROUP, ZERO, flag
from rattle.flight.proof import clears_the_gap, is_located, single_turn, two_turns
from rattle.numerics.compile import inline, kernel

SCANNED, SAFE = range(2)  # what `paths` counts: flights that took this second attempt, and the search


@kernel
def second_attempt(b, groups, paths):
    """Lanes without proof, compacted and located afresh from a scan at fixed steps; their proof is then tried again."""
    n = 0
    for i in range(GROUP * groups):
        if b.proved[i] == ZERO and b.n_plus[i] < b.limit[i]:
            b.todo[n] = i
            n += 1
    paths[SCANNED] += n
    if n == 0:
        return
    padded = (n + GROUP - 1) // GROUP * GROUP
    for k in range(padded):
        i = b.todo[min(k, n - 1)]
        b.z_wall[k], b.z_tau[k], b.z_w[k], b.z_a[k] = b.wall_[i], b.tau_[i], b.w_[i], b.a_[i]
        b.z_sin[k], b.z_cos[k] = b.sin_[i], b.cos_[i]
        b.z_delta[k], b.z_epsilon[k], b.z_gap[k] = b.delta_[i], b.epsilon_[i], b.gap_[i]
        b.z_arc_exit[k], b.z_arc_length[k], b.z_no_arc[k] = b.arc_exit[i], b.arc_length[i], b.no_arc[i]
        b.z_sin_entry[k], b.z_sin_exit[k] = b.sin_entry[i], b.sin_exit[i]
    scan(b, padded)
    conclude(b, padded)
    for k in range(n):
        i = b.todo[k]
        b.s_[i], b.falls[i], b.proved[i] = b.z_s[k], b.z_falls[k], b.z_proved[k]


@inline
def scan(b, n):
    """Points of the flights at fixed steps, until each has ended."""
    for k in range(n):
        from_bottom = b.z_wall[k] < ZERO
        b.z_f[k], b.z_g[k], b.z_turn[k], b.z_end[k] = ZERO, b.z_w[k], ZERO, ZERO
        b.z_turned[k], b.z_ended[k], b.z_falls[k] = flag(from_bottom), ZERO, ZERO
    for j in range(SCAN_STEPS):
        s0, s1 = SCAN_STEP * f32(j), SCAN_STEP * f32(j + 1)
        for k in range(n):
            f, g, turned, turn, ended, falls, end = scanned(
                s0,
                s1,
                b.z_wall[k],
                b.z_f[k],
                b.z_g[k],
                b.z_turned[k] > ZERO,
                b.z_turn[k],
                b.z_ended[k] > ZERO,
                b.z_falls[k] > ZERO,
                b.z_end[k],
                b.z_gap[k],
                b.z_w[k],
                b.z_a[k],
                b.z_sin[k],
                b.z_cos[k],
                b.z_delta[k],
                b.z_epsilon[k],
            )
            b.z_f[k], b.z_g[k], b.z_turn[k], b.z_end[k] = f, g, turn, end
            b.z_turned[k], b.z_ended[k], b.z_falls[k] = flag(turned), flag(ended), flag(falls)
        left = np.int32(0)
        for k in range(n):
            left |= np.int32(b.z_ended[k] == ZERO)
        if left == 0:
            break


@inline
def conclude(b, n):
    """Depth of the last turning point that the scan found, the impact to single precision, and its proof."""
    for k in range(n):
        wall, w, a, delta, epsilon, gap = b.z_wall[k], b.z_w[k], b.z_a[k], b.z_delta[k], b.z_epsilon[k], b.z_gap[k]
        sin0, cos0, turn, end = b.z_sin[k], b.z_cos[k], b.z_turn[k], b.z_end[k]
        scanned_fall = b.z_falls[k]
        c0, c1, c2, c3, c4, c5 = taylor(turn, w, a, sin0, cos0, delta, epsilon)
        lowest, bound, b.z_g[k], place = depth(turn, c0, c1, c2, c3, c4, c5, w, a, delta, epsilon)
        b.z_f[k] = bound if delta * turn < TOO_FAR else UNBOUNDED
        misses = (turn > ZERO) & (wall > ZERO) & (lowest < -gap)  # between two points of the scan
        falls = flag(misses | (scanned_fall > ZERO))
        level = level_of(wall, falls > ZERO, gap)
        u = local_root(falls == ZERO, c0 - level, c1, c2, c3, c4, c5)
        near_turn = turn + u
        from_turn = (end < ZERO) | (misses & (scanned_fall == ZERO))
        s = near_turn if from_turn else end
        s, _u, _speed = refined(s, level, w, a, sin0, cos0, delta, epsilon)
        s, step, speed = refined(s, level, w, a, sin0, cos0, delta, epsilon)
        b.z_s[k], b.z_falls[k], b.z_turn[k] = s, falls, place
        b.z_proved[k] = flag(is_located(s, step, speed, w, a, delta, epsilon))
    for k in range(n):
        wall, w, a, delta, epsilon, gap = b.z_wall[k], b.z_w[k], b.z_a[k], b.z_delta[k], b.z_epsilon[k], b.z_gap[k]
        tau, sin0, cos0, s, turn = b.z_tau[k], b.z_sin[k], b.z_cos[k], b.z_s[k], b.z_turn[k]
        bound, tilt, rising = b.z_f[k], b.z_g[k], b.z_falls[k] == ZERO
        leave, length, sin_entry, sin_exit = b.z_arc_exit[k], b.z_arc_length[k], b.z_sin_entry[k], b.z_sin_exit[k]
        no_arc = b.z_no_arc[k] > ZERO
        once = single_turn(
            wall, rising, tau, s, turn, w, a, sin0, delta, epsilon, leave, length, sin_entry, sin_exit, no_arc
        )
        once &= clears_the_gap(wall, rising, s, turn, bound, tilt, gap, w, a, sin0, delta, epsilon)
        twice = two_turns(
            wall, rising, tau, s, turn, bound, tilt, gap, w, a, sin0, cos0, delta, epsilon, leave, length, no_arc
        )
        b.z_proved[k] = b.z_proved[k] if once | twice else ZERO
