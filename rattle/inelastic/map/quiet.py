"""The quiet limit of any forcing: the ε above which the contact force changes sign."""

from __future__ import annotations

from typing import Any

import numpy as np

from rattle.flight.forcing import TWO_PI
from rattle.inelastic.map.harmonics import ORDER, PHASE, forcing_derivative_bounds, harmonics_at_unit_epsilon

PHASES = 64  # the force is first evaluated on a grid with this many points per period of the fastest harmonic


def quiet_limit(delta: float, drift: float, harmonics: Any = ()) -> float:
    """Return the quiet limit: the smallest ε at which the least contact force in a period is 0."""
    return quiet_limit_with_phase(delta, drift, harmonics_at_unit_epsilon(harmonics))[1]


def quiet_limit_with_phase(delta: float, drift: float, shape: Any) -> tuple[float, float]:
    """Return the phase at which the contact force g = δq + ε G(t) first reaches 0 as ε grows, and ε = δq/max(−G) there.

    q is the drift, and G the varying part of the contact force for the harmonics (3, K) at ε = 1. The maximum of −G is
    found on a grid and improved by Newton's method on G'. A maximum exceeds the nearest value on the grid by at most
    max|G''| h²/2, where h is half the grid spacing. All maxima that could therefore be the largest are improved.

    Returns
    -------
    tuple of float
        The phase, and the quiet limit.
    """
    order = TWO_PI * shape[ORDER]
    size, turn = order * shape[1], TWO_PI * shape[PHASE]
    count = int(PHASES * shape[ORDER].max())
    tau = np.arange(count) / count

    def negative_varying_force(t: Any) -> Any:
        """Return −G(t), minus the varying part of the contact force at ε = 1, at times t."""
        angle = order * np.asarray(t)[..., None] + turn
        return (size * (order * np.cos(angle) + delta * np.sin(angle))).sum(axis=-1)

    def derivatives_of_negative_force(t: Any) -> Any:
        """Return the first and second derivatives, −G' and −G'', of `negative_varying_force` at times t."""
        angle = order * np.asarray(t)[..., None] + turn
        rate = (size * order * (delta * np.cos(angle) - order * np.sin(angle))).sum(axis=-1)
        return rate, -(size * order**2 * (delta * np.sin(angle) + order * np.cos(angle))).sum(axis=-1)

    heights = negative_varying_force(tau)
    slack = 0.5 * forcing_derivative_bounds(delta, shape).force_second_derivative * (0.5 / count) ** 2
    near = tau[heights >= heights.max() - slack]
    for _ in range(50):
        rate, bend = derivatives_of_negative_force(near)
        near = near + np.clip(-rate / np.where(bend < 0, bend, -np.inf), -0.5 / count, 0.5 / count)
    phases = np.concatenate([near, tau])
    deepest = phases[np.argmax(negative_varying_force(phases))]
    return float(deepest), float(delta * drift / negative_varying_force(deepest))
