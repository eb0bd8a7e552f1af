"""Find the part of W^u(A) that becomes quiet, and decide whether chaos ends where W^u(A) touches W^s(A).

W^u(A) and W^s(A) are the unstable and the stable manifold of the saddle A. W^s(A) bounds the basin of quiet motion.
Below the crisis, at smaller ε, the whole branch of W^u(A) on the side of rising v stays with the attractor. Above the
crisis a part of this branch lies beyond W^s(A) and becomes quiet. Samples of one fundamental domain of the branch
reveal this part, because the rest of the branch consists of images of the domain. The domain is so close to A that it
is taken as straight, along the unstable eigenvector. Long simulations on both sides of the contact show whether chaos
ends.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import create_trajectories
from rattle.attractors.samples import Outcome
from rattle.errors import RattleError
from rattle.flight.forcing import DRIFT
from rattle.impacting.attractors.classifier import ImpactingClassifier, cells_of
from rattle.impacting.crisis.contact import Crisis
from rattle.impacting.map.impact_map import apply_impact_map_with_tangent
from rattle.impacting.map.iterate import iterate_tangent
from rattle.impacting.map.quiet import LONGEST_REST, impacts_until_quiet, most_impacts_until_quiet
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.iterates import fold_phases
from rattle.orbits.saddles import Array
from rattle.parameters import Parameters

Flags = NDArray[np.bool_]
NEAREST = 1e-7  # distance in (τ, v) of the fundamental domain from A
SAMPLES = 512  # number of samples of a fundamental domain
# Number of impacts on Σ⁺ that a sample may make at strong damping between leaving A and crossing W^s(A). FIRST_RETURNS
# is for samples that cross at their first return to A, RETURNS for samples that cross at a later return.
FIRST_RETURNS, RETURNS = 64, 256
# at strong damping, a parameter point is undecided if a sample may need more impacts than this to become quiet; at weak
# damping the limit is larger, in proportion to `most_impacts_until_quiet`
MOST_IMPACTS = 8192
# number of impacts of a sample that are ignored as a transient; number of impacts after these over which its Lyapunov
# exponent is measured
TRANSIENT_IMPACTS, LYAPUNOV_IMPACTS = 20_000, 4_000
CHAOS_SAMPLES = 32  # number of samples whose Lyapunov exponents are measured
# distances below the crisis, relative to ε − SN1, at which chaos is tested; no narrow window of periodic motion holds
# all these points
BELOW = (1e-4, 1e-3, 1e-5)
# Distance above the crisis, relative to ε − SN1, at which chaos is tested. Few transients that are chaotic at this
# distance last longer than TRANSIENT_IMPACTS impacts.
ABOVE = 0.01
CHAOTIC = 0.02  # a sample is chaotic if its first Lyapunov exponent, per forcing period, is above this
# W^u(A) counts as going to a chaotic attractor if the share of its samples that are chaotic exceeds
# LEAST_CHAOTIC_SHARE just below a contact with W^s(A), or MOST_CHAOTIC_SHARE just above the contact
LEAST_CHAOTIC_SHARE, MOST_CHAOTIC_SHARE = 0.2, 0.05


class Saddles(NamedTuple):
    """The saddle A at parameter points (n,): its phase, speed and unstable multiplier; NaN where it does not exist."""

    delta: Array
    epsilon: Array
    beta: Array
    tau: Array
    v: Array
    multiplier: Array

    def select(self, chosen: Flags) -> "Saddles":
        """Return the saddles at the points whose flags in `chosen` (n,) are True."""
        return Saddles(*(x[chosen] for x in self))

    @property
    def exists(self) -> Flags:
        """Flags (n,), True for points at which A exists."""
        return np.isfinite(self.tau)

    @property
    def impacts_until_quiet_at_first_return(self) -> Array:
        """Number of impacts (n,) within which a sample becomes quiet if it crosses W^s(A) at its first return to A."""
        return self._impacts_to_leave + self._impacts_until_quiet(FIRST_RETURNS)

    @property
    def impacts_until_quiet_at_later_return(self) -> Array:
        """Number of impacts (n,) within which a sample becomes quiet if it crosses W^s(A) at a later return to A."""
        return self._impacts_until_quiet(RETURNS)

    @property
    def is_decidable_at_points(self) -> Flags:
        """Flags (n,) of the points at which W^u(A) can be followed until it is decided whether a part becomes quiet.

        At these points A is a saddle, quiet motion exists, and becoming quiet takes fewer impacts than a limit:
        MOST_IMPACTS, at weak damping more.
        """
        below, most = self.epsilon < quiet_limit(self.delta), MOST_IMPACTS * _impact_limit_factor(self.delta)
        return self.exists & (self.multiplier > 1.0) & below & (self.impacts_until_quiet_at_later_return < most)

    @property
    def _impacts_to_leave(self) -> Array:
        """Number of impacts (n,) that a sample needs to go from the fundamental domain to a distance of 1 from A."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(1.0 / NEAREST) / np.log(self.multiplier), np.float64)

    def _impacts_until_quiet(self, returns: int) -> Array:
        """Return the number of impacts (n,) within which a sample becomes quiet.

        returns: the number of impacts on Σ⁺ that a sample may make between leaving A and crossing W^s(A) if damping is
        strong. If damping is weak, `_impact_limit_factor` multiplies this number.

        Returns
        -------
        Array
            The sum of the numbers of impacts to leave A, to cross W^s(A), and to become quiet after that.
        """
        rest = impacts_until_quiet(self.delta, self.epsilon, self.beta)
        return np.asarray(self._impacts_to_leave + returns * _impact_limit_factor(self.delta) + 2.0 * rest, np.float64)


