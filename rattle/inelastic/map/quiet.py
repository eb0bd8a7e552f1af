"""The quiet limit of any forcing: the ε above which the contact force changes sign."""

from __future__ import annotations

from typing import Any

import numpy as np

from rattle.flight.forcing import TWO_PI
from rattle.inelastic.map.harmonics import ORDER, PHASE, bounds_of, forcing_shape

PHASES = 64  # grid points per period of the fastest harmonic at which the force is first evaluated


def quiet_limit(delta: float, drift: float, harmonics: Any = ()) -> float:
    """Return the smallest ε at which the contact force g reaches 0 (`least_force`)."""
    return least_force(delta, drift, forcing_shape(harmonics))[1]


def least_force(delta: float, drift: float, shape: Any) -> tuple[float, float]:
    """Return the phase at which the contact force g = δq + ε G(t) first reaches 0 as ε grows, and ε = δq/max(−G).

    G is the varying part of the contact force at ε = 1, for the shape (3, K) of the forcing. Newton's method on G'
    improves the largest −G on a grid inside its interval. A maximum of −G exceeds its value on the grid by at most
    max|G''| h²/2, where h is half the grid spacing. All maxima that could therefore be the largest are improved too.

    Returns
    -------
    tuple of float
        The phase, and the quiet limit.
    """
    order = TWO_PI * shape[ORDER]
    size, turn = order * shape[1], TWO_PI * shape[PHASE]
    count = int(PHASES * shape[ORDER].max())
    tau = np.arange(count) / count

    def depth(t: Any) -> Any:
        angle = order * np.asarray(t)[..., None] + turn
        return (size * (order * np.cos(angle) + delta * np.sin(angle))).sum(axis=-1)

    def rate_and_bend(t: Any) -> Any:
        angle = order * np.asarray(t)[..., None] + turn
        rate = (size * order * (delta * np.cos(angle) - order * np.sin(angle))).sum(axis=-1)
        return rate, -(size * order**2 * (delta * np.sin(angle) + order * np.cos(angle))).sum(axis=-1)

    heights = depth(tau)
    slack = 0.5 * bounds_of(delta, shape).force_bend * (0.5 / count) ** 2
    near = tau[heights >= heights.max() - slack]
    for _ in range(50):
        rate, bend = rate_and_bend(near)
        near = near + np.clip(-rate / np.where(bend < 0, bend, -np.inf), -0.5 / count, 0.5 / count)
    phases = np.concatenate([near, tau])
    deepest = phases[np.argmax(depth(phases))]
    return float(deepest), float(delta * drift / depth(deepest))
