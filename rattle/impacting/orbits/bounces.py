"""The stable orbits P(1, n, 0) with n ≥ 2, which bounce on Σ⁺ only (compiled).

For each n a stable orbit (the node) and a saddle are born at the saddle-node ε_SN(n), and the node is stable up to its
flip ε_PD(n). In units of the quiet limit ε_SN(n) and ε_PD(n) grow with n towards 1. At a given ε the numbers n with a
stable orbit are therefore consecutive: for smaller n the node is unstable, for larger n it does not exist
(docs/decisions/0023-period-one.md).
"""

import math

from rattle.flight.forcing import phase_of_least_force, relative_contact_force, relative_force_amplitude
from rattle.flight.impact_law import determinant
from rattle.impacting.orbits.circuits import keep_orbit_if_stable, walk_circuit
from rattle.impacting.orbits.impact_times import MOST_IMPACTS, SECTIONS, solve_for_impact_times
from rattle.numerics.compile import kernel

ALL_TRIED_UP_TO = 6  # every n up to this number is tried, because the flips of small n are not in the order of n
# damping above which the saddle-nodes of P(1, n, 0) do not come in the order of n, and P(1, n, 0) can be stable
# above the quiet limit, too
STRONG = 1.6
# For damping above STRONG, P(1, n, 0) is sought up to n = MOST_AT_STRONG, and only if ε is at least LEAST_AT_STRONG, in
# units of the quiet limit.
MOST_AT_STRONG, LEAST_AT_STRONG = 24, 0.85
# least contact force, in units of the mean force, for the rate of bounces; a smaller force counts as this force
WEAKEST = 0.02
NONE, STABLE, UNSTABLE = range(3)


@kernel
def fill_bounce_distribution(work, x):
    """Fill `work.shares` (SECTIONS + 1,), the distribution of bounces over half a forcing period.

    The half period begins at the phase of least contact force and has SECTIONS equal sections. Entry i is the share of
    the half period's bounces that come in its first i sections. x is ε in units of the quiet limit. The rate of bounces
    is taken as proportional to g^(2/3), g the contact force: bounces of speed v have the rate g/2v, and all bounces are
    taken to have the same v³/g.
    """
    shares = work.shares
    shares[0] = 0.0
    for i in range(SECTIONS):
        g = relative_contact_force(x, (i + 0.5) / SECTIONS)
        shares[i + 1] = shares[i] + max(g, WEAKEST) ** (2.0 / 3.0)
    for i in range(1, SECTIONS + 1):
        shares[i] /= shares[SECTIONS]


@kernel
def guess_bounce_times(work, n, offset, least):
    """Set the times in `work` to a guess of n bounces in a period that all have the same v³/g.

    least: the phase of least contact force. offset: the place of the first bounce, counted in bounces from this phase:
    0 puts the first bounce at this phase, and −1 puts the second bounce at this phase.
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
def find_node_orbit(n, least, work, delta, epsilon, beta):
    """Search for the node P(1, n, 0), which is born stable at a saddle-node; add it to `work.found` if stable.

    least: the phase of least contact force.

    Returns
    -------
    int
        NONE if the node is not found, else STABLE or UNSTABLE.
    """
    guess_bounce_times(work, n, 0.0, least)
    solved, at_one = solve_for_impact_times(work, n, 0.5, delta, epsilon, beta)
    if solved and at_one > 0.0:
        keep_orbit_if_stable(work, n, delta, epsilon, beta)
        return STABLE if at_one < 2.0 * (1.0 + determinant(delta, 1.0, n)) else UNSTABLE
    # near or beyond the saddle-node the guess may fail, so all phases of the first bounce are tried
    before = work.n_found
    guess_bounce_times(work, n, -0.5, least)
    bounce = work.times[1] - work.times[0]
    _how, zeros = walk_circuit(work, n, bounce, math.sqrt(n) * bounce / 6.0, delta, epsilon, beta)
    if zeros == 0:
        return NONE
    return STABLE if work.n_found > before else UNSTABLE


@kernel
def find_bouncing_orbits(work, delta, epsilon, beta):
    """Add the stable P(1, n, 0) of a cell, 2 ≤ n ≤ MOST_IMPACTS (MOST_AT_STRONG if δ > STRONG), to `work.found`."""
    x = relative_force_amplitude(delta, epsilon)
    strong = delta > STRONG
    if x < LEAST_AT_STRONG if strong else x >= 1.0:
        return
    least = phase_of_least_force(delta)
    fill_bounce_distribution(work, x)
    few = MOST_AT_STRONG if strong else ALL_TRIED_UP_TO
    n, state, unstable, none = 1, UNSTABLE, 1, MOST_IMPACTS + 1
    while n < few or (not strong and state != STABLE and none - unstable > 1):
        if n < few:
            n += 1
        else:
            n = min(unstable + 1 + unstable // 3, MOST_IMPACTS) if none > MOST_IMPACTS else (unstable + none) // 2
        state = find_node_orbit(n, least, work, delta, epsilon, beta)
        if state == NONE:
            if n <= few and not strong:
                return
            none = n
        elif state == UNSTABLE:
            unstable = n
    if state == STABLE and not strong:
        for side in (-1, 1):
            k = n + side
            while max(unstable, few) < k < none and find_node_orbit(k, least, work, delta, epsilon, beta) == STABLE:
                k += side
