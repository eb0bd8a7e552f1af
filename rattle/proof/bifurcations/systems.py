"""Extended systems in ball arithmetic: the equations of a bifurcating periodic motion, with regular zeros.

The unknowns are the times (n,) of the impacts; δ, ε or both; and for a saddle-node or a flip a vector φ (n,):

    R = 0, J(μ) φ = 0, ⟨l, φ⟩ = 1    for the multiplier μ = 1 (saddle-node) or μ = −1 (flip)
    R = 0, w₁ = 0                    for a graze, where w₁ is the velocity at which the grazing impact is reached

R and J are those of `rattle.impacting.orbits.equations`. A codimension-two point is a graze with one more condition
(`codimension_two`). Source: G. Moore and A. Spence, SIAM J. Numer. Anal. 17 (1980) 567–576; Lemma 10 of docs/proofs.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rattle.continuation.conditions import MULTIPLIER, EventKind
from rattle.errors import NotProvedError
from rattle.proof.balls import PI, arb, arb_mat, arb_series
from rattle.proof.bifurcations.codimension_two import CONDITIONS
from rattle.proof.flights import UP, FlightEnclosure, ModelPoint, enclose_extrema, require_first_impact
from rattle.proof.impacting import ImpactingSystem

Series = arb_series
#: Parameters that may be unknowns.
POSSIBLE_UNKNOWNS = ("delta", "epsilon")


class FlightVelocities(NamedTuple):
    """The velocities w0 and w1 of a flight at its ends t0 and t1, and their derivatives; w0_t0 is ∂w0/∂t0.

    All are power series of first order in one of the unknowns.
    """

    w0: Series
    w1: Series
    w0_t0: Series
    w0_t1: Series
    w1_t0: Series
    w1_t1: Series


@dataclass(frozen=True)
class BifurcatingMotion:
    """The properties of a bifurcating motion that do not change along its bifurcation curve.

    walls: the walls (n,) that it meets in m forcing periods, in order.
    kind: saddle-node, flip or graze.
    impact: the number of the impact that grazes, from 0; None for a saddle-node or a flip.
    point: the name of a codimension-two point, or None.
    """

    walls: tuple[int, ...]
    m: int
    kind: EventKind
    impact: int | None = None
    point: str | None = None

    @property
    def n(self) -> int:
        """The number of impacts in m forcing periods."""
        return len(self.walls)


@dataclass(frozen=True)
class ExtendedSystem:
    """The extended system of a bifurcating motion, as a function of its unknowns.

    beta: the half-backlash. known: {name: value} of δ or ε, or {} if both are unknowns. scaling: the vector l (n,) of
    the equation ⟨l, φ⟩ = 1, which fixes the length of the null vector φ; empty for a graze.
    """

    motion: BifurcatingMotion
    beta: arb
    known: dict[str, arb]
    scaling: Sequence[float] = ()

    def __call__(self, unknowns: Sequence[arb]) -> EvaluatedSystem:
        """Evaluate the equations at the unknowns (N,): the impact times; δ, ε or both, if not known; then φ."""
        return EvaluatedSystem(self, unknowns)

    def parameters(self, unknowns: Sequence[Any]) -> tuple[Any, Any]:
        """Return δ and ε: a known parameter as a ball, an unknown parameter as its entry in `unknowns`."""
        free = iter(unknowns[self.motion.n :])
        delta, epsilon = (self.known[name] if name in self.known else next(free) for name in POSSIBLE_UNKNOWNS)
        return delta, epsilon

    def model_point(self, unknowns: Sequence[arb]) -> ModelPoint:
        """Return the parameter point: δ, ε and β as balls; unknown parameters are taken from `unknowns`."""
        return ModelPoint(*self.parameters(unknowns), self.beta)


@dataclass(frozen=True)
class EvaluatedSystem:
    """An extended system, evaluated at the values `unknowns` (N,) of its unknowns."""

    system: ExtendedSystem
    unknowns: Sequence[arb]

    @property
    def residual(self) -> list[arb]:
        """The values (N,) of all equations."""
        return [each[0] for each in self._equation_values([arb_series([x]) for x in self.unknowns])]

    @cached_property
    def jacobian(self) -> arb_mat:
        """The Jacobian (N, N) of all equations; each column comes from series of first order."""
        columns = []
        for k in range(len(self.unknowns)):
            moved = [arb_series([x, 1] if j == k else [x]) for j, x in enumerate(self.unknowns)]
            columns.append([each[1] for each in self._equation_values(moved)])
        return arb_mat(columns).transpose()

    def _equation_values(self, unknowns: list[Series]) -> list[Series]:
        """Return the values of all equations: the residuals R of the impacts, then the conditions of the bifurcation.

        A saddle-node or a flip has the conditions J(μ) φ and ⟨l, φ⟩ − 1. A graze has the condition w₁, the velocity at
        which the grazing impact is reached. A codimension-two point has w₁ and the condition of `codimension_two`.

        Returns
        -------
        list[Series]
            The values (N,).
        """
        motion, (delta, epsilon) = self.system.motion, self.system.parameters(unknowns)
        n, times = motion.n, unknowns[: motion.n]
        zero = arb_series([0])
        flights = [
            flight_velocity_series(
                delta + zero, epsilon + zero, times[i], times[i + 1] if i + 1 < n else times[0] + motion.m,
                self.system.beta * (motion.walls[(i + 1) % n] - motion.walls[i]),
            )
            for i in range(n)
        ]  # fmt: skip
        values = [each.w0 + flights[i - 1].w1 for i, each in enumerate(flights)]
        if motion.impact is not None:
            values.append(flights[motion.impact - 1].w1)
        if motion.point is not None:
            values.append(_codimension_two_condition(motion.point, delta, epsilon, times))
        if motion.kind is not EventKind.GRAZING:
            phi, turn = unknowns[-n:], int(MULTIPLIER[motion.kind])
            values += [_jacobian_product_entry(flights, phi, i, turn) for i in range(n)]
            values.append(sum((x * factor for x, factor in zip(phi, self.system.scaling, strict=True)), zero) - 1)
        return values


def _jacobian_product_entry(
    flights: Sequence[FlightVelocities], phi: Sequence[Series], i: int, multiplier: int
) -> Series:
    """Return entry i of J(μ) φ.

    J(μ) is the Jacobian of the impact equations for perturbations that grow by the factor μ over the period.
    flights: the n flights of the motion. phi: φ (n,). multiplier: μ = 1 or −1.

    Returns
    -------
    Series
        The entry.
    """
    n, here, before = len(flights), flights[i], flights[i - 1]
    after = phi[(i + 1) % n] * (multiplier if i + 1 == n else 1)
    earlier = phi[i - 1] * (multiplier if i == 0 else 1)
    return (here.w0_t0 + before.w1_t1) * phi[i] + here.w0_t1 * after + before.w1_t0 * earlier


def _codimension_two_condition(point: str, delta: Series, epsilon: Series, times: Sequence[Series]) -> Series:
    """Return the value of the condition that is 0 at a codimension-two point, besides the equations of the graze."""
    x = epsilon * (2 * PI() * times[0]).cos()
    return CONDITIONS[point](delta, x, times[1] - times[0], (-delta).exp())


def flight_velocity_series(delta: Series, epsilon: Series, t0: Series, t1: Series, distance: arb) -> FlightVelocities:
    """Return velocities, and derivatives by t0 and t1, of a flight from t0 to t1 that changes Φ by `distance`."""
    # (1.7) to (1.10) of docs/proofs.md
    two_pi = 2 * PI()
    swing, forcing = two_pi * epsilon, two_pi * two_pi * epsilon
    (sin0, cos0), (sin1, cos1) = (((two_pi * t).sin(), (two_pi * t).cos()) for t in (t0, t1))
    decay = (-delta * (t1 - t0)).exp()
    pull = delta / (1 - decay)
    rest = (2 * two_pi * (t1 - t0) + epsilon * (cos1 - cos0) - distance) * pull
    w0, w1 = 2 * two_pi - swing * sin0 - rest, 2 * two_pi - swing * sin1 - rest * decay
    return FlightVelocities(
        w0,
        w1,
        w0_t0=w0 * pull + delta * rest - forcing * cos0,
        w0_t1=-pull * w1,
        w1_t0=decay * pull * w0,
        w1_t1=(delta * rest - w1 * pull) * decay - forcing * cos1,
    )


def require_admissible_at(system: ExtendedSystem, zero: Sequence[arb]) -> None:
    """Raise NotProvedError unless the motion at the solution `zero` is proved to meet its walls and no others.

    All speeds must be proved not to be 0, except at the grazing impact, where the motion touches the wall from inside.
    """
    motion, point, times = system.motion, system.model_point(zero), zero[: system.motion.n]
    grazed = motion.impact
    if grazed is None:
        ImpactingSystem(point, motion.walls, motion.m)(times).require_admissible()
        return
    walls = (*motion.walls[:grazed], *motion.walls[grazed + 1 :])
    missed = ImpactingSystem(point, walls, motion.m)([*times[:grazed], *times[grazed + 1 :]])
    for i, each in enumerate(missed.flights):
        target, name = walls[(i + 1) % len(walls)], f"the flight after impact {i + 1}, without the grazing impact,"
        if i == (grazed - 1) % len(walls):
            time = times[grazed] if grazed else times[0] + motion.m
            require_only_graze(each, walls[i], target, motion.walls[grazed], time, name)
        else:
            require_first_impact(each, walls[i], target, name)


def require_only_graze(flight: FlightEnclosure, wall: int, target: int, touched: int, time: arb, name: str) -> None:
    """Prove that a flight from `wall` to `target` grazes the wall `touched`, and touches no other point of the walls.

    `time` is the time of the graze, at which Φ' = 0. The contact force must point away from the wall then, so that Φ
    has an extremum. All other extrema must be strictly between the walls. name: the flight's name in messages.

    Raises
    ------
    NotProvedError
        If the proof fails; the flight may touch a wall at another time.
    """
    push = flight.point.force(*(2 * time).sin_cos_pi())
    if not (-touched * push > 0 and flight.t0 < time < flight.t1 and -wall * flight.w0 > 0 and target * flight.w1 > 0):
        raise NotProvedError(
            f"{name} is not proved to leave its first wall, to arrive at its last wall and to turn at its graze"
        )
    above, below = flight.point.beta * (1 - wall), -flight.point.beta * (1 + wall)
    close = [
        turn for turn, height in enclose_extrema(flight, name) if not (height > below if turn == UP else height < above)
    ]
    if close != [-touched]:
        raise NotProvedError(f"{name} is not proved to touch a wall only at its graze")
