"""Periodic motions P(m, n₊, n₋) of the stiff gear: solved for, checked, followed from the impacting limit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle import first_impact, flight
from rattle.arclength import Bound, Follower, Path, Problem, tangent_at
from rattle.errors import RattleError, require, require_finite, require_integer, require_number
from rattle.impact_equations import Array
from rattle.orbits import multipliers_of
from rattle.periodic import MOST_IMPACTS, Periodic, PeriodicOrbit, at_parameters
from rattle.stiff.contact import ENDS, contact_end, responses
from rattle.stiff.equations import StiffItinerary
from rattle.stiff.flow import OK, QUIET, departs, piece
from rattle.stiff.returns import StiffPoint

SAME_TIME = 1e-6  # a recomputed flight this close to the motion's is the same flight, and likewise a contact
LEAST_CONTACT = 1e-6  # σ; a shorter one is a graze, at σ = 0, where a branch has a turning point in σ²
GRAZING = 1e-6  # with a lower speed, rounding decides whether a flight meets a wall
SAME_END = 1e-9  # of a contact, besides: what the error of a solution makes of a grazing one
LONGEST = 0.1  # of a step, in the unknowns
STEPS_TO_LIMIT = 20  # at least
MOST_STEPS = 200


@dataclass(frozen=True)
class StiffOrbit(Periodic):
    """A periodic motion P(m, n_plus, n_minus) of the stiff gear at one parameter point.

    walls (c,): of each contact, Σ⁺ first; times (c,) at which they begin, in forcing periods, the first in [0, 1);
    durations (c,); speeds (c,) at which they end, into the gap; depths are below speed/√(2κ) or so. multipliers: both
    Floquet multipliers over m periods, the larger modulus first (product e^(−δm)). admissible: whether it happens.
    """

    delta: float
    epsilon: float
    beta: float
    kappa: float
    m: int
    walls: tuple[int, ...]
    times: NDArray[np.float64]
    durations: NDArray[np.float64]
    speeds: NDArray[np.float64]
    multipliers: tuple[complex, complex]
    admissible: bool

    @property
    def departures(self) -> Array:
        """When it leaves the walls (c,): at the ends of its contacts."""
        return self.times + self.durations

    @property
    def point(self) -> StiffPoint:
        """Its parameters."""
        return StiffPoint(self.delta, self.epsilon, self.beta, self.kappa)

    @property
    def itinerary(self) -> StiffItinerary:
        """Its walls in their order."""
        return StiffItinerary(self.walls, self.m, self.beta, softness(self.kappa))

    @property
    def unknowns(self) -> Array:
        """Times, durations times √(2κ), δ and ε (2c + 2,), as the equations take them."""
        return np.concatenate([self.times, self.durations / softness(self.kappa), [self.delta, self.epsilon]])


def softness(kappa: float) -> float:
    """p = 1/√(2κ), 0 for infinite stiffness."""
    return float(1.0 / np.sqrt(2.0 * kappa))


def trace_of(itinerary: StiffItinerary, x: Array) -> float:
    """The trace of the tangent map (2, 2) in (Φ, Φ') over the period: a product of exact ones, each det e^(−δs)."""
    c, p = itinerary.contacts, itinerary.softness
    delta, kappa = float(x[-2]), 0.5 / p**2
    ends = np.append(x[:c], x[0] + itinerary.m)
    product = np.eye(2)
    for i in range(c):
        s = p * x[c + i]
        sine, lost, _defect = responses(s, delta, kappa)
        contact = np.array([[1 - lost, sine], [-2 * kappa * sine, 1 - lost - delta * sine]])
        gone = -np.expm1(-delta * (ends[i + 1] - ends[i] - s))
        product = np.array([[1.0, gone / delta], [0.0, 1.0 - gone]]) @ contact @ product
    return float(np.trace(product))


class Failure(NamedTuple):
    """What does not happen in a motion: its contact, or flight, of this number ends at this wall and time instead; wall
    0: it does not even begin.
    """

    piece: int
    contact: bool
    wall: int
    time: float


def admissible(itinerary: StiffItinerary, x: Array) -> bool:
    """Whether the motion of x happens: each contact and each flight ends first where the equations say."""
    return first_failure(itinerary, x) is None


def first_failure(itinerary: StiffItinerary, x: Array) -> Failure | None:
    """The first contact or flight of x (2c + 2,) that ends elsewhere than the equations say, None if all happen."""
    c, p, walls = itinerary.contacts, itinerary.softness, itinerary.walls
    delta, epsilon = float(x[-2]), float(x[-1])
    if not (np.isfinite(x).all() and delta > 0.0 and epsilon >= 0.0 and np.min(x[c : 2 * c]) > LEAST_CONTACT):
        return Failure(0, True, 0, 0.0)
    flights = itinerary.flights(x, np.array([p]))
    begins = np.append(x[:c], x[0] + itinerary.m)
    for i in range(c):
        sign, lasts = walls[i], p * x[c + i]
        w0, length = float(flights.w0[i]), float(begins[i + 1] - begins[i] - lasts)
        u = float(itinerary.signs[i] * flights.w1[i - 1])
        leaves = float(begins[i] + lasts)
        if not (length > 0.0 and sign * w0 < 0.0 < u):
            return Failure(i, length > 0.0, 0, leaves)
        start = float(flight.folded(begins[i]))
        found = contact_end(sign, start, 0.0, u, delta, epsilon, 0.5 / p**2, np.inf)
        if found[0] != ENDS or abs(found[1] - lasts) > SAME_TIME * p * np.pi + SAME_END:
            return Failure(i, True, sign if found[0] == ENDS else 0, float(begins[i] + found[1]))
        status, s, wall, *_ = first_impact.first_impact(
            sign, float(flight.folded(leaves)), w0, delta, epsilon, itinerary.beta, flight.DRIFT
        )
        if status != OK:
            return Failure(i, False, 0, leaves)
        arrival = float(itinerary.signs[(i + 1) % c] * flights.w1[i])
        missed = wall != walls[(i + 1) % c] or abs(s - length) > SAME_TIME
        if missed and not (arrival < GRAZING and s > length - SAME_TIME):
            return Failure(i, False, int(wall), leaves + float(s))
    return None


def orbit_of(itinerary: StiffItinerary, x: Array) -> StiffOrbit:
    """The motion of a solution x (2c + 2,) of the equations, time folded."""
    c, p = itinerary.contacts, itinerary.softness
    speeds = -itinerary.signs * itinerary.flights(x, np.array([p])).w0
    large, small = multipliers_of(trace_of(itinerary, x), np.exp(-x[-2] * itinerary.m))
    return StiffOrbit(
        float(x[-2]),
        float(x[-1]),
        itinerary.beta,
        0.5 / p**2,
        itinerary.m,
        itinerary.walls,
        x[:c] - np.floor(x[0]),
        p * x[c : 2 * c],
        speeds,
        (complex(large), complex(small)),
        admissible(itinerary, x),
    )


def from_limit(orbit: PeriodicOrbit, kappa: float) -> StiffOrbit:
    """The motion of the stiff gear at κ that a motion of the impacting model (κ = ∞) becomes, followed in κ^(−1/2).

    Raises ParameterError, and RattleError where it folds back before κ is reached or does not happen there.
    """
    kappa = require_number("kappa", kappa, positive=True)
    require(isinstance(orbit, PeriodicOrbit), f"orbit must be a PeriodicOrbit, got {type(orbit).__name__}")
    n, plane, end = 2 * orbit.times.size, np.array([orbit.delta, orbit.epsilon]), softness(kappa)
    limit = StiffItinerary(orbit.walls, orbit.m, orbit.beta, 0.0)

    def equations(y: NDArray) -> NDArray:
        parameters = np.broadcast_to(plane, (*y.shape[:-1], 2))
        return limit.residual_at(np.concatenate([y[..., :n], parameters], axis=-1), y[..., n:])

    start = np.concatenate([orbit.times, np.full(orbit.times.size, np.pi), [0.0]])
    path = followed(Problem(equations), start, np.eye(n + 1)[n], (0.0, end), lambda _: True)
    last = path.points[-1]
    if path.outside is None or abs(last[-1] - end) > 1e-12 * end:
        raise RattleError(
            f"the motion ends before kappa = {kappa:g}: it folds back at {0.5 / max(path.points[:, -1]) ** 2:g}"
        )
    itinerary = StiffItinerary(orbit.walls, orbit.m, orbit.beta, end)
    found = at_parameters(itinerary, np.concatenate([last[:n], plane]))
    if found is None or not admissible(itinerary, found):
        raise RattleError(f"the motion does not happen at kappa = {kappa:g}: a contact is made or missed on the way")
    return orbit_of(itinerary, found)


def followed(
    problem: Problem, start: Array, direction: Array, span: tuple[float, float], happens: Callable[[Array], bool]
) -> Path:
    """Solutions y (N + 1,) from the start on, the last unknown within its span, while they happen."""
    width = (span[1] - span[0]) / STEPS_TO_LIMIT

    def longest(tangent: Array) -> float:
        return min(LONGEST, width / max(abs(float(tangent[-1])), 1e-12))

    follower = Follower(problem, (Bound(-1, *span),), happens, longest)
    return follower.follow(start, tangent_at(problem, start, direction), MOST_STEPS)


def follow_contacts(
    delta: float, epsilon: float, beta: float, kappa: float, tau: float, v: float, n_plus: int
) -> tuple[StiffItinerary, Array]:
    """The itinerary and the unknowns of the motion from the departure (τ, v) through n_plus contacts with Σ⁺ more."""
    p = softness(kappa)
    wall, position, w, time = np.int64(1), 0.0, -v, tau
    walls, begins, durations = list[int](), list[float](), list[float]()
    while True:
        before, phase = wall, float(flight.folded(time))
        leaves = position == 0.0 and departs(wall, phase, position, w, delta, epsilon)
        if leaves and walls.count(1) == n_plus and before == 1:
            break
        status, s, wall, position, w, *_ = piece(wall, phase, position, w, delta, epsilon, beta, kappa, np.inf)
        if status == QUIET:
            raise RattleError(f"no periodic motion near tau = {tau}, v = {v}: it becomes quiet")
        if status != OK or len(walls) > MOST_IMPACTS:
            raise RattleError(f"no periodic motion near tau = {tau}, v = {v}: it makes contacts without end")
        time += s
        if leaves:
            walls.append(int(wall))
            begins.append(time)
            durations.append(0.0)
        else:
            durations[-1] += s / p
    m = max(round(time - tau), 1)
    last = walls.pop()  # the contact with Σ⁺ that the next period begins with
    itinerary = StiffItinerary((last, *walls), m, beta, p)
    times = [begins[-1] - m, *begins[:-1]]
    return itinerary, np.array([*times, durations[-1], *durations[:-1], delta, epsilon])


def stiff_orbit(
    delta: float, epsilon: float, kappa: float, tau: float, v: float, n_plus: int = 1, beta: float = 0.6
) -> StiffOrbit:
    """The periodic motion of the stiff gear near the departure (τ, v) from Σ⁺, with n_plus ≥ 1 contacts with Σ⁺ a
    period, by Newton's method on times and durations of its contacts.

    All numbers dimensionless; time in forcing periods. Raises ParameterError, and RattleError if there is none near.
    """
    delta, beta = require_number("delta", delta, positive=True), require_number("beta", beta, positive=True)
    kappa, v = require_number("kappa", kappa, positive=True), require_number("v", v, positive=True)
    epsilon, tau = require_number("epsilon", epsilon), float(flight.folded(require_finite("tau", tau)))
    require_integer("n_plus", n_plus, 1, MOST_IMPACTS)
    itinerary, x = follow_contacts(delta, epsilon, beta, kappa, tau, v, n_plus)
    found = at_parameters(itinerary, x)
    if found is None or not admissible(itinerary, found):
        raise RattleError(f"no periodic motion with {n_plus} contacts with Σ⁺ near tau = {tau}, v = {v}: start closer")
    return orbit_of(itinerary, found)
