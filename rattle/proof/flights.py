"""Flights in balls: their velocities from their times, and the proof that they meet no wall before their end.

Between walls

    Φ'' + δΦ' = g(t) = 4πδ − 2πε (2π cos 2πt + δ sin 2πt),
    M = e^(δt) Φ',    M' = e^(δt) g.

Where g keeps its sign M is monotone, so Φ has at most one extremum there (lemmas 3 and 4 of docs/proofs.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from scipy.optimize import brentq

from rattle.errors import NotProvedError
from rattle.proof.balls import PI, arb

UP, DOWN = 1, -1


@dataclass(frozen=True)
class ModelPlane:
    """δ, ε and β in balls, and quantities that follow from them alone."""

    delta: arb
    epsilon: arb
    beta: arb

    @cached_property
    def drift(self) -> arb:
        """Mean slope 4π of the particular solution."""
        return 4 * PI()

    @cached_property
    def swing(self) -> arb:
        """Velocity amplitude 2πε of the forcing."""
        return 2 * PI() * self.epsilon

    @cached_property
    def forcing(self) -> arb:
        """Acceleration amplitude 4π²ε of the forcing."""
        return 2 * PI() * self.swing

    def force(self, sine: arb, cosine: arb) -> arb:
        """Return the contact force g at the phase with this sine and cosine."""
        return self.delta * self.drift - self.forcing * cosine - self.delta * self.swing * sine

    @cached_property
    def edges(self) -> tuple[arb, ...]:
        """The phases at which g vanishes; none below the quiet limit."""
        share = 2 * self.delta / (self.epsilon * (4 * PI() ** 2 + self.delta**2).sqrt())
        if share > 1:
            return ()
        half, middle = share.acos() / (2 * PI()), (self.delta / (2 * PI())).atan() / (2 * PI())
        if not half > 0:
            raise NotProvedError(
                "whether the contact force changes sign is undecided; choose an ε farther from the quiet limit"
            )
        return middle - half, middle + half


@dataclass(frozen=True)
class FlightEnclosure:
    """A flight over `distance` from time t0 to t1, with velocities w0 and w1. Derivatives are named w0_t0 = ∂w0/∂t0."""

    plane: ModelPlane
    t0: arb
    t1: arb
    rest: arb  # C, the decaying part of −Φ', at t0
    cos0: arb
    w0: arb
    w1: arb
    decay: arb  # e^(−δ(t1 − t0))
    w0_t0: arb
    w0_t1: arb
    w1_t0: arb
    w1_t1: arb

    def at(self, t: arb) -> tuple[arb, arb]:
        """Return Φ(t) − Φ(t0) and Φ'(t)."""
        plane, sine, cosine = self.plane, *(2 * t).sin_cos_pi()
        kept = (-plane.delta * (t - self.t0)).exp()
        height = self.rest * (kept - 1) / plane.delta + plane.epsilon * (cosine - self.cos0)
        return height + plane.drift * (t - self.t0), plane.drift - plane.swing * sine - self.rest * kept


def flight(
    plane: ModelPlane, t0: arb, t1: arb, turn0: tuple[arb, arb], turn1: tuple[arb, arb], distance: arb
) -> FlightEnclosure:
    """Return the flight between two times; turn0 and turn1 are (sine, cosine) of their phases (paper 3.1, 3.2)."""
    (sin0, cos0), (sin1, cos1), delta = turn0, turn1, plane.delta
    lost = -(-delta * (t1 - t0)).expm1()
    decay, pull = 1 - lost, delta / lost
    rest = (plane.drift * (t1 - t0) + plane.epsilon * (cos1 - cos0) - distance) * pull
    w0, w1 = plane.drift - plane.swing * sin0 - rest, plane.drift - plane.swing * sin1 - rest * decay
    return FlightEnclosure(
        plane, t0, t1, rest, cos0, w0, w1, decay,
        w0_t0=w0 * pull + delta * rest - plane.forcing * cos0,
        w0_t1=-pull * w1,
        w1_t0=decay * pull * w0,
        w1_t1=(delta * rest - w1 * pull) * decay - plane.forcing * cos1,
    )  # fmt: skip


