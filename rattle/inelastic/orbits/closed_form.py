"""Period-one motions with restitution r and drift q in closed form, and the limits of A and C.

P(1,1,0), any forcing: the impulse of its impact balances the drift, so it arrives with speed δq/(1 + r) and leaves with
v = r times that. With E = e^(−δ) it closes where

    e'(τ) = qδ/(1 − E) − q − v,    det = r²E,    trace = 1 + r²E + (1 + r)² (1 − E) e''(τ)/(δ²q).

One cosine has two such phases from SN1 on, A where e'' > 0 and C where e'' < 0. P(1,1,1) of one cosine: for a given
time s from Σ⁺ to Σ⁻ both impacts are linear equations in X = ε cos 2πτ and Y = ε sin 2πτ, so the family is an explicit
curve ε(s); B is where ε falls along it and D where it rises.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from rattle.flight.first_impact import OK
from rattle.flight.forcing import TWO_PI
from rattle.flight.law import folded, wrapped
from rattle.inelastic.map.harmonics import AMPLITUDE, ORDER, PHASE
from rattle.inelastic.map.impact_map import InelasticPoint, step, step_tangent
from rattle.orbits.period_one import multipliers_of

Array = NDArray[np.float64]
TIMES = np.linspace(0.0, 1.0, 2001)[1:-1]  # from Σ⁺ to Σ⁻, at which the family of P(1,1,1) is looked at
PHASES = 64  # of the fastest harmonic, at which e' is looked at
SAME = 1e-7  # a step that closes to this is the motion; near a fold rounding is stretched


class PeriodOneOrbit(NamedTuple):
    """A period-one motion that happens: its letter ("P" where there is none), impacts on Σ⁻, state, multipliers."""

    name: str
    n_minus: int
    tau: float
    v: float
    multipliers: tuple[complex, complex]

    @property
    def stable(self) -> bool:
        """Whether it attracts."""
        return abs(self.multipliers[0]) < 1.0


def departure_speed(delta: float, restitution: float, drift: float) -> float:
    """Return the speed with which P(1,1,0) leaves Σ⁺."""
    return restitution * delta * drift / (1.0 + restitution)


def slope_at_departure(delta: float, restitution: float, drift: float) -> float:
    """Return e' at the phase of P(1,1,0)."""
    return -drift * delta / math.expm1(-delta) - drift - departure_speed(delta, restitution, drift)


def saddle_node(delta: float, restitution: float, drift: float) -> float:
    """Return the ε of SN1, at which A and C are born under one cosine."""
    return abs(slope_at_departure(delta, restitution, drift)) / TWO_PI


def flip_of_c(delta: float, restitution: float, drift: float) -> float:
    """Return the ε of PDC, at which C loses its stability under one cosine if it still happens there."""
    r, decay = restitution, math.exp(-delta)
    size = 2.0 * delta * delta * (1.0 + r * r * decay) * drift / ((1.0 + r) ** 2 * -math.expm1(-delta) * TWO_PI**2)
    return math.hypot(saddle_node(delta, restitution, drift), size)


def forcing_derivatives(tau: Array, harmonics: Array) -> tuple[Array, Array]:
    """Return e' and e'' at phases (…)."""
    angle = TWO_PI * (harmonics[ORDER] * tau[..., None] + harmonics[PHASE])
    turn = TWO_PI * harmonics[ORDER]
    size = turn * harmonics[AMPLITUDE]
    return -(size * np.sin(angle)).sum(axis=-1), -(size * turn * np.cos(angle)).sum(axis=-1)


def without_minus(point: InelasticPoint) -> list[PeriodOneOrbit]:
    """Return the P(1,1,0) that happen, by their phase."""
    delta, r, drift = point.delta, point.restitution, point.drift
    harmonics = point.harmonics
    wanted = slope_at_departure(delta, r, drift)
    v, decay = departure_speed(delta, r, drift), math.exp(-delta)
    phases = _crossings(
        lambda tau: forcing_derivatives(tau, harmonics)[0] - wanted, int(PHASES * harmonics[ORDER].max())
    )
    found = []
    for tau in phases:
        bend = float(forcing_derivatives(np.array([tau]), harmonics)[1][0])
        trace = 1.0 + r * r * decay + (1.0 + r) ** 2 * (1.0 - decay) * bend / (delta * delta * drift)
        name = "P" if harmonics.shape[1] > 1 else "A" if bend > 0.0 else "C"
        if _happens(tau, v, 0, point):
            found.append(_orbit(name, 0, tau, v, trace, r * r * decay))
    return found


