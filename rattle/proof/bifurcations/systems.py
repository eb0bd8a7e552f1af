"""Extended systems in balls: a periodic motion and its bifurcation condition, as equations with regular zeros.

Unknown are the times (n,) of the impacts; δ, ε or both; and at a saddle-node or flip a vector φ (n,). The equations are

    R = 0, J(μ) φ = 0, ⟨l, φ⟩ = 1    with μ = 1 (saddle-node) or −1 (flip),
    R = 0, w₁ = 0                    at a graze; w₁ is the velocity of arrival at the grazing impact.

R and J are those of `rattle.impacting.orbits.equations`. A codimension-two point is a graze with one more condition.
Source: G. Moore and A. Spence, SIAM J. Numer. Anal. 17 (1980) 567–576.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rattle.continuation.conditions import MULTIPLIER, Kind
from rattle.errors import NotProvedError
from rattle.proof.balls import PI, arb, arb_mat, arb_series
from rattle.proof.bifurcations.corners import CONDITIONS
from rattle.proof.flights import UP, FlightEnclosure, ModelPlane, extrema, require_first
from rattle.proof.impacting import ImpactingSystem

Series = arb_series
FREE = ("delta", "epsilon")


class Between(NamedTuple):
    """The velocities at both ends of a flight between two given times, and their derivatives, as series."""

    w0: Series
    w1: Series
    w0_t0: Series
    w0_t1: Series
    w1_t0: Series
    w1_t1: Series


@dataclass(frozen=True)
class CurveMotion:
    """The properties of a motion that stay constant along its bifurcation curve.

    Attributes
    ----------
    walls, m
        The walls (n,) that it meets in m forcing periods, in order.
    kind : str
        "SN", "PD" or "GR".
    impact : int or None
        The number of the grazing impact.
    point : str or None
        The name of a codimension-two point.
    """

    walls: tuple[int, ...]
    m: int
    kind: Kind
    impact: int | None = None
    point: str | None = None

    @property
    def n(self) -> int:
        """Number of impacts per period."""
        return len(self.walls)


@dataclass(frozen=True)
class System:
    """The equations of a bifurcating motion at one half-backlash.

    `known` holds δ or ε where it is given exactly; `side` is the vector l (n,) that normalises φ.
    """

    motion: CurveMotion
    beta: arb
    known: dict[str, arb]
    side: Sequence[float] = ()

    def __call__(self, at: Sequence[arb]) -> EvaluatedSystem:
        """Evaluate the equations at the unknowns (N,): times, then δ and ε unless known, then φ."""
        return EvaluatedSystem(self, at)

    def parameters(self, at: Sequence[Any]) -> tuple[Any, Any]:
        """Return δ and ε, as balls or series like the unknowns. A known parameter is a ball."""
        free = iter(at[self.motion.n :])
        delta, epsilon = (self.known[name] if name in self.known else next(free) for name in FREE)
        return delta, epsilon

    def plane(self, at: Sequence[arb]) -> ModelPlane:
        """Return the point of the plane at these unknowns."""
        return ModelPlane(*self.parameters(at), self.beta)


@dataclass(frozen=True)
class EvaluatedSystem:
    """The equations evaluated at given unknowns."""

    system: System
    at: Sequence[arb]

    @property
    def residual(self) -> list[arb]:
        """Values R (N,) of the equations."""
        return [each[0] for each in self._values([arb_series([x]) for x in self.at])]

    @cached_property
    def jacobian(self) -> arb_mat:
        """Jacobian ∂R/∂x (N, N). Each column comes from a first-order series."""
        columns = []
        for k in range(len(self.at)):
            moved = [arb_series([x, 1] if j == k else [x]) for j, x in enumerate(self.at)]
            columns.append([each[1] for each in self._values(moved)])
        return arb_mat(columns).transpose()

    def _values(self, at: list[Series]) -> list[Series]:
        motion, (delta, epsilon) = self.system.motion, self.system.parameters(at)
        n, times = motion.n, at[: motion.n]
        zero = arb_series([0])
        flights = [
            flight_series(
                delta + zero, epsilon + zero, times[i], times[i + 1] if i + 1 < n else times[0] + motion.m,
                self.system.beta * (motion.walls[(i + 1) % n] - motion.walls[i]),
            )
            for i in range(n)
        ]  # fmt: skip
        values = [each.w0 + flights[i - 1].w1 for i, each in enumerate(flights)]
        if motion.impact is not None:
            values.append(flights[motion.impact - 1].w1)
        if motion.point is not None:
            values.append(_condition(motion.point, delta, epsilon, times))
        if motion.kind is not Kind.GRAZING:
            phi, turn = at[-n:], int(MULTIPLIER[motion.kind])
            values += [_row(flights, phi, i, turn) for i in range(n)]
            values.append(sum((x * side for x, side in zip(phi, self.system.side, strict=True)), zero) - 1)
        return values


def _row(flights: Sequence[Between], phi: Sequence[Series], i: int, turn: int) -> Series:
    """Return row i of J(μ) φ, where φ grows by the factor μ = ±1 over one period of the motion."""
    n, here, before = len(flights), flights[i], flights[i - 1]
    after = phi[(i + 1) % n] * (turn if i + 1 == n else 1)
    earlier = phi[i - 1] * (turn if i == 0 else 1)
    return (here.w0_t0 + before.w1_t1) * phi[i] + here.w0_t1 * after + before.w1_t0 * earlier


def _condition(point: str, delta: Series, epsilon: Series, times: Sequence[Series]) -> Series:
    """Return the second condition of a codimension-two point, which vanishes where C grazes."""
    x = epsilon * (2 * PI() * times[0]).cos()
    return CONDITIONS[point](delta, x, times[1] - times[0], (-delta).exp())


def flight_series(delta: Series, epsilon: Series, t0: Series, t1: Series, distance: arb) -> Between:
    """Return the flight between two times as series (compare `rattle.proof.flights.flight`)."""
    two_pi = 2 * PI()
    swing, forcing = two_pi * epsilon, two_pi * two_pi * epsilon
    (sin0, cos0), (sin1, cos1) = (((two_pi * t).sin(), (two_pi * t).cos()) for t in (t0, t1))
    decay = (-delta * (t1 - t0)).exp()
    pull = delta / (1 - decay)
    rest = (2 * two_pi * (t1 - t0) + epsilon * (cos1 - cos0) - distance) * pull
    w0, w1 = 2 * two_pi - swing * sin0 - rest, 2 * two_pi - swing * sin1 - rest * decay
    return Between(
        w0,
        w1,
        w0_t0=w0 * pull + delta * rest - forcing * cos0,
        w0_t1=-pull * w1,
        w1_t0=decay * pull * w0,
        w1_t1=(delta * rest - w1 * pull) * decay - forcing * cos1,
    )


def require_happens(system: System, zero: Sequence[arb]) -> None:
    """Raise NotProvedError unless the motion meets its walls, no others, and only the grazing impact has speed 0."""
    motion, plane, times = system.motion, system.plane(zero), zero[: system.motion.n]
    grazed = motion.impact
    if grazed is None:
        ImpactingSystem(plane, motion.walls, motion.m)(times).require_admissible()
        return
    walls = (*motion.walls[:grazed], *motion.walls[grazed + 1 :])
    missed = ImpactingSystem(plane, walls, motion.m)([*times[:grazed], *times[grazed + 1 :]])
    for i, each in enumerate(missed.flights):
        target, name = walls[(i + 1) % len(walls)], f"the flight after impact {i + 1} that is made"
        if i == (grazed - 1) % len(walls):
            time = times[grazed] if grazed else times[0] + motion.m
            require_touches(each, walls[i], target, motion.walls[grazed], time, name)
        else:
            require_first(each, walls[i], target, name)


def require_touches(each: FlightEnclosure, wall: int, target: int, touched: int, time: arb, name: str) -> None:
    """Raise NotProvedError unless a flight that grazes the wall `touched` at `time` meets no wall before its end.

    The contact force g pushes the mass off the touched wall, so the graze is an extremum of Φ. All other extrema must
    be clear of the walls.

    Raises
    ------
    NotProvedError
        If the flight may meet a wall.
    """
    push = each.plane.force(*(2 * time).sin_cos_pi())
    if not (-touched * push > 0 and each.t0 < time < each.t1 and -wall * each.w0 > 0 and target * each.w1 > 0):
        raise NotProvedError(f"{name} is virtual: it starts behind a wall, or does not turn at its graze")
    above, below = each.plane.beta * (1 - wall), -each.plane.beta * (1 + wall)
    close = [turn for turn, height in extrema(each, name) if not (height > below if turn == UP else height < above)]
    if close != [-touched]:
        raise NotProvedError(f"{name} is not proved clear of the walls away from its graze")
