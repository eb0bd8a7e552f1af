"""Other people's integrators on the same trajectories: how fast they are, and whether they agree with `rattle`.

heyoka (Taylor series, several trajectories at once) and scipy (DOP853) know nothing of the closed form: they integrate
the equation of motion and stop where Φ reaches a wall. So each is a peer to be timed against and an independent oracle.
Either can pass through a wall near grazing; such trajectories are counted as lost, never left out in silence.
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
FULL = 4096  # trajectories beside which the lanes left empty at the end do not show
PATIENCE = 50.0  # forcing periods after which a flight that has not ended is lost
BATCH = 8  # trajectories that heyoka integrates at once; 4, 16 and 32 are no faster
STEPS = 256  # heyoka's steps between two looks for lanes that have left the gap
OUTSIDE = 1e-6  # so far beyond a wall is no rounding
RTOL, ATOL = 1e-13, 1e-14  # scipy's
INSTALL = "pip install 'gear-rattle[peers]'"


@dataclass(frozen=True)
class Starts:
    """States (τ, v) on Σ⁺ and their parameters; flat float64 arrays of one length. β is 0.6."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]


class Runner(Protocol):
    """Π^n of every start by one peer; n_plus < n where it lost the wall (the state there means nothing)."""

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Final states, each of the starts' length."""


@dataclass(frozen=True)
class Peer:
    """One peer, measured.

    Nanoseconds are per impact on either wall, one core, δ = 0.6, ε = 0.1, the peer's and rattle's on the same
    trajectories; the impacts are those that each really made. The errors are the largest differences from
    `rattle.Gear.impact` after one Π, in phase and relative in speed, over the compared trajectories but the lost ones,
    on which the peer passed through a wall, stopped, or met other walls than rattle.
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
        """How many times longer the peer takes than rattle."""
        return self.nanoseconds / self.rattle_nanoseconds


def peers(compared: int = 400) -> Iterator[Peer]:
    """Each installed peer, measured; every one takes some seconds. `compared` trajectories check its answers."""
    for name, (make, count, n) in PEERS.items():
        if find_spec(name) is None:
            continue
        run = make()
        nanoseconds, rattle_nanoseconds = race(run, workload(count), n)
        errors = differences(run, random_starts(compared))
        yield Peer(name, version(name), nanoseconds, rattle_nanoseconds, *errors)


def missing() -> dict[str, str]:
    """The peers that are not installed, each with the command that installs it."""
    return {name: INSTALL for name in PEERS if find_spec(name) is None}


def workload(count: int) -> Starts:
    """The first `count` states of the benchmark's workload A: δ = 0.6, ε = 0.1, v in (0.5, 7)."""
    from bench.measure import workloads

    return Starts(*(x[:count] for x in workloads()["A"]))


def random_starts(count: int, seed: int = 7) -> Starts:
    """Random states over the plane: δ ∈ [0.4, 1], ε ∈ [0.02, 0.3], τ ∈ [0, 1), v ∈ (0.01, 7)."""
    rng = np.random.default_rng(seed)
    bounds = ((0.0, 1.0), (0.01, 7.0), (0.4, 1.0), (0.02, 0.3))
    return Starts(*(rng.uniform(low, high, count) for low, high in bounds))


def race(run: Runner, starts: Starts, n: int) -> tuple[float, float]:
    """Nanoseconds per impact of the peer and of rattle, all starts at δ = 0.6, ε = 0.1; each the best of runs in turn.

    Compiling comes before and is not counted. Rattle flies the same trajectories over and over, so that its lanes are
    full; each of its turns is several runs, because one is short and would measure caches that the peer left cold.
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
    """Nanoseconds per impact of one run."""
    began = time.perf_counter()
    done = run()
    seconds = time.perf_counter() - began
    return seconds / int(done.n_plus.sum() + done.n_minus.sum()) * 1e9


def differences(run: Runner, starts: Starts) -> tuple[float, float, int, int]:
    """One Π by the peer against rattle: largest difference in phase, in speed (relative), compared, lost."""
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
    """Final states being filled in; a trajectory that is never settled keeps n_plus = 0 and is lost."""

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]

    @classmethod
    def empty(cls, size: int) -> _Arrivals:
        return cls(np.zeros(size), np.zeros(size), np.zeros(size, np.int64), np.zeros(size, np.int64))

    def settle(self, index: int, when: float, v: float, n_plus: int, n_minus: int) -> None:
        """Record one trajectory's end."""
        self.tau[index], self.v[index] = when % 1.0, v
        self.n_plus[index], self.n_minus[index] = n_plus, n_minus

    def iterates(self) -> Iterates:
        return Iterates(self.tau, self.v, self.n_plus, self.n_minus)


