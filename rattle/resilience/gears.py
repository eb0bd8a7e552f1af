"""The sample of one gear, and the points of a path of parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import states_of
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import Attractor
from rattle.errors import real_array, require, require_integer
from rattle.flight.law import speed_unit, wrapped
from rattle.models import DEFAULT_MODEL, MODELS, AnyGear, Model, model_of
from rattle.parameters import Parameters

Array = NDArray[np.float64]
States = tuple[ArrayLike, ArrayLike] | None
MOST_STEPS = 100_000
SAME_POINT = 1e-6  # of the attractor that two calls find, speeds in their unit


def sample_of(gear: AnyGear, count: int, v_max: SpeedLimit, seed: int, states: States = None) -> tuple[Array, Array]:
    """Return the sample (count,) of `attractors` of a gear, or own states (τ, v), flat. Raises ParameterError."""
    if states is not None:
        tau, v, _shape = states_of(*states)
        return tau, v
    phases, speeds = SampleSpec(count, v_max, seed).states(gear.parameters)
    return phases[0], speeds[0]


def unit_of(gear: AnyGear) -> float:
    """Return the scale of speeds."""
    return float(speed_unit(gear.delta, gear.epsilon, gear.beta))


def same(one: Attractor, other: Attractor, unit: float) -> bool:
    """Return whether two calls for one gear have found the same attractor; of chaotic ones, its kind tells."""
    if (one.kind, one.m, one.n_plus, one.n_minus) != (other.kind, other.m, other.n_plus, other.n_minus):
        return False
    near = abs(wrapped(one.tau - other.tau)) < SAME_POINT and abs(one.v - other.v) < SAME_POINT * unit
    return one.kind != "periodic" or bool(near)


def path_points(path: ArrayLike, beta: float, added: Mapping[str, float | None], steps: int | None) -> Parameters:
    """Return the points (n,) of a path of parameters, whose own points (k, 2 or more) begin with δ, ε, β.

    Parameters
    ----------
    added : Mapping[str, float | None]
        What the model has besides, where the path has none.
    steps : int | None
        N is one more than so many, even along the path with each parameter in units of its range; by default the path's
        own points.

    Returns
    -------
    points
        Parameters: Arrays (n,), along the path.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    given = real_array("path", path)
    others = {name: x for name, x in added.items() if x is not None}
    model = type(model_of(beta, **others)) if others or given.ndim != 2 else _adding(given.shape[1] - 3)
    names = ("delta", "epsilon", *(each.name for each in model.parameters()))
    right = given.ndim == 2 and 2 <= given.shape[1] <= len(names) and len(given) >= 2
    require(
        right,
        "path must be points (k, 2) of δ and ε, (k, 3) with β, or more with what the model adds, got shape "
        f"{given.shape}",
    )
    named = {name: np.full(len(given), x) for name, x in {"beta": beta, **others}.items()}
    at = Parameters.of(model.name, **named | dict(zip(names, given.T, strict=False)))
    points = np.column_stack([at.named[name] for name in names])
    size = np.ptp(points, axis=0)
    scaled = points / np.where(size > 0.0, size, 1.0)
    length = np.linalg.norm(np.diff(scaled, axis=0), axis=1)
    require(bool((length > 0.0).all()), "neighbouring points of the path must differ")
    if steps is not None:
        n = require_integer("steps", steps, 1, MOST_STEPS) + 1
        along = np.append(0.0, np.cumsum(length))
        position = np.linspace(0.0, along[-1], n)
        points = np.column_stack([np.interp(position, along, x) for x in points.T])
    require(len(points) <= MOST_STEPS + 1, f"a path of {len(points)} points is too long: at most {MOST_STEPS + 1}")
    delta, epsilon, beta_, *rest = (np.ascontiguousarray(x) for x in points.T)
    return Parameters(model.name, delta, epsilon, beta_, dict(zip(names[3:], rest, strict=True)))


def _adding(more: int) -> type[Model]:
    """Return the model that adds so many parameters, whose values a path has itself: the first of these."""
    return next((model for model in MODELS.values() if len(model.added) == max(more, 0)), MODELS[DEFAULT_MODEL])
