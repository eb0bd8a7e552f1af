"""Compare the formulas of the paper's section 3.1.1 with exact flights.

A flight leaves Σ⁺ at phase t* with velocity −v. The order of a formula's error is log₂ of the ratio of two errors: one
at a time h (or a speed v), and one at half this time (or speed). Each is the largest error over the phases in PHASES.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import rattle
from rattle.flight import law
from rattle.flight.forcing import DRIFT
from rattle.impacting.gear import Gear

TWO_PI = 2 * np.pi
PHASES = np.arange(16) / 16
#: A point below the quiet limit, so that every small bounce returns to Σ⁺.
DELTA, EPSILON = 0.6, 0.1
#: SPEED, STEPS: speed of departure, and the two times h after the departure, at which the paper's (3.6) and (3.7) are
#: tested.
SPEED = 0.05
STEPS = (2.0**-9, 2.0**-10)
#: The two speeds of departure at which the paper's (3.8) and the change of speed in a bounce are tested.
SPEEDS = (2.0**-8, 2.0**-9)

Array = NDArray[np.float64]


def acceleration_by_formula(phase: Array, v: float, delta: float, epsilon: float) -> Array:
    """Return Φ'' on departure. It is the bracket in the paper's (3.7), and minus the denominator of its (3.8)."""
    return (
        delta * v
        - TWO_PI * delta * epsilon * np.sin(TWO_PI * phase)
        + 2 * TWO_PI * delta
        - TWO_PI**2 * epsilon * np.cos(TWO_PI * phase)
    )


def f(phase: Array, v: float, delta: float, epsilon: float) -> Array:
    """Return the f of the paper's (3.9) as printed: twice Φ''' on departure."""
    sine = np.sin(TWO_PI * phase)
    return 4 * (
        -(delta**2) * v / 2 + delta**2 * np.pi * epsilon * sine - 2 * delta**2 * np.pi + 4 * np.pi**3 * epsilon * sine
    )


def g(phase: Array, v: float, delta: float, epsilon: float) -> Array:
    """Return the g of the paper's (3.10) as printed: the square of Φ'' on departure (not the contact force g)."""
    return acceleration_by_formula(phase, v, delta, epsilon) ** 2


class ErrorOrders(NamedTuple):
    """Measured orders of the errors of the paper's formulas: an error falls as h^order or as v^order.

    displacement, velocity: the orders of (3.6) for Φ and of (3.7) for Φ', as h → 0.
    time: the order of (3.8) for the time to the next impact, as v → 0.
    speed_as_printed, speed_with_third: the orders of v + (f/g) v², as printed, and of v + f/(3g) v² for the speed after
    a bounce, as v → 0.
    """

    displacement: float
    velocity: float
    time: float
    speed_as_printed: float
    speed_with_third: float


def measure_error_orders() -> ErrorOrders:
    """Measure the orders of the errors of the paper's formulas at (DELTA, EPSILON).

    Each order follows from two errors: of (3.6) and (3.7) at two times since the departure, of the other formulas at
    two speeds of departure.

    Returns
    -------
    ErrorOrders
        The order of each formula's error.
    """
    expansions = np.array([_expansion_errors(h) for h in STEPS])
    bounces = np.array([_bounce_errors(v) for v in SPEEDS])
    return ErrorOrders(*np.log2(expansions[0] / expansions[1]), *np.log2(bounces[0] / bounces[1]))


def _expansion_errors(h: float) -> tuple[float, float]:
    """Return the largest errors of Φ by the paper's (3.6) and of Φ' by its (3.7), a time h after the departure."""
    rate = acceleration_by_formula(PHASES, SPEED, DELTA, EPSILON)
    left = []
    for phase, a, jerk in zip(PHASES, rate, f(PHASES, SPEED, DELTA, EPSILON) / 2, strict=True):
        sine, cosine = math.sin(TWO_PI * phase), math.cos(TWO_PI * phase)
        flight = law.flight_from_sine_cosine(-SPEED, sine, cosine, DELTA, EPSILON, DRIFT)
        moved, velocity, *_ = law.evaluate(h, flight)
        left.append((moved - (-SPEED * h + a / 2 * h**2), velocity - (-SPEED + a * h + jerk / 2 * h**2)))
    worst = np.abs(left).max(axis=0)
    return float(worst[0]), float(worst[1])


def _bounce_errors(v: float) -> tuple[float, float, float]:
    """Return the largest errors, over the phases PHASES, of the paper's formulas for a bounce that starts at speed v.

    Returns
    -------
    tuple[float, float, float]
        The errors of the duration by (3.8), and of the speed afterwards by v + (f/g) v² and by
        v + f/(3g) v², with f and g of (3.9) and (3.10).
    """
    gear = Gear(DELTA, EPSILON)
    bounces = [gear.first_impact(1, phase, -v) for phase in PHASES]
    time = np.array([b.flight_time for b in bounces])
    speed = np.array([b.impact_velocity for b in bounces])
    change = f(PHASES, v, DELTA, EPSILON) / g(PHASES, v, DELTA, EPSILON) * v**2
    late = time - 2 * v / acceleration_by_formula(PHASES, v, DELTA, EPSILON)
    return (
        _largest_absolute_value(late),
        _largest_absolute_value(speed - v - change),
        _largest_absolute_value(speed - v - change / 3),
    )


def _largest_absolute_value(values: Array) -> float:
    """Return the largest absolute value in an array."""
    return float(np.abs(values).max())


def bounce_speed_decay_rate(
    v: float, impacts: int, delta: float = DELTA, epsilon: float = EPSILON
) -> tuple[float, float]:
    """Return the rate per forcing period at which ln v falls over many bounces, computed exactly from phase 0 on.

    The speed of bounces also varies with the phase, and the first and the last bounce are at different phases.
    Therefore the rate is computed from ln(v³/g)/3, which does not vary with the phase.

    Returns
    -------
    tuple[float, float]
        The rate, and the number of forcing periods.
    """
    end = rattle.iterate_tangent(delta, epsilon, 0.0, v, impacts)
    invariant = [
        math.log(speed**3 / float(acceleration_by_formula(np.array(phase), 0.0, delta, epsilon)))
        for phase, speed in ((0.0, v), (float(end.tau), float(end.v)))
    ]
    periods = float(end.time)
    return (invariant[0] - invariant[1]) / 3 / periods, periods


def decay_rate_by_formula(
    factor: float, v: float, periods: float, delta: float = DELTA, epsilon: float = EPSILON
) -> float:
    """Return the rate at which ln v falls if each bounce takes 2v/Φ'' and changes v by factor · (f/g) v².

    f and g are the paper's functions (3.9) and (3.10). Bounces start at phase 0 and continue for the given number of
    forcing periods.

    Returns
    -------
    float
        The rate per forcing period.
    """
    t, speed = 0.0, v
    while t < periods:
        phase = np.array(t)
        a = float(acceleration_by_formula(phase, speed, delta, epsilon))
        change = factor * float(f(phase, speed, delta, epsilon)) / a**2
        t, speed = t + 2 * speed / a, speed + change * speed**2
    return math.log(v / speed) / t
