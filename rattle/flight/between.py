"""Flights between two given times, from wall to wall, and their velocities in closed form (paper 3.1, 3.2; compiled).

All numbers are complex: an imaginary part carries exact derivatives (`rattle.numerics.complex_step`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import DRIFT, add_analytic_acceleration, add_slope, analytic_forcing_change
from rattle.numerics.compile import inline

# below this |δs| `departure_velocity_per_drift` sums a series, because the closed form would lose digits by
# cancellation
SERIES_BELOW = 0.1
# the Taylor series of 1 − x/(1 − e^(−x)) has these coefficients of x, x², x⁴, x⁶, …
LAG = (-1 / 2, -1 / 12, 1 / 720, -1 / 30240, 1 / 1209600, -1 / 47900160, 691 / 1307674368000)


class Flights(NamedTuple):
    """The flights of one motion, or of a batch: arrays (…, n), flight i from impact i to impact i + 1.

    Times t and velocities w have index 0 at the departure and index 1 at the arrival; s = t₁ − t₀.
    """

    w0: NDArray  # velocity of departure
    w1: NDArray  # velocity of arrival
    pull: NDArray  # δ/(1 − e^(−δs))
    decay: NDArray  # e^(−δs)
    w0_t0: NDArray  # ∂w₀/∂t₀ at fixed t₁
    w1_t1: NDArray  # ∂w₁/∂t₁ at fixed t₀


W0, W1, PULL, DECAY, W0_T0, W1_T1 = range(len(Flights._fields))


@inline
def decay_loss(z):
    """Return 1 − e^(−z), computed without cancellation, and e^(−z), for complex z."""
    size, half = math.exp(-z.real), math.sin(0.5 * z.imag)
    real, imag = math.cos(z.imag), size * math.sin(z.imag)
    return complex(2.0 * half * half - math.expm1(-z.real) * real, imag), complex(size * real, -imag)


@inline
def departure_velocity_per_drift(x, s, pull):
    """Return 1 − x/(1 − e^(−x)) without cancellation, for x = δs of a flight with duration s.

    The result times the mean drift q is the departure velocity w₀ of an unforced flight that returns to its wall.
    pull: δ/(1 − e^(−x)). The result is computed as 1 − s · pull, or by a series where |Re x| is below SERIES_BELOW.

    Returns
    -------
    complex
        The dimensionless ratio w₀/q.
    """
    if not abs(x.real) < SERIES_BELOW:
        return 1.0 - s * pull
    y = x * x
    series = LAG[1] + y * (LAG[2] + y * (LAG[3] + y * (LAG[4] + y * (LAG[5] + y * LAG[6]))))
    return x * (LAG[0] + x * series)


@inline
def flight_between(t0, t1, turn0, turn1, gap, delta, epsilon):
    """Return the flight from time t0 to time t1 over the distance `gap`, as the fields of `Flights` in order.

    turn0 and turn1 are (sine, cosine) of the phases at both ends.

    Returns
    -------
    tuple
        The fields of `Flights`, not finite if the flight has no duration.
    """
    (sin0, cos0), (sin1, cos1) = turn0, turn1
    s = t1 - t0
    x = delta * s
    lost, decay = decay_loss(x)
    pull = np.divide(delta, lost)
    apart = (analytic_forcing_change(t0, t1, s, epsilon) - gap) * pull
    drift = DRIFT * departure_velocity_per_drift(x, s, pull)
    w0 = add_slope(drift, sin0, cos0, epsilon) - apart
    w1 = add_slope(drift + DRIFT * x, sin1, cos1, epsilon) - apart * decay
    slowing = delta * (DRIFT - drift + apart)
    w0_t0 = add_analytic_acceleration(w0 * pull + slowing, sin0, cos0, epsilon)
    w1_t1 = add_analytic_acceleration((slowing - w1 * pull) * decay, sin1, cos1, epsilon)
    return w0, w1, pull, decay, w0_t0, w1_t1
