"""Many flights at once (compiled): each lane of a block has one trajectory with its own parameters.

A step of all lanes is a sequence of stages. Every stage is a short loop over the lanes, of straight-line code that LLVM
turns into vector instructions; the block stays in the first-level cache, and short stages overlap in the processor. If
the located impact of a lane is not proved to be the first, a scan locates the impact again, and the proof is tried
again. Flights that are still not proved are computed one by one by `first_impact.first_impact_by_safe_search`.
docs/kernel.md explains the stages.
"""

import numpy as np
from numpy import float32 as f32

from rattle.flight.contact_phase import IN_CONTACT, is_chatter_certain_to_complete, stays_in_contact
from rattle.flight.first_impact import OK, final_step_to_impact, first_impact_by_safe_search, state_after_step
from rattle.flight.forcing import DRIFT, Q, add_slope32, contact_force
from rattle.flight.guess import (
    LONGEST_DECAY32,
    FlightMinimum,
    estimate_minimum,
    guess_time_of_turn_or_arrival,
    height_at_next_wall,
    improve_guess_by_newton_step,
    refine_time_at_level,
    taylor_coefficients,
    time_step_to_level,
)
from rattle.flight.impact_law import reflected_velocity
from rattle.flight.lanes.block import (
    ARCS,
    GROUP,
    ROUGH,
    ZERO,
    convert_flag_to_float,
    double_precision_flight,
    negative_force_arc32,
    single_precision_flight,
)
from rattle.flight.lanes.rescan import SAFE, rescan_unproved_lanes
from rattle.flight.law import evaluate_short, fold_phase, second_derivative
from rattle.flight.proof import has_at_most_one_turn, is_certain_to_miss_opposite_wall, is_one_final_step_enough
from rattle.flight.tangent import carry_tangent_over_flight
from rattle.numerics.compile import inline, kernel

MOST_NEGATIVE = -np.finfo(np.float64).max  # the most negative finite number


@inline
def copy_to_single_precision(b, groups):
    """Copy the state of each lane to single precision.

    This is a loop of its own, because a loop that mixes single and double precision uses vectors of half the length.
    """
    for field in range(len(b.state)):
        for i in range(GROUP * groups):
            b.state_[field, i] = f32(b.state[field, i])


@inline
def guess_flight_times(b, groups):
    """Compute A of each lane's flight law; guess the time when a flight from Σ⁺ turns or a flight from Σ⁻ ends."""
    for i in range(GROUP * groups):
        b.a_[i] = add_slope32(Q, b.sin0_[i], b.cos0_[i], b.epsilon_[i]) - b.w_[i]
        b.s_[i] = guess_time_of_turn_or_arrival(
            b.wall_[i], b.gap_[i], b.inverse_delta_[i], single_precision_flight(b, i)
        )


@inline
def improve_time_guesses(b, groups):
    """Improve the guessed time on lanes where the contact force varies so much that its mean gives a poor guess."""
    for i in range(GROUP * groups):
        s = improve_guess_by_newton_step(b.s_[i], b.wall_[i], b.gap_[i], single_precision_flight(b, i))
        s = min(s, f32(0.95) * LONGEST_DECAY32 * b.inverse_delta_[i])
        # The guess is improved only on lanes with strongly varying contact force (`rough`), so that a lane's result
        # does not depend on the other lanes.
        b.s_[i] = s if b.rough[i] > ZERO else b.s_[i]


@inline
def compute_height_coefficients(b, groups):
    """Compute the Taylor coefficients of the height F of each flight at the guessed time."""
    for i in range(GROUP * groups):
        c = taylor_coefficients(b.s_[i], single_precision_flight(b, i))
        b.c0[i], b.c1[i], b.c2[i], b.c3[i], b.c4[i], b.c5[i] = c


@inline
def choose_wall(b, groups):
    """Choose each flight's next wall by an estimate of the minimum of its height F; keep bounds for the proof."""
    for i in range(GROUP * groups):
        series = b.c0[i], b.c1[i], b.c2[i], b.c3[i], b.c4[i], b.c5[i]
        lowest, minimum = estimate_minimum(b.s_[i], series, single_precision_flight(b, i))
        falls = (b.wall_[i] > ZERO) & (lowest < -b.gap_[i])
        b.bound[i], b.tilt[i], b.turn[i] = minimum
        b.falls[i] = convert_flag_to_float(falls)


