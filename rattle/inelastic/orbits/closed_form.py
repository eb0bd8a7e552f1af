"""Period-one motions with restitution r and drift q in closed form, and the limits of A and C.

P(1,1,0), for any forcing: the impulse of its impact balances the drift, so the motion arrives with speed δq/(1 + r) and
leaves with speed v = r δq/(1 + r). With E = e^(−δ), the phase τ of its impact, and the
determinant and trace of its tangent map, are given by

    e'(τ) = qδ/(1 − E) − q − v,    det = r²E,    trace = 1 + r²E + (1 + r)² (1 − E) e''(τ)/(δ²q).

Under one cosine there are two such phases τ for ε above SN1: A with e'' > 0 and C with e'' < 0.
`rattle.inelastic.orbits.period_one` computes A to D for many points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.first_impact import OK
from rattle.flight.forcing import TWO_PI
from rattle.flight.law import fold_phase, wrap_phase_difference
from rattle.inelastic.map.harmonics import AMPLITUDE, ORDER, PHASE
from rattle.inelastic.map.impact_map import InelasticPoint, step
from rattle.inelastic.orbits.family import departure_speed_over_drift
from rattle.orbits.orbits_a_to_d import multipliers_from_trace

Array = NDArray[np.float64]
PHASES = 64  # grid points per period of the fastest harmonic at which e' is evaluated
SAME_STATE = 1e-7  # largest difference between a state and its image (in v: relative) that counts as repetition


class OneImpactMotion(NamedTuple):
    """An admissible P(1,1,0): phase and speed after its impact, and its Floquet multipliers."""

    tau: float
    v: float
    multipliers: tuple[complex, complex]


def departure_speed(delta: float, restitution: float, drift: float) -> float:
    """Return the speed with which every P(1,1,0) leaves Σ⁺. The forcing does not change this speed."""
    return restitution * delta * drift / (1.0 + restitution)


def forcing_slope_at_departure(delta: float, restitution: float, drift: float) -> float:
    """Return the value that the derivative e' of the forcing has when a P(1,1,0) leaves Σ⁺."""
    swing = drift * departure_speed_over_drift(delta, -math.expm1(-delta))
    return float(swing - departure_speed(delta, restitution, drift))


def epsilon_of_saddle_node(delta: float, restitution: float, drift: float) -> float:
    """Return the ε of SN1, at which A and C are born under forcing by one cosine."""
    return abs(forcing_slope_at_departure(delta, restitution, drift)) / TWO_PI


def epsilon_of_flip_of_c(delta: float, restitution: float, drift: float) -> float:
    """Return the ε of PDC, the flip of C under forcing by one cosine; C may be virtual at this ε."""
    r, decay = restitution, math.exp(-delta)
    size = 2.0 * delta * delta * (1.0 + r * r * decay) * drift / ((1.0 + r) ** 2 * -math.expm1(-delta) * TWO_PI**2)
    return math.hypot(epsilon_of_saddle_node(delta, restitution, drift), size)


def forcing_derivatives(tau: Array, harmonics: Array) -> tuple[Array, Array]:
    """Return the derivatives e' and e'' of the forcing, each in the shape of `tau`; `harmonics` is (3, K)."""
    angle = TWO_PI * (harmonics[ORDER] * tau[..., None] + harmonics[PHASE])
    turn = TWO_PI * harmonics[ORDER]
    size = turn * harmonics[AMPLITUDE]
    return -(size * np.sin(angle)).sum(axis=-1), -(size * turn * np.cos(angle)).sum(axis=-1)


def one_impact_motions(point: InelasticPoint) -> list[OneImpactMotion]:
    """Return the admissible motions P(1,1,0) under any forcing, sorted by phase."""
    delta, r, drift = point.delta, point.restitution, point.drift
    harmonics = point.harmonics
    wanted = forcing_slope_at_departure(delta, r, drift)
    v, decay = departure_speed(delta, r, drift), math.exp(-delta)
    phases = _zeros_of_periodic_function(
        lambda tau: forcing_derivatives(tau, harmonics)[0] - wanted, int(PHASES * harmonics[ORDER].max())
    )
    found = []
    for tau in phases:
        bend = float(forcing_derivatives(np.array([tau]), harmonics)[1][0])
        trace = 1.0 + r * r * decay + (1.0 + r) ** 2 * (1.0 - decay) * bend / (delta * delta * drift)
        if _is_admissible(tau, v, point):
            large, small = multipliers_from_trace(trace, r * r * decay)
            found.append(OneImpactMotion(tau, v, (complex(large), complex(small))))
    return sorted(found, key=lambda each: each.tau)


def _zeros_of_periodic_function(function: Callable[[Array], Array], count: int) -> list[float]:
    """Return zeros of a function of period 1: one in each of `count` equal intervals at whose ends its signs differ."""
    grid = np.arange(count + 1) / count
    from scipy.optimize import brentq  # imported here because it takes a quarter of a second to load

    values = function(grid)
    changes = np.flatnonzero((values[1:] > 0) != (values[:-1] > 0))

    def value_at(tau: float) -> float:
        return float(function(np.array([tau]))[0])

    return [float(fold_phase(brentq(value_at, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-15))) for i in changes]


def _is_admissible(tau: float, v: float, point: InelasticPoint) -> bool:
    """Return whether a state (τ, v) repeats after one period and one impact, without contact or impacts on Σ⁻."""
    status, tau1, v1, time, below, on_plus, on_minus = step(tau, v, point)
    closed = (
        abs(wrap_phase_difference(tau1 - tau)) < SAME_STATE
        and abs(v1 - v) < SAME_STATE * max(v, 1e-300)
        and abs(time - 1.0) < SAME_STATE
    )
    return bool(status == OK and closed and below + on_plus + on_minus == 0)
