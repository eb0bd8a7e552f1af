"""The return map of the stiff gear on whole arrays; each element has its own trajectory and parameters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from rattle.flight.first_impact import OK
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import Iterates, IteratesWithExponents, check_states_and_parameters
from rattle.stiff.map.flow import QUIET
from rattle.stiff.map.return_map import StiffPoint, step, step_with_tangent


@kernel
def apply_stiff_returns(tau, v, n, delta, epsilon, beta, kappa, quiet, n_plus, n_minus):
    """Replace each state (τ, v) of flat arrays by its image after n returns to Σ⁺.

    A motion that makes only n_plus < n returns keeps its last state. Its entry of `quiet` is set to 1 if its contact
    never ends, and to 0 if it cannot be followed. n_plus and n_minus count the contacts with each wall.
    """
    for i in range(tau.size):
        point = StiffPoint(delta[i], epsilon[i], beta[i], kappa[i])
        while n_plus[i] < n[i]:
            code, tau[i], v[i], _time, below = step(tau[i], v[i], point)
            if code != OK:
                quiet[i] = np.int8(code == QUIET)
                break
            n_plus[i] += 1
            n_minus[i] += below


@kernel
def apply_stiff_returns_with_tangent(tau, v, n, delta, epsilon, beta, kappa, n_plus, n_minus, growth):
    """Replace states as `apply_stiff_returns` does, and follow a tangent vector in (t, v²/2) from each.

    The time, ln stretch of the tangent vector and ln|det| over the returns are added to the three rows of `growth`
    (3, k), in the column of the state.
    """
    for i in range(tau.size):
        point = StiffPoint(delta[i], epsilon[i], beta[i], kappa[i])
        x, y = 1.0, 0.0
        while n_plus[i] < n[i]:
            code, tau1, v1, time, below, j00, j01, j10, j11, _ln = step_with_tangent(tau[i], v[i], point)
            if code != OK:
                break
            j01, j10, j11 = j01 / v[i], j10 * v1, j11 * v1 / v[i]
            x, y = j00 * x + j01 * y, j10 * x + j11 * y
            size = math.hypot(x, y)
            x, y = x / size, y / size
            growth[0, i] += time
            growth[1, i] += math.log(size)
            growth[2, i] += math.log(abs(j00 * j11 - j01 * j10))
            tau[i], v[i] = tau1, v1
            n_plus[i] += 1
            n_minus[i] += below


def iterate(
    delta: ArrayLike,
    epsilon: ArrayLike,
    tau: ArrayLike,
    v: ArrayLike,
    n: ArrayLike,
    beta: ArrayLike = 0.6,
    kappa: ArrayLike = 1e4,
) -> Iterates:
    """Return the n-th departures from Σ⁺ after departures (τ, v): their images under Π^n. All arguments broadcast.

    v, δ, β and κ must be > 0, ε ≥ 0, and n integers ≥ 0; all are dimensionless. A trajectory whose contact with Σ⁺
    never ends keeps its last state and has n_plus < n.

    Returns
    -------
    Iterates
        Arrays of the broadcast shape: τ, v, and the numbers of contacts with both walls.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    flat, shape = check_states_and_parameters(delta, epsilon, tau, v, n, beta, kappa=kappa)
    n_plus, n_minus = np.zeros(flat[0].size, np.int64), np.zeros(flat[0].size, np.int64)
    apply_stiff_returns(*flat, np.zeros(flat[0].size, np.int8), n_plus, n_minus)
    return Iterates(*(x.reshape(shape) for x in (*flat[:2], n_plus, n_minus)))


def iterate_tangent(
    delta: ArrayLike,
    epsilon: ArrayLike,
    tau: ArrayLike,
    v: ArrayLike,
    n: ArrayLike,
    beta: ArrayLike = 0.6,
    kappa: ArrayLike = 1e4,
) -> IteratesWithExponents:
    """Return the results of `iterate`, and both Lyapunov exponents over the n returns.

    The exponents are in the coordinates of `rattle.iterate_tangent`. They are NaN for a motion that makes no return.

    Returns
    -------
    IteratesWithExponents
        States, numbers of contacts with both walls, and exponents.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    flat, shape = check_states_and_parameters(delta, epsilon, tau, v, n, beta, kappa=kappa)
    n_plus, n_minus = np.zeros(flat[0].size, np.int64), np.zeros(flat[0].size, np.int64)
    growth = np.zeros((3, flat[0].size))
    apply_stiff_returns_with_tangent(*flat, n_plus, n_minus, growth)
    return IteratesWithExponents.from_growth((*flat[:2], n_plus, n_minus), growth, shape)