def with_minus(point: InelasticPoint) -> list[PeriodOneOrbit]:
    """Return the P(1,1,1) of one cosine that happen, by their time from Σ⁺ to Σ⁻."""
    epsilon = abs(float(point.harmonics[AMPLITUDE, 0]))

    def excess(s: float) -> float:
        return _on_family(s, point)[0] - epsilon

    values = np.array([excess(s) for s in TIMES])
    inside = [
        (TIMES[i], minimize_scalar(excess, bounds=(TIMES[i - 1], TIMES[i + 1]), method="bounded").x, TIMES[i + 1])
        for i in range(1, len(TIMES) - 1)
        if 0.0 < values[i] <= min(values[i - 1], values[i + 1])
    ]
    grid = np.unique(np.concatenate([TIMES, [each[1] for each in inside]]))
    values = np.array([excess(s) for s in grid])
    found = []
    for i in np.flatnonzero(values[1:] * values[:-1] < 0):
        s = brentq(excess, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-15)
        _epsilon, tau, v, u = _on_family(s, point)
        name = "D" if values[i + 1] > values[i] else "B"
        if v > 0.0 and u > 0.0 and _happens(tau, v, 1, point):
            status, _t, _v, _time, _below, j00, _j01, _j10, j11, log_det, *_ = step_tangent(tau, v, point)
            if status == OK:
                found.append(_orbit(name, 1, tau, v, j00 + j11, math.exp(log_det)))
    return found


def period_one_orbits(point: InelasticPoint) -> list[PeriodOneOrbit]:
    """Return the period-one motions that happen and are known: A to D of one cosine, P(1,1,0) of any forcing."""
    found = without_minus(point)
    if point.harmonics.shape[1] == 1:
        found += with_minus(point)
    return sorted(found, key=lambda each: (each.name, each.tau))


def _on_family(s: float, point: InelasticPoint) -> tuple[float, float, float, float]:
    """ε, phase, speed of departure from Σ⁺ and of arrival at Σ⁻ of the P(1,1,1) that takes s from Σ⁺ to Σ⁻."""
    delta, r, drift, gap = point.delta, point.restitution, point.drift, 2.0 * point.beta
    cos, sin = math.cos(TWO_PI * s), math.sin(TWO_PI * s)
    # e and e' over (1, X, Y) at the departure from Σ⁺ and, s later, from Σ⁻
    heights = np.array([[0.0, 1.0, 0.0], [0.0, cos, -sin]])
    slopes = -TWO_PI * np.array([[0.0, 0.0, 1.0], [0.0, sin, cos]])
    ends = []
    for begin, time, distance in ((0, s, -gap), (1, 1.0 - s, gap)):
        apart = np.array([distance - drift * time, 0.0, 0.0]) - (heights[1 - begin] - heights[begin])
        size = apart * delta / -math.expm1(-delta * time)
        base = np.array([drift, 0.0, 0.0])
        ends.append((base + size + slopes[begin], base + size * math.exp(-delta * time) + slopes[1 - begin]))
    (leave_plus, reach_minus), (leave_minus, reach_plus) = ends
    impacts = np.array([leave_minus + r * reach_minus, leave_plus + r * reach_plus])
    x, y = np.linalg.solve(impacts[:, 1:], -impacts[:, 0])
    state = np.array([1.0, x, y])
    return math.hypot(x, y), math.atan2(y, x) / TWO_PI % 1.0, -float(leave_plus @ state), -float(reach_minus @ state)


def _crossings(function: Callable[[Array], Array], count: int) -> list[float]:
    """Return the zeros of a periodic function, one in each of count equal intervals at whose ends its signs differ."""
    grid = np.arange(count + 1) / count
    values = function(grid)
    changes = np.flatnonzero((values[1:] > 0) != (values[:-1] > 0))

    def at(tau: float) -> float:
        return float(function(np.array([tau]))[0])

    return [float(folded(brentq(at, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-15))) for i in changes]


def _happens(tau: float, v: float, n_minus: int, point: InelasticPoint) -> bool:
    status, tau1, v1, time, below, on_plus, on_minus = step(tau, v, point)
    closed = abs(wrapped(tau1 - tau)) < SAME and abs(v1 - v) < SAME * max(v, 1e-300) and abs(time - 1.0) < SAME
    return bool(status == OK and closed and below == n_minus and on_plus + on_minus == 0)


def _orbit(name: str, n_minus: int, tau: float, v: float, trace: float, determinant: float) -> PeriodOneOrbit:
    large, small = multipliers_of(trace, determinant)
    return PeriodOneOrbit(name, n_minus, float(tau), float(v), (complex(large), complex(small)))
