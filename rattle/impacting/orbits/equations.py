"""A periodic motion as the times of its impacts: equations that stay smooth where the impact map has its square root.

Given the times t₀, t₁ at its ends, a flight from wall to wall has its velocities in closed form (paper 3.1, 3.2): with
s = t₁ − t₀, D the distance between the walls, L = 1 − e^(−δs) and C = δ (4πs + ε (cos 2πt₁ − cos 2πt₀) − D)/L,

    w₀ = 4π − 2πε sin 2πt₀ − C          w₁ = 4π − 2πε sin 2πt₁ − C e^(−δs).

An elastic impact turns the velocity of arrival into minus that of departure, so a motion with n impacts in m periods is
n equations in n times, R_i = w₀ of flight i + w₁ of flight i − 1 = 0 with t_n = t₀ + m. Each equation holds three
neighbouring times. A perturbation that grows by λ over the motion solves the same equations with t_n' = λ t₀', so

    det J(1) = 0 at a saddle-node,   det J(−1) = 0 at a flip,   w₁ = 0 at a graze,

all analytic in times and parameters, through grazing and beyond, where the motion is virtual: it comes from behind the
wall. Everything here takes complex arguments, whose imaginary part carries exact derivatives (`derivatives`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import Problem, line_scale
from rattle.flight.between import TWO_PI, Flights, flights_between
from rattle.numerics.complex_step import Array
from rattle.orbits.period_one import multipliers_of


@dataclass(frozen=True)
class Itinerary:
    """Which walls a motion meets (+1 or −1, one for each impact of a period, Σ⁺ first), in how many forcing periods,
    and the half-backlash.
    """

    walls: tuple[int, ...]
    m: int
    beta: float

    @property
    def n(self) -> int:
        """Impacts per period."""
        return len(self.walls)

    @cached_property
    def after(self) -> NDArray[np.int64]:
        """The impact after each impact (n,)."""
        return np.roll(np.arange(self.n), -1)

    @cached_property
    def before(self) -> NDArray[np.int64]:
        """The impact before each impact (n,)."""
        return np.roll(np.arange(self.n), 1)

    @cached_property
    def gaps(self) -> Array:
        """The distance D that each flight covers (n,)."""
        walls = np.asarray(self.walls)
        return self.beta * (walls[self.after] - walls)

    def flights(self, x: NDArray) -> Flights:
        """The flights between impacts at times x[…, :n] with δ = x[…, n], ε = x[…, n + 1]."""
        t0, delta, epsilon = x[..., : self.n], x[..., self.n, None], x[..., self.n + 1, None]
        t1 = np.concatenate([t0[..., 1:], t0[..., :1] + self.m], axis=-1)
        turn0 = np.sin(TWO_PI * t0), np.cos(TWO_PI * t0)
        turn1 = turn0[0][..., self.after], turn0[1][..., self.after]
        return flights_between(t0, t1, turn0, turn1, self.gaps, delta, epsilon)

    def residual(self, x: NDArray) -> NDArray:
        """R (…, n): zero where every impact is elastic."""
        return self._residual(self.flights(x))

    def _residual(self, flights: Flights) -> NDArray:
        return flights.w0 + flights.w1[..., self.before]

    def jacobian(self, x: NDArray, multiplier: float = 1.0) -> NDArray:
        """J(λ) = ∂R/∂t (…, n, n) with t_n' = λ t₀'."""
        return self.with_jacobian(x, multiplier)[1]

    def with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """R and J(λ), from the same flights."""
        flights, n = self.flights(x), self.n
        before = flights.decay * flights.pull * flights.w0  # ∂w₁/∂t₀
        after = -flights.pull * flights.w1  # ∂w₀/∂t₁
        wrap = np.ones(n)
        wrap[-1] = multiplier
        rows = np.arange(n)
        matrix = np.zeros((*after.shape, n), after.dtype)
        matrix[..., rows, rows] = flights.w0_t0 + flights.w1_t1[..., self.before]
        matrix[..., rows, self.after] += after * wrap
        matrix[..., self.after, rows] += before / wrap
        return self._residual(flights), matrix

    def with_graze(self, x: NDArray, impact: int) -> NDArray:
        """R (…, n + 1), and after it the velocity with which an impact is reached."""
        flights = self.flights(x)
        return np.append(self._residual(flights), flights.w1[..., impact - 1, None], -1)

    def monodromy(self, x: Array) -> Array:
        """The product (2, 2) of the flights' tangent maps in (t, w²/2), each of determinant e^(−δs); infinite at a
        graze.
        """
        flights = self.flights(x)
        product = np.eye(2)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = -flights.pull * flights.w1
            for i in range(self.n):
                # dw₀ = w0_t0 dt₀ + after dt₁ gives dt₁; then dw₁ = before dt₀ + w1_t1 dt₁
                t_t, t_w = -flights.w0_t0[i] / after[i], 1.0 / after[i]
                w_t = flights.decay[i] * flights.pull[i] * flights.w0[i] + flights.w1_t1[i] * t_t
                w_w = flights.w1_t1[i] * t_w
                energy = [[t_t, t_w / flights.w0[i]], [w_t * flights.w1[i], w_w * flights.w1[i] / flights.w0[i]]]
                product = np.array(energy) @ product
        return product

    def trace(self, x: Array) -> float:
        """The trace of the monodromy; infinite at a graze, where the terms are too, of either sign, and have no sum."""
        terms = np.diagonal(self.monodromy(x))
        return float(terms.sum()) if np.isfinite(terms).all() else np.inf

    def begun_at(self, first: int) -> "Itinerary":
        """The itinerary of the same motion, begun at impact number `first`."""
        return Itinerary(self.walls[first:] + self.walls[:first], self.m, self.beta)

    def without(self, impact: int) -> "Itinerary":
        """The itinerary of the motion that just fails to make this impact."""
        return Itinerary(self.walls[:impact] + self.walls[impact + 1 :], self.m, self.beta)

    def with_impact(self, impact: int, wall: int) -> "Itinerary":
        """The itinerary with one impact more, which becomes number `impact`."""
        return Itinerary((*self.walls[:impact], wall, *self.walls[impact:]), self.m, self.beta)

    def doubled(self) -> "Itinerary":
        """The itinerary twice over."""
        return Itinerary(self.walls * 2, 2 * self.m, self.beta)


def on_line(itinerary: Itinerary, origin: Array, direction: Array) -> Problem:
    """The equations (…, n + 1) → (…, n) of a motion at (δ, ε) = origin + p direction; times and p unknown."""

    def equations(y: NDArray) -> NDArray:
        n = itinerary.n
        return itinerary.residual(np.concatenate([y[..., :n], origin + y[..., n:] * direction], axis=-1))

    return Problem(equations, scale=line_scale(origin, direction))


def smooth_multipliers(itinerary: Itinerary, x: Array, grazed: int | None = None) -> NDArray[np.complex128]:
    """Both multipliers (2,) of the motion of x; at a graze those of the motion that misses the impact `grazed`, which
    are finite.
    """
    if grazed is not None:
        itinerary, x = itinerary.without(grazed), np.delete(x, grazed)
    return multipliers_of(itinerary.trace(x), np.exp(-x[itinerary.n] * itinerary.m))
