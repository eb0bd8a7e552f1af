"""A periodic motion as the times of its impacts: equations that are smooth even where the impact map has a square root.

For a flight from wall to wall the times t₀ and t₁ at its ends give its velocities w₀ and w₁ there in closed form (paper
3.1, 3.2). With s = t₁ − t₀, D the distance between the walls, L = 1 − e^(−δs) and C = δ (4πs + ε (cos 2πt₁ − cos 2πt₀)
− D)/L,

    w₀ = 4π − 2πε sin 2πt₀ − C          w₁ = 4π − 2πε sin 2πt₁ − C e^(−δs).

At an elastic impact the velocity of departure is minus the velocity of arrival (`rattle.flight.impact_law`). A motion
with n impacts in m periods therefore solves n equations in n times,

    R_i = w₀ of flight i + w₁ of flight i − 1 = 0,    t_n = t₀ + m.

Each equation contains three neighbouring times. J(λ) is the Jacobian ∂R/∂t for perturbations dt that grow by λ over the
motion, dt_n = λ dt₀. It follows that

    det J(1) = 0 at a saddle-node,   det J(−1) = 0 at a flip,   w₁ = 0 at a graze.

These functions are analytic in times and parameters, through grazing and beyond, where the motion is virtual and comes
from behind the wall. All functions take complex arguments, whose imaginary part carries exact derivatives.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem, line_scale
from rattle.flight.between import DECAY, PULL, W0, W0_T0, W1, W1_T1, Flights, flight_between
from rattle.flight.forcing import sine_cosine_of_complex_time
from rattle.flight.impact_law import arrival_term_of_mismatch, impact_mismatch
from rattle.numerics.compile import kernel
from rattle.numerics.complex_step import Array, reshape_like, to_complex_batch
from rattle.orbits.orbits_a_to_d import multipliers_from_trace
from rattle.orbits.periodic_motions import Equations


@kernel
def fill_equations(x, gaps, m, multiplier, flights, residual, matrix):
    """Write the flights (6, k, n), residuals R (k, n) and Jacobians J(λ) (k, n, n) of motions x (k, n + 2).

    A row of x holds the n impact times of a motion, δ and ε. gaps (n,): the distances of the flights from wall to wall,
    0 or ±2β. multiplier: λ. `flights`, `residual` and `matrix` must hold zeros before the call. If J is not needed,
    `matrix` has the shape (k, 0, 0).
    """
    k, n, size = x.shape[0], gaps.size, matrix.shape[1]
    for j in range(k):
        delta, epsilon = x[j, n], x[j, n + 1]
        first = sine_cosine_of_complex_time(x[j, 0])
        turn1 = first
        for i in range(n):
            turn0, t1 = turn1, x[j, 0] + m
            if i < n - 1:
                t1 = x[j, i + 1]
                turn1 = sine_cosine_of_complex_time(t1)
            else:
                turn1 = first
            found = flight_between(x[j, i], t1, turn0, turn1, gaps[i], delta, epsilon)
            for part in range(6):
                flights[part, j, i] = found[part]
        for i in range(n):
            residual[j, i] = impact_mismatch(flights[W1, j, i - 1], flights[W0, j, i])
        for i in range(size):
            after, later = (i + 1, 1.0 + 0j) if i < n - 1 else (0, multiplier)
            pull = flights[PULL, j, i]
            matrix[j, i, i] += impact_mismatch(flights[W1_T1, j, i - 1], flights[W0_T0, j, i])
            matrix[j, i, after] -= pull * flights[W1, j, i] * later  # −pull · w₁ is ∂w₀/∂t₁
            matrix[j, after, i] += arrival_term_of_mismatch(
                np.divide(flights[DECAY, j, i] * pull * flights[W0, j, i], later)
            )


@dataclass(frozen=True)
class Itinerary(Equations):
    """The itinerary of a motion of the impacting gear (walls, forcing periods, half-backlash), and its equations."""

    @property
    def n(self) -> int:
        """Number of impacts per period."""
        return len(self.walls)

    @cached_property
    def wall_distances(self) -> Array:
        """Distances (n,) of the flights from wall to wall: 0 or ±2β."""
        walls = np.asarray(self.walls)
        return self.beta * (np.roll(walls, -1) - walls)

    def _flights_residual_and_jacobian(
        self, x: NDArray, multiplier: complex = 1.0, *, with_matrix: bool = False
    ) -> tuple[NDArray, ...]:
        """Return flights (6, …, n), residual R (…, n) and Jacobian J(λ) (…, n, n); without `with_matrix` J is empty."""
        batch, n = to_complex_batch(x), self.n
        k, size = len(batch), n if with_matrix else 0
        flights, residual, matrix = (np.zeros(shape, complex) for shape in ((6, k, n), (k, n), (k, size, size)))
        fill_equations(batch, self.wall_distances, self.m, complex(multiplier), flights, residual, matrix)
        return reshape_like(x, flights, axis=1), reshape_like(x, residual), reshape_like(x, matrix)

    def flights(self, x: NDArray) -> Flights:
        """Return the flights between impacts at the times x[…, :n], for δ = x[…, n] and ε = x[…, n + 1]."""
        return Flights(*self._flights_residual_and_jacobian(x)[0])

    def residual(self, x: NDArray) -> NDArray:
        """Return the residual R (…, n); entry i is 0 if impact number i obeys the impact law."""
        return self._flights_residual_and_jacobian(x)[1]

    def evaluate_with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """Return the residual R and its Jacobian J(λ) = ∂R/∂t (…, n, n) for perturbations with dt_n = λ dt₀."""
        _, residual, matrix = self._flights_residual_and_jacobian(x, multiplier, with_matrix=True)
        return residual, matrix

    def residual_with_graze(self, x: NDArray, impact: int) -> NDArray:
        """Return the residual R, followed by the arrival velocity at impact number `impact`, as (…, n + 1)."""
        flights, residual, _ = self._flights_residual_and_jacobian(x)
        return np.concatenate([residual, flights[1][..., impact - 1, None]], axis=-1)

    def monodromy(self, x: Array) -> Array:
        """Return the tangent map of the motion over its period, in the coordinates (t, w²/2).

        It is the product of the flights' tangent maps. A flight of duration s has a tangent map with determinant
        e^(−δs).

        Returns
        -------
        Array
            The matrix (2, 2), infinite at a graze.
        """
        flights = self.flights(x)
        product = np.eye(2)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = -flights.pull * flights.w1
            for i in range(self.n):
                # solve dw₀ = w0_t0 dt₀ + after dt₁ for dt₁, and insert dt₁ into dw₁ = decay pull w₀ dt₀ + w1_t1 dt₁
                t_t, t_w = -flights.w0_t0[i] / after[i], 1.0 / after[i]
                w_t = flights.decay[i] * flights.pull[i] * flights.w0[i] + flights.w1_t1[i] * t_t
                w_w = flights.w1_t1[i] * t_w
                e_t, e_w = (self.law.energy_change(flights.w1[i], change) for change in (w_t, w_w))
                product = np.array([[t_t, t_w / flights.w0[i]], [e_t, e_w / flights.w0[i]]]) @ product
        return product

    def trace(self, x: Array) -> float:
        """Return the trace of the monodromy matrix.

        Returns
        -------
        float
            The trace; inf at a graze, where both diagonal elements are infinite and their sum is undefined.
        """
        terms = np.diagonal(self.monodromy(x))
        return float(terms.sum()) if np.isfinite(terms).all() else np.inf


def equations_on_line(itinerary: Itinerary, origin: Array, direction: Array) -> ContinuationProblem:
    """Return the impact equations of a motion along the line (δ, ε) = origin + p · direction.

    The n + 1 unknowns are the n times and p.

    Returns
    -------
    ContinuationProblem
        The n equations.
    """

    def equations(y: NDArray) -> NDArray:
        n = itinerary.n
        return itinerary.residual(np.concatenate([y[..., :n], origin + y[..., n:] * direction], axis=-1))

    return ContinuationProblem(equations, scale=line_scale(origin, direction))


def multipliers_without_graze(itinerary: Itinerary, x: Array, grazed: int | None = None) -> NDArray[np.complex128]:
    """Return both multipliers (2,) of the motion at x (n + 2,).

    If the motion grazes, `grazed` is the number of the grazing impact. The result is then for the motion without this
    impact, because its multipliers are finite.

    Returns
    -------
    NDArray[np.complex128]
        The multipliers, the larger modulus first.
    """
    if grazed is not None:
        itinerary, x = itinerary.without_impact(grazed), np.delete(x, grazed)
    determinant = itinerary.law.determinant(x[itinerary.n], itinerary.m, itinerary.n)
    return multipliers_from_trace(itinerary.trace(x), determinant)
