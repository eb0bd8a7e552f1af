"""Contact that lasts: a phase of a motion, with an entry and, if the contact force changes sign, a release (compiled).

In contact Φ' = 0 on a wall, and the contact force presses on it. This module alone decides where a motion enters:

- `is_captured`: the bounces on Σ⁺ are certain to die out there, though they never end. That is quiet motion, the one
  contact that a motion with elastic impacts enters; it has no release, since the force never changes sign.
- `stays_in_contact`: there is no speed into the gap, and the force presses. Elastic impacts lead there from no other
  state: it is a start on the wall, or a speed that leaves double precision.

A law whose chatter completes (`ImpactLaw.chatter_completes`) enters in finite time where it bounces, and is released
with speed 0 at the phase where the force turns away, the entry of `forcing.negative_arc` on Σ⁺ and its exit on Σ⁻. The
stiff gear's contacts have depth: `rattle.stiff.map.flow.departs` is their release, and one without an end is quiet.
"""

from rattle.flight.forcing import contact_force, library_phase
from rattle.numerics.compile import inline, kernel

IN_CONTACT = 2  # status of a motion in contact: there is no next flight until a release
ENDLESS = 3  # status of a motion that makes MOST_BOUNCES impacts on Σ⁻ between two on Σ⁺
MOST_BOUNCES = 100_000
SLOWEST = 1e-150  # below, heights and speeds squared leave double precision
#: x of `rattle.inelastic.map.contact`: a chatter takes at most this share of the time in which the force might vanish.
SHARE = 0.4
LOW = 2.0 * (1.0 - SHARE) ** 2  # v²/(gap × force) up to which a bounce stays clear of the other wall


@inline
def is_captured(speed, force, largest_invariant):
    """Return whether the bounce on Σ⁺ with this speed, under this contact force, is certain to become quiet.

    It is where v³/g is at most the largest invariant of `rattle.impacting.map.quiet`.

    Returns
    -------
    bool
        False means that it is not certain yet.
    """
    return speed * speed * speed <= largest_invariant * force


@inline
def chatter_completes(speed, pressing, gap, capture):
    """Return whether an impact that is left with this speed is certain to lead to contact, by impacts that lose energy.

    Parameters
    ----------
    speed, pressing, gap : float
        Speed after the impact, contact force towards the wall, and 2β.
    capture : float
        Up to which v/h² a chatter completes (`rattle.inelastic.map.contact.capture_of`); 0 where impacts are elastic.

    Returns
    -------
    bool
        True if it is certain.
    """
    certain = speed <= capture * pressing * pressing
    return (pressing > 0.0) & (speed * speed <= LOW * gap * pressing) & certain


@kernel
def stays_in_contact(wall, w, tau, delta, epsilon, drift):
    """Return whether the motion does not leave the wall.

    It stays with no speed into the gap and a contact force that presses on the wall. A graze arrives with no speed and
    leaves at once, because the force points into the gap.

    Returns
    -------
    bool
        True in contact.
    """
    if wall * w < -SLOWEST:
        return False
    sine, cosine = library_phase(tau)
    force = contact_force(sine, cosine, delta, epsilon, drift)
    return not (w == 0.0 and wall * force < 0.0)
