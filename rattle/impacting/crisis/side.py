"""On which side of its boundary crisis a parameter point is: does W^u(A), on the attractor's side, go to rest in part?

W^s(A) bounds the basin of quiet motion. Before the crisis all of W^u(A) on the side of rising v stays with the
attractor there; past it some of it lies beyond W^s(A), and goes to rest. Samples of one fundamental domain tell, from
so near to A that its unstable eigenvector is the manifold; all else of W^u(A) is images of these.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.samples import QUIET
from rattle.errors import parameters
from rattle.flight.law import DRIFT
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.attractors.settle import Cells
from rattle.impacting.map.impact_map import impact_tangent
from rattle.impacting.map.quiet import LONGEST_REST, capture_invariants, impacts_to_rest, longest_rest
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.iterates import fold

CRISIS_SIDES = ("not_computed", "no_saddle", "inside", "escapes", "undecided")
NO_SADDLE, INSIDE, ESCAPES, UNSURE = range(1, 5)
NEAREST = 1e-7  # distance from A in (τ, v) at which the samples begin
SAMPLES = 512
RETURNING = 256  # impacts on Σ⁺ after W^u(A) has left A, besides those of coming to rest, where damping is strong, and
MOST_IMPACTS = 8192  # at most; elsewhere as many more as `longest_rest` is longer


def _direction(
    delta: float, epsilon: float, beta: float, tau: float, v: float, multiplier: float
) -> tuple[float, float]:
    """The unstable unit eigenvector at A, towards rising v."""
    j00, j01, j10, j11 = impact_tangent(tau, v, delta, epsilon, beta, DRIFT, False)[5:9]
    one, other = (j01, multiplier - j00), (multiplier - j11, j10)
    x, y = one if np.hypot(*one) > np.hypot(*other) else other
    size = np.copysign(np.hypot(x, y), y if abs(y) > 1e-9 * abs(x) else x)
    return x / size, y / size


def crisis_side(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Indices of CRISIS_SIDES, of the broadcast shape of delta, epsilon and beta (dimensionless).

    no_saddle: A does not exist. inside: no sample of W^u(A), on the side of rising v, goes to rest. escapes: some do.
    undecided: there is no rest to go to, from the quiet limit on, or telling takes more than 8192 impacts, below δ =
    0.3 in proportion more: just below that and where A is born. A part of W^u(A) shorter than 1/512 of a fundamental
    domain that escapes is not seen: at δ from 0.6 to 0.768 and β = 0.6 the side is right from 1e-5 of the crisis on. A
    cell's side does not depend on the other cells. Raises ParameterError. Source: docs/crisis.md.
    """
    broadcast = parameters(delta, epsilon, beta)
    d, e, b = (np.array(x, order="C").ravel() for x in broadcast)
    orbits = period_one(d, e, b)
    tau, v, multiplier = orbits.tau[0], orbits.v[0], np.real(orbits.multipliers[0, 0])
    side = np.where(orbits.exists[0], UNSURE, NO_SADDLE).astype(np.int8)
    with np.errstate(divide="ignore", invalid="ignore"):
        climb = np.log(1.0 / NEAREST) / np.log(multiplier)
        longer = longest_rest(d) / LONGEST_REST
        most = climb + RETURNING * longer + 2.0 * impacts_to_rest(d, e, b)
    told = np.flatnonzero(orbits.exists[0] & (multiplier > 1.0) & (e < quiet_limit(d)) & (most < MOST_IMPACTS * longer))
    if told.size:
        rows = [x[told] for x in (d, e, b, tau, v, multiplier)]
        along = np.array([_direction(*row) for row in zip(*rows, strict=True)])
        d, e, b, tau, v, multiplier = rows
        s = NEAREST * multiplier[:, None] ** ((np.arange(SAMPLES) + 0.5) / SAMPLES)
        nothing = np.zeros((told.size, 0))
        classifier = ImpactingClassifier(Cells(d, e, b, capture_invariants(d, e, b)), nothing, nothing)
        status = classifier.settled(
            np.repeat(np.arange(told.size), SAMPLES),
            fold(tau[:, None] + s * along[:, :1]).ravel(),
            (v[:, None] + s * along[:, 1:]).ravel(),
            np.repeat(most[told].astype(np.int64), SAMPLES),
        ).reshape(s.shape)
        side[told] = np.where((status == QUIET).any(axis=1), ESCAPES, INSIDE)
    return side.reshape(np.shape(broadcast[0]))
