"""Measure other integrators on the same trajectories: their speed, and their differences from `rattle`.

heyoka (Taylor series, several trajectories at once) and scipy (DOP853) do not use the closed form of a flight. They
integrate the equation of motion and stop where Φ reaches a wall, so each is also an independent check. Both can pass
through a wall near grazing; such trajectories are counted as lost.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import rattle
from rattle import Iterates

if TYPE_CHECKING:
    from numpy.typing import NDArray

TWO_PI = 2.0 * math.pi
BETA = 0.6
REPEATS = 5
FULL = 4096  # rattle gets at least this many trajectories, so that its lanes are full nearly all the time
PATIENCE = 50.0  # a flight that has not ended after this many forcing periods is lost
BATCH = 8  # number of trajectories that heyoka integrates at once; 4, 16 and 32 are no faster
STEPS = 256  # heyoka's steps between two checks for lanes that have left the gap
OUTSIDE = 1e-6  # a state farther than this beyond a wall has passed through it, which rounding does not explain
RTOL, ATOL = 1e-13, 1e-14  # tolerances of scipy
INSTALL = "pip install 'gear-rattle[peers]'"


@dataclass(frozen=True)
class Starts:
    """States (τ, v) of departures from Σ⁺ with their parameters, as flat float64 arrays of one length; β is 0.6."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]


class Runner(Protocol):
    """A function that computes Πⁿ of states with another integrator."""

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Return Πⁿ of the states. A trajectory with n_plus < n is lost, and its final state has no meaning."""


@dataclass(frozen=True)
class Peer:
    """The measured speed and differences of another integrator.

    nanoseconds, rattle_nanoseconds: per impact on either wall, on one core, for the same trajectories at δ = 0.6,
    ε = 0.1. phase_error, speed_error: largest differences from `rattle.Gear.impact` after one Π, absolute in phase and
    relative in speed, without lost trajectories. compared: number of compared trajectories. lost: how many of these
    passed through a wall, stopped, or had another number of impacts on Σ⁻ than with rattle.
    """

    name: str
    version: str
    nanoseconds: float
    rattle_nanoseconds: float
    phase_error: float
    speed_error: float
    compared: int
    lost: int

    @property
    def ratio(self) -> float:
        """The time of the other integrator divided by that of rattle."""
        return self.nanoseconds / self.rattle_nanoseconds


def peers(compared: int = 400) -> Iterator[Peer]:
    """Measure each installed integrator, which takes some seconds. compared: number of trajectories to compare."""
    for name, (make, count, n) in PEERS.items():
        if find_spec(name) is None:
            continue
        run = make()
        nanoseconds, rattle_nanoseconds = race(run, workload(count), n)
        errors = differences(run, random_starts(compared))
        yield Peer(name, version(name), nanoseconds, rattle_nanoseconds, *errors)


def missing() -> dict[str, str]:
    """Return the integrators that are not installed, each with the command that installs it."""
    return {name: INSTALL for name in PEERS if find_spec(name) is None}


def workload(count: int) -> Starts:
    """Return the first `count` states of workload A: δ = 0.6, ε = 0.1, v from 0.5 to 7."""
    from bench.measure import workloads

    return Starts(*(x[:count] for x in workloads()["A"]))


def random_starts(count: int, seed: int = 7) -> Starts:
    """Return random states at random points: δ in [0.4, 1], ε in [0.02, 0.3], τ in [0, 1), v in (0.01, 7)."""
    rng = np.random.default_rng(seed)
    bounds = ((0.0, 1.0), (0.01, 7.0), (0.4, 1.0), (0.02, 0.3))
    return Starts(*(rng.uniform(low, high, count) for low, high in bounds))


def race(run: Runner, starts: Starts, n: int) -> tuple[float, float]:
    """Return the nanoseconds per impact of another integrator and of rattle, each the best of alternating runs.

    Compilation does not count. rattle computes the same trajectories several times, so that its lanes are full. It runs
    REPEATS times in succession, because a single short run would measure the caches that the other integrator left.

    Returns
    -------
    tuple[float, float]
        The other integrator's and rattle's nanoseconds.
    """
    gear = rattle.Gear(0.6, 0.1, BETA)
    tau, v = (np.tile(x, -(-FULL // x.size)) for x in (starts.tau, starts.v))

    def peer() -> Iterates:
        return run(starts, n)

    def ours() -> Iterates:
        return gear.iterate(tau, v, n)

    timed = [(_nanoseconds(peer), min(_nanoseconds(ours) for _ in range(REPEATS))) for _ in range(REPEATS)]
    return min(pair[0] for pair in timed), min(pair[1] for pair in timed)


def _nanoseconds(run: Callable[[], Iterates]) -> float:
    """Return the nanoseconds per impact of one run."""
    began = time.perf_counter()
    done = run()
    seconds = time.perf_counter() - began
    return seconds / int(done.n_plus.sum() + done.n_minus.sum()) * 1e9


def differences(run: Runner, starts: Starts) -> tuple[float, float, int, int]:
    """Compare one Π with rattle's. Return the fields phase_error, speed_error, compared and lost of `Peer`."""
    theirs = run(starts, 1)
    columns = zip(starts.tau, starts.v, starts.delta, starts.epsilon, strict=True)
    ours = [rattle.Gear(delta, epsilon, BETA).impact(tau, v) for tau, v, delta, epsilon in columns]
    tau, v, n_minus = (np.array([getattr(one, name) for one in ours]) for name in ("tau", "v", "n_minus"))
    kept = (theirs.n_plus == 1) & (theirs.n_minus == n_minus)
    phase = np.abs((theirs.tau - tau + 0.5) % 1.0 - 0.5)[kept]
    speed = np.abs(theirs.v / v - 1.0)[kept]
    return float(phase.max(initial=0.0)), float(speed.max(initial=0.0)), tau.size, int(tau.size - kept.sum())


