"""Any periodic motion P(m, n₊, n₋), stable or not.

The unknowns of a motion are the times of its impacts. For a solution the multipliers are computed, and whether it is
admissible: then each flight ends at its first impact.
"""

from dataclasses import dataclass

import numpy as np

from rattle.errors import RattleError, require, require_finite, require_integer, require_number
from rattle.flight import first_impact, forcing, impact_law, law
from rattle.impacting.map.impact_map import ImpactingPoint
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.period_one import orbits_at
from rattle.numerics.complex_step import Array
from rattle.orbits.orbits_a_to_d import Orbit
from rattle.orbits.periodic_motions import MOST_IMPACTS, PeriodicMotion, shorten_to_least_period, solve_at_parameters

SAME_TIME = 1e-6  # two flights count as the same if their durations, in forcing periods, differ by at most this
GRAZING_SPEED = 1e-6  # largest impact speed, in units of `law.speed_unit`, that rounding may give to a graze
# largest errors at a graze whose speed is at most GRAZING_SPEED: of its time, in forcing periods, and of its arrival
# speed, in units of `law.speed_unit`
GRAZING_TIME = 1e-4


@dataclass(frozen=True, repr=False)
class PeriodicOrbit(PeriodicMotion):
    """A periodic motion of the impacting gear at one parameter point, with the fields of `PeriodicMotion`."""

    @property
    def departures(self) -> Array:
        """The times (n,) at which the motion leaves the walls. They are the times of its impacts."""
        return self.times

    @property
    def point(self) -> ImpactingPoint:
        """The motion's parameter point for kernels, with the test for quiet motion switched off."""
        return ImpactingPoint(self.delta, self.epsilon, self.beta, 0.0)

    @property
    def itinerary(self) -> Itinerary:
        """The itinerary of the motion: its walls in order, its forcing periods, and the half-backlash."""
        return Itinerary(self.walls, self.m, self.beta)

    @property
    def unknowns(self) -> Array:
        """The unknowns (n + 2,) of the impact equations: the n times, δ and ε."""
        return np.append(self.times, [self.delta, self.epsilon])


def orbit_of(itinerary: Itinerary, x: Array) -> PeriodicOrbit:
    """Return the motion at a solution x = (n times, δ, ε), with its times shifted so that the first is in [0, 1)."""
    speeds = -np.asarray(itinerary.walls) * itinerary.flights(x).w0
    return PeriodicOrbit.from_solution(itinerary, x, speeds, itinerary.trace(x), is_admissible(itinerary, x))


def is_admissible(itinerary: Itinerary, x: Array, grazed: int | None = None) -> bool:
    """Return whether the motion at x = (n times, δ, ε) is admissible.

    A motion is admissible if it leaves each wall into the gap and each flight ends at its first impact. If `grazed` is
    given, impact number `grazed` has speed 0, and the motion may make or miss this impact.

    Returns
    -------
    bool
        False if the motion is virtual.
    """
    return find_impossible_flight(itinerary, x, grazed) is None


