"""Helper functions of `rattle.resilience`: samples of one gear, the unit of speeds, and the points of a path."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import check_and_flatten_states
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import require, require_integer, require_real_array
from rattle.flight.law import speed_unit, wrap_phase_difference
from rattle.models import DEFAULT_MODEL, MODELS, AnyGear, Model, model_of
from rattle.parameters import Parameters

Array = NDArray[np.float64]
States = tuple[ArrayLike, ArrayLike] | None
#: Largest number of steps of a path.
MOST_STEPS = 100_000
#: States of two periodic attractors are the same if τ and v differ by less than this, v in units of `speed_unit_of`.
SAME_POINT = 1e-6


def initial_states_of(
    gear: AnyGear, count: int, v_max: SpeedLimit, seed: int, states: States = None
) -> tuple[Array, Array]:
    """Return the initial states that `Gear.attractors` draws, or `states` if given, as flat arrays of τ and v.

    Returns
    -------
    tuple[Array, Array]
        τ and v (n,).

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    if states is not None:
        tau, v, _shape = check_and_flatten_states(*states)
        return tau, v
    phases, speeds = SampleSpec(count, v_max, seed).draw_states(gear.parameters)
    return phases[0], speeds[0]


def speed_unit_of(gear: AnyGear) -> float:
    """Return the unit of speeds in which distances between states are measured, at the gear's parameters."""
    return float(speed_unit(gear.delta, gear.epsilon, gear.beta))


def is_same_attractor(one: Attractor, other: Attractor, unit: float) -> bool:
    """Return whether two attractors of a gear have the same kind and label and, if periodic, nearly the same state."""
    if (one.kind, one.m, one.n_plus, one.n_minus) != (other.kind, other.m, other.n_plus, other.n_minus):
        return False
    near = abs(wrap_phase_difference(one.tau - other.tau)) < SAME_POINT and abs(one.v - other.v) < SAME_POINT * unit
    return one.kind != "periodic" or bool(near)


def points_along_path(path: ArrayLike, beta: float, added: Mapping[str, float | None], steps: int | None) -> Parameters:
    """Return the parameters at the steps of a path.

    Parameters
    ----------
    path : ArrayLike
        The corners of the path, (k, 2 or more): columns δ and ε, then β and the parameters that the model adds. Columns
        at the end may be left out if they do not vary.
    beta : float
        The half-backlash, if the path has no column of β.
    added : Mapping[str, float | None]
        The parameters that the model adds, if the path has no columns of them. None means not given.
    steps : int | None
        The number of equal steps, between n = steps + 1 points. Lengths are measured with each parameter in units of
        its range. None: the points are the corners of the path.

    Returns
    -------
    points
        The parameters as arrays (n,) along the path.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    given = require_real_array("path", path)
    others = {name: x for name, x in added.items() if x is not None}
    model = (
        type(model_of(beta, **others)) if others or given.ndim != 2 else _model_by_parameter_count(given.shape[1] - 3)
    )
    names = ("delta", "epsilon", *(each.name for each in model.parameters()))
    right = given.ndim == 2 and 2 <= given.shape[1] <= len(names) and len(given) >= 2
    require(
        right,
        f"path must have a row for each of two points or more, and 2 to {len(names)} columns, {', '.join(names)} in "
        f"this order; got shape {given.shape}",
    )
    named = {name: np.full(len(given), x) for name, x in {"beta": beta, **others}.items()}
    at = Parameters.from_values(model.name, **named | dict(zip(names, given.T, strict=False)))
    points = np.column_stack([at.values_by_name[name] for name in names])
    size = np.ptp(points, axis=0)
    scaled = points / np.where(size > 0.0, size, 1.0)
    length = np.linalg.norm(np.diff(scaled, axis=0), axis=1)
    require(bool((length > 0.0).all()), "neighbouring points of the path must differ")
    if steps is not None:
        n = require_integer("steps", steps, 1, MOST_STEPS) + 1
        along = np.append(0.0, np.cumsum(length))
        position = np.linspace(0.0, along[-1], n)
        points = np.column_stack([np.interp(position, along, x) for x in points.T])
    require(
        len(points) <= MOST_STEPS + 1, f"a path of {len(points):,} points is too long: the limit is {MOST_STEPS + 1:,}"
    )
    delta, epsilon, beta_, *rest = (np.ascontiguousarray(x) for x in points.T)
    return Parameters(model.name, delta, epsilon, beta_, dict(zip(names[3:], rest, strict=True)))


def _model_by_parameter_count(n_added: int) -> type[Model]:
    """Return the first model with max(n_added, 0) parameters besides δ, ε and β, or else the default model."""
    return next((model for model in MODELS.values() if len(model.added) == max(n_added, 0)), MODELS[DEFAULT_MODEL])
