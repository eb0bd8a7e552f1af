"""Flights between two given times, from wall to wall, and their velocities in closed form (paper 3.1, 3.2)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.numerics.complex_step import Array

TWO_PI = 2 * np.pi
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


def flights_between(
    t0: NDArray, t1: NDArray, turn0: Turn, turn1: Turn, gaps: Array, delta: NDArray, epsilon: NDArray
) -> Flights:
    """The flights from times t0 to times t1 over distances `gaps`; turn0 and turn1 are theirs."""
    (sin0, cos0), (sin1, cos1) = turn0, turn1
    s = t1 - t0
    decay = np.exp(-delta * s)
    pull = -delta / np.expm1(-delta * s)
    swing = -2 * np.sin(np.pi * (t0 + t1)) * np.sin(np.pi * s)  # cos 2πt₁ − cos 2πt₀
    c = (2 * TWO_PI * s + epsilon * swing - gaps) * pull
    w0 = 2 * TWO_PI - TWO_PI * epsilon * sin0 - c
    w1 = 2 * TWO_PI - TWO_PI * epsilon * sin1 - c * decay
    forcing = TWO_PI**2 * epsilon
    return Flights(
        w0=w0,
        w1=w1,
        pull=pull,
        decay=decay,
        w0_t0=w0 * pull + delta * c - forcing * cos0,
        w1_t1=(delta * c - w1 * pull) * decay - forcing * cos1,
    )
