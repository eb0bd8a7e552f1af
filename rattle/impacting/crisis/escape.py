"""Find the part of W^u(A) that goes to rest, and whether chaos ends where W^u(A) touches W^s(A).

W^s(A) bounds the basin of quiet motion. Before the crisis all of W^u(A) on the side of rising v stays with the
attractor there; past it some of it lies beyond W^s(A), and goes to rest. Samples of one fundamental domain tell, from
so near to A that its unstable eigenvector is the manifold; all else of W^u(A) is images of these. Whether chaos ends is
seen by long simulation on both sides of the contact.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import begun
from rattle.attractors.samples import Outcome
from rattle.errors import RattleError
from rattle.flight.forcing import DRIFT
from rattle.impacting.attractors.classifier import ImpactingClassifier, cells_of
from rattle.impacting.crisis.contact import Crisis
from rattle.impacting.map.impact_map import impact_tangent
from rattle.impacting.map.iterate import iterate_tangent
from rattle.impacting.map.quiet import LONGEST_REST, impacts_to_rest, longest_rest
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.iterates import fold
from rattle.orbits.saddles import Array
from rattle.parameters import Parameters

Flags = NDArray[np.bool_]
NEAREST = 1e-7  # distance from A in (τ, v) at which the samples begin
SAMPLES = 512
FIRST_RETURNS, RETURNS = 64, 256  # impacts on Σ⁺ between leaving A and coming to rest, where damping is strong, and
MOST_IMPACTS = 8192  # in all at most; elsewhere as many more as `longest_rest` is longer
SETTLE, WATCH = 20_000, 4_000  # impacts
WATCHED = 32  # samples that are
BELOW = (1e-4, 1e-3, 1e-5)  # of ε − SN1: not all of them in narrow windows of periodic motion
ABOVE = 0.01  # where no more than a few transients last
CHAOTIC = 0.02  # first Lyapunov exponent
SHARE, FEW = 0.2, 0.05  # of the samples: that must be chaotic below, and that may be above


class Saddles(NamedTuple):
    """A at parameter points (n,): its phase, speed and unstable multiplier, NaN where it does not exist."""

    delta: Array
    epsilon: Array
    beta: Array
    tau: Array
    v: Array
    multiplier: Array

    def at(self, chosen: Flags) -> "Saddles":
        """Return at these of the points."""
        return Saddles(*(x[chosen] for x in self))

    @property
    def exists(self) -> Flags:
        """Flags (n,) of the points at which A exists."""
        return np.isfinite(self.tau)

    @property
    def first_excursion(self) -> Array:
        """Impacts (n,) in which what passes W^s(A) at its first return has left A twice and is at rest."""
        return self._climb + self._impacts(FIRST_RETURNS)

    @property
    def excursions(self) -> Array:
        """Impacts (n,) in which W^u(A) has left A, returned many times, and is at rest if it goes there."""
        return self._impacts(RETURNS)

    @property
    def decidable(self) -> Flags:
        """Flags of the points at which W^u(A) can be followed until its fate is known.

        There is rest to go to, in a bearable number of impacts.
        """
        below, most = self.epsilon < quiet_limit(self.delta), MOST_IMPACTS * _longer(self.delta)
        return self.exists & (self.multiplier > 1.0) & below & (self.excursions < most)

    @property
    def _climb(self) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(1.0 / NEAREST) / np.log(self.multiplier), np.float64)

    def _impacts(self, returns: int) -> Array:
        rest = impacts_to_rest(self.delta, self.epsilon, self.beta)
        return np.asarray(self._climb + returns * _longer(self.delta) + 2.0 * rest, np.float64)


def _longer(delta: Array) -> Array:
    """Return by which factor a relaxation takes longer than where damping is strong."""
    return longest_rest(delta) / LONGEST_REST


def saddles(delta: Array, epsilon: Array, beta: Array) -> Saddles:
    """Return a at flat arrays of parameters."""
    orbits = period_one(delta, epsilon, beta)
    multiplier = np.real(orbits.multipliers[0, 0])
    return Saddles(delta, epsilon, beta, orbits.tau[0], orbits.v[0], multiplier)


def _direction(
    delta: float, epsilon: float, beta: float, tau: float, v: float, multiplier: float
) -> tuple[float, float]:
    """Return the unstable unit eigenvector at A, towards rising v."""
    j00, j01, j10, j11 = impact_tangent(tau, v, delta, epsilon, beta, DRIFT, False)[5:9]
    one, other = (j01, multiplier - j00), (multiplier - j11, j10)
    x, y = one if np.hypot(*one) > np.hypot(*other) else other
    size = np.copysign(np.hypot(x, y), y if abs(y) > 1e-9 * abs(x) else x)
    return x / size, y / size


class FollowedManifold:
    """Samples (n · count,) of a fundamental domain of W^u(A) at n `decidable` points.

    They are followed for at most `impacts` (n,). s (n, count): their distance from A at the start, which is their place
    on W^u(A).
    """

    def __init__(self, a: Saddles, count: int, impacts: Array) -> None:
        along = np.array([_direction(*at) for at in zip(*a, strict=True)])
        nothing, cell = np.zeros((a.delta.size, 0)), np.repeat(np.arange(a.delta.size), count)
        self.s = NEAREST * a.multiplier[:, None] ** ((np.arange(count) + 0.5) / count)
        tau, v = fold(a.tau[:, None] + self.s * along[:, :1]), a.v[:, None] + self.s * along[:, 1:]
        self.samples = begun(cell, tau.ravel(), v.ravel(), impacts.astype(np.int64)[cell])
        at = Parameters(ImpactingClassifier.model, a.delta, a.epsilon, a.beta)
        self.classifier = ImpactingClassifier(cells_of(at), nothing, nothing)
        self.classifier.settle(np.arange(cell.size), self.samples)

    @property
    def at_rest(self) -> Flags:
        """Flags (n, count) of the samples that are certain to come to rest."""
        return np.asarray(self.samples.status.reshape(self.s.shape) == Outcome.QUIET)


def escapes(delta: float, epsilon: Array, beta: float) -> Flags:
    """Return at which epsilon (n,) a part of W^u(A) goes to rest; False where that is not decidable."""
    a = saddles(np.full(epsilon.size, delta), epsilon, np.full(epsilon.size, beta))
    found = a.decidable
    if found.any():
        a = a.at(found)
        found[found] = FollowedManifold(a, SAMPLES, a.first_excursion).at_rest.any(axis=1)
    return found


def saddle_at(delta: float, epsilon: float, beta: float) -> Saddles:
    """Return a at one parameter point. Raises RattleError if it is absent, or nothing is decidable there."""
    a = saddles(*(np.array([x]) for x in (delta, epsilon, beta)))
    if not a.decidable[0]:
        raise RattleError(
            f"there is no A of which W^u can go to rest at delta = {delta}, epsilon = {epsilon}, beta = {beta}"
        )
    return a


def chaotic_part(delta: float, epsilon: float, beta: float, settle: int = SETTLE) -> float:
    """Share of the orbits of W^u(A) that are chaotic after so many impacts."""
    a = saddle_at(delta, epsilon, beta)
    found = FollowedManifold(a, WATCHED, a.first_excursion + settle)
    left = found.samples.status == Outcome.UNRESOLVED
    if not left.any():
        return 0.0
    watched = iterate_tangent(delta, epsilon, found.samples.tau[left], found.samples.v[left], WATCH, beta)
    nothing, once = np.zeros(watched.v.size, np.int64), np.ones(watched.v.size, np.int64)
    stay = found.classifier.settled(nothing, watched.tau, watched.v, once) == Outcome.UNRESOLVED
    return float(np.count_nonzero(stay & (watched.lyapunov[0] > CHAOTIC))) / WATCHED


def is_chaotic_below(contact: Crisis) -> bool:
    """Return whether what attracts W^u(A) just below the contact is chaotic."""
    floor, gap = float(sn1_formula(contact.delta)), contact.gap
    return any(chaotic_part(contact.delta, floor + gap * (1.0 - x), contact.beta) > SHARE for x in BELOW)


def outlived(contact: Crisis) -> bool:
    """Return whether chaos outlives the contact."""
    epsilon = float(sn1_formula(contact.delta)) + contact.gap * (1.0 + ABOVE)
    return chaotic_part(contact.delta, epsilon, contact.beta) > FEW