@inline
def solve_impact_time_locally(b, groups):
    """Move the time of the guess to the impact, where the Taylor polynomial reaches the level of the wall."""
    for i in range(GROUP * groups):
        level = height_at_next_wall(b.wall_[i], b.falls[i] > ZERO, b.gap_[i])
        series = b.c0[i], b.c1[i], b.c2[i], b.c3[i], b.c4[i], b.c5[i]
        b.s_[i] += time_step_to_level(not b.falls[i] > ZERO, level, series)


@inline
def expand_and_solve_again(b, groups):
    """Expand F at the new time and solve again, because the first polynomial is poor far from the turning point."""
    for i in range(GROUP * groups):
        level, flight = height_at_next_wall(b.wall_[i], b.falls[i] > ZERO, b.gap_[i]), single_precision_flight(b, i)
        b.s_[i] += time_step_to_level(not b.falls[i] > ZERO, level, taylor_coefficients(b.s_[i], flight))


@inline
def refine_impact_times(b, groups):
    """Refine the time of each impact by a step of fourth order, and keep the step and the speed for the proof."""
    for i in range(GROUP * groups):
        level = height_at_next_wall(b.wall_[i], b.falls[i] > ZERO, b.gap_[i])
        b.s_[i], b.step[i], b.speed[i] = refine_time_at_level(b.s_[i], level, single_precision_flight(b, i))


@inline
def prove_first_impacts(b, groups):
    """Decide for each lane whether its located impact is proved to be the first of its flight."""
    for i in range(GROUP * groups):
        rising, s, flight = b.falls[i] == ZERO, b.s_[i], single_precision_flight(b, i)
        minimum = FlightMinimum(b.bound[i], b.tilt[i], b.turn[i])
        clear = is_certain_to_miss_opposite_wall(b.wall_[i], rising, s, minimum, b.gap_[i], flight)
        b.proved[i] = convert_flag_to_float(clear & is_one_final_step_enough(s, b.step[i], b.speed[i], flight))


@inline
def reject_lanes_with_two_turns(b, groups):
    """Withdraw the flag `proved` of lanes whose F' may change sign twice.

    Two changes are possible only if the contact force changes sign during the flight.
    """
    for i in range(GROUP * groups):
        flight, rising = single_precision_flight(b, i), b.falls[i] == ZERO
        certain = has_at_most_one_turn(
            b.wall_[i], rising, b.tau_[i], b.s_[i], b.turn[i], flight, negative_force_arc32(b, i)
        )
        b.proved[i] = b.proved[i] if certain else ZERO


@inline
def evaluate_lanes_in_double(b, groups):
    """Evaluate in double precision each flight's height above the level of its next wall, and the flight's F'."""
    for i in range(GROUP * groups):
        gap = b.gap[i]
        level = 0.0 if b.wall[i] > 0.0 else gap
        level = -gap if b.target[i] < 0.0 else level
        f0, f1, _f2, lost, sin1, cos1 = evaluate_short(b.s[i], double_precision_flight(b, i))
        b.f0[i], b.w1[i], b.lost[i], b.sin1[i], b.cos1[i] = f0 - level, f1, lost, sin1, cos1


@inline
def copy_to_double_precision(b, groups):
    """Copy flight times, next walls and the verdicts of the proof from single to double precision."""
    for i in range(GROUP * groups):
        b.s[i] = np.float64(b.s_[i])
        b.target[i] = 1.0 - 2.0 * np.float64(b.falls[i])
        b.sure[i] = np.float64(b.proved[i])


@inline
def select_number(go, new, old):
    """Return `new` if `go` is true, else `old`, in a form that LLVM vectorises well.

    LLVM would turn `new if go else old` into a masked store, which is slow without AVX-512. LLVM does not do so if
    `old` is written as the maximum of `old` and MOST_NEGATIVE, the most negative number.

    Returns
    -------
    float
        `new` or `old`.
    """
    return new if go else max(old, MOST_NEGATIVE)


