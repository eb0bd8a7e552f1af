"""Parameters of either gear as columns, (δ, ε, β) and of the stiff one κ, and gears at them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import states_of
from rattle.attractors.speeds import SpeedLimit, sampled_speeds
from rattle.attractors.table import MOST_SAMPLES, Attractor
from rattle.errors import parameters, real_array, require, require_integer
from rattle.flight.law import speed_unit, wrapped
from rattle.models import AnyGear, AnyModel, Columns, model_at, model_of
from rattle.numerics.sampling import initial_conditions

Array = NDArray[np.float64]
States = tuple[ArrayLike, ArrayLike] | None
MOST_STEPS = 100_000
SAME_POINT = 1e-6  # of the attractor that two calls find, speeds in their unit


def columns_of(gear: AnyGear, n: int) -> Columns:
    """The parameters of a gear, n times."""
    model = model_at(gear)
    stiffness = () if model.stiffness is None else (model.stiffness,)
    return tuple(np.full(n, x) for x in (gear.delta, gear.epsilon, gear.beta, *stiffness))


def model_on(columns: Columns) -> AnyModel:
    """Which gear these are the parameters of: its model at the first of them."""
    return model_of(float(columns[2][0]), None if len(columns) == 3 else float(columns[3][0]))


def gear_at(row: Array) -> AnyGear:
    """The gear at one row of parameters (3,) or (4,)."""
    delta, epsilon, beta, *kappa = (float(x) for x in row)
    return model_of(beta, *kappa).gear(delta, epsilon)


def sample_of(gear: AnyGear, count: int, v_max: SpeedLimit, seed: int, states: States = None) -> tuple[Array, Array]:
    """The sample (count,) of `attractors` of a gear, or own states (τ, v), flat. Raises ParameterError."""
    if states is not None:
        tau, v, _shape = states_of(*states)
        return tau, v
    count = require_integer("count", count, 1, MOST_SAMPLES)
    seed = require_integer("seed", seed, 0, (1 << 128) - 1)
    delta, epsilon, beta, *_ = columns_of(gear, 1)
    tau, v = initial_conditions(delta, epsilon, beta, count, sampled_speeds(v_max, delta, epsilon, beta), seed)
    return tau[0], v[0]


def unit_of(gear: AnyGear) -> float:
    """What speeds are measured in."""
    return float(speed_unit(gear.delta, gear.epsilon, gear.beta))


def same(one: Attractor, other: Attractor, unit: float) -> bool:
    """Whether two calls for one gear have found the same attractor; of chaotic ones, its kind tells."""
    if (one.kind, one.m, one.n_plus, one.n_minus) != (other.kind, other.m, other.n_plus, other.n_minus):
        return False
    near = abs(wrapped(one.tau - other.tau)) < SAME_POINT and abs(one.v - other.v) < SAME_POINT * unit
    return one.kind != "periodic" or bool(near)


def path_of(path: ArrayLike, beta: float, kappa: float | None, steps: int | None) -> Array:
    """The points (n, 3) or (n, 4) of a path of parameters, whose own (k, 2 to 4) begin with δ and ε.

    steps: n is one more than so many, even along the path with each parameter in units of its range; by default the
    path's own points. Raises ParameterError.
    """
    given = real_array("path", path)
    right = given.ndim == 2 and 2 <= given.shape[1] <= 4 and len(given) >= 2
    require(right, f"path must be points (k, 2) of δ and ε, (k, 3) with β or (k, 4) with κ, got shape {given.shape}")
    more = [np.full(len(given), x) for x in (beta, kappa) if x is not None][given.shape[1] - 2 :]
    points = np.column_stack([given, *more])
    named = dict(zip(("delta", "epsilon", "beta", "kappa"), points.T, strict=False))
    points = np.column_stack(parameters(**named))
    size = np.ptp(points, axis=0)
    scaled = points / np.where(size > 0.0, size, 1.0)
    length = np.linalg.norm(np.diff(scaled, axis=0), axis=1)
    require(bool((length > 0.0).all()), "neighbouring points of the path must differ")
    if steps is not None:
        n = require_integer("steps", steps, 1, MOST_STEPS) + 1
        along = np.append(0.0, np.cumsum(length))
        at = np.linspace(0.0, along[-1], n)
        points = np.column_stack([np.interp(at, along, x) for x in points.T])
    require(len(points) <= MOST_STEPS + 1, f"a path of {len(points)} points is too long: at most {MOST_STEPS + 1}")
    return np.asarray(points, np.float64)
