"""The stable orbits P(1, n, 0) with n ≥ 2, which bounce on Σ⁺ only (compiled).

For each n a node and a saddle are born at the saddle-node ε_SN(n), and the node is stable up to its flip ε_PD(n). In
units of the quiet limit ε_SN(n) and ε_PD(n) grow with n towards 1. At a given ε the numbers n with a stable orbit are
therefore consecutive: for smaller n the node is unstable, for larger n it does not exist
(docs/decisions/0023-period-one.md).
"""

import math

from rattle.flight.forcing import phase_of_least_force, relative_force, relative_swing
from rattle.flight.impact_law import determinant
from rattle.impacting.orbits.circuits import keep, walk_round
from rattle.impacting.orbits.impact_times import MOST_IMPACTS, SECTIONS, newton_on_times
from rattle.numerics.compile import kernel

ONE_BY_ONE = 6  # every n up to this number is tried, because the flips of small n are not in the order of n
STRONG = 1.6  # damping above which saddle-nodes are not in the order of n, and nodes are stable above the quiet limit
# above STRONG: largest n that is tried, and least ε of stable nodes, in quiet limits
MOST_AT_STRONG, LEAST_AT_STRONG = 24, 0.85
WEAKEST = 0.02  # least contact force, in units of the mean force, in the rate of bounces; it replaces smaller forces
NONE, STABLE, UNSTABLE = range(3)


@kernel
def share_out(work, x):
    """Fill `work.shares`: the share of the bounces of half a period from the least contact force to each section's end.

    x is ε in units of the quiet limit. With one adiabatic invariant v³/g the bounces come at the rate g/2v ∝ g^(2/3).
    """
    shares = work.shares
    shares[0] = 0.0
    for i in range(SECTIONS):
        g = relative_force(x, (i + 0.5) / SECTIONS)
        shares[i + 1] = shares[i] + max(g, WEAKEST) ** (2.0 / 3.0)
    for i in range(1, SECTIONS + 1):
        shares[i] /= shares[SECTIONS]


@kernel
def space(work, n, offset, least):
    """Set the times of n bounces with a common adiabatic invariant, as a guess.

    The phase of least contact force is `least`. The first bounce comes `offset` ∈ [−1, 0] bounces after this phase.
    """
    shares, i = work.shares, 0
    for j in range(n):
        share = 2.0 * (j + offset) / n
        half = abs(share) if share <= 1.0 else 2.0 - share
        while i < SECTIONS - 1 and shares[i + 1] < half:
            i += 1
        while shares[i] > half:
            i -= 1
        t = 0.5 * (i + (half - shares[i]) / (shares[i + 1] - shares[i])) / SECTIONS
        work.walls[j] = 1
        work.times[j] = least + (math.copysign(t, share) if share <= 1.0 else 1.0 - t)


@kernel
def node(n, least, work, delta, epsilon, beta):
    """Return NONE, STABLE or UNSTABLE for the node P(1, n, 0), and keep the node if it is stable."""
    space(work, n, 0.0, least)
    solved, at_one = newton_on_times(work, n, 0.5, delta, epsilon, beta)
    if solved and at_one > 0.0:
        keep(work, n, delta, epsilon, beta)
        return STABLE if at_one < 2.0 * (1.0 + determinant(delta, 1.0, n)) else UNSTABLE
    before = work.n_found  # near or beyond the saddle-node the guess may fail, so all phases of a bounce are tried
    space(work, n, -0.5, least)
    bounce = work.times[1] - work.times[0]
    _how, zeros = walk_round(work, n, bounce, math.sqrt(n) * bounce / 6.0, delta, epsilon, beta)
    if zeros == 0:
        return NONE
    return STABLE if work.n_found > before else UNSTABLE


@kernel
def find_bounces(work, delta, epsilon, beta):
    """Keep the stable P(1, n, 0) of a cell with 2 ≤ n ≤ MOST_IMPACTS (MOST_AT_STRONG if δ > STRONG)."""
    x = relative_swing(delta, epsilon)
    strong = delta > STRONG
    if x < LEAST_AT_STRONG if strong else x >= 1.0:
        return
    least = phase_of_least_force(delta)
    share_out(work, x)
    few = MOST_AT_STRONG if strong else ONE_BY_ONE
    n, state, unstable, none = 1, UNSTABLE, 1, MOST_IMPACTS + 1
    while n < few or (not strong and state != STABLE and none - unstable > 1):
        if n < few:
            n += 1
        else:
            n = min(unstable + 1 + unstable // 3, MOST_IMPACTS) if none > MOST_IMPACTS else (unstable + none) // 2
        state = node(n, least, work, delta, epsilon, beta)
        if state == NONE:
            if n <= few and not strong:
                return
            none = n
        elif state == UNSTABLE:
            unstable = n
    if state == STABLE and not strong:
        for side in (-1, 1):
            k = n + side
            while max(unstable, few) < k < none and node(k, least, work, delta, epsilon, beta) == STABLE:
                k += side