class Heyoka:
    """Runner on heyoka's batch integrator; reflection by callback. Making one compiles (some tenths of a second).

    A flight starts one rounding inside the gap: where an event function is exactly zero at the start of a step, the
    return to that wall within the step goes unseen. Events have a direction and no cooldown, so that only arrivals
    count, and short bounces too.
    """

    def __init__(self) -> None:
        import heyoka

        self.edge = math.nextafter(BETA, 0.0)
        self.left = [0] * BATCH  # per lane: impacts on Σ⁺ still to come; 0: arrived
        self.below = [0] * BATCH  # per lane: impacts on Σ⁻ so far
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
        # Cheaper than arrays to index one by one; writes go to the integrator.
        self.heights: Any = memoryview(self.integrator.state[0])
        self.velocities: Any = memoryview(self.integrator.state[1])

    def _on_upper(self) -> Callable[[object, int, int], bool]:
        """Callback that reflects on Σ⁺, and stops when a lane has arrived. heyoka would copy a bound method's self."""

        def reflect(_integrator: object, _sign: int, lane: int) -> bool:
            self.heights[lane] = self.edge
            self.velocities[lane] = -self.velocities[lane]
            self.left[lane] -= 1
            return self.left[lane] != 0

        return reflect

    def _on_lower(self) -> Callable[[object, int, int], bool]:
        """Callback that reflects on Σ⁻."""

        def reflect(_integrator: object, _sign: int, lane: int) -> bool:
            self.heights[lane] = -self.edge
            self.velocities[lane] = -self.velocities[lane]
            self.below[lane] += 1
            return True

        return reflect

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Π^n of every start; n ≥ 1. A lane that is done takes the next trajectory."""
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
        """Put a trajectory into a lane and return its index; None puts the lane to rest."""
        self.left[lane], self.below[lane] = n, 0
        if index is None:
            self.heights[lane], self.velocities[lane], ends[lane] = 0.0, 0.0, clock[lane]
            return None
        self.heights[lane], self.velocities[lane] = self.edge, -starts.v[index]
        self.integrator.pars[:, lane] = starts.delta[index], starts.epsilon[index]
        clock[lane], ends[lane] = starts.tau[index], starts.tau[index] + n * PATIENCE
        return index


def _acceleration(heyoka: Any, velocity: Any) -> Any:
    """Φ'' in free flight as heyoka's expression; its parameters are δ and ε."""
    delta, epsilon, turn = heyoka.par[0], heyoka.par[1], TWO_PI * heyoka.time
    steady = delta * (2.0 * TWO_PI - velocity)
    return steady - TWO_PI * epsilon * (TWO_PI * heyoka.cos(turn) + delta * heyoka.sin(turn))


class _Wall:
    """Event function of scipy's solve_ivp: zero on a wall, counted when the motion comes from inside, then terminal."""

    terminal = True

    def __init__(self, side: int) -> None:
        self.height, self.direction = side * BETA, float(side)

    def __call__(self, _time: float, state: NDArray[np.float64]) -> float:
        return float(state[0]) - self.height


class Scipy:
    """Runner on scipy's solve_ivp (DOP853, tight tolerances), restarted on the wall after every impact."""

    def __init__(self) -> None:
        self.walls = _Wall(1), _Wall(-1)

    def __call__(self, starts: Starts, n: int) -> Iterates:
        """Π^n of every start, one after the other."""
        arrivals = _Arrivals.empty(starts.tau.size)
        columns = zip(starts.tau, starts.v, starts.delta, starts.epsilon, strict=True)
        for index, (tau, v, delta, epsilon) in enumerate(columns):
            arrivals.settle(index, *self._iterate(float(tau), float(v), float(delta), float(epsilon), n))
        return arrivals.iterates()

    def _iterate(self, tau: float, v: float, delta: float, epsilon: float, n: int) -> tuple[float, float, int, int]:
        """Time, speed, and impacts on Σ⁺ and Σ⁻ of one trajectory, to its n-th impact on Σ⁺ or to where it is lost."""
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
        """Time, wall and velocity of the first impact of one flight; None if it is lost.

        The event function is exactly zero at the start. The first step is one after which the flight, turning at its
        hardest, cannot be back yet: so its end is off the wall, and the zero at the start is never taken for an impact.
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
    """(Φ', Φ'') in free flight, for scipy."""
    steady, cosine, sine = 2.0 * TWO_PI * delta, TWO_PI * TWO_PI * epsilon, TWO_PI * delta * epsilon

    def field(when: float, state: NDArray[np.float64]) -> tuple[float, float]:
        velocity = float(state[1])
        turn = TWO_PI * when
        return velocity, steady - delta * velocity - cosine * math.cos(turn) - sine * math.sin(turn)

    return field


# How to make each peer, and what is timed: so many trajectories of workload A, so many impacts on Σ⁺ of each.
PEERS: dict[str, tuple[Callable[[], Runner], int, int]] = {"heyoka": (Heyoka, 256, 50), "scipy": (Scipy, 24, 20)}
