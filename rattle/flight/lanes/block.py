"""A block of lanes: the data of every lane, and how trajectories are put on lanes and taken off (compiled).

The lanes of a block are divided into groups of GROUP lanes. Kernels compute only the groups in use, the first ones.
"""

import math
from itertools import accumulate

import numpy as np
from numpy import float32 as f32

from rattle.flight.contact_phase import ENDLESS, MOST_BOUNCES
from rattle.flight.forcing import (
    DRIFT,
    NegativeArc,
    add_slope,
    find_negative_force_arc,
    has_force_amplitude_above,
    sine_cosine_at,
)
from rattle.flight.law import Flight
from rattle.numerics.compile import inline, kernel

LANES, GROUP = 192, 16  # numbers of lanes of a block, and of a group; only groups in use are computed
#: Numbers of groups: all, none, one. They are np.int64, because Python integers would compile further kernel variants.
GROUPS, NONE, ONCE = np.array([LANES // GROUP, 0, 1])
SMOOTH, ROUGH, ARCS = range(3)
ROUGHNESS = 0.75  # the first guess is improved on lanes where `relative_force_amplitude` exceeds this number
# a tangent vector and its determinant are reset when one of them has grown or shrunk by this factor
LARGEST_GROWTH = 1e100
ZERO, ONE = f32(0.0), f32(1.0)

#: Fields that also have a copy in single precision. The name of the copy ends in an underscore.
_STATE = ("tau", "w", "wall", "sin0", "cos0")
_PARAMETERS = ("inverse_delta", "delta", "epsilon", "gap")
#: Fields in double precision that a lane keeps from flight to flight.
_CARRIED = (
    *_STATE,
    *_PARAMETERS,
    # coefficient of restitution; largest v/h² (speed v, pressing force h) at which a chatter is certain to complete, 0
    # if impacts are elastic
    *("restitution", "capture"),
    # impacts on Σ⁺ and on Σ⁻ so far; most impacts on Σ⁺; status with which the lane stopped early, 0 if it did not
    *("n_plus", "n_minus", "limit", "stuck"),
    # tangent vector (dt, dw); product of the determinants of the flights; time so far, in forcing periods
    *("t_tangent", "w_tangent", "determinant", "time"),
    # reference state of the search for recurrences, and its number of impacts; number of checks so far; number of
    # the check at which the reference state is replaced next
    *("at_tau", "at_v", "at_n", "looks", "next_look"),
    # number of the part of the observation to which the growth of the tangent vector is added, −1 before the first
    # part; time up to which this growth was added; unit of speeds (`speed_unit`)
    *("batch", "since", "unit"),
)
_NEXT_IMPACT = ("f0", "s", "w1", "bend", "lost", "sin1", "cos1", "target", "sure")
#: Fields in single precision: copies of parameters and state, and the arc of negative contact force. _GUESSED has the
#: flight time, the Taylor coefficients at this time, and the results of the guess and of the proof.
_PARAMETERS_32, _STATE_32 = (tuple(f"{name}_" for name in names) for names in (_PARAMETERS, _STATE))
_ARC = ("arc_exit", "arc_length", "sin_entry", "sin_exit", "no_arc")
_CARRIED_32 = ("rough", *_PARAMETERS_32, *_ARC)
_SCANNED = (*_PARAMETERS_32[1:], *_ARC, *_STATE_32, "a_")
_GUESSED = (*("s_", "c0", "c1", "c2", "c3", "c4", "c5"), *("step", "speed", "turn", "bound", "tilt", "falls", "proved"))
#: Fields for the second attempt at a proof. _COMPACTED: data of the lanes without proof, moved to the first lanes.
#: _FOUND: results of the attempt.
_COMPACTED = tuple("z_" + name.rstrip("_") for name in _SCANNED)
_FOUND = ("z_f", "z_g", "z_turned", "z_turn", "z_ended", "z_falls", "z_end", "z_s", "z_proved")

#: All fields, each an array over the lanes. `who` is the number of the trajectory on a lane, −1 if there is none.
FIELDS = (
    dict.fromkeys((*_CARRIED, *_NEXT_IMPACT), np.float64)
    | dict.fromkeys((*_CARRIED_32, *_STATE_32, "a_", *_GUESSED, *_COMPACTED, *_FOUND), np.float32)
    | dict.fromkeys(("who", "todo"), np.int64)
)
#: Arrays (field, lane) that share the memory of neighbouring fields, for loops over many fields.
TABLES = {
    "state": _STATE,
    "state_": _STATE_32,
    "parameters": _PARAMETERS,
    "parameters_": _PARAMETERS_32,
    "carried": _CARRIED,
    "carried_": _CARRIED_32,
    "scanned": _SCANNED,
    "compacted": _COMPACTED,
}


def _block_dtype() -> np.dtype[np.void]:
    """Return the dtype of one block: all FIELDS in order, each on whole cache lines, and TABLES in the same memory."""
    ends = accumulate((np.dtype(of).itemsize * LANES for of in FIELDS.values()), initial=0)
    offsets = dict(zip([*FIELDS, ""], ends, strict=True))
    fields = [(name, (of, (LANES,)), offsets[name]) for name, of in FIELDS.items()]
    tables = [(name, (FIELDS[of[0]], (len(of), LANES)), offsets[of[0]]) for name, of in TABLES.items()]
    names, formats, starts = zip(*fields, *tables, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": starts, "itemsize": offsets[""]})


BLOCK = _block_dtype()


@inline
def convert_flag_to_float(condition):
    """Return 1 if the condition holds, else 0, as a float32, so that all numbers of a stage have the same width."""
    return ONE if condition else ZERO


@inline
def single_precision_flight(b, i):
    """Return the flight of lane i, in single precision."""
    k = np.uint64(i)  # unsigned, because an index that may be negative prevents vectorisation
    return Flight(b.w_[k], b.a_[k], b.sin0_[k], b.cos0_[k], b.delta_[k], b.epsilon_[k])


@inline
def double_precision_flight(b, i):
    """Return the flight of lane i in double precision."""
    k = np.uint64(i)
    a = add_slope(DRIFT, b.sin0[k], b.cos0[k], b.epsilon[k]) - b.w[k]
    return Flight(b.w[k], a, b.sin0[k], b.cos0[k], b.delta[k], b.epsilon[k])


@inline
def negative_force_arc32(b, i):
    """Return the arc of negative contact force of lane i, in single precision."""
    k = np.uint64(i)
    return NegativeArc(not b.no_arc[k] > ZERO, b.arc_exit[k], b.arc_length[k], b.sin_entry[k], b.sin_exit[k])


@kernel
def put_trajectory_on_lane(b, i, tau, v, delta, epsilon, beta, limit):
    """Put a trajectory on lane i: on Σ⁺ at phase tau with speed v, to be followed for `limit` impacts on Σ⁺."""
    for field in range(len(b.carried)):
        b.carried[field, i] = 0.0
    b.tau[i], b.w[i], b.wall[i], b.limit[i] = tau, -v, 1.0, limit
    b.delta[i], b.epsilon[i], b.gap[i], b.inverse_delta[i] = delta, epsilon, 2.0 * beta, 1.0 / delta
    b.restitution[i] = 1.0
    for field in range(len(b.parameters)):
        b.parameters_[field, i] = b.parameters[field, i]
    b.t_tangent[i], b.determinant[i] = 1.0, 1.0 / v
    arc = find_negative_force_arc(delta, epsilon)
    b.arc_exit[i], b.arc_length[i], b.sin_entry[i], b.sin_exit[i] = (
        arc.exit_phase,
        arc.length,
        arc.sin_entry,
        arc.sin_exit,
    )
    b.no_arc[i] = ZERO if arc.exists else ONE
    b.rough[i] = convert_flag_to_float(has_force_amplitude_above(ROUGHNESS, delta, epsilon))
    # `at_v` is −1: no state is close to a reference state with a negative speed, so this one is never found again.
    # `next_look` is 1, so that the first check replaces this reference state.
    b.at_v[i], b.next_look[i], b.batch[i] = -1.0, 1.0, -1.0


@kernel
def move_trajectory(b, i, j):
    """Put the trajectory of lane j on lane i, and leave lane j empty."""
    for field in range(len(b.carried)):
        b.carried[field, i] = b.carried[field, j]
    for field in range(len(b.carried_)):
        b.carried_[field, i] = b.carried_[field, j]
    b.who[i] = b.who[j]
    b.who[j], b.limit[j] = -1, -1.0


@kernel
def move_trajectories_to_front(b):
    """Move the trajectories to the first lanes, and return the number of groups of GROUP lanes that hold them."""
    i, j = 0, LANES - 1
    while True:
        while i < LANES and b.who[i] >= 0:
            i += 1
        while j >= 0 and b.who[j] < 0:
            j -= 1
        if i > j:
            return (i + GROUP - 1) // GROUP
        move_trajectory(b, i, j)


@inline
def normalise_tangent(b, i):
    """Return ln stretch and ln|det| of lane i in (t, w²/2) since the last call, and normalise its tangent vector.

    In these coordinates a flight has the determinant e^(−δs), because dw²/2 = w dw at both ends.

    Returns
    -------
    tuple[float, float]
        ln stretch and ln|det|.
    """
    w = b.w[i]
    energy = b.w_tangent[i] * w
    length = math.hypot(b.t_tangent[i], energy)
    contraction = math.log(abs(b.determinant[i] * w))
    b.t_tangent[i], b.w_tangent[i], b.determinant[i] = b.t_tangent[i] / length, energy / (length * w), 1.0 / w
    return math.log(length), contraction


@inline
def is_near_overflow(b, i):
    """Return whether the tangent vector or determinant of lane i must be reset to stay within double precision."""
    size, determinant = abs(b.t_tangent[i]) + abs(b.w_tangent[i]), abs(b.determinant[i])
    inside = (
        (size > 1.0 / LARGEST_GROWTH)
        & (size < LARGEST_GROWTH)
        & (determinant > 1.0 / LARGEST_GROWTH)
        & (determinant < LARGEST_GROWTH)
    )
    return not inside


@kernel
def clear_block(b):
    """Empty all lanes of a block, and set their limits to 0 impacts."""
    for i in range(LANES):
        put_trajectory_on_lane(b, i, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0)
        b.who[i] = -1


@inline
def stop_lane_at_limit(b, i):
    """Stop lane i if it made too many impacts on Σ⁻. Return whether it is stopped or at its limit of impacts on Σ⁺."""
    if b.n_minus[i] > MOST_BOUNCES * (b.n_plus[i] + 1.0):
        b.stuck[i], b.limit[i] = ENDLESS, -1.0
    return not b.n_plus[i] < b.limit[i]


@inline
def recompute_sines_and_cosines(b, groups):
    """Recompute the sines and cosines of all phases, because updates from flight to flight add rounding errors."""
    for i in range(GROUP * groups):
        b.sin0[i], b.cos0[i] = sine_cosine_at(b.tau[i])


@inline
def prepare_flights(b, groups, is_queue_empty):
    """Recompute the sines and cosines of the phases, and return the number of groups in use.

    is_queue_empty: whether no further trajectory waits for a lane. If so, the trajectories on lanes are first moved to
    the first lanes.

    Returns
    -------
    int
        Number of groups in use.
    """
    if is_queue_empty:
        groups = move_trajectories_to_front(b)
    recompute_sines_and_cosines(b, groups)
    return groups


@inline
def classify_contact_force_of_lanes(b, groups):
    """Return the kind of the contact force on the lanes in use; the kind decides which stages the lanes need.

    Returns
    -------
    int
        ARCS if the contact force changes sign on some lane, else ROUGH if its amplitude divided by its mean exceeds
        ROUGHNESS on some lane, else SMOOTH.
    """
    found = SMOOTH
    for i in range(GROUP * groups):
        found = max(found, ARCS if b.no_arc[i] == ZERO else ROUGH if b.rough[i] > ZERO else SMOOTH)
    return found


def allocate_lane_block() -> np.ndarray:
    """Return memory for one block: an array (1,) of one record, aligned to cache lines.

    Kernels take this array, because numba does not accept a record with overlapping fields from Python.

    Returns
    -------
    np.ndarray
        (1,); its record has the dtype that `_block_dtype` returns.
    """
    raw = np.zeros(BLOCK.itemsize + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + BLOCK.itemsize].view(BLOCK)
