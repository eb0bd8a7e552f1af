"""A periodic motion of the stiff gear as the times and durations of its contacts: equations smooth down to κ = ∞.

Contact i begins at time t_i with outward velocity u_i and lasts pσ_i, with p = 1/√(2κ); then a flight leads to the next
wall. Given these times the flights have their velocities in closed form (`rattle.impacting.orbits.equations`), and two
equations say that the contact fits in: its depth at the end, over pσ_i, is 0, and its velocity there is that of the
flight:

    u Ŝ/σ + p (response to the force)/σ = 0,        u (cos-like) + p (…) − w₀ = 0,        Ŝ = e^(−δpσ/2) sin(νσ)/ν.

At p = 0 they read sin σ = 0, so σ = π, and w₀ = −u: the elastic impact. So any motion of the impacting model is a
solution at p = 0, and everything is analytic in p there: it differs by O(κ^(−1/2)). At σ = 0 the motion grazes, and
goes on smoothly beyond, where it is virtual. Complex arguments carry exact derivatives.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.flight.between import TWO_PI, Flights, flights_between
from rattle.numerics.complex_step import Array

SMALL = 0.5  # duration or angle below which a Taylor series is used
TERMS = 16


@dataclass(frozen=True)
class Contacts:
    """The contacts of one motion, or of a batch: arrays (…, c); derivatives are named as in x_u = ∂x/∂u."""

    x: NDArray  # depth at the end, over p
    v: NDArray  # outward velocity at the end
    x_u: NDArray
    v_u: NDArray
    x_t: NDArray  # by the time of the beginning
    v_t: NDArray
    v_duration: NDArray  # by σ; that of x is v


def free_responses(duration: NDArray, loss: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Ŝ, 1 − C and σ − Ŝ after σ, with δp = loss; small durations by Taylor series, whose derivatives stay exact."""
    half = 0.5 * loss + 0j
    frequency = np.sqrt(1 - half**2)
    decay, angle = np.exp(-half * duration), frequency * duration
    sine = decay * np.sin(angle) / frequency
    lost = -np.expm1(-half * duration) + decay * (2 * np.sin(angle / 2) ** 2 - half * np.sin(angle) / frequency)
    last, term = 0.0 * duration, duration + 0.0 * loss
    series, integral, rest = term, duration * duration / 2, 0.0 * term
    for n in range(1, TERMS):
        last, term = term, -(loss * duration * term + duration * duration / n * last) / (n + 1)
        series, rest, integral = series + term, rest - term, integral + duration * term / (n + 2)
    small = np.abs(duration) * (1 + np.abs(loss)) < SMALL
    return (
        np.where(small, series, sine),
        np.where(small, integral, lost),
        np.where(small, rest, duration - sine),
    )


def sine_defect(z: NDArray) -> NDArray:
    """z − sin z."""
    square = z * z
    series = z * square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110))))
    return np.where(np.abs(z) < SMALL, series, z - np.sin(z))


