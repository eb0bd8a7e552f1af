"""Lasting contact: where a motion enters a contact phase, and where it is released (compiled).

In contact Φ' = 0 on a wall, and the contact force presses on the wall. This module alone decides where a motion enters
contact:

- `is_bounce_captured`: the bounces on Σ⁺ are certain to die out, though they never end. This is quiet motion, the only
  contact that a motion with elastic impacts enters. It has no release, because the contact force never changes sign.
- `stays_in_contact`: the speed into the gap is 0, and the force presses. Elastic impacts lead there only if the motion
  starts on the wall with speed 0, or if a speed underflows.

If chatter completes under the impact law (`ImpactLaw.chatter_completes`), the motion enters contact in finite time. It
is released with speed 0 at the phase where the contact force turns away from the wall. On Σ⁺ this is the beginning of
`forcing.find_negative_force_arc`, on Σ⁻ the end of this arc.

In a contact of the stiff gear the teeth are compressed. `rattle.stiff.map.flow.is_contact_over` decides when such a
contact is over; a contact that is never over is quiet motion.
"""

from rattle.flight.forcing import contact_force, sine_cosine_by_math_library
from rattle.numerics.compile import inline, kernel

IN_CONTACT = 2  # status of a motion in contact: there is no next flight until a release
ENDLESS = 3  # status of a motion that makes over MOST_BOUNCES impacts on Σ⁻ for one on Σ⁺
MOST_BOUNCES = 100_000
# A departure from a wall at a lower speed than this counts as contact, because the square of the speed and the height
# of the bounce may underflow.
SLOWEST = 1e-150
#: A chatter is certain to complete only if a bound of its duration is at most this share of the time until the contact
#: force may vanish (`rattle.inelastic.map.contact`).
SHARE = 0.4
# if v²/(gap × force) is at most this number, a bounce with the speed v is certain not to reach the other wall
LARGEST_CLEAR_BOUNCE = 2.0 * (1.0 - SHARE) ** 2


@inline
def is_bounce_captured(speed, force, largest_invariant):
    """Return whether a bounce on Σ⁺ with this speed, under this contact force, is certain to become quiet.

    It is certain if speed³/force ≤ `largest_invariant`, the limit that `rattle.impacting.map.quiet` computes.

    Returns
    -------
    bool
        False means that it is not certain yet.
    """
    return speed * speed * speed <= largest_invariant * force


@inline
def is_chatter_certain_to_complete(speed, pressing, gap, capture):
    """Return whether the motion after an impact with this speed is certain to end in contact (inelastic impacts).

    Parameters
    ----------
    speed, pressing, gap : float
        Speed after the impact, contact force towards the wall, and 2β.
    capture : float
        Largest speed/pressing² at which a chatter is certain to complete
        (`rattle.inelastic.map.contact.chatter_capture_limit`); 0 where impacts are elastic.

    Returns
    -------
    bool
        True if it is certain.
    """
    certain = speed <= capture * pressing * pressing
    return (pressing > 0.0) & (speed * speed <= LARGEST_CLEAR_BOUNCE * gap * pressing) & certain


@kernel
def stays_in_contact(wall, w, tau, delta, epsilon, drift):
    """Return whether a motion that is on a wall stays there, with velocity w at phase tau.

    The motion stays if its speed into the gap is 0 and the contact force does not point into the gap. A graze also
    arrives with speed 0, but leaves at once, because the contact force points into the gap. A positive speed of at most
    SLOWEST counts as contact under any force.

    Returns
    -------
    bool
        True in contact.
    """
    if wall * w < -SLOWEST:
        return False
    sine, cosine = sine_cosine_by_math_library(tau)
    force = contact_force(sine, cosine, delta, epsilon, drift)
    return not (w == 0.0 and wall * force < 0.0)
