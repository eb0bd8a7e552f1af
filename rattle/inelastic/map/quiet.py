"""The quiet limit of any forcing: the ε from which the contact force changes its sign."""

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

    G is the force of the shape (3, K). The largest −G of a grid is improved by Newton's method on G' inside its
    interval. Another maximum may exceed its grid value by at most bend h²/2, with h half the grid spacing. Maxima that
    could be the largest are improved too.

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
