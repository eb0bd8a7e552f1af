"""Chatter that completes, and the contact phase that follows (compiled).

Impacts with restitution r < 1 die out in finite time where the contact force h = ±g presses on the wall. Let the motion
leave an impact at time t with speed v, and let h be positive on [t, t + T], with minimum h_min and variation V of ln h
there. Over a bounce with arrival speed v₁ the impulse is ∫ h = v + v₁. The work of h gives v₁ ≤ v √(h_max/h_min), with
the extremes of h over that bounce, and drag reduces v₁ further. The speed after the k-th impact is therefore at most
r^k v e^(V/2), and all flights together last at most

    2 v e^(V/2) / ((1 − r) h_min).

If this bound is at most T, the chatter is complete within T. With |h'| ≤ L and T = x h/L, h_min ≥ (1 − x) h and
V ≤ −ln(1 − x); x = 2/5 allows the largest v, LEAST_SHARE (1 − r) h²/L. No bounce is higher than v²/(2 (1 − x)² h).
The teeth then stay together until the release, the known zero of g at which the force turns away from the wall.
`is_chatter_captured` decides this without following the impacts. The time at which the chatter ends does not influence
the motion after the release.

A chatter of elastic impacts never ends. With r = 1 the adiabatic law of `rattle.impacting.map.quiet` decides whether
quiet motion is certain; the fastest harmonic takes the place of the first one in it (`quiet_invariant`).
"""

import math

from rattle.flight.contact_phase import SHARE, is_chatter_certain_to_complete
from rattle.flight.contact_phase import is_bounce_captured as is_quiet
from rattle.impacting.map.quiet import largest_eta
from rattle.inelastic.map.harmonics import ORDER, contact_force_and_rate, forcing_derivative_bounds
from rattle.numerics.compile import inline, kernel

# a chatter is certain to complete if the speed after an impact is at most LEAST_SHARE (1 − r) h²/max|g'|; h is the
# contact force at the impact (see the top of this file)
LEAST_SHARE = 0.5 * SHARE * (1.0 - SHARE) ** 1.5
PHASES = 64  # number of phases, per period of the fastest harmonic, at which the contact force is evaluated


@inline
def chatter_capture_limit(delta, restitution, harmonics):
    """Return the largest v/h² at which a chatter is certain to complete; v: speed after impact, h: contact force."""
    return LEAST_SHARE * (1.0 - restitution) / forcing_derivative_bounds(delta, harmonics).force_derivative


@inline
def is_chatter_captured(wall, v, force, point):
    """Return whether an impact is certain to lead to contact or, if impacts are elastic, to quiet motion.

    v: the speed after the impact. force: the contact force at the impact.

    Returns
    -------
    bool
        False if neither is certain.
    """
    pressing = wall * force
    if not pressing > 0.0:
        return False
    if wall > 0 and is_quiet(v, force, point.quiet_invariant):
        return True
    return is_chatter_certain_to_complete(v, pressing, 2.0 * point.beta, point.capture)


@kernel
def quiet_invariant(delta, drift, beta, harmonics):
    """Return the largest v³/g (speed v, contact force g) at which elastic bounces are certain to become quiet.

    Returns
    -------
    float
        The bound; 0 if the contact force is 0 or negative at some phase.
    """
    highest = 0.0
    for j in range(harmonics.shape[1]):
        highest = max(highest, harmonics[ORDER, j])
    fastest, smallest = 0.0, math.inf
    count = int(PHASES * highest)
    for i in range(count):
        force, rate = contact_force_and_rate(i / count, delta, drift, harmonics)
        if not force > 0.0:
            return 0.0
        r = max(abs(rate) / force, math.pi * highest, delta)
        fastest = max(fastest, r * r * r / (force * force))
        smallest = min(smallest, force)
    eta = largest_eta(delta / highest)
    return min(eta * eta * eta / fastest, (2.0 * beta) ** 1.5 * math.sqrt(smallest))
