"""The least shock that takes an attractor's motion to another attractor: the distance of its basin's boundary."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.speeds import SpeedLimit, sampled_speed
from rattle.attractors.table import Attractor
from rattle.errors import RattleError, require, require_finite
from rattle.models import AnyGear
from rattle.resilience.gears import same, unit_of

Array = NDArray[np.float64]
SCANNED, ROUNDS, HALVINGS = 64, 3, 5  # shocks each way from a state; so often, up to the least so far; then of 64 parts
PHASES = 64  # of quiet motion
AT_REST = 1e-6  # units of speed of a departure that stands for a motion at rest
MOST_STATES = 64  # of a chaotic attractor, or a long orbit


class LeastShock(NamedTuple):
    """The least change of speed that was found to take a motion to another attractor; inf, and none, if there is none.

    change: of Φ'; a departure from Σ⁺ that is faster by x has −x. tau: phase of the shock. position, velocity: Φ and Φ'
    before it. to: what the motion goes to. error: no shock that is smaller by this, from the same state, does it.
    """

    change: float
    tau: float
    position: float
    velocity: float
    to: Attractor | None
    error: float


class _State(NamedTuple):
    tau: float
    position: float
    velocity: float


Departure = Callable[[_State, float], tuple[float, float] | None]


def smallest_shock(
    gear: AnyGear, attractor: Attractor, phase: float | None = None, v_max: SpeedLimit = None
) -> LeastShock:
    """Return the least shock, a change of Φ' at one moment, that takes a motion on an attractor to another one.

    The shock comes at a departure from Σ⁺, whichever of the attractor's it is (of a chaotic one, 64 of them), or at
    this phase of the forcing, of a periodic or quiet motion. Shocks are tried whose departures are slower than v_max,
    as in `Gear.attractors`. The result is an upper bound: 64 shocks each way, and three times 64 below the least so
    far, are followed from each state; a basin that is thinner may be nearer. `Gear.boundary_distance` searches harder
    for quiet motion.

    Returns
    -------
    LeastShock
        The shock, with the states before and after it.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        Where the attractor is none of this gear's.
    """
    highest = sampled_speed(v_max, gear.delta, gear.epsilon, gear.beta)
    require(attractor.kind in ("quiet", "periodic", "chaotic"), f"a motion that is {attractor.kind} has no boundary")
    if phase is not None:
        states, departure = _at_phase(gear, attractor, require_finite("phase", phase) % 1.0)
    else:
        states, departure = _at_departures(gear, attractor), _changed
    search = _ShockSearch(gear, attractor, states, departure, highest)
    search.run()
    return search.found()


def _at_departures(gear: AnyGear, attractor: Attractor) -> list[_State]:
    if attractor.kind == "quiet":
        return [_State(float(tau), gear.beta, 0.0) for tau in (np.arange(PHASES) + 0.5) / PHASES]
    many = min(attractor.n_plus, MOST_STATES) if attractor.kind == "periodic" else MOST_STATES
    orbit = gear.iterate(attractor.tau, attractor.v, np.arange(many))
    return [_State(float(tau), gear.beta, -float(v)) for tau, v in zip(orbit.tau, orbit.v, strict=True)]


def _changed(state: _State, change: float) -> tuple[float, float] | None:
    """Return the departure after a shock at a state."""
    v = -(state.velocity + change)
    return (state.tau, v) if v > 0.0 else None


def _at_phase(gear: AnyGear, attractor: Attractor, phase: float) -> tuple[list[_State], Departure]:
    """Return the states of an attractor at a phase, and their departures from Σ⁺ after a shock."""
    if attractor.kind == "quiet":
        return [_State(phase, gear.beta, 0.0)], _changed
    require(attractor.kind == "periodic", "a shock at a phase is that of a quiet or periodic motion: leave phase out")
    wait = (phase - attractor.tau) % 1.0 or 1.0
    states = []
    for i in range(attractor.m):
        moving = gear.trajectory(attractor.tau, attractor.v, wait + i, 2)
        states.append(_State(phase, float(moving.phi[-1]), float(moving.velocity[-1])))

    def departure(state: _State, change: float) -> tuple[float, float] | None:
        try:
            tau, v = gear.departure(state.tau, state.position, state.velocity + change)
        except RattleError:
            return None
        return tau, max(v, AT_REST * unit_of(gear))

    return states, departure


class _ShockSearch:
    """The least shock so far, and between which of one state it lies: `low` does nothing, `high` does."""

    def __init__(
        self, gear: AnyGear, attractor: Attractor, states: list[_State], departure: Departure, highest: float
    ) -> None:
        self.gear, self.attractor, self.states, self.departure, self.highest = (
            gear, attractor, states, departure, highest,
        )  # fmt: skip
        self.state, self.way, self.low, self.high = 0, 1.0, 0.0, np.inf
        self.to: Attractor | None = None

    def run(self) -> None:
        """Scan all states, and again below the least; then close in on it."""
        every, both = np.arange(len(self.states)), np.array([-1.0, 1.0])
        for _ in range(ROUNDS):
            limit = min(self.high, self.highest)
            self._scan(every, both, 0.0, limit)
            if self.high == np.inf:
                return
        for _ in range(HALVINGS):
            self._scan(np.array([self.state]), np.array([self.way]), self.low, self.high)

    def found(self) -> LeastShock:
        """Return the shock."""
        state = self.states[self.state]
        if self.to is None:
            return LeastShock(np.inf, np.nan, np.nan, np.nan, None, np.nan)
        return LeastShock(self.way * self.high, *state, self.to, self.high - self.low)

    def _scan(self, states: NDArray[np.int64], ways: Array, low: float, high: float) -> None:
        """Try so many shocks of each of these states each of these ways, above low and up to high."""
        size = low + (high - low) * np.arange(1, SCANNED + 1) / SCANNED
        tried = [(int(i), float(way), k) for i in states for way in ways for k in range(SCANNED)]
        after = [self.departure(self.states[i], way * float(size[k])) for i, way, k in tried]
        step = np.array([k for *_, k in tried])
        there = np.array([each is not None and each[1] < self.highest for each in after])
        tau, v = np.array([each for each, ok in zip(after, there, strict=True) if ok] or np.zeros((0, 2))).T
        found = self.gear.reached(np.append(self.attractor.tau, tau), np.append(self.attractor.v, v))
        own = found.which[0]
        if not same(found.attractors[own], self.attractor, unit_of(self.gear)):
            raise RattleError(f"the {self.attractor.kind} motion is no attractor of this gear")
        leaves = np.zeros(step.size, np.bool_)
        decided = np.array([each.kind != "undecided" for each in found.attractors])
        leaves[there] = (found.which[1:] != own) & decided[found.which[1:]]
        if not leaves.any():
            return
        one = np.flatnonzero(leaves)[np.argmin(step[leaves])]
        self.state, self.way, k = tried[one]
        self.high, self.low = float(size[k]), float(size[k - 1]) if k else low
        self.to = found.attractors[found.which[1 + int(there[: one + 1].sum()) - 1]]
