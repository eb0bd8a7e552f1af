"""Motions P(m, n₊, n₋) of the stiff gear: solve for one, check it, or follow it from the impacting limit."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import (
    BoundsOfUnknown,
    ContinuationProblem,
    CurveFollower,
    OneWayPath,
    make_longest_step_function,
    tangent_at,
)
from rattle.errors import RattleError, require, require_finite, require_integer, require_number
from rattle.flight import law
from rattle.impacting.orbits.periodic import PeriodicOrbit
from rattle.numerics.complex_step import Array
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.orbits.periodic_motions import MOST_IMPACTS, PeriodicMotion, shorten_to_least_period, solve_at_parameters
from rattle.stiff.map.flow import OK, QUIET, follow_piece, is_contact_over
from rattle.stiff.map.return_map import StiffPoint
from rattle.stiff.orbits import closure
from rattle.stiff.orbits.closure import ContactCycle, softness
from rattle.stiff.orbits.equations import StiffItinerary

LONGEST_STEP = 0.1  # longest continuation step, in the unknowns
STEPS_TO_LIMIT = 20  # least number of continuation steps from the impacting limit to finite stiffness
MOST_STEPS = 200  # largest number of continuation steps from the impacting limit


@dataclass(frozen=True, repr=False)
class StiffOrbit(PeriodicMotion):
    """A periodic motion of the stiff gear: see `PeriodicMotion`.

    durations (c,): the durations of the c contacts, in forcing periods. `speeds` are the speeds at the ends of the
    contacts. A contact is about as deep as its speed divided by √(2κ), or less.
    """

    kappa: float
    durations: NDArray[np.float64]

    @property
    def added(self) -> tuple[str, ...]:
        """The names of the motion's parameters besides δ, ε and β: "kappa" only."""
        return ("kappa",)

    @property
    def departures(self) -> Array:
        """The times (c,) at which the motion leaves the walls: the ends of its contacts."""
        return self.times + self.durations

    @property
    def point(self) -> StiffPoint:
        """The parameter point of the motion."""
        return StiffPoint(self.delta, self.epsilon, self.beta, self.kappa)

    @property
    def itinerary(self) -> StiffItinerary:
        """The itinerary of the motion: its walls in order, its m forcing periods, β and the stiffness."""
        return StiffItinerary(self.walls, self.m, self.beta, softness(self.kappa))

    @property
    def unknowns(self) -> Array:
        """The unknowns (2c + 2,) of the equations: times of c contacts, durations multiplied by √(2κ), δ and ε."""
        return np.concatenate([self.times, self.durations / softness(self.kappa), [self.delta, self.epsilon]])


def trace_of_tangent_map(itinerary: StiffItinerary, x: Array) -> float:
    """Return the trace of the tangent map, in (Φ, Φ'), over the period of the motion with unknowns x (2c + 2,)."""
    return float(closure.tangent_map_trace(np.delete(x, -2), _contact_cycle_of(itinerary, x)))


class FailingPiece(NamedTuple):
    """A flight or contact that does not end at the wall and time that the equations of a motion assume.

    piece: the number of the flight or contact. is_contact: whether it is a contact. wall, time: the wall and the time
    at which the flight or contact ends instead; wall is 0 if the flight or contact cannot begin or has no end.
    """

    piece: int
    is_contact: bool
    wall: int
    time: float


def is_admissible_solution(itinerary: StiffItinerary, x: Array) -> bool:
    """Return whether the motion with unknowns x is admissible: each flight and contact ends as its equations assume."""
    return bool(closure.is_admissible(np.delete(x, -2), _contact_cycle_of(itinerary, x)))


def first_failing_piece(itinerary: StiffItinerary, x: Array) -> FailingPiece | None:
    """Return the first flight or contact of the motion with unknowns x that does not end as the equations assume.

    Returns
    -------
    FailingPiece | None
        The flight or contact; None if the motion is admissible.
    """
    number, contact, wall, time = closure.find_failing_piece(np.delete(x, -2), _contact_cycle_of(itinerary, x))
    return None if number < 0 else FailingPiece(int(number), bool(contact), int(wall), float(time))


