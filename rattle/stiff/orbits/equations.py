"""Equations for the times and durations of contacts of a periodic motion of the stiff gear, smooth up to κ = ∞.

Contact i begins at time t_i with outward velocity u_i and lasts pσ_i, with p = 1/√(2κ). A flight then leads to the next
wall. These times determine the velocities of the flights in closed form (`rattle.impacting.orbits.equations`). For each
contact two equations remain: the final depth divided by pσ_i is 0, and the final velocity is the initial velocity w₀ of
the next flight,

    u Ŝ/σ + p (response to the force)/σ = 0,
    u (dŜ/dσ) + p (response to the force) − w₀ = 0,        Ŝ = e^(−δpσ/2) sin(νσ)/ν,    ν² = 1 − (δp/2)².

At p = 0 these equations are sin σ = 0, so σ = π, and w₀ = −u, which is the elastic impact. So any motion of the
impacting model is a solution at p = 0. The equations are analytic in p at p = 0, so motions at stiffness κ differ from
motions of the impacting model by O(κ^(−1/2)). At σ = 0 the motion grazes, and the solution continues smoothly to σ < 0,
where it is virtual. With complex arguments the functions yield exact derivatives (complex step).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.flight.between import (
    DECAY,
    PULL,
    W0,
    W0_T0,
    W1,
    W1_T1,
    Flights,
    decay_loss,
    flight_between,
)
from rattle.flight.forcing import (
    TWO_PI,
    complex_sine_cosine,
    force_fourier_coefficients_of_complex_phase,
    sine_cosine_of_complex_time,
)
from rattle.numerics.compile import inline, kernel
from rattle.numerics.complex_step import Array, reshape_like, to_complex_batch
from rattle.orbits.periodic_motions import Equations

SMALL = 0.5  # a Taylor series is used if |σ| (1 + |loss|), or an angle, is below this
TERMS = 16  # number of terms of the series for a contact


@inline
def free_responses(duration, loss):
    """Return Ŝ, 1 − C and σ − Ŝ, the responses of the depth without a force, after a contact of duration σ.

    Ŝ is the depth that a unit velocity (dx/dσ) at the beginning leads to, and C the depth that a unit depth leads to.
    loss: δp, with p = 1/√(2κ).

    Returns
    -------
    tuple
        The three values, for small σ from Taylor series, whose derivatives are exact.
    """
    if abs(duration) * (1.0 + abs(loss)) < SMALL:
        last, term = 0.0 * duration, duration
        series, integral, rest = term, 0.5 * duration * duration, 0.0 * duration
        for n in range(1, TERMS):
            last, term = term, -(loss * duration * term + duration * duration * last * (1.0 / n)) * (1.0 / (n + 1))
            series, rest, integral = series + term, rest - term, integral + duration * term * (1.0 / (n + 2))
        return series, integral, rest
    half = 0.5 * loss
    frequency = np.sqrt(1.0 - half * half)
    fallen, decay = decay_loss(half * duration)
    sine, _ = complex_sine_cosine(frequency * duration)
    half_sine, _ = complex_sine_cosine(0.5 * frequency * duration)
    swing = np.divide(sine, frequency)
    return (
        decay * swing,
        fallen + decay * (2.0 * half_sine * half_sine - half * swing),
        duration - decay * swing,
    )


@inline
def z_minus_sine(z):
    """Return z − sin z without cancellation."""
    if abs(z) < SMALL:
        y = z * z
        return z * y * (1 / 6) * (1 - y * (1 / 20) * (1 - y * (1 / 42) * (1 - y * (1 / 72) * (1 - y * (1 / 110)))))
    return z - complex_sine_cosine(z)[0]


@inline
def contact_end_state(sign, t, duration, u, p, delta, epsilon):
    """Return depth and outward velocity at the end of a contact that begins at time t with outward velocity u.

    sign: the wall, ±1. duration: σ, in units of p = 1/√(2κ).

    Returns
    -------
    tuple
        x = depth/p, the velocity v, and the derivatives ∂x/∂u, ∂v/∂u, ∂x/∂t, ∂v/∂t and ∂v/∂σ. The derivative of x by σ
        is v.
    """
    sine, lost, defect = free_responses(duration, delta * p)
    half, s = complex_sine_cosine(math.pi * p * duration)[0], p * duration
    versine, turned = 2 * half * half, complex_sine_cosine(TWO_PI * s)[0]
    sin0, cos0 = sine_cosine_of_complex_time(t)
    mean, a, b = force_fourier_coefficients_of_complex_phase(sign, sin0, cos0, delta, epsilon)
    stiff, loss = 1 - TWO_PI * p * TWO_PI * p, TWO_PI * delta * p * p
    square = stiff * stiff + loss * loss
    stiff, loss = np.divide(stiff, square), np.divide(loss, square)
    P, Q = lost - versine, TWO_PI * p * defect - z_minus_sine(TWO_PI * s)
    dP, dQ = sine - TWO_PI * p * turned, TWO_PI * p * (lost + delta * p * sine - versine)
    x_a, x_b = p * (stiff * P + loss * Q), p * (stiff * Q - loss * P)
    v_a, v_b = p * (stiff * dP + loss * dQ), p * (stiff * dQ - loss * dP)
    v_u = 1 - lost - delta * p * sine
    depth = u * sine + p * mean * lost + a * x_a + b * x_b
    v = u * v_u + p * mean * sine + a * v_a + b * v_b
    force = mean + a * (1 - versine) + b * turned
    return (
        depth,
        v,
        sine,
        v_u,
        TWO_PI * (b * x_a - a * x_b),
        TWO_PI * (b * v_a - a * v_b),
        p * (force - delta * v) - depth,
    )


@kernel
def residuals_and_jacobian(x, p, signs, m, beta, multiplier, with_matrix):
    """Return the flights, the residuals R and the Jacobian J(λ) of motions x (k, 2c + 2) with the softness p (k,).

    J(λ) = ∂R/∂(times, durations) is for perturbations that grow by λ = multiplier over the period. signs (c,): the
    walls that the motions meet, as ±1.

    Returns
    -------
    tuple
        Flights (6, k, c), R (k, 2c) and J (k, 2c, 2c); J is (k, 0, 0) if `with_matrix` is False.
    """
    k, c = x.shape[0], signs.size
    n = 2 * c
    flights, residual = np.empty((6, k, c), np.complex128), np.empty((k, n), np.complex128)
    size = n if with_matrix else 0
    matrix = np.zeros((k, size, size), np.complex128)
    for j in range(k):
        delta, epsilon = x[j, n], x[j, n + 1]
        for i in range(c):
            t0, t1, after = x[j, i] + p[j] * x[j, c + i], x[j, 0] + m, 0
            if i < c - 1:
                t1, after = x[j, i + 1], i + 1
            gap = beta * (signs[after] - signs[i])
            found = flight_between(
                t0, t1, sine_cosine_of_complex_time(t0), sine_cosine_of_complex_time(t1), gap, delta, epsilon
            )
            for part in range(6):
                flights[part, j, i] = found[part]
        for i in range(c):
            sign, before, duration = signs[i], (i - 1) % c, x[j, c + i]
            u = sign * flights[W1, j, before]
            depth, v, x_u, v_u, x_t, v_t, v_duration = contact_end_state(
                sign, x[j, i], duration, u, p[j], delta, epsilon
            )
            depth = np.divide(depth, duration)
            residual[j, i], residual[j, c + i] = depth, v - sign * flights[W0, j, i]
            if not with_matrix:
                continue
            after, later = (i + 1, 1.0 + 0j) if i < c - 1 else (0, multiplier)
            earlier = 1.0 + 0j if i else np.divide(1.0 + 0j, multiplier)
            # ∂w₁/∂t₀ of the flight before contact i, and ∂w₀/∂t₁ of the flight after it. If a flight joins two
            # periods, the former is divided by the multiplier, and the latter is multiplied by it.
            from_start = flights[DECAY, j, before] * flights[PULL, j, before] * flights[W0, j, before] * earlier
            to_end = -flights[PULL, j, i] * flights[W1, j, i] * later
            of_depth = np.divide(x_u, duration), np.divide(x_t, duration), np.divide(v - depth, duration)
            for row, by in ((i, of_depth), (c + i, (v_u, v_t, v_duration))):
                by_u, by_t, by_duration = by
                start = sign * by_u * from_start
                matrix[j, row, before] += start
                matrix[j, row, c + before] += p[j] * start
                matrix[j, row, i] += by_t + sign * by_u * flights[W1_T1, j, before]
                matrix[j, row, c + i] += by_duration
            matrix[j, c + i, i] -= sign * flights[W0_T0, j, i]
            matrix[j, c + i, c + i] -= sign * p[j] * flights[W0_T0, j, i]
            matrix[j, c + i, after] -= sign * to_end
    return flights, residual, matrix


@dataclass(frozen=True)
class StiffItinerary(Equations):
    """The equations of the stiff gear's motions that meet given walls in order in m forcing periods.

    softness: p = 1/√(2κ), which is 0 for the impacting model.
    """

    softness: float

    @property
    def n_contacts(self) -> int:
        """The number c of contacts per period of the motion."""
        return len(self.walls)

    @property
    def n(self) -> int:
        """The number 2c of unknown times and durations."""
        return 2 * self.n_contacts

    @cached_property
    def signs(self) -> Array:
        """The walls (c,) that the motion meets, as ±1.0."""
        return np.asarray(self.walls, np.float64)

    def _residuals_and_jacobian(
        self, x: NDArray, p: NDArray | float, multiplier: complex = 1.0, *, with_matrix: bool = False
    ) -> tuple[NDArray, ...]:
        """Return flights (6, …, c), residuals R (…, 2c) and Jacobian J(λ) (…, 2c, 2c) at the softness p.

        p is a number or (…, 1). J(λ) = ∂R/∂(times, durations), for λ = multiplier, is empty unless `with_matrix`.

        Returns
        -------
        tuple of ndarray
            Flights, R and J(λ).
        """
        batch = to_complex_batch(x)
        softness = np.empty(len(batch), np.complex128)
        softness[:] = np.ravel(p)
        flights, residual, matrix = residuals_and_jacobian(
            batch, softness, self.signs, self.m, self.beta, complex(multiplier), with_matrix
        )
        return reshape_like(x, flights, axis=1), reshape_like(x, residual), reshape_like(x, matrix)

    def flights(self, x: NDArray, p: NDArray) -> Flights:
        """Return the flights of motions x (…, 2c + 2) at the softness p (…, 1); flight i follows contact i.

        x: the times of the c contacts, their durations divided by p, δ and ε.

        Returns
        -------
        Flights
            Velocities at both ends of the flights (…, c), with derivatives.
        """
        return Flights(*self._residuals_and_jacobian(x, p)[0])

    def residual_at(self, x: NDArray, p: NDArray) -> NDArray:
        """Return the residuals (…, 2c) of motions x at the given p = 1/√(2κ), (…, 1); x must be complex if p is."""
        return self._residuals_and_jacobian(x, p)[1]

    def residual(self, x: NDArray) -> NDArray:
        """Return the residuals (…, 2c) of motions x: c of depth, c of velocity; all are 0 for a periodic motion."""
        return self._residuals_and_jacobian(x, self.softness)[1]

    def evaluate_with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """Return the residuals R (…, 2c) of motions x and J(λ) = ∂R/∂(times, durations) (…, 2c, 2c).

        J(λ) is for perturbations that grow by λ = multiplier over a period.

        Returns
        -------
        tuple of ndarray
            R and J(λ).
        """
        _, residual, matrix = self._residuals_and_jacobian(x, self.softness, multiplier, with_matrix=True)
        return residual, matrix

    def residual_with_graze(self, x: NDArray, impact: int) -> NDArray:
        """Return (…, 2c + 1): the residuals of motions x, then σ of contact number `impact`, which is 0 at a graze."""
        return np.concatenate([self.residual(x), x[..., self.n_contacts + impact, None]], axis=-1)
