"""A block of lanes: what every lane carries, and how trajectories are put on lanes and taken off (compiled)."""

import math

import numpy as np
from numpy import float32 as f32

from rattle.flight.law import DRIFT, TWO_PI, Arc, Flight, negative_arc, versines
from rattle.flight.tangent import MOST_BOUNCES, STUCK
from rattle.numerics.compile import inline, kernel

LANES, GROUP = 96, 16  # lanes are flown in groups, as many as are in use
GROUPS = LANES // GROUP
SMOOTH, ROUGH, ARCS = range(3)
ROUGHNESS = 0.75  # of the amplitude at which the contact force changes sign: from there a better guess pays
HUGE = 1e100  # what a tangent vector may grow to between two looks
ZERO, ONE = f32(0.0), f32(1.0)

#: Double precision: the state; the parameters; the impacts counted, at most `limit` on Σ⁺, and why a lane stopped
#: early; a tangent vector (dt, dw) with the product of determinants and the time; the next impact.
_DOUBLE = (
    *("tau", "w", "wall", "sin0", "cos0"),
    *("delta", "epsilon", "gap", "inverse_delta"),
    *("n_plus", "n_minus", "limit", "stuck"),
    *("t_tangent", "w_tangent", "determinant", "time"),
    *("f0", "s", "w1", "bend", "lost", "sin1", "cos1", "target", "sure"),
)
#: Single precision: copies of state and parameters; the arc of negative contact force; flight time, Taylor
#: coefficients, what was decided. z_: the lanes of the second attempt, compacted.
_SINGLE = (
    *("tau_", "w_", "wall_", "sin_", "cos_", "a_", "delta_", "epsilon_", "gap_", "inverse_delta_"),
    *("arc_exit", "arc_length", "sin_entry", "sin_exit", "no_arc", "rough"),
    *("s_", "c0", "c1", "c2", "c3", "c4", "c5", "step", "speed", "turn", "bound", "tilt", "falls", "proved"),
    *("z_wall", "z_tau", "z_w", "z_a", "z_sin", "z_cos", "z_delta", "z_epsilon", "z_gap"),
    *("z_arc_exit", "z_arc_length", "z_sin_entry", "z_sin_exit", "z_no_arc", "z_proved"),
    *("z_f", "z_g", "z_turned", "z_turn", "z_ended", "z_falls", "z_end", "z_s"),
)
#: What a driver keeps of the trajectory on a lane, `who` (−1: none): a reference state with the impacts to there, looks
#: so far and at which the reference moves up; the batch that it is measured for (below 0: none yet) and since when; the
#: unit of its speeds.
_NOTES = ("at_tau", "at_v", "at_n", "looks", "next_look", "batch", "since", "unit")
#: One block: every field is an array over its lanes.
BLOCK = np.dtype(
    [(name, np.float64, (LANES,)) for name in _DOUBLE]
    + [(name, np.float32, (LANES,)) for name in _SINGLE]
    + [(name, np.float64, (LANES,)) for name in _NOTES]
    + [(name, np.int64, (LANES,)) for name in ("who", "todo")]
)


@inline
def flag(condition):
    """1 or 0 as a float32, which keeps a stage's numbers of one width."""
    return ONE if condition else ZERO


@inline
def flight32(b, i):
    """The flight of lane i, in single precision."""
    k = np.uint64(i)  # a number that might count from the end keeps some loops from becoming vector instructions
    return Flight(b.w_[k], b.a_[k], b.sin_[k], b.cos_[k], b.delta_[k], b.epsilon_[k])


@inline
def flight64(b, i):
    """The same in double precision."""
    k = np.uint64(i)
    a = DRIFT - TWO_PI * b.epsilon[k] * b.sin0[k] - b.w[k]
    return Flight(b.w[k], a, b.sin0[k], b.cos0[k], b.delta[k], b.epsilon[k])


@inline
def arc32(b, i):
    """The arc of lane i."""
    k = np.uint64(i)
    return Arc(not b.no_arc[k] > ZERO, b.arc_exit[k], b.arc_length[k], b.sin_entry[k], b.sin_exit[k])


@kernel
def load(b, i, tau, v, delta, epsilon, beta, limit):
    """Put a trajectory on lane i: on Σ⁺ at phase tau with speed v, until it has made limit impacts there."""
    b.tau[i], b.w[i], b.wall[i] = tau, -v, 1.0
    b.n_plus[i], b.n_minus[i], b.limit[i], b.stuck[i] = 0.0, 0.0, limit, 0.0
    b.delta[i], b.epsilon[i], b.gap[i], b.inverse_delta[i] = delta, epsilon, 2.0 * beta, 1.0 / delta
    b.delta_[i], b.epsilon_[i], b.gap_[i], b.inverse_delta_[i] = delta, epsilon, 2.0 * beta, 1.0 / delta
    b.t_tangent[i], b.w_tangent[i], b.determinant[i], b.time[i] = 1.0, 0.0, 1.0 / v, 0.0
    arc = negative_arc(delta, epsilon)
    b.arc_exit[i], b.arc_length[i], b.sin_entry[i], b.sin_exit[i] = arc.leave, arc.length, arc.sin_entry, arc.sin_exit
    b.no_arc[i] = ZERO if arc.exists else ONE
    b.at_tau[i], b.at_v[i], b.at_n[i] = 0.0, -1.0, 0.0  # a reference that nothing is near
    b.looks[i], b.next_look[i], b.batch[i], b.since[i] = 0.0, 1.0, -1.0, 0.0
    b.rough[i] = flag(epsilon * math.hypot(TWO_PI, delta) > ROUGHNESS * 2.0 * delta)