def find_impossible_flight(itinerary: Itinerary, x: Array, grazed: int | None = None) -> tuple[int, int, float] | None:
    """Return the first impossible flight of the motion at x; None if the motion is admissible.

    If `grazed` is given, impact number `grazed` has speed 0, and the motion may make or miss this impact.

    Returns
    -------
    tuple[int, int, float] | None
        (number, wall, time): the number of the impact at which the flight departs, the wall that the flight really
        meets first, and the time at which it meets this wall. If the flight would start from behind its own wall, or
        its first impact cannot be computed, wall is 0 and time is that of the departure.
    """
    n, walls = itinerary.n, itinerary.walls
    delta, epsilon = float(x[n]), float(x[n + 1])
    w0, unit = itinerary.flights(x).w0, law.speed_unit(delta, epsilon, itinerary.beta)
    ends = np.append(x[:n], x[0] + itinerary.m)
    for i in range(n):
        if i == grazed:
            w = -walls[i] * GRAZING_SPEED * unit
        else:
            w = float(w0[i])
            if not -walls[i] * w > 0.0:
                return i, 0, float(ends[i])
        to = (i + 1) % n
        status, s, wall, w1 = _first_impact(walls[i], ends[i], w, delta, epsilon, itinerary.beta)
        if status != first_impact.OK:
            return i, 0, float(ends[i])
        if to == grazed:
            late = abs(s - (ends[i + 1] - ends[i])) > GRAZING_TIME
            missed = wall != walls[to] or late or abs(w1) > GRAZING_TIME * unit
            if missed and not _skips_graze(itinerary, ends, i, s, wall):
                return i, int(wall), float(ends[i] + s)
            continue
        near = GRAZING_TIME if i == grazed else SAME_TIME
        if wall != walls[to] or abs(s - (ends[i + 1] - ends[i])) > near:
            return i, int(wall), float(ends[i] + s)
    return None


def _skips_graze(itinerary: Itinerary, ends: Array, i: int, s: float, wall: int) -> bool:
    """Return whether a computed flight skips the grazing impact i + 1: it goes from impact i to impact i + 2.

    ends: the times of all impacts of the itinerary. s, wall: the duration of the flight, and the wall that it meets.

    Returns
    -------
    bool
        True if the flight meets the wall of impact i + 2 at the time of this impact.
    """
    after = (i + 2) % itinerary.n
    arrival = ends[i + 2] if i + 2 < ends.size else ends[1] + itinerary.m
    return bool(wall == itinerary.walls[after] and abs(s - (arrival - ends[i])) < GRAZING_TIME)


def _first_impact(
    wall: int, time: float, w: float, delta: float, epsilon: float, beta: float
) -> tuple[int, float, int, float]:
    """Return (status, time of flight, wall, arrival velocity) of the first impact of a flight."""
    found = first_impact.first_impact(wall, float(law.fold_phase(time)), w, delta, epsilon, beta, forcing.DRIFT)
    return int(found[0]), float(found[1]), int(found[2]), float(found[3])


def follow_impacts(
    delta: float, epsilon: float, beta: float, tau: float, v: float, n_plus: int
) -> tuple[Itinerary, Array]:
    """Return the itinerary and the impact times of the motion from (τ, v) over the next n_plus impacts on Σ⁺.

    Returns
    -------
    tuple[Itinerary, Array]
        The itinerary, and the unknowns (n + 2,): times of the impacts, δ and ε.

    Raises
    ------
    RattleError
        If the motion comes to rest, cannot be followed, or makes more than MOST_IMPACTS impacts before it has made
        n_plus impacts on Σ⁺.
    """
    walls, times = [1], [tau]
    time, wall, w, left = tau, 1, -v, n_plus
    while True:
        status, s, wall, w1 = _first_impact(wall, time, w, delta, epsilon, beta)
        if status != first_impact.OK or len(times) > MOST_IMPACTS:
            raise RattleError(
                f"no periodic motion near tau = {tau}, v = {v}: the motion from this state comes to rest, cannot be "
                f"followed, or makes more than {MOST_IMPACTS} impacts before {n_plus} on Σ⁺; give another state"
            )
        time, w = time + s, impact_law.reflected_velocity(w1)
        left -= wall == 1
        if left == 0:
            m = max(round(time - tau), 1)
            return Itinerary(tuple(walls), m, beta), np.array([*times, delta, epsilon])
        walls.append(wall)
        times.append(time)