def _contact_cycle_of(itinerary: StiffItinerary, x: Array) -> ContactCycle:
    """Return the walls, the period and the parameters of the motion with the unknowns x as a `ContactCycle`."""
    kappa = 0.5 / itinerary.softness**2
    return ContactCycle(np.array(itinerary.walls), itinerary.m, float(x[-2]), itinerary.beta, kappa)


def orbit_of(itinerary: StiffItinerary, x: Array) -> StiffOrbit:
    """Return the `StiffOrbit` of a solution x (2c + 2,) with c contacts.

    Returns
    -------
    StiffOrbit
        The orbit. Its times are those of x, shifted by a whole number of forcing periods so that the first contact
        begins at a time in [0, 1).
    """
    c, p = itinerary.n_contacts, itinerary.softness
    speeds = -itinerary.signs * itinerary.flights(x, np.array([p])).w0
    more: dict[str, Any] = {"kappa": 0.5 / p**2, "durations": p * x[c : 2 * c]}
    return StiffOrbit.from_solution(
        itinerary, x, speeds, trace_of_tangent_map(itinerary, x), is_admissible_solution(itinerary, x), **more
    )


def continue_from_limit(orbit: PeriodicOrbit, kappa: float) -> StiffOrbit:
    """Return the motion of the stiff gear that a motion of the impacting model becomes at the stiffness κ.

    The motion is continued in κ^(−1/2) from κ = ∞, at fixed δ, ε and β.

    Returns
    -------
    StiffOrbit
        The motion, with its contacts, multipliers and stability.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the branch folds back or becomes singular before κ is reached, or the motion is virtual there.
    """
    kappa = require_number("kappa", kappa, positive=True)
    require(isinstance(orbit, PeriodicOrbit), f"orbit must be a PeriodicOrbit, got {type(orbit).__name__}")
    n, plane, end = 2 * orbit.times.size, np.array([orbit.delta, orbit.epsilon]), softness(kappa)
    limit = StiffItinerary(orbit.walls, orbit.m, orbit.beta, 0.0)

    def equations(y: NDArray) -> NDArray:
        parameters = np.broadcast_to(plane, (*y.shape[:-1], 2))
        return limit.residual_at(np.concatenate([y[..., :n], parameters], axis=-1), y[..., n:])

    start = np.concatenate([orbit.times, np.full(orbit.times.size, np.pi), [0.0]])
    path = follow_from_rigid_limit(ContinuationProblem(equations), start, np.eye(n + 1)[n], (0.0, end), lambda _: True)
    last = path.points[-1]
    if path.first_point_outside is None or abs(last[-1] - end) > 1e-12 * end:
        largest = float(max(path.points[:, -1]))
        # `largest` is 0 if the first step from κ = ∞ failed
        where = f"at kappa = {0.5 / largest**2:g}: give a larger kappa" if largest else "at once: give another motion"
        raise RattleError(
            f"the motion cannot be followed to kappa = {kappa:g}, because its branch, which begins at kappa = "
            f"infinity, folds back or becomes singular {where}"
        )
    itinerary = StiffItinerary(orbit.walls, orbit.m, orbit.beta, end)
    found = solve_at_parameters(itinerary, np.concatenate([last[:n], plane]))
    if found is None or not is_admissible_solution(itinerary, found):
        raise RattleError(
            f"the motion is virtual at kappa = {kappa:g}, because a contact is gained or lost on the way from kappa = "
            "infinity: give a larger kappa"
        )
    return orbit_of(itinerary, found)


def follow_from_rigid_limit(
    problem: ContinuationProblem,
    start: Array,
    direction: Array,
    span: tuple[float, float],
    is_admissible: Callable[[Array], bool],
) -> OneWayPath:
    """Follow solutions from `start` (N + 1,) while they are admissible and the last unknown, 1/√(2κ), is in `span`."""
    follower = CurveFollower(
        problem,
        (BoundsOfUnknown(-1, *span),),
        is_admissible,
        make_longest_step_function(span, STEPS_TO_LIMIT, LONGEST_STEP),
    )
    return follower.follow(start, tangent_at(problem, start, direction), MOST_STEPS)