@dataclass
class _Arrivals:
    """The final states so far. A trajectory without a final state keeps n_plus = 0, which means that it is lost."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]

    @classmethod
    def empty(cls, size: int) -> _Arrivals:
        return cls(np.zeros(size), np.zeros(size), np.zeros(size, np.int64), np.zeros(size, np.int64))

    def settle(self, index: int, when: float, v: float, n_plus: int, n_minus: int) -> None:
        """Record the final state of a trajectory."""
        self.tau[index], self.v[index] = when % 1.0, v
        self.n_plus[index], self.n_minus[index] = n_plus, n_minus

    def iterates(self) -> Iterates:
        return Iterates(self.tau, self.v, self.n_plus, self.n_minus)


class Heyoka:
    """Runner with heyoka's batch integrator; callbacks reflect trajectories. Creating one compiles for some 0.1 s.

    A flight begins one rounding error inside the gap, because heyoka misses an event of a wall within a step that
    begins exactly on this wall. Events have a direction, so that only arrivals count, and no cooldown, so that short
    bounces count too.
    """

    def __init__(self) -> None:
        import heyoka

        self.edge = math.nextafter(BETA, 0.0)
        self.left = [0] * BATCH  # for each lane: remaining impacts on Σ⁺; 0: the trajectory has ended
        self.below = [0] * BATCH  # for each lane: impacts on Σ⁻ so far
        height, velocity = heyoka.make_vars("height", "velocity")
        arriving = heyoka.event_direction
        self.integrator: Any = heyoka.taylor_adaptive_batch(
            [(height, velocity), (velocity, _acceleration(heyoka, velocity))],
            np.zeros((2, BATCH)),
            time=np.zeros(BATCH),
            pars=np.ones((2, BATCH)),
            t_events=[
                heyoka.t_event_batch(
                    height - BETA, callback=self._on_upper(), direction=arriving.positive, cooldown=0.0
                ),
                heyoka.t_event_batch(
                    height + BETA, callback=self._on_lower(), direction=arriving.negative, cooldown=0.0
                ),
            ],
        )
        # Memory views are faster than arrays for single elements, and write to the integrator's state.
        self.heights: Any = memoryview(self.integrator.state[0])
        self.velocities: Any = memoryview(self.integrator.state[1])

    def _on_upper(self) -> Callable[[object, int, int], bool]:
        """Return a callback that reflects on Σ⁺ and stops when a trajectory has ended.

        The callback is not a bound method, because heyoka would copy the object to which the method is bound.

        Returns
        -------
        Callable[[object, int, int], bool]
            The callback.
        """

        def reflect(_integrator: object, _sign: int, lane: int) -> bool:
            self.heights[lane] = self.edge
            self.velocities[lane] = -self.velocities[lane]
            self.left[lane] -= 1
            return self.left[lane] != 0

        return reflect

    def _on_lower(self) -> Callable[[object, int, int], bool]:
        """Return a callback that reflects on Σ⁻."""

        def reflect(_integrator: object, _sign: int, lane: int) -> bool:
            self.heights[lane] = -self.edge
            self.velocities[lane] = -self.velocities[lane]
            self.below[lane] += 1
            return True

        return reflect

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Return Πⁿ of all states, n ≥ 1. A free lane takes the next trajectory."""
        arrivals, waiting = _Arrivals.empty(starts.tau.size), iter(range(starts.tau.size))
        clock, ends = np.zeros(BATCH), np.zeros(BATCH)
        running = {lane: self._load(lane, starts, next(waiting, None), n, clock, ends) for lane in range(BATCH)}
        while any(index is not None for index in running.values()):
            self.integrator.set_time(clock)
            self.integrator.propagate_until(ends, max_steps=STEPS)
            clock = self.integrator.time.copy()
            for lane, index in running.items():
                if index is None:
                    continue
                lost = not abs(self.heights[lane]) < BETA + OUTSIDE or clock[lane] >= ends[lane]
                if self.left[lane] == 0 or lost:
                    n_plus, v = n - self.left[lane], abs(self.velocities[lane])
                    arrivals.settle(index, clock[lane], v, n_plus, self.below[lane])
                    running[lane] = self._load(lane, starts, next(waiting, None), n, clock, ends)
        return arrivals.iterates()

    def _load(
        self,
        lane: int,
        starts: Starts,
        index: int | None,
        n: int,
        clock: NDArray[np.float64],
        ends: NDArray[np.float64],
    ) -> int | None:
        """Put a trajectory into a lane and return its index. With None, make the lane idle."""
        self.left[lane], self.below[lane] = n, 0
        if index is None:
            self.heights[lane], self.velocities[lane], ends[lane] = 0.0, 0.0, clock[lane]
            return None
        self.heights[lane], self.velocities[lane] = self.edge, -starts.v[index]
        self.integrator.pars[:, lane] = starts.delta[index], starts.epsilon[index]
        clock[lane], ends[lane] = starts.tau[index], starts.tau[index] + n * PATIENCE
        return index


