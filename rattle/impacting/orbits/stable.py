"""Find the stable orbits of period one at many parameter points, each cell by itself (compiled).

P(1, 1, 0) comes from closed forms, and P(1, n, 0) from `rattle.impacting.orbits.bounces`. Orbits with impacts on Σ⁻ are
found on the circuits (`rattle.impacting.orbits.circuits`) of three kinds of itineraries, where + and − are impacts on
Σ⁺ and Σ⁻: (+−)^k, +^n − and + −^k. Other itineraries are not searched, because an independent search found no stable
orbit of such an itinerary (docs/decisions/0023-period-one.md).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.first_impact import SIGMA_MINUS, SIGMA_PLUS
from rattle.flight.forcing import phase_of_least_force, relative_force_amplitude
from rattle.flight.impact_law import determinant
from rattle.impacting.orbits.bounces import find_bouncing_orbits
from rattle.impacting.orbits.circuits import CLOSED, LOST, add_orbit_if_new, keep_orbit_if_stable, walk_circuit
from rattle.impacting.orbits.closed_form import single_impact_orbit
from rattle.impacting.orbits.impact_times import allocate_workspace, solve_for_impact_times
from rattle.impacting.orbits.limits import epsilon_sine_of_single_impact
from rattle.numerics.compile import kernel

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_CROSSINGS = 16  # largest k of itineraries (+−)^k, where + and − are impacts on Σ⁺ and Σ⁻
MOST_ON_ONE_WALL = 6  # largest number of impacts on one wall if there is a single impact on the other wall
PHASES = 4  # number of phases of the first impact at which a walk along a circuit of alternating motions may start
# for orbits with a single impact on one wall: guesses of the duration of a flight across the gap, in forcing periods,
# each with a flag that says whether to try Newton's method too
STARTS = ((0.3, True), (0.25, True), (0.15, False), (0.12, False))


class StableOrbits(NamedTuple):
    """The stable orbits of period one of many cells.

    Attributes
    ----------
    n : (cells,)
        Number of orbits of each cell, which may exceed room. The other arrays (cells, room) hold the first `room`
        orbits in the order of their number of impacts, and 0 or NaN beyond n.
    n_plus, n_minus
        Impacts on Σ⁺ and Σ⁻ in a period.
    tau, v
        Phase and speed of the fastest impact on Σ⁺.
    trace
        Trace of the tangent map over the period.
    """

    n: Counts
    n_plus: Counts
    n_minus: Counts
    tau: Array
    v: Array
    trace: Array


@kernel
def find_alternating_orbits(least, work, delta, epsilon, beta):
    """Add the stable orbits of period one that meet Σ⁺ and Σ⁻ in turn, k ≤ MOST_CROSSINGS times each, to `work.found`.

    For each k a walk along a circuit of motions (see `circuits`) finds these orbits. The walk starts with impacts at
    intervals of 1/(2k) forcing periods. It ends when the first impact has moved by 1/k periods, to the time that the
    third impact had at the start: from there on the motions repeat. least: the phase of least contact force, near which
    the walks start.
    """
    idle = 0
    for k in range(1, MOST_CROSSINGS + 1):
        n = 2 * k
        longest, how, zeros = math.sqrt(n) / (8.0 * k), LOST, 0
        for phase in range(PHASES):
            for i in range(n):
                work.walls[i] = 1 - 2 * (i % 2)
                work.times[i] = least + (phase / PHASES + 0.5 * i) / k
            how, zeros = walk_circuit(work, n, 1.0 / k, longest, delta, epsilon, beta)
            if how != LOST:
                break
        # A motion of period 1/k crosses the gap if, under the mean contact force alone and without damping, it arrives
        # at Σ⁻ with a speed above 0.
        crosses = 4.0 * k * k * beta > math.pi * delta
        idle = idle + 1 if crosses and zeros == 0 else 0
        if idle == 2:  # no orbit for two successive k: motions with more crossings dissipate more, so none is expected
            break


@kernel
def find_orbits_with_single_impact(single, others, least, work, delta, epsilon, beta):
    """Add the stable orbits with one impact on the wall `single` and `others` on the other wall to `work.found`.

    In the space of impact times these orbits lie on a closed curve (a circuit, see `circuits`). The walks along this
    curve start near guessed motions. In each guess the single impact is at the phase `least` of least contact force if
    `single` is Σ⁻, and half a period later if `single` is Σ⁺. If the gap is small, there are two curves instead, and
    neither is closed: along each, the time of the single impact grows by a period. The motions on one curve have short
    flights across the gap, and those on the other curve have long flights.
    """
    n = others + 1
    for crossing, solved in STARTS:
        t = least if single < 0 else least + 0.5
        for i in range(n):
            work.walls[i] = single if i == 0 else -single
            work.times[i] = t
            t += crossing if i == 0 else (1.0 - 2.0 * crossing) / (others - 1)
        # keep the orbit that Newton's method finds, because the walk, which begins at this orbit, may miss it
        if solved and solve_for_impact_times(work, n, 0.3, delta, epsilon, beta)[0]:
            keep_orbit_if_stable(work, n, delta, epsilon, beta)
        how, _zeros = walk_circuit(work, n, 1.0, 0.1 * math.sqrt(n), delta, epsilon, beta)
        if how == CLOSED:
            break


@kernel
def add_stable_orbits_of_cell(work, delta, epsilon, beta, offset):
    """Add all stable orbits of period one of a cell to `work.found`. offset: ε sin 2πτ of A and C."""
    exists, tau, v, trace = single_impact_orbit(1.0, delta, epsilon, beta, offset)
    if exists and abs(trace) < 1.0 + determinant(delta, 1.0, 1):
        add_orbit_if_new(1.0, 0.0, tau, v, trace, work)
    least = phase_of_least_force(delta)
    find_alternating_orbits(least, work, delta, epsilon, beta)
    x, gap = relative_force_amplitude(delta, epsilon), beta / delta
    for others in range(2, MOST_ON_ONE_WALL + 1):
        if gap < 0.25 * math.pi / (others * others - 1) + 0.8 * x / others:
            find_orbits_with_single_impact(SIGMA_MINUS, others, least, work, delta, epsilon, beta)
        if x > 0.6 + 0.4 * others and gap < 0.45 * x:
            find_orbits_with_single_impact(SIGMA_PLUS, others, least, work, delta, epsilon, beta)
    find_bouncing_orbits(work, delta, epsilon, beta)


@kernel
def sort_by_impact_count(work):
    """Sort the orbits in `work.found` by their number of impacts in a period."""
    rows = work.found
    for i in range(1, work.n_found):
        j = i
        while j > 0 and rows[j - 1, 0] + rows[j - 1, 1] > rows[j, 0] + rows[j, 1]:
            for k in range(rows.shape[1]):
                rows[j - 1, k], rows[j, k] = rows[j, k], rows[j - 1, k]
            j -= 1


@kernel
def fill_stable_orbits(work, delta, epsilon, beta, offset, stable):
    """Write the stable orbits at flat arrays of parameters (cells,) to `stable`, a `StableOrbits` of zeros and NaN.

    work: the scratch memory. offset (cells,): ε sin 2πτ of A and C.
    """
    for cell in range(delta.size):
        work.n_found = 0
        add_stable_orbits_of_cell(work, delta[cell], epsilon[cell], beta[cell], offset[cell])
        sort_by_impact_count(work)
        stable.n[cell] = work.n_found
        for j in range(min(work.n_found, stable.tau.shape[1])):
            row = work.found[j]
            stable.n_plus[cell, j], stable.n_minus[cell, j] = int(row[0]), int(row[1])
            stable.tau[cell, j], stable.v[cell, j], stable.trace[cell, j] = row[2], row[3], row[4]


def find_stable_orbits(delta: Array, epsilon: Array, beta: Array, room: int) -> StableOrbits:
    """Return at most `room` stable orbits of period one for each cell of flat arrays of parameters (cells,)."""
    shape = (delta.size, room)
    n, (n_plus, n_minus), (tau, v, trace) = (
        np.zeros(delta.size, np.int64),
        np.zeros((2, *shape), np.int64),
        np.full((3, *shape), np.nan),
    )
    stable = StableOrbits(n, n_plus, n_minus, tau, v, trace)
    fill_stable_orbits(allocate_workspace(), delta, epsilon, beta, epsilon_sine_of_single_impact(delta), stable)
    return stable
