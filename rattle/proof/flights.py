"""Flights in ball arithmetic: their velocities from their times, and the proof that they meet no wall on their way.

Between the walls Φ'' + δΦ' = g(t) (1.1), so M = e^(δt) Φ' has the derivative M' = e^(δt) g. Between two zeros of g the
function M is monotone, so Φ has at most one extremum there. The equations and Lemmas 3 to 5 are in docs/proofs.md.
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

#: Signs of a velocity. UP also marks a minimum of Φ, after which Φ grows, and DOWN a maximum, after which Φ falls.
UP, DOWN = 1, -1


@dataclass(frozen=True)
class ModelPoint:
    """A parameter point: δ, ε and β as balls, and quantities that follow from these parameters alone."""

    delta: arb
    epsilon: arb
    beta: arb

    @cached_property
    def drift(self) -> arb:
        """4π, the mean velocity of the forced motion."""
        return 4 * PI()

    @cached_property
    def velocity_amplitude(self) -> arb:
        """2πε, the amplitude of the velocity's oscillation."""
        return 2 * PI() * self.epsilon

    @cached_property
    def force_amplitude(self) -> arb:
        """4π²ε, the amplitude of the cosine in the contact force g, (1.2) of docs/proofs.md."""
        return 2 * PI() * self.velocity_amplitude

    def force(self, sine: arb, cosine: arb) -> arb:
        """Return the contact force g, (1.2) of docs/proofs.md, from sine = sin 2πt and cosine = cos 2πt."""
        return self.delta * self.drift - self.force_amplitude * cosine - self.delta * self.velocity_amplitude * sine

    @cached_property
    def phases_of_zero_force(self) -> tuple[arb, ...]:
        """The two phases at which the contact force is 0, or () if ε is proved to be below the quiet limit.

        Raises
        ------
        NotProvedError
            If ε is not proved to be below the quiet limit, nor proved to be above it.
        """
        share = 2 * self.delta / (self.epsilon * (4 * PI() ** 2 + self.delta**2).sqrt())
        if share > 1:
            return ()
        half, middle = share.acos() / (2 * PI()), (self.delta / (2 * PI())).atan() / (2 * PI())
        if not half > 0:
            raise NotProvedError(
                "it is undecided whether the contact force changes sign: move epsilon away from the quiet limit"
            )
        return middle - half, middle + half


@dataclass(frozen=True)
class FlightEnclosure:
    """Enclosure of a flight: each of its numbers is a ball.

    t0, t1: times at which it starts and ends.
    constant: the constant C of equations (1.4) to (1.7) of docs/proofs.md.
    cos0: cos 2πt0.
    w0, w1: velocities at t0 and t1.
    decay: e^(−δ(t1 − t0)).
    w0_t0, w0_t1, w1_t0, w1_t1: derivatives of the velocities by the times (1.10); w0_t0 is ∂w0/∂t0.
    """

    point: ModelPoint
    t0: arb
    t1: arb
    constant: arb
    cos0: arb
    w0: arb
    w1: arb
    decay: arb
    w0_t0: arb
    w0_t1: arb
    w1_t0: arb
    w1_t1: arb

    def state_at(self, t: arb) -> tuple[arb, arb]:
        """Return Φ(t) − Φ(t0) and Φ'(t), by (1.4) and (1.5) of docs/proofs.md."""
        point, sine, cosine = self.point, *(2 * t).sin_cos_pi()
        kept = (-point.delta * (t - self.t0)).exp()
        height = self.constant * (kept - 1) / point.delta + point.epsilon * (cosine - self.cos0)
        return height + point.drift * (
            t - self.t0
        ), point.drift - point.velocity_amplitude * sine - self.constant * kept


def enclose_flight(
    point: ModelPoint, t0: arb, t1: arb, sine_cosine0: tuple[arb, arb], sine_cosine1: tuple[arb, arb], distance: arb
) -> FlightEnclosure:
    """Return the flight over a distance between two times, by (1.7) to (1.10) of docs/proofs.md.

    Parameters
    ----------
    sine_cosine0, sine_cosine1 : tuple[arb, arb]
        (sin 2πt, cos 2πt) at t0 and at t1.
    distance : arb
        Φ(t1) − Φ(t0).

    Returns
    -------
    FlightEnclosure
        The flight.
    """
    (sin0, cos0), (sin1, cos1), delta = sine_cosine0, sine_cosine1, point.delta
    lost = -(-delta * (t1 - t0)).expm1()
    decay, pull = 1 - lost, delta / lost
    rest = (point.drift * (t1 - t0) + point.epsilon * (cos1 - cos0) - distance) * pull
    w0, w1 = (
        point.drift - point.velocity_amplitude * sin0 - rest,
        point.drift - point.velocity_amplitude * sin1 - rest * decay,
    )
    return FlightEnclosure(
        point, t0, t1, rest, cos0, w0, w1, decay,
        w0_t0=w0 * pull + delta * rest - point.force_amplitude * cos0,
        w0_t1=-pull * w1,
        w1_t0=decay * pull * w0,
        w1_t1=(delta * rest - w1 * pull) * decay - point.force_amplitude * cos1,
    )  # fmt: skip