def _impact_limit_factor(delta: Array) -> Array:
    """Return the factor by which limits of impacts are larger at these dampings than at strong damping.

    It is 1 at strong damping, and grows like `most_impacts_until_quiet`, the limit of the impacts until a motion is
    quiet.

    Returns
    -------
    Array
        The factors (n,).
    """
    return most_impacts_until_quiet(delta) / LONGEST_REST


def saddles_at(delta: Array, epsilon: Array, beta: Array) -> Saddles:
    """Return the saddle A at flat arrays of parameters."""
    orbits = period_one(delta, epsilon, beta)
    multiplier = np.real(orbits.multipliers[0, 0])
    return Saddles(delta, epsilon, beta, orbits.tau[0], orbits.v[0], multiplier)


def _unstable_direction(
    delta: float, epsilon: float, beta: float, tau: float, v: float, multiplier: float
) -> tuple[float, float]:
    """Return the unit eigenvector (τ, v) of the unstable multiplier at A, which points towards rising v."""
    j00, j01, j10, j11 = apply_impact_map_with_tangent(tau, v, delta, epsilon, beta, DRIFT, False)[5:9]
    one, other = (j01, multiplier - j00), (multiplier - j11, j10)
    x, y = one if np.hypot(*one) > np.hypot(*other) else other
    size = np.copysign(np.hypot(x, y), y if abs(y) > 1e-9 * abs(x) else x)
    return x / size, y / size


class FollowedManifold:
    """Samples of W^u(A) at n parameter points, `count` for each, followed for at most `impacts` (n,) impacts.

    `Saddles.is_decidable_at_points` must hold at each point. The samples lie in one fundamental domain.
    `positions` (n, count) holds the initial distances of the samples from A along W^u(A).
    """

    def __init__(self, a: Saddles, count: int, impacts: Array) -> None:
        along = np.array([_unstable_direction(*at) for at in zip(*a, strict=True)])
        nothing, cell = np.zeros((a.delta.size, 0)), np.repeat(np.arange(a.delta.size), count)
        self.positions = NEAREST * a.multiplier[:, None] ** ((np.arange(count) + 0.5) / count)
        tau, v = (
            fold_phases(a.tau[:, None] + self.positions * along[:, :1]),
            a.v[:, None] + self.positions * along[:, 1:],
        )
        self.samples = create_trajectories(cell, tau.ravel(), v.ravel(), impacts.astype(np.int64)[cell])
        at = Parameters(ImpactingClassifier.model, a.delta, a.epsilon, a.beta)
        self.classifier = ImpactingClassifier(cells_of(at), nothing, nothing)
        self.classifier.follow_to_attractor_or_limit(np.arange(cell.size), self.samples)

    @property
    def quiet_sample_flags(self) -> Flags:
        """Flags (n, count), True for samples that are certain to become quiet."""
        return np.asarray(self.samples.status.reshape(self.positions.shape) == Outcome.QUIET)