@kernel
def move(b, i, j):
    """Put the trajectory of lane j on lane i, and leave lane j empty."""
    b.tau[i], b.w[i], b.wall[i], b.sin0[i], b.cos0[i] = b.tau[j], b.w[j], b.wall[j], b.sin0[j], b.cos0[j]
    b.n_plus[i], b.n_minus[i], b.limit[i], b.stuck[i] = b.n_plus[j], b.n_minus[j], b.limit[j], b.stuck[j]
    b.delta[i], b.epsilon[i], b.gap[i], b.inverse_delta[i] = b.delta[j], b.epsilon[j], b.gap[j], b.inverse_delta[j]
    b.delta_[i], b.epsilon_[i], b.gap_[i], b.inverse_delta_[i] = (
        b.delta_[j],
        b.epsilon_[j],
        b.gap_[j],
        b.inverse_delta_[j],
    )
    b.t_tangent[i], b.w_tangent[i], b.determinant[i] = b.t_tangent[j], b.w_tangent[j], b.determinant[j]
    b.time[i], b.no_arc[i], b.arc_exit[i], b.arc_length[i] = b.time[j], b.no_arc[j], b.arc_exit[j], b.arc_length[j]
    b.sin_entry[i], b.sin_exit[i], b.rough[i] = b.sin_entry[j], b.sin_exit[j], b.rough[j]
    b.at_tau[i], b.at_v[i], b.at_n[i] = b.at_tau[j], b.at_v[j], b.at_n[j]
    b.looks[i], b.next_look[i], b.batch[i], b.since[i] = b.looks[j], b.next_look[j], b.batch[j], b.since[j]
    b.unit[i], b.who[i] = b.unit[j], b.who[j]
    b.who[j], b.limit[j] = -1, -1.0


@kernel
def close_ranks(b):
    """Move trajectories to the first lanes. Returns the groups of lanes that are still in use."""
    i, j = 0, LANES - 1
    while True:
        while i < LANES and b.who[i] >= 0:
            i += 1
        while j >= 0 and b.who[j] < 0:
            j -= 1
        if i > j:
            return (i + GROUP - 1) // GROUP
        move(b, i, j)


@inline
def stretched(b, i):
    """ln stretch and ln|determinant| of lane i since the last call, in (t, w²/2); the vector is normalised.

    There a flight has determinant e^(−δs); dw²/2 = w dw at both ends.
    """
    w = b.w[i]
    energy = b.w_tangent[i] * w
    length = math.hypot(b.t_tangent[i], energy)
    contraction = math.log(abs(b.determinant[i] * w))
    b.t_tangent[i], b.w_tangent[i], b.determinant[i] = b.t_tangent[i] / length, energy / (length * w), 1.0 / w
    return math.log(length), contraction


@inline
def overflows(b, i):
    """True if the tangent vector of lane i or its determinant must be taken off before they leave double precision."""
    size, determinant = abs(b.t_tangent[i]) + abs(b.w_tangent[i]), abs(b.determinant[i])
    inside = (size > 1.0 / HUGE) & (size < HUGE) & (determinant > 1.0 / HUGE) & (determinant < HUGE)
    return not inside


@kernel
def empty(b):
    """A block without trajectories: every lane has reached its limit."""
    for i in range(LANES):
        load(b, i, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0)
        b.who[i] = -1


@inline
def ended(b, i):
    """True if lane i has made its impacts or cannot go on: a motion that only bounces on Σ⁻ is stuck."""
    if b.n_minus[i] > MOST_BOUNCES * (b.n_plus[i] + 1.0):
        b.stuck[i], b.limit[i] = STUCK, -1.0
    return not b.n_plus[i] < b.limit[i]


@inline
def synchronise(b, groups):
    """Sine and cosine of the phase afresh: carried from flight to flight they drift by rounding."""
    for i in range(GROUP * groups):
        versine, sine, _defect = versines(b.tau[i])
        b.sin0[i], b.cos0[i] = sine, 1.0 - versine


@inline
def made_ready(b, groups, none_waits):
    """Before the next flights: close ranks once no trajectory waits for a lane, and synchronise; the groups in use."""
    if none_waits:
        groups = close_ranks(b)
    synchronise(b, groups)
    return groups


@inline
def roughest(b, groups):
    """What the lanes need: ARCS if the contact force changes sign on any, ROUGH if it comes near that, else SMOOTH."""
    found = SMOOTH
    for i in range(GROUP * groups):
        found = max(found, ARCS if b.no_arc[i] == ZERO else ROUGH if b.rough[i] > ZERO else SMOOTH)
    return found


def block() -> np.ndarray:
    """Memory for one block, aligned to cache lines."""
    raw = np.zeros(BLOCK.itemsize + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + BLOCK.itemsize].view(BLOCK)
