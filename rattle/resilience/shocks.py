"""The minimal fatal shock of an attractor: the smallest change of Φ' that takes its motion to another attractor."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.speeds import SpeedLimit, highest_sampled_speed
from rattle.attractors.table import Attractor
from rattle.errors import RattleError, require, require_finite
from rattle.models import AnyGear
from rattle.resilience.gears import is_same_attractor, speed_unit_of

Array = NDArray[np.float64]
#: Number of shocks of each sign that are tried from a state in one scan.
SHOCKS_PER_SCAN = 64
#: Number of scans of all states. Each scan tries shocks up to the smallest fatal shock that was found before.
FULL_SCANS = 3
#: Number of later scans, which try shocks only from the state of the smallest fatal shock that was found. Each of these
#: scans divides the length of the interval between a harmless and a fatal size of the shock by SHOCKS_PER_SCAN.
NARROWING_SCANS = 5
#: Number of phases at which shocks are applied to quiet motion.
PHASES = 64
#: Speed, in units of `speed_unit_of`, of the departure from Σ⁺ that stands for a motion at rest on Σ⁺.
AT_REST = 1e-6
#: Shocks are applied to at most this number of states of a chaotic attractor or of a long orbit.
MOST_STATES = 64


class LeastShock(NamedTuple):
    """The smallest shock that was found to take a motion to another attractor.

    change: the change of Φ', inf if no shock was found. Φ' is negative at a departure from Σ⁺, so a shock that makes a
    departure faster by x has the change −x.
    tau: the phase of the shock. position, velocity: Φ and Φ' before the shock.
    to: the attractor that the motion goes to, None if no shock was found.
    error: the accuracy of `change`: a shock smaller by `error`, from the same state, does not take the motion away.
    tau, position, velocity and error are NaN if no shock was found.
    """

    change: float
    tau: float
    position: float
    velocity: float
    to: Attractor | None
    error: float


class _StateBeforeShock(NamedTuple):
    """A state of the motion before the shock: phase, Φ and Φ'."""

    tau: float
    position: float
    velocity: float


Departure = Callable[[_StateBeforeShock, float], tuple[float, float] | None]


def smallest_shock(
    gear: AnyGear, attractor: Attractor, phase: float | None = None, v_max: SpeedLimit = None
) -> LeastShock:
    """Return the smallest shock, a jump of Φ' at one moment, that takes a motion on an attractor to another attractor.

    The result is an upper bound. Three scans try 64 shocks of each sign from each state, up to the smallest shock that
    was found before. A thin basin between two tried shocks may be missed. `Gear.boundary_distance` searches quiet
    motion more thoroughly.

    Parameters
    ----------
    phase : float | None
        The phase of the forcing at which the shock comes, for periodic or quiet motion. None: the shock may come at any
        departure of the attractor from Σ⁺. For a chaotic attractor 64 departures are tried.
    v_max : SpeedLimit
        Largest speed of departure after a shock, given as in `Gear.attractors`.

    Returns
    -------
    LeastShock
        The shock, the state before it, and the attractor after it.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the attractor is not an attractor of this gear.
    """
    highest = highest_sampled_speed(v_max, gear.delta, gear.epsilon, gear.beta)
    require(
        attractor.kind in ("quiet", "periodic", "chaotic"),
        f"the attractor must be quiet, periodic or chaotic, got {attractor.kind!r}, which has no known basin",
    )
    if phase is not None:
        states, departure = _states_at_phase(gear, attractor, require_finite("phase", phase) % 1.0)
    else:
        states, departure = _states_at_departures(gear, attractor), _departure_from_wall
    search = _ShockSearch(gear, attractor, states, departure, highest)
    search.run_scans()
    return search.smallest_shock_found()


def _states_at_departures(gear: AnyGear, attractor: Attractor) -> list[_StateBeforeShock]:
    """Return the states of an attractor at its departures from Σ⁺; for quiet motion, states at PHASES phases."""
    if attractor.kind == "quiet":
        return [_StateBeforeShock(float(tau), gear.beta, 0.0) for tau in (np.arange(PHASES) + 0.5) / PHASES]
    many = min(attractor.n_plus, MOST_STATES) if attractor.kind == "periodic" else MOST_STATES
    orbit = gear.iterate(attractor.tau, attractor.v, np.arange(many))
    return [_StateBeforeShock(float(tau), gear.beta, -float(v)) for tau, v in zip(orbit.tau, orbit.v, strict=True)]


def _departure_from_wall(state: _StateBeforeShock, change: float) -> tuple[float, float] | None:
    """Return the departure (τ, v) after a shock to a state on Σ⁺, or None if Φ' is not negative after the shock."""
    v = -(state.velocity + change)
    return (state.tau, v) if v > 0.0 else None


