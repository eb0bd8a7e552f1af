"""Points of the grazing curve Γ, each by one flight backwards from its touch of Σ⁻ (compiled)."""

from rattle.flight.first_impact import OK, SIGMA_MINUS, first_impact
from rattle.flight.law import DRIFT, contact_force, folded, versines
from rattle.numerics.compile import kernel


@kernel
def before_touch(touch, delta, epsilon, beta, tau, v):
    """Write the states (τ, v) on Σ⁺ whose flights touch Σ⁻ with speed 0 at these times; v = −1 where there is none.

    A touch from inside the gap needs a contact force that points into it. Backwards in time the motion leaves Σ⁻ like
    any other, and what it meets first is where it came from. τ is not folded: it changes steadily with touch.
    """
    for i in range(touch.size):
        v[i], tau[i] = -1.0, touch[i]
        versine, sine, _defect = versines(touch[i])
        if not contact_force(sine, 1.0 - versine, delta, epsilon, DRIFT) > 0.0:
            continue
        status, time, wall, speed, _l, _s0, _c0, _s1, _c1 = first_impact(
            SIGMA_MINUS, folded(-touch[i]), 0.0, -delta, epsilon, beta, -DRIFT
        )
        if status == OK and wall > 0:
            tau[i], v[i] = touch[i] - time, speed
