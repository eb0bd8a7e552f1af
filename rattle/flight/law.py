"""Free flight between the walls in closed form, in double and in single precision (compiled).

A flight leaves a wall (+1: Φ = β, −1: Φ = −β) with phase τ and velocity w. Let θ = 2πτ, A = q − 2πε sin θ − w and k(x)
= e^(−x) − 1 + x. Equation (3.1) of Mason and Piiroinen (2009) then becomes, free of cancellation for short flights,

    F(s) = Φ(s) − Φ(0) = w s + A k(δs)/δ − ε [cos θ (1 − cos 2πs) − sin θ (2πs − sin 2πs)].

The last term, which is subtracted, is e(t₀) + s e'(t₀) − e(t₁) for the forcing e(t) = ε cos 2πt and a flight from t₀ to
t₁ = t₀ + s. This term and all others that depend on the forcing come from `rattle.flight.forcing`. The mean drift is
q = 4π. Reversed time is the same law with δ → −δ, q → −q, τ → −τ and w → −w, so one kernel serves both directions of
time.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.flight import coefficients, forcing
from rattle.flight.forcing import (
    Real,
    add_acceleration,
    add_slope,
    drop_below_tangent_line,
    largest_forcing_slope,
    sine_cosine_at,
    slope_loss,
    versines,
)
from rattle.numerics.compile import inline, kernel
from rattle.numerics.polynomial import evaluate_degree_6, evaluate_degree_12

FASTEST = 1e100  # upper limit of the natural speed, which would overflow for very large parameters
LONGEST_DECAY = 2.0  # largest δs for which the polynomials of `decay_remainder64` and `decay_remainder32` are accurate


class Flight(NamedTuple):
    """The numbers in the flight law (see the module) that determine one flight, in double or in single precision."""

    w: Real  # velocity of departure
    a: Real  # A = q − 2πε sin θ − w
    sin0: Real  # sine of the forcing's phase at the departure
    cos0: Real
    delta: Real
    epsilon: Real


@inline
def fold_phase(tau):
    """Return a phase shifted by whole forcing periods into [0, 1). A tiny negative phase gives 0, not 1."""
    fraction = tau - np.floor(tau)
    return fraction if fraction < 1.0 else 0.0


@inline
def wrap_phase_difference(difference):
    """Return the difference of two phases, shifted by whole forcing periods into [−1/2, 1/2]."""
    return difference - np.rint(difference)


@inline
def natural_speed(delta, epsilon, beta):
    """Return the speed scale of motions, 1.5 √(16πδβ) + 2πε, near 7 at (δ, ε, β) = (0.6, 0.1, 0.6).

    The drift across the gap reaches √(16πδβ); 2πε is the largest speed of the forcing.

    Returns
    -------
    float or ndarray
        The speed, with the broadcast shape; never infinite.
    """
    # separate roots, because the product of δ and β may overflow
    across = 6.0 * math.sqrt(math.pi) * np.sqrt(delta) * np.sqrt(beta)
    return np.minimum(across + largest_forcing_slope(np.minimum(epsilon, FASTEST)), FASTEST)


@inline
def speed_unit(delta, epsilon, beta):
    """Return the speed difference that counts as a phase difference of 1; about 1 at (δ, ε, β) = (0.6, 0.1, 0.6)."""
    return natural_speed(delta, epsilon, beta) / 7.0


@inline
def decay_remainder64(x):
    """Return (e^(−x) − 1 + x)/x² for x in [−0.05, 2]."""
    return evaluate_degree_12(coefficients.DECAY, x)


@inline
def decay_remainder32(x):
    """Return (e^(−x) − 1 + x)/x² for x in [0, 2], in single precision."""
    return evaluate_degree_6(coefficients.DECAY_32, x)


def _build_flight_evaluation(dtype, decay, functions):
    """Build the kernel `evaluate` of the flight law for one precision, without branches, so that loops vectorise."""
    one, versines, sine_change_and_new_cosine = dtype(1.0), functions.versines, functions.sine_change_and_new_cosine
    drop_below_tangent_line, slope_loss_from_sine_change = (
        functions.drop_below_tangent_line,
        functions.slope_loss_from_sine_change,
    )
    add_acceleration_at_changed_phase = functions.add_acceleration_at_changed_phase

    @inline
    def evaluate(s, flight):
        """Evaluate a flight at time s; δs must be in [−0.05, 2] in double precision, in [0, 2] in single precision.

        Returns
        -------
        tuple of six floats
            F, F', F'', 1 − e^(−δs), and the forcing's sine and cosine at s.
        """
        w, a, sin0, cos0, delta, epsilon = flight
        step = versines(s)
        x = delta * s
        k = x * decay(x)  # k(δs)/(δs), with k(x) = e^(−x) − 1 + x
        lost = x * (one - k)  # 1 − e^(−δs)
        dsin, cos1 = sine_change_and_new_cosine(step, sin0, cos0)
        f0 = s * (w + a * k) - drop_below_tangent_line(step, sin0, cos0, epsilon)
        f1 = w + a * lost - slope_loss_from_sine_change(dsin, epsilon)
        f2 = add_acceleration_at_changed_phase(delta * a * (one - lost), sin0, dsin, cos1, epsilon)
        return f0, f1, f2, lost, sin0 + dsin, cos1

    return evaluate


evaluate_short = _build_flight_evaluation(np.float64, decay_remainder64, forcing.IN_DOUBLE)
evaluate32 = _build_flight_evaluation(np.float32, decay_remainder32, forcing.IN_SINGLE)


@inline
def flight_from_sine_cosine(w, sin0, cos0, delta, epsilon, drift):
    """Return a flight from a wall with velocity w, at the phase with sine sin0 and cosine cos0. drift: q of the law."""
    return Flight(w, add_slope(drift, sin0, cos0, epsilon) - w, sin0, cos0, delta, epsilon)


@inline
def flight_from_phase(tau, w, delta, epsilon, drift):
    """Return the flight that leaves a wall at phase tau with velocity w. drift: the constant q of the flight law."""
    sin0, cos0 = sine_cosine_at(tau)
    return flight_from_sine_cosine(w, sin0, cos0, delta, epsilon, drift)


@kernel
def evaluate(s, flight):
    """Return height F, F' and F'' of a flight at any time s, 1 − e^(−δs) and the forcing's sine and cosine at s."""
    w, a, sin0, cos0, delta, epsilon = flight
    x = delta * s
    f0, f1, f2, lost, sin1, cos1 = evaluate_short(s, flight)
    if -0.05 <= x <= LONGEST_DECAY:
        return f0, f1, f2, lost, sin1, cos1
    lost = -math.expm1(-x)
    f0 = w * s + a * ((x - lost) / delta) - drop_below_tangent_line(versines(s), sin0, cos0, epsilon)
    f1 = w + a * lost - slope_loss(sin0, cos0, sin1, cos1, epsilon)
    return f0, f1, second_derivative(lost, sin1, cos1, flight), lost, sin1, cos1


@inline
def second_derivative(lost, sin1, cos1, flight):
    """Return F'' of a flight at time s, from 1 − e^(−δs) and the forcing's sine and cosine at s."""
    return add_acceleration(flight.delta * flight.a * (1.0 - lost), sin1, cos1, flight.epsilon)


@inline
def third_derivative(lost, sin1, cos1, flight):
    """Return F''' of a flight at time s, from 1 − e^(−δs) and the forcing's sine and cosine at s."""
    delta = flight.delta
    return forcing.third_derivative(sin1, cos1, flight.epsilon) - delta * delta * flight.a * (1.0 - lost)


@inline
def fourth_derivative(lost, sin1, cos1, flight):
    """Return F⁗ of a flight at time s, from 1 − e^(−δs) and the forcing's sine and cosine at s."""
    delta = flight.delta
    return forcing.fourth_derivative(sin1, cos1, flight.epsilon) + delta * delta * delta * flight.a * (1.0 - lost)