def periodic_orbit(
    delta: float, epsilon: float, tau: float, v: float, n_plus: int = 1, beta: float = 0.6
) -> PeriodicOrbit:
    """Return the periodic motion near the state (τ, v) after an impact on Σ⁺, with n_plus ≥ 1 impacts on Σ⁺ per period.

    The impact equations are solved by Newton's method, starting with the flights from (τ, v). The fields tau, v and
    n_plus of an `Attractor` are suitable. The motion has its least period: if it already repeats after fewer than
    n_plus impacts, its n_plus is smaller. All numbers are dimensionless, time is in forcing periods.

    Returns
    -------
    PeriodicOrbit
        The motion with its impacts, multipliers and stability.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If no periodic motion is found near the state, or the motion found is virtual.
    """
    delta, beta = require_number("delta", delta, positive=True), require_number("beta", beta, positive=True)
    epsilon, v = require_number("epsilon", epsilon), require_number("v", v, positive=True)
    require_integer("n_plus", n_plus, 1, MOST_IMPACTS)
    tau = float(law.fold_phase(require_finite("tau", tau)))
    itinerary, x = follow_impacts(delta, epsilon, beta, tau, v, n_plus)
    found = solve_at_parameters(itinerary, x)
    if found is None or not is_admissible(itinerary, found):
        raise RattleError(
            f"no admissible periodic motion with {n_plus} impacts on Σ⁺ was found near tau = {tau}, v = {v}: "
            "give a state closer to the motion"
        )
    require(
        bool(np.isfinite(found).all()),
        f"numbers of the periodic motion near tau = {tau}, v = {v} are beyond double precision: give less extreme "
        "parameters",
    )
    return orbit_of(*shorten_to_least_period(itinerary, found))


def to_periodic_orbit(orbit: PeriodicOrbit | Orbit) -> PeriodicOrbit:
    """Return a motion as a `PeriodicOrbit`. For an `Orbit` the impact equations are solved.

    Returns
    -------
    PeriodicOrbit
        The motion with its impacts, multipliers and stability.

    Raises
    ------
    ParameterError
        If the motion is neither a `PeriodicOrbit` nor an `Orbit` of the impacting gear.
    RattleError
        If Newton's method finds no admissible motion near the state of the `Orbit`.
    """
    if isinstance(orbit, PeriodicOrbit):
        return orbit
    require(isinstance(orbit, Orbit), f"orbit must be an Orbit or a PeriodicOrbit, got {type(orbit).__name__}")
    added = ", ".join(orbit.added)
    require(
        not added,
        f"orbit must be of the impacting gear, got one of a gear with {added}: use the functions of that gear, such as "
        "rattle.stiff.stiff_branch",
    )
    return periodic_orbit(orbit.delta, orbit.epsilon, orbit.tau, orbit.v, orbit.n_plus, orbit.beta)


def reason_for_virtual_motion(itinerary: Itinerary, x: Array, grazed: int | None = None) -> str | None:
    """Return None if the motion at x is admissible, else a clause that says which of its flights is impossible.

    If `grazed` is given, impact number `grazed` has speed 0, and the motion may make or miss this impact.

    Returns
    -------
    str | None
        None, or a clause such as "the flight after impact 0 on Σ⁺ touches Σ⁻ on its way".
    """
    failure = find_impossible_flight(itinerary, x, grazed)
    if failure is None:
        return None
    impact, wall, _ = failure
    here, there = ("Σ⁺" if w > 0 else "Σ⁻" for w in (itinerary.walls[impact], wall))
    if wall == 0:
        return f"the speed after impact {impact} on {here} reaches 0"
    return f"the flight after impact {impact} on {here} touches {there} on its way"


def period_one_orbit(name: str, delta: float, epsilon: float, beta: float = 0.6) -> PeriodicOrbit:
    """Return the orbit `name`, "A" to "D", at one parameter point (dimensionless), stable or not.

    Returns
    -------
    PeriodicOrbit
        The orbit with its impacts, multipliers and stability.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    RattleError
        If the orbit does not exist at this point.
    """
    for orbit in orbits_at(delta, epsilon, beta):
        if orbit.name == name:
            return periodic_orbit(delta, epsilon, orbit.tau, orbit.v, 1, beta)
    raise RattleError(f"the orbit {name} does not exist at delta = {delta}, epsilon = {epsilon}, beta = {beta}")
