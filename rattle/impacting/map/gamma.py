"""The grazing curve Γ in the (τ, v) plane: states whose flight just touches Σ⁻ (paper, section 3; compiled).

The time of the touch determines the state at the touch, because Φ = −β and Φ' = 0 there. So Γ is parametrised by the
time of touch, and each point of Γ is found by one flight backwards in time. Γ breaks where this flight itself grazes a
wall.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.errors import require, require_number
from rattle.flight.first_impact import OK, SIGMA_MINUS, first_impact
from rattle.flight.forcing import DRIFT, contact_force, sine_cosine_at
from rattle.flight.law import fold_phase
from rattle.numerics.compile import kernel

FIRST_POINTS = 256
# No point is inserted between two points of Γ whose times of touch differ by less than this. If the states of these
# points are still farther apart than the spacing, Γ breaks between them.
CLOSEST = 1e-13
FINEST = 1e-4  # least allowed spacing of points


class GammaPiece(NamedTuple):
    """One piece of Γ: points (n,) (τ, v) on Σ⁺, in the order of the times `touch` at which their flights graze Σ⁻.

    τ is continuous along the piece and may leave [0, 1); τ % 1 is the phase. `closed` is True if the last point is the
    first point one forcing period later.
    """

    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    touch: NDArray[np.float64]
    closed: bool


def gamma(delta: float, epsilon: float, beta: float, spacing: float, unit: float) -> tuple[GammaPiece, ...]:
    """Return the pieces of the grazing curve Γ, as `rattle.Gear.gamma` does.

    Neighbouring points of a piece are at most `spacing` apart in (τ, v/unit).

    Returns
    -------
    tuple[GammaPiece, ...]
        The pieces in the order of the time of touch.
    """
    spacing = require_number("spacing", spacing, positive=True)
    require(spacing >= FINEST, f"spacing must be at least {FINEST:g}, got {spacing:g}")

    def touch_times_and_states(times: NDArray[np.float64]) -> NDArray[np.float64]:
        tau, v = np.empty(times.size), np.empty(times.size)
        fill_states_before_touch(times, delta, epsilon, beta, tau, v)
        return np.stack([times, tau, v])

    points = touch_times_and_states(np.arange(FIRST_POINTS) / FIRST_POINTS)
    while True:
        last = points[:, :1] + np.array([[1.0], [1.0], [0.0]])  # repeat the first point one period later
        touch, tau, v = np.concatenate([points, last], axis=1)
        exists = v >= 0
        near = np.hypot(np.diff(tau), np.diff(v) / unit) <= spacing
        joined = exists[:-1] & exists[1:] & near
        open_ = ~joined & (exists[:-1] | exists[1:]) & (np.diff(touch) > CLOSEST)
        if not open_.any():
            break
        middle = 0.5 * (touch[:-1] + touch[1:])[open_]
        points = np.concatenate([points, touch_times_and_states(middle)], axis=1)
        points = points[:, np.argsort(points[0])]
    if joined.all():
        return (GammaPiece(tau, v, touch, True),)
    # begin after a break, so that no piece crosses the end of the period
    start = int(np.flatnonzero(~joined)[0]) + 1
    shift = np.array([[1.0], [1.0], [0.0]])
    points = np.concatenate([points[:, start:], points[:, :start] + shift], axis=1)
    joined = np.roll(joined, -start)[:-1]
    pieces = np.split(points, np.flatnonzero(~joined) + 1, axis=1)
    return tuple(GammaPiece(p[1], p[2], p[0], False) for p in pieces if p[2, 0] >= 0)


@kernel
def fill_states_before_touch(touch, delta, epsilon, beta, tau, v):
    """Write the states (τ, v) on Σ⁺ whose flights touch Σ⁻ with speed 0 at the times `touch`; v = −1 if there is none.

    A touch from inside the gap needs a contact force that points from Σ⁻ into the gap. Backwards in time the motion
    leaves Σ⁻ at the touch, and the state on Σ⁺ is its first impact. τ is not reduced to [0, 1), so that it changes
    continuously with the time of touch.
    """
    for i in range(touch.size):
        v[i], tau[i] = -1.0, touch[i]
        sine, cosine = sine_cosine_at(touch[i])
        if not contact_force(sine, cosine, delta, epsilon, DRIFT) > 0.0:
            continue
        status, time, wall, speed, _l, _flight, _s1, _c1 = first_impact(
            SIGMA_MINUS, fold_phase(-touch[i]), 0.0, -delta, epsilon, beta, -DRIFT
        )
        if status == OK and wall > 0:
            tau[i], v[i] = touch[i] - time, speed
