"""The impact map on whole arrays: each element has its own trajectory and parameters, and all are computed in lanes."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rattle.flight.lanes.block import (
    GROUP,
    GROUPS,
    NONE,
    allocate_lane_block,
    classify_contact_force_of_lanes,
    clear_block,
    is_near_overflow,
    normalise_tangent,
    prepare_flights,
    put_trajectory_on_lane,
    stop_lane_at_limit,
)
from rattle.flight.lanes.rescan import SAFE, SCANNED
from rattle.flight.lanes.stages import advance
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import Iterates, IteratesWithExponents, check_states_and_parameters

# number of flights between two checks of the lanes; it divides the round numbers of impacts that users choose
FLIGHTS = np.int64(20)


class _ThreadLaneMemory(threading.local):
    """Scratch memory of kernels: each thread has a block of lanes of its own."""

    def __init__(self) -> None:
        self.block = allocate_lane_block()


_memory = _ThreadLaneMemory()


def lane_block_of_thread() -> Any:
    """Return this thread's block of lanes for kernels: an array (1,) of one record."""
    return _memory.block


def _build_iterate_lanes(tangent: bool) -> Any:
    @kernel
    def iterate_lanes(memory, tau, v, n, delta, epsilon, beta, paths):
        """Return Π^n of each element of flat arrays. A lane that finishes an element gets the next element.

        `paths` (2,) is incremented in place: it counts flights whose first impact needs a scan, and flights whose first
        impact needs the slower safe search.

        Returns
        -------
        tuple of ndarray
            (status, τ, v, impacts on Σ⁺, impacts on Σ⁻, growth). growth (3, size) holds the time and, if the kernel was
            made with `tangent`, ln stretch of a tangent vector and ln|det| of the tangent matrices, otherwise 0.
        """
        b, size = memory[0], tau.size
        out_tau, out_v = tau.copy(), v.copy()
        n_plus, n_minus = np.zeros(size, np.int64), np.zeros(size, np.int64)
        status = np.zeros(size, np.int8)
        growth = np.zeros((3, size))
        fresh, groups = NONE, GROUPS
        clear_block(b)
        while groups > 0:
            for i in range(GROUP * groups):
                k = b.who[i]
                over = stop_lane_at_limit(b, i)
                if tangent and k >= 0 and (over or is_near_overflow(b, i)):
                    stretch, contraction = normalise_tangent(b, i)
                    growth[1, k] += stretch
                    growth[2, k] += contraction
                if not over:
                    continue
                if k >= 0:
                    out_tau[k], out_v[k], growth[0, k] = b.tau[i], abs(b.w[i]), b.time[i]
                    n_plus[k], n_minus[k], status[k] = b.n_plus[i], b.n_minus[i], b.stuck[i]
                    b.who[i] = -1
                if fresh < size:
                    put_trajectory_on_lane(
                        b, i, tau[fresh], v[fresh], delta[fresh], epsilon[fresh], beta[fresh], n[fresh]
                    )
                    b.who[i] = fresh
                    fresh += 1
            groups = prepare_flights(b, groups, fresh == size)
            advance(memory, groups, FLIGHTS, classify_contact_force_of_lanes(b, groups), tangent, paths)
        return status, out_tau, out_v, n_plus, n_minus, growth

    # the name by which a compiling process finds the kernel
    iterate_lanes.name = "_iterate_lanes_tangent" if tangent else "_iterate_lanes_plain"
    return iterate_lanes


_iterate_lanes_plain, _iterate_lanes_tangent = _build_iterate_lanes(False), _build_iterate_lanes(True)


def iterate(
    delta: ArrayLike, epsilon: ArrayLike, tau: ArrayLike, v: ArrayLike, n: ArrayLike, beta: ArrayLike = 0.6
) -> Iterates:
    """Return the states after n steps of the impact map Π from the states (τ, v).

    All six arguments broadcast: δ > 0, ε ≥ 0, τ, v > 0, integers n ≥ 0, and β > 0. All values are dimensionless. A
    trajectory that comes to rest keeps its last state and has n_plus < n. The result of an element does not depend on
    the other elements.

    Returns
    -------
    Iterates
        States and numbers of impacts.
    """
    flat, shape = check_states_and_parameters(delta, epsilon, tau, v, n, beta)
    _status, *out, _growth = _iterate_lanes_plain(lane_block_of_thread(), *flat, np.zeros(2, np.int64))
    return Iterates(*(x.reshape(shape) for x in out))


def iterate_tangent(
    delta: ArrayLike, epsilon: ArrayLike, tau: ArrayLike, v: ArrayLike, n: ArrayLike, beta: ArrayLike = 0.6
) -> IteratesWithExponents:
    """Return the results of `iterate` with both Lyapunov exponents over the n impacts.

    A tangent vector that points along the phase at first is re-normalised repeatedly, in the coordinates (t, v²/2), in
    which a flight of duration s has the determinant e^(−δs). The second exponent is ln|det| of the tangent matrices
    per forcing period, minus the first exponent. Both exponents are NaN where n is 0.

    Returns
    -------
    IteratesWithExponents
        States, times and exponents.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    flat, shape = check_states_and_parameters(delta, epsilon, tau, v, n, beta)
    _status, *out, growth = _iterate_lanes_tangent(lane_block_of_thread(), *flat, np.zeros(2, np.int64))
    return IteratesWithExponents.from_growth(out, growth, shape)


def count_flights(
    delta: ArrayLike, epsilon: ArrayLike, tau: ArrayLike, v: ArrayLike, n: ArrayLike, beta: ArrayLike = 0.6
) -> tuple[int, int, int]:
    """Return how many flights `iterate` computes, how many of these need a scan, and how many need a safe search.

    A first impact is searched by a scan at fixed steps if the first guess is not proved, and by the slower safe search
    if the scan is not proved either.

    Returns
    -------
    tuple[int, int, int]
        All flights, scanned flights, and safely searched flights.
    """
    flat, _shape = check_states_and_parameters(delta, epsilon, tau, v, n, beta)
    counted = np.zeros(2, np.int64)
    _status, _tau, _v, n_plus, n_minus, _growth = _iterate_lanes_plain(lane_block_of_thread(), *flat, counted)
    return int(n_plus.sum() + n_minus.sum()), int(counted[SCANNED]), int(counted[SAFE])