def sign(x: arb) -> int:
    """Return the sign that all numbers of a ball share, or 0 if they share none."""
    return UP if x > 0 else DOWN if x < 0 else 0


def require_first(flight: FlightEnclosure, wall: int, target: int, name: str) -> None:
    """Raise NotProvedError unless the flight leaves `wall` and reaches `target` first (lemma 3).

    Its end speeds must not be 0, and all its extrema must lie between the walls.

    Raises
    ------
    NotProvedError
        If another wall may come first.
    """
    if not flight.t1 > flight.t0:
        raise NotProvedError(f"{name} has no duration")
    if sign(flight.w0) != -wall or sign(flight.w1) != target:
        raise NotProvedError(f"{name} is virtual, or grazes a wall at one of its ends")
    # positions of the walls relative to the departure
    above, below = flight.plane.beta * (1 - wall), -flight.plane.beta * (1 + wall)
    for turn, height in extrema(flight, name):
        if not (height > below if turn == UP else height < above):
            raise NotProvedError(f"{name} may touch Σ{'⁻' if turn == UP else '⁺'} on its way")


def extrema(flight: FlightEnclosure, name: str) -> Iterator[tuple[int, arb]]:
    """Yield the kind and height of each extremum of a flight.

    Between two zeros of g M is monotone. The sign of Φ' is decided at each zero, and every change of sign is an
    extremum (lemma 4).

    Yields
    ------
    tuple[int, arb]
        UP for a minimum or DOWN for a maximum; a ball that holds Φ − Φ(t0) there.

    Raises
    ------
    NotProvedError
        If two extrema cannot be separated.
    """
    places = [flight.t0]
    for time in [*cuts(flight), flight.t1]:
        if places[-1] < time:
            places.append(time)
        else:  # two zeros of g within rounding of each other: Φ' must keep one sign around both
            places[-1] = places[-1].union(time)
    signs = [sign(flight.at(place)[1]) for place in places]
    if not all(signs):
        raise NotProvedError(f"{name} turns too close to a zero of the contact force to separate them")
    for (start, end), (before, after) in zip(pairwise(places), pairwise(signs), strict=True):
        if after != before:
            yield after, extremum(flight, start, end, name)


def cuts(flight: FlightEnclosure) -> list[arb]:
    """Return, in order, the times at which g vanishes in a flight or within rounding of its ends."""
    found = []
    for edge in flight.plane.edges:
        number = math.floor(float((flight.t0 - edge).mid())) - 1
        while not edge + number > flight.t1:
            if not edge + number < flight.t0:
                found.append(edge + number)
            number += 1
    return sorted(found, key=lambda time: float(time.mid()))


def extremum(flight: FlightEnclosure, start: arb, end: arb, name: str) -> arb:
    """Return a ball that holds Φ − Φ(t0) at the one zero t* of Φ' between start and end, where M is monotone.

    At any time e there |M| ≤ |M(e)| between e and t*, so |Φ(t*) − Φ(e)| ≤ L e^(δL) |Φ'(e)|, L = end − start (lemma 5).

    Returns
    -------
    arb
        The ball.

    Raises
    ------
    NotProvedError
        If the zero is not enclosed.
    """
    turn = arb(_turn(flight, float(start.mid()), float(end.mid())))
    if not (turn > start and turn < end):
        raise NotProvedError(f"{name} turns too close to a wall: the height of its extremum is not enclosed")
    height, slope = flight.at(turn)
    length = end - start
    return height + arb(0, 1) * length * (flight.plane.delta * length).exp() * slope


def _turn(flight: FlightEnclosure, start: float, end: float) -> float:
    """Guess in doubles when Φ' changes sign. The bound of `extremum` holds for any guess."""
    delta, epsilon = float(flight.plane.delta), float(flight.plane.epsilon)
    t0, rest = float(flight.t0), float(flight.rest)

    def slope(t: float) -> float:
        return 4 * math.pi - 2 * math.pi * epsilon * math.sin(2 * math.pi * t) - rest * math.exp(-delta * (t - t0))

    if not slope(start) * slope(end) < 0:
        return 0.5 * (start + end)
    return float(brentq(slope, start, end, xtol=1e-15))
