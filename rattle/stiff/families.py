"""The counterparts of A, B, C and D of the stiff gear at given δ, β and κ: whole families in ε.

P(1,1,0), A and C: for a given duration of the contact all conditions are linear in ε cos 2πt and ε sin 2πt, so the
family is one explicit curve. P(1,1,1): followed in ε from motions of the impacting limit. Both join smoothly where the
contact with Σ⁻ is lost, so a letter is a stretch between folds: A, SN1, C, fold at G1, B, SN2, D, fold at G2, A.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.arclength import newton
from rattle.bifurcations import Kind, condition
from rattle.errors import RattleError, require_number
from rattle.impact_equations import Array
from rattle.orbits import orbits_at
from rattle.periodic import at_parameters, periodic_orbit
from rattle.regions import REGION_I, REGION_II, REGION_III, REGION_IV, REGION_V
from rattle.stiff.branches import StiffBranch, stiff_branch
from rattle.stiff.equations import StiffItinerary
from rattle.stiff.motion import StiffOrbit, admissible, from_limit, orbit_of, softness

SEEDS = 12  # eccentricities of the impacting limit at which P(1,1,1) is looked for
OTHER = "P"  # a P(1,1,0) that is slower than A and C: it has no counterpart in the impacting model
DURATIONS = 600  # of the contact, for P(1,1,0)


class Named(NamedTuple):
    """A motion with the letter of its counterpart."""

    name: str
    orbit: StiffOrbit


class _Family(NamedTuple):
    """Motions P(1,1,0) by the duration σ of their contact (k,): eccentricity and time of the contact."""

    duration: NDArray
    epsilon: NDArray
    time: NDArray

    def unknowns(self, i: int, delta: float) -> Array:
        """Time, duration, δ and ε of a member."""
        return np.array([self.time[i], self.duration[i], delta, self.epsilon[i]])


def _family(itinerary: StiffItinerary, delta: float, duration: NDArray) -> _Family:
    """The motions whose contacts last pσ, σ = duration (k,): linear equations for ε cos 2πt and ε sin 2πt."""
    k = duration.size

    def unknowns(time: NDArray | float, epsilon: NDArray | float) -> NDArray:
        return np.stack(np.broadcast_arrays(time, duration, delta, epsilon), axis=-1).reshape(k, 4)

    rest = itinerary.residual(unknowns(0.0, 0.0))
    matrix = np.stack([itinerary.residual(unknowns(t, 1.0)) - rest for t in (0.0, 0.25)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
        x = (rest[:, 1] * matrix[:, 0, 1] - rest[:, 0] * matrix[:, 1, 1]) / determinant
        y = (rest[:, 0] * matrix[:, 1, 0] - rest[:, 1] * matrix[:, 0, 0]) / determinant
    return _Family(duration, np.hypot(x, y), np.arctan2(y, x) / (2 * np.pi) % 1.0)


def _sampled(itinerary: StiffItinerary, delta: float) -> _Family:
    """The family at durations dense about half a swing, π, and below four, with the least ε of each stretch."""
    from scipy.optimize import minimize_scalar

    p = itinerary.softness
    longest = 0.999 / p
    dense = np.linspace(0.0, min(4 * np.pi, longest), DURATIONS)[1:]
    hard = p * np.geomspace(1e-2, 1e4, DURATIONS)  # σ − π is about 2p times force over speed
    duration = np.concatenate([dense, np.linspace(dense[-1], longest, DURATIONS), np.pi - hard, np.pi + hard])
    duration = np.unique(duration[(duration > 0.0) & (duration <= longest)])
    found = _family(itinerary, delta, duration)
    more = []
    for i in _folds_of(itinerary, delta, found):
        ends = duration[i - 1], duration[i + 1]
        lowest = minimize_scalar(
            lambda s: _family(itinerary, delta, np.array([s])).epsilon[0], bounds=ends, method="bounded"
        )
        more.append(lowest.x)
    return _family(itinerary, delta, np.sort(np.append(duration, more)))


def _folds_of(itinerary: StiffItinerary, delta: float, family: _Family) -> list[int]:
    """The members at which ε is least among neighbours, and which happen."""
    size = family.epsilon
    least = np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])) + 1
    return [int(i) for i in least if admissible(itinerary, family.unknowns(int(i), delta))]


def without_minus(delta: float, epsilon: float, beta: float, kappa: float) -> list[StiffOrbit]:
    """All motions P(1,1,0) that happen, by rising duration of the contact."""
    from scipy.optimize import brentq

    itinerary = StiffItinerary((1,), 1, beta, softness(kappa))
    family = _sampled(itinerary, delta)
    off, found = family.epsilon - epsilon, []
    for i in np.flatnonzero((off[:-1] < 0) != (off[1:] < 0)).tolist():
        if not any(admissible(itinerary, family.unknowns(j, delta)) for j in (i, i + 1)):
            continue
        ends = family.duration[i : i + 2]
        root = brentq(lambda s: _family(itinerary, delta, np.array([s])).epsilon[0] - epsilon, *ends, xtol=1e-13)
        x = _family(itinerary, delta, np.array([root])).unknowns(0, delta)
        solved = at_parameters(itinerary, np.append(x[:3], epsilon))
        if solved is not None and admissible(itinerary, solved):
            found.append(orbit_of(itinerary, solved))
    return found


def saddle_node_1(delta: float, kappa: float, beta: float = 0.6) -> StiffOrbit:
    """The motion of the stiff gear at SN1, where A and C are born: ε(δ) beside δ, β and κ.

    Raises ParameterError, and RattleError where there is none.
    """
    delta, beta = require_number("delta", delta, positive=True), require_number("beta", beta, positive=True)
    itinerary = StiffItinerary((1,), 1, beta, softness(require_number("kappa", kappa, positive=True)))
    family, problem = _sampled(itinerary, delta), condition(itinerary, Kind.SADDLE_NODE)
    speed = 2.0 * np.pi * delta
    folds = _folds_of(itinerary, delta, family)
    for i in sorted(folds, key=lambda i: abs(_speed(itinerary, family.unknowns(i, delta)) - speed)):
        solved = newton(problem, family.unknowns(i, delta), np.array([0.0, 0.0, 1.0, 0.0]))
        if solved is not None and admissible(itinerary, solved[0]):
            return orbit_of(itinerary, solved[0])
    raise RattleError(f"A and C are not born in a saddle-node at delta = {delta:g}, beta = {beta:g}, kappa = {kappa:g}")


def _speed(itinerary: StiffItinerary, x: Array) -> float:
    return -float(itinerary.flights(x, np.array([itinerary.softness])).w0[0])


def with_minus(delta: float, beta: float, kappa: float, span: tuple[float, float]) -> list[StiffBranch]:
    """The branches of P(1,1,1) in ε within the span: those that impacting motions lead to."""
    branches: list[StiffBranch] = []
    for seed in np.linspace(*span, SEEDS + 2)[1:-1][::-1]:
        for orbit in orbits_at(delta, float(seed), beta):
            if orbit.n_minus == 0:
                continue
            try:
                found = from_limit(periodic_orbit(delta, float(seed), orbit.tau, orbit.v, 1, beta), kappa)
            except RattleError:
                continue
            if not any(_on(branch, found) for branch in branches):
                branches.append(stiff_branch(found, "epsilon", span))
    return branches


def _on(branch: StiffBranch, orbit: StiffOrbit) -> bool:
    """Whether a motion is on a branch in ε already."""
    size = orbit.times.size
    for _, x in branch.crossings(-2, orbit.epsilon):
        apart = x[: 2 * size] - orbit.unknowns[: 2 * size]
        apart[:size] -= np.rint(apart[0])
        if np.max(np.abs(apart)) < 1e-5:
            return True
    return False


def letters(branch: StiffBranch) -> list[str]:
    """The letter of every stretch of a branch of P(1,1,1) between its folds.

    A stretch that loses its contact with Σ⁻ at its end is the continuation of A, if a saddle, or of C.
    """
    edges = [0, *_folds(branch), len(branch) - 1]
    saddle = []
    for i, j in pairwise(edges):
        middle = branch.multipliers[0, (i + j) // 2]
        saddle.append(bool(middle.imag == 0 and middle.real > 1.0))
    names = ["B" if each else "D" for each in saddle]
    lost = ["is lost" in end for end in branch.ends]
    for at, beside, other in ((0, 1, -1), (-1, -2, 0)):
        if not lost[at]:
            continue
        if saddle[at]:
            names[at] = "A"
        elif len(names) > 2 or (len(names) == 2 and not lost[other]):
            names[at] = "C" if saddle[beside] else names[at]
    return names


def _folds(branch: StiffBranch) -> list[int]:
    """The points of a branch at which it folds."""
    return [event.point for event in branch.events if event.kind is Kind.SADDLE_NODE]


def period_one(delta: float, epsilon: float, beta: float, kappa: float) -> tuple[Named, ...]:
    """The counterparts of A–D that happen, sorted by letter."""
    found, taken = list[Named](), set[str]()
    for orbit in sorted(without_minus(delta, epsilon, beta, kappa), key=lambda orbit: -orbit.v):
        large = orbit.multipliers[0]
        name = "A" if large.imag == 0 and large.real > 1.0 else "C"
        found.append(Named(name if name not in taken else OTHER, orbit))
        taken.add(name)
    if epsilon > 0.0:
        for branch in with_minus(delta, beta, kappa, (0.0, 1.5 * epsilon)):
            names, folds = letters(branch), _folds(branch)
            for point, x in branch.crossings(-2, epsilon):
                orbit = orbit_of(StiffItinerary((1, -1), 1, beta, softness(kappa)), np.append(x[:-2], epsilon))
                found.append(Named(names[int(np.searchsorted(folds, point, side="right"))], orbit))
    return tuple(sorted(found, key=lambda named: (named.name, named.orbit.tau)))


def region(found: tuple[Named, ...]) -> int:
    """Region 1…5 (I…V) of the paper's Figure 7 from the motions A–D that exist; 0 for another combination."""
    names = "".join(sorted({named.name for named in found} - {OTHER}))
    stable = any(named.orbit.stable for named in found if named.name == "D")
    return {"": REGION_I, "AC": REGION_II, "ABCD": REGION_III if stable else REGION_IV, "AD": REGION_V}.get(names, 0)