def flag_epsilon_with_escaping_part(delta: float, epsilon: Array, beta: float) -> Flags:
    """Return flags (n,) of ε at which a part of W^u(A) becomes quiet; False where this cannot be decided."""
    a = saddles_at(np.full(epsilon.size, delta), epsilon, np.full(epsilon.size, beta))
    found = a.is_decidable_at_points
    if found.any():
        a = a.select(found)
        found[found] = FollowedManifold(a, SAMPLES, a.impacts_until_quiet_at_first_return).quiet_sample_flags.any(
            axis=1
        )
    return found


def saddle_at(delta: float, epsilon: float, beta: float) -> Saddles:
    """Return the saddle A at one point. Raises RattleError unless the point is `Saddles.is_decidable_at_points`."""
    a = saddles_at(*(np.array([x]) for x in (delta, epsilon, beta)))
    if not a.is_decidable_at_points[0]:
        raise RattleError(
            f"W^u(A) cannot be followed at delta = {delta}, epsilon = {epsilon}, beta = {beta}: the saddle A or quiet "
            "motion does not exist there, or becoming quiet takes too many impacts; choose another point"
        )
    return a


def chaotic_share(delta: float, epsilon: float, beta: float, transient: int = TRANSIENT_IMPACTS) -> float:
    """Return the share of CHAOS_SAMPLES samples of W^u(A) that are chaotic after a transient.

    Parameters
    ----------
    delta, epsilon, beta : float
        Parameters of the gear.
    transient : int
        Impacts of the transient, added to `Saddles.impacts_until_quiet_at_first_return`.

    Returns
    -------
    float
        The share of all samples; 0 if each sample has become quiet or periodic by the end of the transient.
    """
    a = saddle_at(delta, epsilon, beta)
    found = FollowedManifold(a, CHAOS_SAMPLES, a.impacts_until_quiet_at_first_return + transient)
    left = found.samples.status == Outcome.UNRESOLVED
    if not left.any():
        return 0.0
    watched = iterate_tangent(delta, epsilon, found.samples.tau[left], found.samples.v[left], LYAPUNOV_IMPACTS, beta)
    nothing, once = np.zeros(watched.v.size, np.int64), np.ones(watched.v.size, np.int64)
    stay = found.classifier.outcomes_of_states(nothing, watched.tau, watched.v, once) == Outcome.UNRESOLVED
    return float(np.count_nonzero(stay & (watched.lyapunov[0] > CHAOTIC))) / CHAOS_SAMPLES


def is_chaotic_below_crisis(contact: Crisis) -> bool:
    """Return whether W^u(A) goes to a chaotic attractor at ε just below a contact of W^u(A) with W^s(A)."""
    floor, gap = float(sn1_formula(contact.delta)), contact.epsilon_above_sn1
    return any(chaotic_share(contact.delta, floor + gap * (1.0 - x), contact.beta) > LEAST_CHAOTIC_SHARE for x in BELOW)


def is_chaotic_above_crisis(contact: Crisis) -> bool:
    """Return whether W^u(A) still goes to a chaotic attractor at ε just above a contact of W^u(A) with W^s(A)."""
    epsilon = float(sn1_formula(contact.delta)) + contact.epsilon_above_sn1 * (1.0 + ABOVE)
    return chaotic_share(contact.delta, epsilon, contact.beta) > MOST_CHAOTIC_SHARE
