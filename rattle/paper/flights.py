"""The acceleration Φ'' along flights. The paper claims that Φ'' > 0, and does not consider flights with Φ'' < 0."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import DRIFT, TWO_PI
from rattle.impacting.gear import Gear
from rattle.orbits.orbits_a_to_d import NAMES, PeriodOne

Array = NDArray[np.float64]
#: Number of instants during a flight at which Φ'' is computed.
INSTANTS = 201


def smallest_acceleration(delta: float, epsilon: float, phase: float, velocity: float, time: float) -> float:
    """Return the smallest Φ'' at INSTANTS equally spaced times of a flight that leaves a wall with `velocity`."""
    s = np.linspace(0.0, time, INSTANTS)
    decaying = delta * (DRIFT - TWO_PI * epsilon * np.sin(TWO_PI * phase) - velocity)
    values = decaying * np.exp(-delta * s) - TWO_PI**2 * epsilon * np.cos(TWO_PI * (phase + s))
    return float(values.min())


class ReferenceImpacts(NamedTuple):
    """The impacts during one step of the impact map Π from Σ⁺.

    walls, times: the wall of each impact, and its time since the departure, in forcing periods.
    least_acceleration: the smallest Φ'' during the step.
    """

    walls: tuple[int, ...]
    times: tuple[float, ...]
    least_acceleration: float


def compute_reference_step(delta: float, epsilon: float, tau: float, v: float) -> ReferenceImpacts:
    """Return the impacts of one step of Π from (τ, v), computed one after another, and the smallest Φ''."""
    gear, wall, phase, velocity = Gear(delta, epsilon), 1, tau, -v
    walls: list[int] = []
    times: list[float] = []
    low = np.inf
    while not walls or wall < 0:
        flown = gear.first_impact(wall, phase, velocity)
        low = min(low, smallest_acceleration(delta, epsilon, phase, velocity, flown.flight_time))
        wall, phase, velocity = flown.next_wall, phase + flown.flight_time, -flown.impact_velocity
        walls.append(wall)
        times.append(phase - tau)
    return ReferenceImpacts(tuple(walls), tuple(times), low)


class SmallestSecondDerivative(NamedTuple):
    """The smallest Φ'' of one orbit, over all cells in which the orbit exists.

    name: the name of the orbit, A to D.
    smallest, delta, epsilon: the smallest Φ'', and the cell where it occurs.
    negative_share: the share of the cells in which Φ'' is negative somewhere on the orbit.
    first_negative_epsilon: the smallest ε of the cells with negative Φ'', NaN if there are none.
    """

    name: str
    smallest: float
    delta: float
    epsilon: float
    negative_share: float
    first_negative_epsilon: float


def find_smallest_accelerations(
    delta: Array, epsilon: Array, orbits: PeriodOne
) -> tuple[SmallestSecondDerivative, ...]:
    """Return, for each of the orbits A to D, a record of the flight with the smallest Φ'' over the cells (n,)."""
    found = []
    for k, name in enumerate(NAMES):
        here = np.flatnonzero(orbits.exists[k])
        low = np.array(
            [
                compute_reference_step(
                    *map(float, (delta[i], epsilon[i], orbits.tau[k, i], orbits.v[k, i]))
                ).least_acceleration
                for i in here
            ]
        )
        worst, negative = here[low.argmin()], here[low < 0]
        first = float(epsilon[negative].min()) if negative.size else np.nan
        found.append(
            SmallestSecondDerivative(
                name, float(low.min()), float(delta[worst]), float(epsilon[worst]), negative.size / here.size, first
            )
        )
    return tuple(found)
