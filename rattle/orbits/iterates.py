"""Results of a return map for arrays of states, and motions sampled in time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, RattleError, real_array, require, require_integer, require_number
from rattle.flight.first_impact import OK

LONGEST, MOST_POINTS, MOST_IMPACTS = 10_000.0, 10_000_000, 10_000_000
Array = NDArray[np.float64]


class Iterates(NamedTuple):
    """Final states of many trajectories with the impacts counted on each wall; all of the broadcast shape."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]


class Returned(NamedTuple):
    """States (n,) after one return to Σ⁺, with its time; goes: whether there was one, else the state is as before."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    time: NDArray[np.float64]
    goes: NDArray[np.bool_]

    @classmethod
    def of(cls, found: Stretched) -> Returned:
        """Return the states after these trajectories of one impact."""
        goes = found.n_plus > 0
        return cls(found.tau, found.v, np.where(goes, found.time, 0.0), goes)


class Stretched(NamedTuple):
    """`Iterates` with the time taken and both Lyapunov exponents, (2, *shape), per forcing period."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]
    time: NDArray[np.float64]
    lyapunov: NDArray[np.float64]

    @classmethod
    def of(cls, flat: Sequence[NDArray[Any]], growth: NDArray[np.float64], shape: tuple[int, ...]) -> Stretched:
        """Return trajectories from the flat (τ, v, n₊, n₋) and growth (3, k): time, ln stretch and ln|det| of each."""
        time = growth[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = growth[1] / time
            second = growth[2] / time - first
        tau, v, n_plus, n_minus = (x.reshape(shape) for x in flat)
        exponents = np.stack([first, second]).reshape(2, *shape)
        return cls(tau, v, n_plus, n_minus, time.reshape(shape), exponents)


def fold(phases: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phases folded into [0, 1); a tiny negative one would round up to 1."""
    folded = phases % 1.0
    return np.where(folded < 1.0, folded, 0.0)


def require_states(tau: NDArray[Any], v: NDArray[Any], n: NDArray[Any]) -> None:
    """Raise ParameterError unless these are departures, and numbers of returns."""
    require(bool(np.isfinite(tau).all()), "tau must be finite")
    require(bool((np.isfinite(v) & (v > 0)).all()), "v must be finite and greater than 0")
    require(np.issubdtype(n.dtype, np.integer) and bool((n >= 0).all()), "n must be integers of at least 0")
    require(bool((n < 1 << 53).all()), "n must be below 2**53")


def checked(
    delta: ArrayLike, epsilon: ArrayLike, tau: ArrayLike, v: ArrayLike, n: ArrayLike, beta: ArrayLike, **more: ArrayLike
) -> tuple[list[NDArray[Any]], tuple[int, ...]]:
    """Flat contiguous copies of (τ, v, n, δ, ε, β) and more parameters above 0, and the broadcast shape."""
    named = {"delta": delta, "epsilon": epsilon, "tau": tau, "v": v, "beta": beta, **more}
    steps = np.asarray(n)
    try:
        arrays = [real_array(name, value) for name, value in named.items()]
        d, e, phases, speeds, b, *others, steps = np.broadcast_arrays(*arrays, steps)
    except ParameterError:
        raise
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{', '.join(named)} and n must broadcast: {error}") from None
    require_states(phases, speeds, steps)
    for name, array in (("delta", d), ("beta", b), *zip(more, others, strict=True)):
        require(bool((np.isfinite(array) & (array > 0)).all()), f"{name} must be finite and greater than 0")
    require(bool((np.isfinite(e) & (e >= 0)).all()), "epsilon must be finite and at least 0")
    flat = [np.array(x, np.float64, order="C").ravel() for x in (fold(phases), speeds, steps, d, e, b, *others)]
    return flat, phases.shape


class Trajectory(NamedTuple):
    """A sampled motion. time, phi, velocity (points,): forcing periods since the start, Φ and Φ'.

    impact_time, impact_wall, impact_speed (k,): the impacts on the way, wall +1 (Φ = β) or −1, speed |Φ'|. rest: when
    it comes to rest on Σ⁺, inf if it does not; its bounces are slower than 1e-4 from there on, and are left out.
    """

    time: Array
    phi: Array
    velocity: Array
    impact_time: Array
    impact_wall: NDArray[np.int64]
    impact_speed: Array
    rest: float


def sampled_motion(
    sampled: Callable[..., tuple[int, int, float]],
    tau: float,
    v: float,
    parameters: Sequence[Any],
    periods: float,
    points: int,
) -> Trajectory:
    """Return a motion of any model from (τ, v) on, sampled at this number of points.

    Parameters
    ----------
    sampled : Callable[..., tuple[int, int, float]]
        A kernel that takes (τ, v), parameters, the times and arrays for Φ and Φ' (points,), and for time, wall and
        speed of the impacts; returns its status, how many impacts there were, and when the motion came to rest.

    Returns
    -------
    Trajectory
        Times, Φ and Φ' (points,), and the impacts on the way.

    Raises
    ------
    RattleError
        If the motion makes too many impacts.
    """
    v, periods = require_number("v", v, positive=True), require_number("periods", periods, positive=True)
    require(periods <= LONGEST, f"periods must be at most {LONGEST:g}, got {periods:g}")
    points = require_integer("points", points, 2, MOST_POINTS)
    time = np.linspace(0.0, periods, points)
    phi, velocity = np.empty(points), np.empty(points)
    room = 1024
    while True:
        at, wall, speed = np.empty(room), np.empty(room, np.int64), np.empty(room)
        status, count, rest = sampled(tau, v, *parameters, time, phi, velocity, at, wall, speed)
        if status != OK:
            raise RattleError("the motion cannot be followed: its parameters or its state are beyond double precision")
        if count > MOST_IMPACTS:
            raise RattleError(f"the motion makes more than {MOST_IMPACTS} impacts: ask for fewer periods")
        if count <= room:
            return Trajectory(time, phi, velocity, at[:count], wall[:count], speed[:count], float(rest))
        room = count


class Impact(NamedTuple):
    """One step of the impact map.

    It has (τ, v), the impacts on Σ⁻ on the way, the tangent matrix ∂(τ', v')/∂(τ, v), and the time taken.
    """

    tau: float
    v: float
    n_minus: int
    tangent: NDArray[np.float64]
    time: float