def _build_impact_stage(tangent):
    """Build the stage that moves lanes to their impacts. With `tangent` this stage also prepares `carry_tangents`."""

    @inline
    def move_lanes_to_impacts(b, groups):
        """Move each lane to its impact and reflect its velocity.

        A lane is moved only if its impact is proved, and only if the lane has made fewer impacts on Σ⁺ than its limit.
        If tangent vectors are followed, a lane that is not moved gets the flight duration 0, and the fields sin1 and
        cos1 of all lanes get sine and cosine of the phase at which this flight departed, for `carry_tangents`.
        """
        for i in range(GROUP * groups):
            tau, wall, target, s, flight = b.tau[i], b.wall[i], b.target[i], b.s[i], double_precision_flight(b, i)
            w1, lost, sin1, cos1 = b.w1[i], b.lost[i], b.sin1[i], b.cos1[i]
            u, exact = final_step_to_impact(s, b.f0[i], w1, lost, sin1, cos1, flight)
            w1, bend, lost, sin1, cos1 = state_after_step(u, w1, lost, sin1, cos1, flight)
            s += u
            sure = (b.sure[i] > 0.0) & exact & (target * w1 > 0.0)
            go = sure & (b.n_plus[i] < b.limit[i])
            b.sure[i] = 1.0 if sure else 0.0
            if tangent:
                b.bend[i], b.lost[i], b.w1[i] = bend, lost, w1
                b.s[i] = s if go else 0.0
                b.sin1[i], b.cos1[i] = flight.sin0, flight.cos0
            later, back = fold_phase(tau + s), b.restitution[i] * reflected_velocity(w1)
            plus, minus = 0.5 + 0.5 * target, 0.5 - 0.5 * target
            b.tau[i] = select_number(go, later, tau)
            b.w[i] = select_number(go, back, flight.w)
            b.wall[i] = select_number(go, target, wall)
            if not tangent:
                b.time[i] = select_number(go, b.time[i] + s, b.time[i])
            b.sin0[i] = select_number(go, sin1, flight.sin0)
            b.cos0[i] = select_number(go, cos1, flight.cos0)
            b.n_plus[i] = select_number(go, b.n_plus[i] + plus, b.n_plus[i])
            b.n_minus[i] = select_number(go, b.n_minus[i] + minus, b.n_minus[i])

    return move_lanes_to_impacts


land_plain, land_tangent = _build_impact_stage(False), _build_impact_stage(True)


@inline
def carry_tangents(b, groups):
    """Carry tangent vectors over the last flight and its impact, on all lanes that were moved to their impacts."""
    for i in range(GROUP * groups):
        go = b.s[i] > 0.0
        t0, q0, det0, time0 = b.t_tangent[i], b.w_tangent[i], b.determinant[i], b.time[i]
        sin0, cos0, sin1, cos1 = b.sin1[i], b.cos1[i], b.sin0[i], b.cos0[i]
        t1, q1, det = carry_tangent_over_flight(
            t0,
            q0,
            b.w1[i],
            b.bend[i],
            b.lost[i],
            sin0,
            cos0,
            sin1,
            cos1,
            b.inverse_delta[i],
            b.epsilon[i],
        )
        r = b.restitution[i]
        det1 = det0 * (r * det)
        b.t_tangent[i] = select_number(go, t1, t0)
        b.w_tangent[i] = select_number(go, r * q1, q0)
        b.determinant[i] = select_number(go, det1, det0)
        b.time[i] = time0 + b.s[i]


@inline
def has_lossy_lane(b, groups):
    """Return whether impacts lose energy on some lane, so that a chatter may complete."""
    found = False
    for i in range(GROUP * groups):
        found |= b.capture[i] > 0.0
    return found


@inline
def stop_lanes_with_completing_chatter(b, groups):
    """Stop the lanes whose chatter is certain to complete. The caller computes when their motions leave the wall."""
    for i in range(GROUP * groups):
        pressing = b.wall[i] * contact_force(b.sin0[i], b.cos0[i], b.delta[i], b.epsilon[i], DRIFT)
        stops = is_chatter_certain_to_complete(abs(b.w[i]), pressing, b.gap[i], b.capture[i]) & (
            b.n_plus[i] < b.limit[i]
        )
        b.stuck[i] = select_number(stops, float(IN_CONTACT), b.stuck[i])
        b.limit[i] = select_number(stops, -1.0, b.limit[i])