def follow_contacts(
    delta: float, epsilon: float, beta: float, kappa: float, tau: float, v: float, n_plus: int
) -> tuple[StiffItinerary, Array]:
    """Follow a motion from a departure (τ, v) over n_plus contacts with Σ⁺, as a guess of a periodic motion.

    Returns
    -------
    tuple[StiffItinerary, Array]
        The itinerary, and the unknowns (2c + 2,): times of the c contacts, durations times √(2κ), δ and ε.

    Raises
    ------
    RattleError
        If the motion becomes quiet first, makes more than MOST_IMPACTS contacts, or cannot be followed.
    """
    p = softness(kappa)
    wall, position, w, time = np.int64(1), 0.0, -v, tau
    walls, begins, durations = list[int](), list[float](), list[float]()
    while True:
        before, phase = wall, float(law.fold_phase(time))
        leaves = position == 0.0 and is_contact_over(wall, phase, position, w, delta, epsilon)
        if leaves and walls.count(1) == n_plus and before == 1:
            break
        status, s, wall, position, w, *_ = follow_piece(wall, phase, position, w, delta, epsilon, beta, kappa, np.inf)
        if status == QUIET:
            raise RattleError(
                f"no periodic motion near tau = {tau}, v = {v}: the motion from this state becomes quiet; "
                "give another state"
            )
        if status != OK:
            raise RattleError(
                f"no periodic motion near tau = {tau}, v = {v}: the motion from this state cannot be followed to "
                f"{n_plus} contacts with Σ⁺; give another state"
            )
        if len(walls) > MOST_IMPACTS:
            raise RattleError(
                f"no periodic motion near tau = {tau}, v = {v}: the motion from this state makes more than "
                f"{MOST_IMPACTS} contacts before it has made {n_plus} contacts with Σ⁺; give another state"
            )
        time += s
        if leaves:
            walls.append(int(wall))
            begins.append(time)
            durations.append(0.0)
        else:
            durations[-1] += s / p
    m = max(round(time - tau), 1)
    last = walls.pop()  # the last contact with Σ⁺ is put first, one period earlier
    itinerary = StiffItinerary((last, *walls), m, beta, p)
    times = [begins[-1] - m, *begins[:-1]]
    return itinerary, np.array([*times, durations[-1], *durations[:-1], delta, epsilon])


def convert_to_stiff_orbit(orbit: StiffOrbit | Orbit) -> StiffOrbit:
    """Return an orbit as a `StiffOrbit`, solving for it if it is an `Orbit`. Raises ParameterError for other gears."""
    if isinstance(orbit, StiffOrbit):
        return orbit
    require(isinstance(orbit, Orbit), f"orbit must be an Orbit or a StiffOrbit, got {type(orbit).__name__}")
    require(
        "kappa" in orbit.added,
        "orbit must be of the stiff gear, got one without kappa: follow orbits of the impacting gear with "
        "rattle.branch",
    )
    return stiff_orbit(orbit.delta, orbit.epsilon, orbit.added["kappa"], orbit.tau, orbit.v, orbit.n_plus, orbit.beta)


def stiff_orbit(
    delta: float, epsilon: float, kappa: float, tau: float, v: float, n_plus: int = 1, beta: float = 0.6
) -> StiffOrbit:
    """Return the periodic motion of the stiff gear near the departure (τ, v) from Σ⁺, with n_plus ≥ 1 contacts with Σ⁺.

    Newton's method solves for the times and durations of the contacts. If the motion already repeats after fewer than
    n_plus contacts with Σ⁺, it is returned with its shortest period. All numbers are dimensionless, time is in forcing
    periods.

    Returns
    -------
    StiffOrbit
        The motion, with its contacts, multipliers and stability.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If no periodic motion is found near this departure.
    """
    delta, beta = require_number("delta", delta, positive=True), require_number("beta", beta, positive=True)
    kappa, v = require_number("kappa", kappa, positive=True), require_number("v", v, positive=True)
    epsilon, tau = require_number("epsilon", epsilon), float(law.fold_phase(require_finite("tau", tau)))
    require_integer("n_plus", n_plus, 1, MOST_IMPACTS)
    itinerary, x = follow_contacts(delta, epsilon, beta, kappa, tau, v, n_plus)
    found = solve_at_parameters(itinerary, x)
    if found is None or not is_admissible_solution(itinerary, found):
        raise RattleError(
            f"no periodic motion with {n_plus} contacts with Σ⁺ near tau = {tau}, v = {v}: give tau and v closer to a "
            "periodic motion"
        )
    return orbit_of(*shorten_to_least_period(itinerary, found))
