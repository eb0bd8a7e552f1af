"""Results of a return map for arrays of states, sampled motions, and checks of their arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import ParameterError, RattleError, require, require_integer, require_number, require_real_array
from rattle.flight.first_impact import OK

# largest allowed number of forcing periods, of points and of impacts of a sampled motion
LONGEST, MOST_POINTS, MOST_IMPACTS = 10_000.0, 10_000_000, 10_000_000
Array = NDArray[np.float64]


class Iterates(NamedTuple):
    """Final states and numbers of impacts of trajectories, arrays of the shape to which the arguments broadcast."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]


class StatesAfterReturn(NamedTuple):
    """States (n,) after one return to Σ⁺, and the durations of the returns.

    has_returned (n,): False for a state that never returns; such a state is left unchanged, with duration 0.
    """

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    time: NDArray[np.float64]
    has_returned: NDArray[np.bool_]

    @classmethod
    def from_iterates(cls, found: IteratesWithExponents) -> StatesAfterReturn:
        """Return the record from the results of `iterate_tangent` for one impact on Σ⁺."""
        has_returned = found.n_plus > 0
        return cls(found.tau, found.v, np.where(has_returned, found.time, 0.0), has_returned)


class IteratesWithExponents(NamedTuple):
    """`Iterates` with the elapsed time and both Lyapunov exponents (2, *shape), per forcing period."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]
    time: NDArray[np.float64]
    lyapunov: NDArray[np.float64]

    @classmethod
    def from_growth(
        cls, flat: Sequence[NDArray[Any]], growth: NDArray[np.float64], shape: tuple[int, ...]
    ) -> IteratesWithExponents:
        """Return the results of k trajectories in the shape `shape`, with both Lyapunov exponents.

        flat: τ, v, n₊ and n₋, each (k,). growth (3, k): for each trajectory the time, ln stretch of its tangent vector,
        and ln|det| of its tangent map.

        Returns
        -------
        IteratesWithExponents
            The results; the exponents are NaN where the time is 0.
        """
        time = growth[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            first = growth[1] / time
            second = growth[2] / time - first
        tau, v, n_plus, n_minus = (x.reshape(shape) for x in flat)
        exponents = np.stack([first, second]).reshape(2, *shape)
        return cls(tau, v, n_plus, n_minus, time.reshape(shape), exponents)


def fold_phases(phases: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return phases folded into [0, 1). A tiny negative phase gives 0, not 1."""
    folded = phases % 1.0
    return np.where(folded < 1.0, folded, 0.0)


def require_states(tau: NDArray[Any], v: NDArray[Any], n: NDArray[Any]) -> None:
    """Raise ParameterError unless (tau, v) are departures from Σ⁺ and n holds numbers of returns."""
    require(bool(np.isfinite(tau).all()), "tau must be finite")
    require(bool((np.isfinite(v) & (v > 0)).all()), "v must be finite and greater than 0")
    require(np.issubdtype(n.dtype, np.integer) and bool((n >= 0).all()), "n must hold integers of at least 0")
    require(bool((n < 1 << 53).all()), "n must be below 2**53")


def check_states_and_parameters(
    delta: ArrayLike, epsilon: ArrayLike, tau: ArrayLike, v: ArrayLike, n: ArrayLike, beta: ArrayLike, **more: ArrayLike
) -> tuple[list[NDArray[Any]], tuple[int, ...]]:
    """Check and broadcast states, numbers of returns and parameters; `more` are further positive parameters.

    Returns
    -------
    tuple
        Flat contiguous copies of τ (in [0, 1)), v, n, δ, ε, β and the values of `more`; and the broadcast shape.

    Raises
    ------
    ParameterError
        If an argument is outside its domain, or the shapes do not broadcast.
    """
    named = {"delta": delta, "epsilon": epsilon, "tau": tau, "v": v, "beta": beta, **more}
    steps = np.asarray(n)
    try:
        arrays = [require_real_array(name, value) for name, value in named.items()]
        d, e, phases, speeds, b, *others, steps = np.broadcast_arrays(*arrays, steps)
    except ParameterError:
        raise
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{', '.join(named)} and n must have shapes that broadcast: {error}") from None
    require_states(phases, speeds, steps)
    for name, array in (("delta", d), ("beta", b), *zip(more, others, strict=True)):
        require(bool((np.isfinite(array) & (array > 0)).all()), f"{name} must be finite and greater than 0")
    require(bool((np.isfinite(e) & (e >= 0)).all()), "epsilon must be finite and at least 0")
    flat = [np.array(x, np.float64, order="C").ravel() for x in (fold_phases(phases), speeds, steps, d, e, b, *others)]
    return flat, phases.shape


class Trajectory(NamedTuple):
    """A motion, given by Φ and Φ' at a sequence of times and by its impacts.

    Attributes
    ----------
    time, phi, velocity : ndarray, (points,)
        Forcing periods since the start, Φ and Φ'.
    impact_time, impact_wall, impact_speed : ndarray, (k,)
        The impacts: time, wall +1 (Φ = β) or −1, and speed |Φ'|.
    rest : float
        Time from which contact lasts for ever, inf if it never does. The impacting gear bounces for ever: its bounces
        count as contact once they are slower than 1e-4 and certain to become quiet, and are then left out.
    """

    time: Array
    phi: Array
    velocity: Array
    impact_time: Array
    impact_wall: NDArray[np.int64]
    impact_speed: Array
    rest: float


def sample_motion(
    sampled: Callable[..., tuple[int, int, float]],
    tau: float,
    v: float,
    parameters: Sequence[Any],
    periods: float,
    points: int,
) -> Trajectory:
    """Return the motion of any model from a departure (τ, v), sampled at `points` equally spaced times.

    Parameters
    ----------
    sampled : Callable[..., tuple[int, int, float]]
        A kernel that takes (τ, v), the parameters, the times, and arrays to fill: Φ and Φ' (points,), and time, wall
        and speed of the impacts. It returns its status, the number of impacts, and the time at which the motion comes
        to rest (inf if it does not).

    Returns
    -------
    Trajectory
        Times, Φ and Φ' (points,), and the impacts.

    Raises
    ------
    ParameterError
        If v, periods or points is outside its domain.
    RattleError
        If the motion makes too many impacts, or cannot be followed.
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
            raise RattleError(
                "the motion cannot be followed: a flight is too long, or a parameter or the state is beyond double "
                "precision"
            )
        if count > MOST_IMPACTS:
            raise RattleError(f"the motion makes more than {MOST_IMPACTS} impacts: give fewer periods")
        if count <= room:
            return Trajectory(time, phi, velocity, at[:count], wall[:count], speed[:count], float(rest))
        room = count


class Impact(NamedTuple):
    """One step of the impact map from a state (τ, v).

    tau and v are the state after the next impact on Σ⁺, n_minus is the number of impacts on Σ⁻ before it, tangent (2,
    2) the derivative of the new state with respect to the old one, and time the elapsed time in forcing periods.
    """

    tau: float
    v: float
    n_minus: int
    tangent: NDArray[np.float64]
    time: float