@kernel
def advance_lane_safely(b, i, paths):
    """Move lane i, with its tangent vector, to its next impact, as `first_impact_by_safe_search` finds it.

    A lane that is in lasting contact, or whose flight has no impact, is stopped instead.
    """
    wall, flight = np.int64(b.wall[i]), double_precision_flight(b, i)
    if stays_in_contact(wall, flight.w, b.tau[i], flight.delta, flight.epsilon, DRIFT):
        b.stuck[i], b.limit[i] = IN_CONTACT, -1.0
        return
    paths[SAFE] += 1
    status, s, target, w1, lost, sin1, cos1 = first_impact_by_safe_search(wall, b.tau[i], flight, 0.5 * b.gap[i])
    if status != OK:
        b.stuck[i], b.limit[i] = status, -1.0
        return
    bend = second_derivative(lost, sin1, cos1, flight)
    t0, q0, sin0, cos0 = b.t_tangent[i], b.w_tangent[i], flight.sin0, flight.cos0
    t, q, det = carry_tangent_over_flight(
        t0, q0, w1, bend, lost, sin0, cos0, sin1, cos1, b.inverse_delta[i], flight.epsilon
    )
    r = b.restitution[i]
    b.t_tangent[i], b.w_tangent[i] = t, r * q
    b.determinant[i] *= r * det
    b.time[i] += s
    b.tau[i], b.w[i], b.wall[i], b.sin0[i], b.cos0[i] = (
        fold_phase(b.tau[i] + s),
        r * reflected_velocity(w1),
        target,
        sin1,
        cos1,
    )
    b.n_plus[i] += 0.5 + 0.5 * target
    b.n_minus[i] += 0.5 - 0.5 * target


@kernel
def compute_unproved_flights(b, groups, paths):
    """Compute the flights of the lanes whose impact is not proved, one by one with `advance_lane_safely`."""
    for i in range(GROUP * groups):
        if not b.sure[i] > 0.0 and b.n_plus[i] < b.limit[i]:
            advance_lane_safely(b, i, paths)


@kernel
def advance(memory, groups, flights, force, tangent, paths):
    """Compute the next `flights` flights of every lane that has made fewer impacts on Σ⁺ than its limit.

    memory: the block, as `allocate_lane_block` returns it. groups: number of groups of lanes in use. force: the result
    of `classify_contact_force_of_lanes`. tangent: whether tangent vectors are carried along. paths: two counters, of
    the flights that need a scan and of the flights that also need the safe search.
    """
    b = memory[0]
    lossy = has_lossy_lane(b, groups)
    for _ in range(flights):
        if lossy:
            stop_lanes_with_completing_chatter(b, groups)
        copy_to_single_precision(b, groups)
        guess_flight_times(b, groups)
        if force >= ROUGH:
            improve_time_guesses(b, groups)
        compute_height_coefficients(b, groups)
        choose_wall(b, groups)
        solve_impact_time_locally(b, groups)
        expand_and_solve_again(b, groups)
        refine_impact_times(b, groups)
        prove_first_impacts(b, groups)
        if force == ARCS:
            reject_lanes_with_two_turns(b, groups)
        unproved = np.int32(0)
        for i in range(GROUP * groups):
            # both casts are needed: numba widens the result of `|` to 64 bits, and mixed widths vectorise badly
            unproved = np.int32(unproved | np.int32(b.proved[i] == ZERO))
        if unproved:
            rescan_unproved_lanes(b, groups, force, paths)
        copy_to_double_precision(b, groups)
        evaluate_lanes_in_double(b, groups)
        if tangent:
            land_tangent(b, groups)
            carry_tangents(b, groups)
        else:
            land_plain(b, groups)
        unsure = np.int64(0)
        for i in range(GROUP * groups):
            unsure |= np.int64(b.sure[i] == 0.0)
        if unsure:
            compute_unproved_flights(b, groups, paths)
