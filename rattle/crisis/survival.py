"""Does a chaotic attractor end where W^u(A) touches W^s(A)? Long simulation on both sides of the contact."""

import numpy as np

from rattle.crisis.contact import Crisis
from rattle.crisis.escape import at_rest, fundamental
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.impacting.orbits.limits import sn1

SAMPLES = 32
SETTLE, WATCH = 20_000, 4_000  # impacts
BELOW = (1e-4, 1e-3, 1e-5)  # of ε − SN1: not all of them in narrow windows of periodic motion
ABOVE = 0.05
CHAOTIC = 0.02  # first Lyapunov exponent
SHARE = 0.2  # of the samples, that must be chaotic


def chaotic_part(delta: float, epsilon: float, beta: float, settle: int = SETTLE) -> float:
    """Share of the orbits of W^u(A), on the attractor's side, that are chaotic after so many impacts."""
    at = np.array([epsilon])
    tau, v, impacts = fundamental(delta, at, beta, SAMPLES)
    end = iterate(delta, epsilon, tau[0], v[0], impacts[0] + settle, beta)
    rests = at_rest(delta, at, beta, end.tau, end.v)
    if rests.all():
        return 0.0
    watched = iterate_tangent(delta, epsilon, end.tau[~rests], end.v[~rests], WATCH, beta)
    chaotic = (watched.lyapunov[0] > CHAOTIC) & ~at_rest(delta, at, beta, watched.tau, watched.v)
    return float(np.count_nonzero(chaotic)) / SAMPLES


def is_chaotic(contact: Crisis) -> bool:
    """Whether what attracts W^u(A) just below the contact is chaotic."""
    floor, gap = float(sn1(contact.delta)), contact.gap
    return any(chaotic_part(contact.delta, floor + gap * (1.0 - x), contact.beta) > SHARE for x in BELOW)


def outlived(contact: Crisis) -> bool:
    """Whether chaos outlives the contact."""
    epsilon = float(sn1(contact.delta)) + contact.gap * (1.0 + ABOVE)
    return chaotic_part(contact.delta, epsilon, contact.beta) > SHARE