def _states_at_phase(gear: AnyGear, attractor: Attractor, phase: float) -> tuple[list[_StateBeforeShock], Departure]:
    """Return the states of an attractor at a phase, and a function that maps state and shock to the next departure."""
    if attractor.kind == "quiet":
        return [_StateBeforeShock(phase, gear.beta, 0.0)], _departure_from_wall
    require(
        attractor.kind == "periodic",
        "phase can be given for quiet or periodic motion only: leave it out for a chaotic attractor",
    )
    wait = (phase - attractor.tau) % 1.0 or 1.0
    states = []
    for i in range(attractor.m):
        moving = gear.trajectory(attractor.tau, attractor.v, wait + i, 2)
        states.append(_StateBeforeShock(phase, float(moving.phi[-1]), float(moving.velocity[-1])))

    def departure_after_shock(state: _StateBeforeShock, change: float) -> tuple[float, float] | None:
        """Return the first departure (τ, v) from Σ⁺ after a shock, v > 0 even after rest; None if it is not found."""
        try:
            tau, v = gear.departure(state.tau, state.position, state.velocity + change)
        except RattleError:
            return None
        return tau, max(v, AT_REST * speed_unit_of(gear))

    return states, departure_after_shock


class _ShockSearch:
    """The search for the smallest fatal shock, which takes the motion to another attractor.

    state: the index of the state from which the smallest fatal shock was found. sign: the sign of this shock. high: its
    size, inf as long as no fatal shock is found. low: a smaller size that is not fatal from this state.
    attractor_after: the attractor that the motion goes to after the shock, None as long as no fatal shock is found.
    """

    def __init__(
        self, gear: AnyGear, attractor: Attractor, states: list[_StateBeforeShock], departure: Departure, highest: float
    ) -> None:
        self.gear, self.attractor, self.states, self.departure, self.highest = (
            gear, attractor, states, departure, highest,
        )  # fmt: skip
        self.state, self.sign, self.low, self.high = 0, 1.0, 0.0, np.inf
        self.attractor_after: Attractor | None = None

    def run_scans(self) -> None:
        """Scan all states FULL_SCANS times, and then the state with the smallest fatal shock NARROWING_SCANS times.

        The latter scans narrow the interval from `low` to `high`, which holds the least fatal size. If the first scan
        finds no fatal shock, no further scan is made.
        """
        every, both = np.arange(len(self.states)), np.array([-1.0, 1.0])
        for _ in range(FULL_SCANS):
            limit = min(self.high, self.highest)
            self._scan_shocks(every, both, 0.0, limit)
            if self.high == np.inf:
                return
        for _ in range(NARROWING_SCANS):
            self._scan_shocks(np.array([self.state]), np.array([self.sign]), self.low, self.high)

    def smallest_shock_found(self) -> LeastShock:
        """Return the smallest fatal shock that the scans found; its change is inf if they found none."""
        state = self.states[self.state]
        if self.attractor_after is None:
            return LeastShock(np.inf, np.nan, np.nan, np.nan, None, np.nan)
        return LeastShock(self.sign * self.high, *state, self.attractor_after, self.high - self.low)

    def _scan_shocks(self, states: NDArray[np.int64], signs: Array, low: float, high: float) -> None:
        """Try shocks from states: SHOCKS_PER_SCAN sizes from low to high, with each of the signs `signs`.

        If shocks take the motion to another attractor, the smallest of them becomes the smallest known fatal shock.

        Raises
        ------
        RattleError
            If the attractor from which the shocks start is no attractor of the gear.
        """
        size = low + (high - low) * np.arange(1, SHOCKS_PER_SCAN + 1) / SHOCKS_PER_SCAN
        tried = [(int(i), float(sign), k) for i in states for sign in signs for k in range(SHOCKS_PER_SCAN)]
        after = [self.departure(self.states[i], sign * float(size[k])) for i, sign, k in tried]
        step = np.array([k for *_, k in tried])
        there = np.array([each is not None and each[1] < self.highest for each in after])
        tau, v = np.array([each for each, ok in zip(after, there, strict=True) if ok] or np.zeros((0, 2))).T
        found = self.gear.reached(np.append(self.attractor.tau, tau), np.append(self.attractor.v, v))
        own = found.which[0]
        if not is_same_attractor(found.attractors[own], self.attractor, speed_unit_of(self.gear)):
            raise RattleError(
                f"the given {self.attractor.kind} motion is no attractor of this gear: pass one of gear.attractors()"
            )
        leaves = np.zeros(step.size, np.bool_)
        decided = np.array([each.kind != "undecided" for each in found.attractors])
        leaves[there] = (found.which[1:] != own) & decided[found.which[1:]]
        if not leaves.any():
            return
        one = np.flatnonzero(leaves)[np.argmin(step[leaves])]
        self.state, self.sign, k = tried[one]
        self.high, self.low = float(size[k]), float(size[k - 1]) if k else low
        self.attractor_after = found.attractors[found.which[1 + int(there[: one + 1].sum()) - 1]]