def _acceleration(heyoka: Any, velocity: Any) -> Any:
    """Return Φ'' in free flight as an expression of heyoka with the parameters δ and ε."""
    delta, epsilon, turn = heyoka.par[0], heyoka.par[1], TWO_PI * heyoka.time
    steady = delta * (2.0 * TWO_PI - velocity)
    return steady - TWO_PI * epsilon * (TWO_PI * heyoka.cos(turn) + delta * heyoka.sin(turn))


class _Wall:
    """Event function for scipy's solve_ivp: zero on a wall. An arrival from inside ends the integration."""

    terminal = True

    def __init__(self, side: int) -> None:
        self.height, self.direction = side * BETA, float(side)

    def __call__(self, _time: float, state: NDArray[np.float64]) -> float:
        return float(state[0]) - self.height


class Scipy:
    """Runner with scipy's solve_ivp (DOP853, tight tolerances), started again on the wall after each impact."""

    def __init__(self) -> None:
        self.walls = _Wall(1), _Wall(-1)

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Return Πⁿ of all states, computed one after the other."""
        arrivals = _Arrivals.empty(starts.tau.size)
        columns = zip(starts.tau, starts.v, starts.delta, starts.epsilon, strict=True)
        for index, (tau, v, delta, epsilon) in enumerate(columns):
            arrivals.settle(index, *self._iterate(float(tau), float(v), float(delta), float(epsilon), n))
        return arrivals.iterates()

    def _iterate(self, tau: float, v: float, delta: float, epsilon: float, n: int) -> tuple[float, float, int, int]:
        """Follow a trajectory to its n-th impact on Σ⁺ or until it is lost; return time, speed, impacts by wall."""
        when, side, velocity, hits = tau, 1, -v, {1: 0, -1: 0}
        while hits[1] < n:
            arrival = self._fly(when, side, velocity, delta, epsilon)
            if arrival is None:
                break
            when, side, velocity = arrival[0], arrival[1], -arrival[2]
            hits[side] += 1
        return when, abs(velocity), hits[1], hits[-1]

    def _fly(
        self, when: float, side: int, velocity: float, delta: float, epsilon: float
    ) -> tuple[float, int, float] | None:
        """Return time, wall and velocity of the first impact of a flight, or None if the flight is lost.

        The event function is zero at the start of the flight. The first step is so short that even the largest possible
        acceleration cannot bring the flight back to the wall; so the zero at the start never counts as an impact.

        Returns
        -------
        tuple[float, int, float] | None
            Time, wall (1 or −1) and velocity.
        """
        from scipy.integrate import solve_ivp

        if not side * velocity < 0.0:
            return None
        hardest = delta * 2.0 * (TWO_PI + abs(velocity)) + TWO_PI * epsilon * math.hypot(TWO_PI, delta)
        flight: Any = solve_ivp(
            _field(delta, epsilon),
            (when, when + PATIENCE),
            np.array([side * BETA, velocity]),
            method="DOP853",
            events=self.walls,
            first_step=min(abs(velocity) / hardest, PATIENCE),
            rtol=RTOL,
            atol=ATOL,
        )
        for wall, times, states in zip((1, -1), flight.t_events, flight.y_events, strict=True):
            if times.size:
                return float(times[0]), wall, float(states[0][1])
        return None


def _field(delta: float, epsilon: float) -> Callable[[float, NDArray[np.float64]], tuple[float, float]]:
    """Return the function for (Φ', Φ'') in free flight, as scipy needs it."""
    steady, cosine, sine = 2.0 * TWO_PI * delta, TWO_PI * TWO_PI * epsilon, TWO_PI * delta * epsilon

    def field(when: float, state: NDArray[np.float64]) -> tuple[float, float]:
        velocity = float(state[1])
        turn = TWO_PI * when
        return velocity, steady - delta * velocity - cosine * math.cos(turn) - sine * math.sin(turn)

    return field


# For each integrator: its runner, the number of trajectories of workload A to time, and their impacts on Σ⁺.
PEERS: dict[str, tuple[Callable[[], Runner], int, int]] = {"heyoka": (Heyoka, 256, 50), "scipy": (Scipy, 24, 20)}