@dataclass(frozen=True)
class StiffItinerary:
    """Which walls a motion of the stiff gear meets (+1 or −1 for each contact of a period, Σ⁺ first), in how many
    forcing periods, the half-backlash, and p = 1/√(2κ), 0 for the impacting model.
    """

    walls: tuple[int, ...]
    m: int
    beta: float
    softness: float

    @property
    def contacts(self) -> int:
        """Contacts c per period."""
        return len(self.walls)

    @property
    def n(self) -> int:
        """Unknowns: times and durations σ of the contacts."""
        return 2 * self.contacts

    @cached_property
    def signs(self) -> Array:
        """The walls (c,)."""
        return np.asarray(self.walls, np.float64)

    def flights(self, x: NDArray, p: NDArray) -> Flights:
        """Flight i leads from contact i to contact i + 1; x (…, 2c + 2): times, durations σ, δ, ε; p (…, 1)."""
        c = self.contacts
        begins, delta, epsilon = x[..., :c], x[..., self.n, None], x[..., self.n + 1, None]
        t0 = begins + p * x[..., c : self.n]
        t1 = np.concatenate([begins[..., 1:], begins[..., :1] + self.m], axis=-1)
        turn0, turn1 = (np.sin(TWO_PI * t0), np.cos(TWO_PI * t0)), (np.sin(TWO_PI * t1), np.cos(TWO_PI * t1))
        gaps = self.beta * (np.roll(self.signs, -1) - self.signs)
        return flights_between(t0, t1, turn0, turn1, gaps, delta, epsilon)

    def contact(self, x: NDArray, u: NDArray, p: NDArray) -> Contacts:
        """The contacts entered with outward velocities u (…, c)."""
        c = self.contacts
        t, duration, delta, epsilon = x[..., :c], x[..., c : self.n], x[..., self.n, None], x[..., self.n + 1, None]
        sine, lost, defect = free_responses(duration, delta * p)
        s = p * duration
        versine, turn = 2 * np.sin(np.pi * s) ** 2, np.sin(TWO_PI * s)
        size = self.signs * TWO_PI * epsilon
        sin0, cos0 = np.sin(TWO_PI * t), np.cos(TWO_PI * t)
        mean = self.signs * 2 * TWO_PI * delta
        a, b = -size * (TWO_PI * cos0 + delta * sin0), size * (TWO_PI * sin0 - delta * cos0)
        stiff, loss = 1 - (TWO_PI * p) ** 2, TWO_PI * delta * p**2
        square = stiff**2 + loss**2
        stiff, loss = stiff / square, loss / square
        P, Q = lost - versine, TWO_PI * p * defect - sine_defect(TWO_PI * s)
        dP, dQ = sine - TWO_PI * p * turn, TWO_PI * p * (lost + delta * p * sine - versine)
        x_a, x_b = p * (stiff * P + loss * Q), p * (stiff * Q - loss * P)
        v_a, v_b = p * (stiff * dP + loss * dQ), p * (stiff * dQ - loss * dP)
        v_u = 1 - lost - delta * p * sine
        depth = u * sine + p * mean * lost + a * x_a + b * x_b
        v = u * v_u + p * mean * sine + a * v_a + b * v_b
        force = mean + a * (1 - versine) + b * turn
        found = (depth, v, sine, v_u, TWO_PI * (b * x_a - a * x_b), TWO_PI * (b * v_a - a * v_b))
        whole = (*found, p * (force - delta * v) - depth)
        return Contacts(*(y if np.iscomplexobj(x) or np.iscomplexobj(p) else y.real for y in whole))

    def solved(self, x: NDArray, p: NDArray) -> tuple[Flights, Contacts]:
        """Flights and contacts of unknowns."""
        flights = self.flights(x, p)
        return flights, self.contact(x, self.signs * np.roll(flights.w1, 1, axis=-1), p)

    def residual_at(self, x: NDArray, p: NDArray) -> NDArray:
        """R (…, 2c): depths over σ, then velocities, at another p (…, 1) than the own one."""
        return self._residual(x, *self.solved(x, p))

    def _residual(self, x: NDArray, flights: Flights, contacts: Contacts) -> NDArray:
        depths = contacts.x / x[..., self.contacts : self.n]
        return np.concatenate([depths, contacts.v - self.signs * flights.w0], axis=-1)

    def residual(self, x: NDArray) -> NDArray:
        """R (…, 2c): zero where every contact fits between its flights."""
        return self.residual_at(x, np.array([self.softness]))

    def jacobian(self, x: NDArray, multiplier: float = 1.0) -> NDArray:
        """J(λ) = ∂R/∂(times, σ) (…, 2c, 2c), where what is a period later is λ times as large."""
        return self.with_jacobian(x, multiplier)[1]

    def with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """R and J(λ), from the same flights and contacts."""
        p, c = self.softness, self.contacts
        flights, contacts = self.solved(x, np.array([p]))
        duration = x[..., c : self.n]
        from_start = flights.decay * flights.pull * flights.w0  # ∂w₁/∂t₀
        to_end = -flights.pull * flights.w1  # ∂w₀/∂t₁
        matrix = np.zeros((*x.shape[:-1], self.n, self.n), np.result_type(x, contacts.x))
        depth = contacts.x / duration
        for i in range(c):
            before, after = (i - 1) % c, (i + 1) % c
            earlier, later = 1.0 if i else 1.0 / multiplier, 1.0 if i < c - 1 else multiplier
            sign = self.signs[i]
            for row, by_u, by_t, by_duration in (
                (i, contacts.x_u[..., i] / duration[..., i], contacts.x_t[..., i] / duration[..., i],
                 (contacts.v[..., i] - depth[..., i]) / duration[..., i]),
                (c + i, contacts.v_u[..., i], contacts.v_t[..., i], contacts.v_duration[..., i]),
            ):  # fmt: skip
                start = sign * by_u * from_start[..., before] * earlier
                matrix[..., row, before] += start
                matrix[..., row, c + before] += p * start
                matrix[..., row, i] += by_t + sign * by_u * flights.w1_t1[..., before]
                matrix[..., row, c + i] += by_duration
            matrix[..., c + i, i] -= sign * flights.w0_t0[..., i]
            matrix[..., c + i, c + i] -= sign * p * flights.w0_t0[..., i]
            matrix[..., c + i, after] -= sign * to_end[..., i] * later
        return self._residual(x, flights, contacts), matrix

    def with_graze(self, x: NDArray, impact: int) -> NDArray:
        """R (…, 2c + 1), and after it the duration σ of a contact."""
        return np.append(self.residual(x), x[..., self.contacts + impact, None], -1)

    def doubled(self) -> "StiffItinerary":
        """The itinerary twice over."""
        return StiffItinerary(self.walls * 2, 2 * self.m, self.beta, self.softness)

    def begun_at(self, first: int) -> "StiffItinerary":
        """The itinerary of the same motion, begun at contact number `first`."""
        return StiffItinerary(self.walls[first:] + self.walls[:first], self.m, self.beta, self.softness)