def proved_sign(x: arb) -> int:
    """Return 1 if all numbers of a ball are above 0, −1 if all are below 0, otherwise 0."""
    return UP if x > 0 else DOWN if x < 0 else 0


def require_first_impact(flight: FlightEnclosure, wall: int, target: int, name: str) -> None:
    """Prove that the flight leaves `wall` and that its first impact is its end on `target`.

    By Lemma 3 of docs/proofs.md it suffices that the speeds at both ends are not 0 and that all extrema of Φ during the
    flight are strictly between the walls.

    Parameters
    ----------
    wall, target : int
        1 for Σ⁺, −1 for Σ⁻.
    name : str
        The flight's name in messages.

    Raises
    ------
    NotProvedError
        If the proof fails; the flight may meet a wall before its end.
    """
    if not flight.t1 > flight.t0:
        raise NotProvedError(
            f"the duration of {name} is not proved to be positive: its times are wrong, or enclosed too widely"
        )
    if proved_sign(flight.w0) != -wall or proved_sign(flight.w1) != target:
        raise NotProvedError(f"{name} is not proved to start and end inside the walls: it may graze or pass a wall")
    # Φ of both walls minus Φ at the departure
    above, below = flight.point.beta * (1 - wall), -flight.point.beta * (1 + wall)
    for turn, height in enclose_extrema(flight, name):
        if not (height > below if turn == UP else height < above):
            raise NotProvedError(f"{name} may touch Σ{'⁻' if turn == UP else '⁺'} on its way")


def enclose_extrema(flight: FlightEnclosure, name: str) -> Iterator[tuple[int, arb]]:
    """Yield all extrema of Φ on a flight.

    M = e^(δt) Φ' is monotone between two neighbouring zeros of the contact force g (Lemma 4 of docs/proofs.md). So Φ
    has one extremum between two such zeros if Φ' has different signs at them, otherwise none.

    Yields
    ------
    tuple[int, arb]
        The sign of Φ' after the extremum (UP after a minimum, DOWN after a maximum), and a ball that contains
        Φ − Φ(t0) at the extremum.

    Raises
    ------
    NotProvedError
        If the sign of Φ' at a zero of g is not proved.
    """
    places = [flight.t0]
    for time in [*force_zero_times(flight), flight.t1]:
        if places[-1] < time:
            places.append(time)
        else:  # the balls of two times overlap, so the order of the times is unknown: Φ' must have one sign over both
            places[-1] = places[-1].union(time)
    signs = [proved_sign(flight.state_at(place)[1]) for place in places]
    if not all(signs):
        raise NotProvedError(
            f"the sign of the velocity of {name} is not proved at an end or at a zero of the contact force: an "
            "extremum may be too close"
        )
    for (start, end), (before, after) in zip(pairwise(places), pairwise(signs), strict=True):
        if after != before:
            yield after, enclose_extremum(flight, start, end, name)


def force_zero_times(flight: FlightEnclosure) -> list[arb]:
    """Return the times, in order, at which the contact force vanishes during a flight.

    Returns
    -------
    list[arb]
        The times. A time close to an end of the flight is included unless it is proved to be outside.
    """
    found = []
    for edge in flight.point.phases_of_zero_force:
        number = math.floor(float((flight.t0 - edge).mid())) - 1
        while not edge + number > flight.t1:
            if not edge + number < flight.t0:
                found.append(edge + number)
            number += 1
    return sorted(found, key=lambda time: float(time.mid()))


def enclose_extremum(flight: FlightEnclosure, start: arb, end: arb, name: str) -> arb:
    """Return a ball that contains Φ − Φ(t0) at the only zero t* of Φ' between start and end.

    M = e^(δt) Φ' must be monotone between start and end. For any time u between them |M| ≤ |M(u)| from u to t*, so
    |Φ(t*) − Φ(u)| ≤ L exp(δL) |Φ'(u)| with L = end − start (Lemma 5 of docs/proofs.md). u is a guess of t*: the closer
    u is to t*, the narrower is the ball.

    Returns
    -------
    arb
        Φ(u) − Φ(t0) ± this bound.

    Raises
    ------
    NotProvedError
        If the guess u is not between start and end.
    """
    turn = arb(_guess_extremum_time(flight, float(start.mid()), float(end.mid())))
    if not (turn > start and turn < end):
        raise NotProvedError(f"{name} has an extremum too close to its end or to a zero of the contact force")
    height, slope = flight.state_at(turn)
    length = end - start
    return height + arb(0, 1) * length * (flight.point.delta * length).exp() * slope


def _guess_extremum_time(flight: FlightEnclosure, start: float, end: float) -> float:
    """Return a guess, in doubles, of the time at which Φ' changes sign. `enclose_extremum` is right for any guess."""
    delta, epsilon = float(flight.point.delta), float(flight.point.epsilon)
    t0, rest = float(flight.t0), float(flight.constant)

    def slope(t: float) -> float:
        return 4 * math.pi - 2 * math.pi * epsilon * math.sin(2 * math.pi * t) - rest * math.exp(-delta * (t - t0))

    if not slope(start) * slope(end) < 0:
        return 0.5 * (start + end)
    return float(brentq(slope, start, end, xtol=1e-15))
