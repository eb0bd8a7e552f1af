"""Flights between two given times, from wall to wall, and their velocities in closed form (paper 3.1, 3.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.numerics.complex_step import Array

TWO_PI = 2 * np.pi
SMALL = 0.1  # damping times flight, below which the mean drift's part of a velocity cancels
LAG = (-1 / 2, -1 / 12, 1 / 720, -1 / 30240, 1 / 1209600, -1 / 47900160, 691 / 1307674368000)  # of x, x², x⁴, x⁶, …
Turn = tuple[NDArray, NDArray]  # sine and cosine of 2π times


@dataclass(frozen=True)
class Flights:
    """The flights of one motion, or of a batch: arrays (…, n), flight i from impact i to impact i + 1."""

    w0: NDArray  # velocity of departure
    w1: NDArray  # velocity of arrival
    pull: NDArray  # δ/L
    decay: NDArray  # e^(−δs)
    w0_t0: NDArray  # ∂w₀/∂t₀ at fixed t₁
    w1_t1: NDArray  # ∂w₁/∂t₁ at fixed t₀


def _lag(x: NDArray, s: NDArray, pull: NDArray) -> NDArray:
    """1 − x/(1 − e^(−x)) for x = δs, to rounding however small: s times δ/(1 − e^(−x)) is near 1 then."""
    lag = 1.0 - s * pull
    small = np.abs(x.real) < SMALL
    if small.any():
        y = x[small]
        lag[small] = y * (LAG[0] + y * np.polyval(LAG[:0:-1], y * y))
    return lag


def flights_between(
    t0: NDArray, t1: NDArray, turn0: Turn, turn1: Turn, gaps: Array, delta: NDArray, epsilon: NDArray
) -> Flights:
    """The flights from times t0 to times t1 over distances `gaps`; turn0 and turn1 are theirs."""
    (sin0, cos0), (sin1, cos1) = turn0, turn1
    s = t1 - t0
    x = delta * s
    decay = np.exp(-x)
    pull = -delta / np.expm1(-x)
    swing = -2 * np.sin(np.pi * (t0 + t1)) * np.sin(np.pi * s)  # cos 2πt₁ − cos 2πt₀
    apart = (epsilon * swing - gaps) * pull
    drift, rate = 2 * TWO_PI * _lag(x, s, pull), TWO_PI * epsilon
    w0 = drift - rate * sin0 - apart
    w1 = drift + 2 * TWO_PI * x - rate * sin1 - apart * decay
    slowing = delta * (2 * TWO_PI - drift + apart)
    forcing = TWO_PI * rate
    return Flights(
        w0=w0,
        w1=w1,
        pull=pull,
        decay=decay,
        w0_t0=w0 * pull + slowing - forcing * cos0,
        w1_t1=(slowing - w1 * pull) * decay - forcing * cos1,
    )
