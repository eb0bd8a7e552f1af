"""The motion Φ(t) between its impacts: sampled in closed form (paper 3.1, 3.2) on the way from impact to impact."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError, require, require_integer, require_number
from rattle.flight.first_impact import OK, SIGMA_PLUS, first_impact
from rattle.flight.law import DRIFT, TWO_PI, evaluate, folded
from rattle.flight.tangent import rests
from rattle.numerics.compile import kernel

LONGEST, MOST_POINTS, MOST_IMPACTS = 10_000.0, 10_000_000, 10_000_000
AT_REST = 1e-4  # speed below which a bounce of a motion that is certain to become quiet is not followed any more
Array = NDArray[np.float64]


class Trajectory(NamedTuple):
    """A sampled motion. time, phi, velocity (points,): forcing periods since the start, Φ and Φ'.

    impact_time, impact_wall, impact_speed (k,): the impacts on the way, wall +1 (Φ = β) or −1, speed |Φ'|. rest: when
    it comes to rest on Σ⁺, inf if it does not; its bounces are slower than 1e-4 from there on, and are left out.
    """

    time: Array
    phi: Array
    velocity: Array
    impact_time: Array
    impact_wall: NDArray[np.int64]
    impact_speed: Array
    rest: float


@kernel
def sampled(tau, v, delta, epsilon, beta, slowest, time, phi, velocity, impact_time, impact_wall, impact_speed):
    """Write Φ and Φ' at rising times, and the impacts until the last of them: (status, number of impacts, rest).

    Impacts beyond the room for them are counted, not written.
    """
    wall, w, now, phase = SIGMA_PLUS, -v, 0.0, tau
    i, impacts = 0, 0
    while i < time.size:
        if (wall > 0 and abs(w) < slowest) or rests(wall, w, phase, delta, epsilon, DRIFT):
            phi[i:], velocity[i:] = wall * beta, 0.0
            return OK, impacts, now
        status, s, target, w1, _l, sin0, cos0, _s1, _c1 = first_impact(wall, phase, w, delta, epsilon, beta, DRIFT)
        if status != OK:
            return status, impacts, math.inf
        a = DRIFT - TWO_PI * epsilon * sin0 - w
        while i < time.size and time[i] < now + s:
            f0, f1, _f2, _lost, _sin, _cos = evaluate(time[i] - now, w, a, sin0, cos0, delta, epsilon)
            phi[i], velocity[i] = wall * beta + f0, f1
            i += 1
        if i == time.size:
            break
        now, phase, wall, w = now + s, folded(phase + s), target, -w1
        if impacts < impact_time.size:
            impact_time[impacts], impact_wall[impacts], impact_speed[impacts] = now, wall, abs(w)
        impacts += 1
        if impacts > MOST_IMPACTS:
            break
    return OK, impacts, math.inf


def trajectory(
    delta: float, epsilon: float, beta: float, tau: float, v: float, periods: float, points: int, slowest: float
) -> Trajectory:
    """See `rattle.Gear.trajectory`; slowest: the speed of what is certain to become quiet."""
    slowest = min(slowest, AT_REST)

    def follow(v: float, *room: Any) -> tuple[int, int, float]:
        status, impacts, rest = sampled(tau, v, delta, epsilon, beta, slowest, *room)
        return int(status), int(impacts), float(rest)

    return followed(v, periods, points, follow)


def followed(v: float, periods: float, points: int, follow: Callable[..., tuple[int, int, float]]) -> Trajectory:
    """A motion of either model with initial speed v, sampled at so many points.

    follow: takes v, the times and arrays for Φ and Φ' (points,), and for time, wall and speed of the impacts; returns
    its status, how many impacts there were, and when the motion came to rest.
    """
    v, periods = require_number("v", v, positive=True), require_number("periods", periods, positive=True)
    require(periods <= LONGEST, f"periods must be at most {LONGEST:g}, got {periods:g}")
    points = require_integer("points", points, 2, MOST_POINTS)
    time = np.linspace(0.0, periods, points)
    phi, velocity = np.empty(points), np.empty(points)
    room = 1024
    while True:
        at, wall, speed = np.empty(room), np.empty(room, np.int64), np.empty(room)
        status, count, rest = follow(v, time, phi, velocity, at, wall, speed)
        if status != OK:
            raise RattleError("the motion cannot be followed: its parameters or its state are beyond double precision")
        if count > MOST_IMPACTS:
            raise RattleError(f"the motion makes more than {MOST_IMPACTS} impacts: ask for fewer periods")
        if count <= room:
            return Trajectory(time, phi, velocity, at[:count], wall[:count], speed[:count], rest)
        room = count
