"""Which part of W^u(A) goes to rest, seen by following samples of it, many ε at once; and whether a chaotic attractor
ends where W^u(A) touches W^s(A), by long simulation on both sides of the contact.
"""

import numpy as np
from numpy.typing import NDArray

from rattle.flight.law import DRIFT, contact_force
from rattle.impacting.crisis.contact import Crisis
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.impacting.map.quiet import capture_invariants
from rattle.impacting.orbits.limits import sn1
from rattle.impacting.orbits.periodic import period_one_saddle
from rattle.orbits.iterates import fold
from rattle.orbits.saddles import Array, eigenvectors

Flags = NDArray[np.bool_]
NEAR = 1e-4  # of λ − 1: where W^u(A) is left to be straight
RETURNS = 60  # impacts of the excursions that are followed
AT_REST = 150  # impacts from A down to certain rest
SPARSE = 400  # samples of a fundamental domain, at least
SAMPLES = 32
SETTLE, WATCH = 20_000, 4_000  # impacts
BELOW = (1e-4, 1e-3, 1e-5)  # of ε − SN1: not all of them in narrow windows of periodic motion
ABOVE = 0.05
CHAOTIC = 0.02  # first Lyapunov exponent
SHARE = 0.2  # of the samples, that must be chaotic


def at_rest(delta: float, epsilon: Array, beta: float, tau: Array, v: Array) -> Flags:
    """Whether states (…, n), at epsilon (…, 1), are certain to come to rest."""
    invariants = capture_invariants(
        np.full(epsilon.size, delta), np.ascontiguousarray(epsilon.ravel()), np.full(epsilon.size, beta)
    ).reshape(epsilon.shape)
    force = contact_force(np.sin(2 * np.pi * tau), np.cos(2 * np.pi * tau), delta, epsilon, DRIFT)
    return np.asarray(v**3 < invariants * force)


def fundamental(delta: float, epsilon: Array, beta: float, samples: int) -> tuple[Array, Array, NDArray[np.int64]]:
    """States (n, samples) of one fundamental domain of W^u(A), on the attractor's side, at each epsilon (n,), and the
    impacts (n,) in which they return to A and come to rest.
    """
    tau, v, impacts = np.empty((epsilon.size, samples)), np.empty((epsilon.size, samples)), np.empty(epsilon.size, int)
    for i, x in enumerate(epsilon):
        saddle = period_one_saddle("A", delta, float(x), beta)
        rate, (direction, _) = np.log(np.real(saddle.multipliers[0])), eigenvectors(saddle)
        s = NEAR * np.expm1(rate) * np.exp(rate * np.linspace(-1.0, 0.0, samples))
        tau[i], v[i] = saddle.tau + s * direction[0], saddle.v + s * direction[1]
        impacts[i] = int(2 * np.log(1.0 / s[0]) / rate) + RETURNS + AT_REST
    return fold(tau), v, impacts


def escapes(delta: float, epsilon: Array, beta: float, samples: int = SPARSE) -> Flags:
    """Which samples (n, samples) of W^u(A) go to rest at each epsilon (n,) on their first excursions."""
    tau, v, impacts = fundamental(delta, epsilon, beta, samples)
    end = iterate(delta, epsilon[:, None], tau, v, impacts[:, None], beta)
    return at_rest(delta, epsilon[:, None], beta, end.tau, end.v)


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
