"""The impact map of the inelastic gear on whole arrays; each element has its own trajectory and parameters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError
from rattle.flight.contact_phase import IN_CONTACT
from rattle.flight.first_impact import OK
from rattle.inelastic.given import Harmonics, check_harmonics, check_inelastic_parameters
from rattle.inelastic.map.cells import InelasticCells, inelastic_point_of_cell, make_inelastic_cells
from rattle.inelastic.map.impact_map import step, step_with_tangent
from rattle.numerics.compile import kernel
from rattle.orbits.iterates import Iterates, IteratesWithExponents, fold_phases, require_states
from rattle.parameters import Parameters


@kernel
def apply_inelastic_returns(tau, v, n, cell, cells, quiet, n_plus, n_minus, contacts, time):
    """Replace each state (τ, v) of flat arrays by its image after n steps of the impact map.

    A motion whose contact never ends after n_plus < n steps keeps its last state, and its entry of `quiet` is set to 1.
    n_plus and n_minus count the impacts on each wall, with a completed chatter as one impact. `contacts` counts contact
    phases, and `time` sums the time in forcing periods.
    """
    for i in range(tau.size):
        point = inelastic_point_of_cell(cell[i], cells)
        while n_plus[i] < n[i]:
            code, tau1, v1, duration, below, on_plus, on_minus = step(tau[i], v[i], point)
            if code != OK:
                quiet[i] = np.int8(code == IN_CONTACT)
                break
            tau[i], v[i] = tau1, v1
            n_plus[i] += 1
            n_minus[i] += below
            contacts[i] += on_plus + on_minus
            time[i] += duration


@kernel
def apply_inelastic_returns_with_tangent(tau, v, n, cell, cells, n_plus, n_minus, growth):
    """Replace states as `apply_inelastic_returns` does, and follow a tangent vector in (t, v²/2) from each.

    The time, ln stretch of the tangent vector and ln|det| over the returns are added to the three rows of `growth`
    (3, k), in the column of the state.
    """
    for i in range(tau.size):
        point = inelastic_point_of_cell(cell[i], cells)
        x, y = 1.0, 0.0
        while n_plus[i] < n[i]:
            code, tau1, v1, time, below, j00, j01, j10, j11, log_det, _p, _m = step_with_tangent(tau[i], v[i], point)
            if code != OK:
                break
            x, y = j00 * x + j01 / v[i] * y, v1 * (j10 * x + j11 / v[i] * y)
            size = math.hypot(x, y)
            if size > 0.0:
                x, y = x / size, y / size
            else:
                x, y = 1.0, 0.0
            growth[0, i] += time
            growth[1, i] += math.log(size)
            growth[2, i] += log_det
            tau[i], v[i] = tau1, v1
            n_plus[i] += 1
            n_minus[i] += below


def _broadcast_states_and_cells(
    parameters: Parameters, tau: ArrayLike, v: ArrayLike, n: ArrayLike
) -> tuple[list[Any], Any, tuple[int, ...]]:
    """Broadcast states and parameters, and check them.

    Returns
    -------
    list, InelasticCells, tuple of int
        Flat copies of τ, v, n and of each state's cell number; the cells; the broadcast shape.

    Raises
    ------
    ParameterError
        If the shapes do not broadcast, or a state is outside its domain.
    """
    number = np.arange(parameters.size).reshape(parameters.shape)
    try:
        phases, speeds, steps, cell = np.broadcast_arrays(
            np.asarray(tau, np.float64), np.asarray(v, np.float64), np.asarray(n), number
        )
    except (TypeError, ValueError) as error:
        raise ParameterError(f"the shapes of tau, v, n and the parameters do not broadcast: {error}") from None
    require_states(phases, speeds, steps)
    flat = parameters.flat()
    added = flat.added["restitution"], flat.added["load"]
    cells: InelasticCells = make_inelastic_cells(flat.delta, flat.epsilon, flat.beta, *added, parameters.harmonics)
    arrays = (fold_phases(phases), speeds, steps.astype(np.int64), cell)
    return [np.array(x, order="C").ravel() for x in arrays], cells, phases.shape


def _allocate_counters(size: int, number: int) -> list[NDArray[np.int64]]:
    """Return `number` arrays (size,) of zeros, in which kernels count impacts and contact phases."""
    return [np.zeros(size, np.int64) for _ in range(number)]


def iterate(
    delta: ArrayLike,
    epsilon: ArrayLike,
    tau: ArrayLike,
    v: ArrayLike,
    n: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
    harmonics: Harmonics = (),
) -> Iterates:
    """Apply the impact map n times to states (τ, v), as `rattle.iterate` does for elastic impacts.

    Parameters
    ----------
    delta, epsilon, beta, restitution, load : array_like
        The parameters, which broadcast with the states: see `rattle.Gear`.
    tau, v : array_like
        Phase and speed (> 0) after an impact on Σ⁺.
    n : array_like of int
        Number of impacts on Σ⁺. If a chatter is certain to complete, all its impacts up to the end of the contact phase
        count as one. A motion that becomes quiet keeps its last state and has n_plus < n.
    harmonics : sequence of (int, float, float)
        The harmonics besides the first.

    Returns
    -------
    Iterates
        States and impacts on both walls.

    Raises
    ------
    ParameterError
        If a number is outside its domain.
    """
    at = check_inelastic_parameters(delta, epsilon, beta, restitution, load, check_harmonics(harmonics))
    (tau_, v_, n_, cell), cells, shape = _broadcast_states_and_cells(at, tau, v, n)
    n_plus, n_minus, contacts = _allocate_counters(tau_.size, 3)
    apply_inelastic_returns(
        tau_, v_, n_, cell, cells, np.zeros(tau_.size, np.int8), n_plus, n_minus, contacts, np.zeros(tau_.size)
    )
    return Iterates(tau_.reshape(shape), v_.reshape(shape), n_plus.reshape(shape), n_minus.reshape(shape))


def iterate_tangent(
    delta: ArrayLike,
    epsilon: ArrayLike,
    tau: ArrayLike,
    v: ArrayLike,
    n: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
    harmonics: Harmonics = (),
) -> IteratesWithExponents:
    """Return the results of `iterate`, and both Lyapunov exponents over the n impacts: see `rattle.iterate_tangent`.

    λ₁ + λ₂ is −δ plus 2 ln r times the number of impacts per forcing period. After a contact phase λ₁ is −∞, and λ₂,
    which is computed as a difference, is NaN. Raises ParameterError.

    Returns
    -------
    IteratesWithExponents
        States, impacts on both walls, and exponents.
    """
    at = check_inelastic_parameters(delta, epsilon, beta, restitution, load, check_harmonics(harmonics))
    (tau_, v_, n_, cell), cells, shape = _broadcast_states_and_cells(at, tau, v, n)
    n_plus, n_minus = _allocate_counters(tau_.size, 2)
    growth = np.zeros((3, tau_.size))
    apply_inelastic_returns_with_tangent(tau_, v_, n_, cell, cells, n_plus, n_minus, growth)
    return IteratesWithExponents.from_growth((tau_, v_, n_plus, n_minus), growth, shape)
