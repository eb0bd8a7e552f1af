"""The forcing e(t), and the contact force g(t) that it produces.

    Φ'' + δΦ' = g(t),    g(t) = δq + e''(t) + δe'(t),    e(t) = ε cos 2πt,    q = 4π

Kernels hold a phase as its sine and cosine, from which any harmonic follows. They take the forcing as the argument
`epsilon`: a number, the amplitude of one cosine. Another forcing is another type of this argument. For this type numba
compiles these functions again, and all kernels that call them, so that one cosine keeps its own fast code. Functions
take both sine and cosine of a phase, because a sum of harmonics needs both. `add_slope` and `add_acceleration` add to
a number, because the order of operations decides the stored bits. Code outside kernels uses `Forcing`.

These modules are valid for a forcing of one cosine only: A to D in closed form and their limits
(`rattle.impacting.orbits.closed_form`, `limits`), the single arc of negative contact force (`find_negative_force_arc`,
and the proofs of a first impact in `proof` that use it), contacts with stiff walls, which respond to one frequency
(`rattle.stiff.map.contact`), and `rattle.proof`.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import float32 as f32
from numpy.typing import ArrayLike, NDArray

from rattle.flight import coefficients
from rattle.numerics.compile import InlineFunction, inline, kernel
from rattle.numerics.polynomial import evaluate_degree_4, evaluate_degree_5, evaluate_degree_10

TWO_PI = 2.0 * math.pi
DRIFT = 4.0 * math.pi  # the number q of the equations; the mean contact force is δq
Q = f32(DRIFT)
W1, W2, W3, W4, W5 = (f32(TWO_PI**k) for k in range(1, 6))  # factors (2π)^k of the k-th derivatives
SIXTH = f32(TWO_PI**6 / 720)

Real = float | np.float32


class NegativeArc(NamedTuple):
    """The arc of phases where the contact force is negative, if it exists."""

    exists: bool
    exit_phase: Real  # phase at the end of the arc, where the force becomes positive again
    length: Real
    sin_entry: Real  # sine of 2π times the phase at the beginning of the arc
    sin_exit: Real


@inline
def versine_quotient64(q):
    """Return (1 − cos z)/z² for q = z², |z| ≤ π."""
    return evaluate_degree_10(coefficients.VERSINE, q)


@inline
def sine_defect_quotient64(q):
    """Return (z − sin z)/z³ for q = z², |z| ≤ π."""
    return evaluate_degree_10(coefficients.SINE_DEFECT, q)


@inline
def versine_quotient32(q):
    """Return (1 − cos z)/z² for q = z², |z| ≤ π, in single precision."""
    return evaluate_degree_5(coefficients.VERSINE_32, q)


@inline
def sine_defect_quotient32(q):
    """Return (z − sin z)/z³ for q = z², |z| ≤ π, in single precision."""
    return evaluate_degree_4(coefficients.SINE_DEFECT_32, q)


class FlightFunctions(NamedTuple):
    """The functions of the forcing that a flight needs, as inline kernels of one precision."""

    versines: InlineFunction
    sine_change_and_new_cosine: InlineFunction
    drop_below_tangent_line: InlineFunction
    slope_loss_from_sine_change: InlineFunction
    add_slope: InlineFunction
    add_acceleration: InlineFunction
    add_acceleration_at_changed_phase: InlineFunction


def _build_flight_functions(dtype, versine, sine_defect):
    """Build the functions of a flight in one precision, without branches, so that loops over flights vectorise."""
    two_pi = dtype(TWO_PI)
    rounder = dtype(1.5 * 2.0 ** (52 if dtype is np.float64 else 23))  # x + rounder − rounder is the nearest integer

    @inline
    def versines(s):
        """Return 1 − cos 2πs, sin 2πs and 2πs − sin 2πs, computed without cancellation."""
        turns = (s + rounder) - rounder
        z = two_pi * (s - turns)
        q = z * z
        defect = z * q * sine_defect(q)
        return q * versine(q), z - defect, two_pi * turns + defect

    @inline
    def sine_change_and_new_cosine(step, sin0, cos0):
        """Return the change of sin 2πt and the new cos 2πt after a time s; `step` is versines(s)."""
        omc, siny, _defect = step
        return cos0 * siny - sin0 * omc, cos0 - (cos0 * omc + sin0 * siny)

    @inline
    def drop_below_tangent_line(step, sin0, cos0, epsilon):
        """Return e(t₀) + s e'(t₀) − e(t₁), where e is the forcing and s = t₁ − t₀; `step` is versines(s)."""
        omc, _siny, defect = step
        return epsilon * (cos0 * omc - sin0 * defect)

    @inline
    def slope_loss_from_sine_change(dsin, epsilon):
        """Return e'(t₀) − e'(t₁) of the forcing e, from the change dsin of sin 2πt between the two times."""
        return (two_pi * epsilon) * dsin

    @inline
    def add_slope(x, sine, cosine, epsilon):
        """Return x + e', where e' is the derivative of the forcing at the phase with this sine and cosine."""
        return x - two_pi * epsilon * sine

    @inline
    def add_acceleration(x, sine, cosine, epsilon):
        """Return x + e'', e'' the second derivative of the forcing at the phase with this sine and cosine."""
        return x - two_pi * two_pi * epsilon * cosine

    @inline
    def add_acceleration_at_changed_phase(x, sin0, dsin, cos1, epsilon):
        """Return x + e'', where e is the forcing, at the phase with the cosine cos1 and the sine sin0 + dsin."""
        return x - two_pi * two_pi * epsilon * cos1

    return FlightFunctions(
        versines,
        sine_change_and_new_cosine,
        drop_below_tangent_line,
        slope_loss_from_sine_change,
        add_slope,
        add_acceleration,
        add_acceleration_at_changed_phase,
    )


IN_DOUBLE, IN_SINGLE = (
    _build_flight_functions(np.float64, versine_quotient64, sine_defect_quotient64),
    _build_flight_functions(np.float32, versine_quotient32, sine_defect_quotient32),
)
versines, sine_change_and_new_cosine = IN_DOUBLE.versines, IN_DOUBLE.sine_change_and_new_cosine
drop_below_tangent_line, slope_loss_from_sine_change = (
    IN_DOUBLE.drop_below_tangent_line,
    IN_DOUBLE.slope_loss_from_sine_change,
)
add_slope, add_acceleration, add_slope32 = IN_DOUBLE.add_slope, IN_DOUBLE.add_acceleration, IN_SINGLE.add_slope


@inline
def sine_cosine_at(tau):
    """Return the sine and cosine of 2πτ."""
    versine, sine, _defect = versines(tau)
    return sine, 1.0 - versine


@inline
def sine_cosine_by_math_library(tau):
    """Return the sine and cosine of 2πτ by the math library: exact to the last bit, slower than `sine_cosine_at`."""
    angle = TWO_PI * tau
    return math.sin(angle), math.cos(angle)


def sines_cosines_of_spaced_phases(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return sines and cosines (count,) of equally spaced phases that begin at 0."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.sin(angle), np.cos(angle)


@inline
def short_versine_and_sine(u):
    """Return 1 − cos 2πu and sin 2πu for a short time u, by Taylor series with errors below 1e-15 for u up to 1e-4."""
    y = TWO_PI * u
    return y * y * (0.5 - y * y * (1.0 / 24.0)), y * (1.0 - y * y * (1.0 / 6.0))


@inline
def advance_sine_and_cosine(step, sine, cosine):
    """Return the sine and cosine of a phase after a short time; step: `short_versine_and_sine` of this time."""
    omc, siny = step
    cosine1 = cosine - (siny * sine + omc * cosine)
    return sine + (siny * cosine - omc * sine), cosine1


@inline
def third_derivative(sine, cosine, epsilon):
    """Return the third derivative of the forcing."""
    return TWO_PI * TWO_PI * TWO_PI * epsilon * sine


@inline
def fourth_derivative(sine, cosine, epsilon):
    """Return the fourth derivative of the forcing."""
    return TWO_PI**4 * epsilon * cosine


@inline
def slope_loss(sin0, cos0, sin1, cos1, epsilon):
    """Return e'(t₀) − e'(t₁): by how much the derivative of the forcing falls from one phase to a later one."""
    return TWO_PI * epsilon * (sin1 - sin0)


@inline
def height_derivatives_by_departure_time(f_w, decay, sin0, cos0, sin1, cos1, epsilon):
    """Return the derivatives of a flight's F and F' with respect to the departure time, for a fixed duration.

    ∂F/∂t₀ = e'(t₁) − e'(t₀) − f_w e''(t₀) and ∂F'/∂t₀ = e''(t₁) − decay e''(t₀), with f_w = ∂F/∂w₀ and decay = ∂F'/∂w₀.

    Returns
    -------
    tuple[float, float]
        ∂F/∂t₀ and ∂F'/∂t₀.
    """
    force = TWO_PI * TWO_PI * epsilon
    return f_w * force * cos0 - slope_loss(sin0, cos0, sin1, cos1, epsilon), force * (decay * cos0 - cos1)


@inline
def largest_forcing_slope(epsilon):
    """Return the largest |e'|, e' the derivative of the forcing."""
    return TWO_PI * epsilon


# ---- the contact force


@inline
def contact_force(sine, cosine, delta, epsilon, drift):
    """Return the contact force g = Φ'' + δΦ' = δq + e'' + δe', q the drift. Where g > 0, it presses on Σ⁺."""
    return delta * drift - TWO_PI * epsilon * (TWO_PI * cosine + delta * sine)


@inline
def contact_force_rate(sine, cosine, delta, epsilon):
    """Return the derivative g' of the contact force with respect to time."""
    return TWO_PI * TWO_PI * epsilon * (TWO_PI * sine - delta * cosine)


@inline
def contact_force_amplitude(delta, epsilon):
    """Return the amplitude of the contact force: its largest deviation from its mean."""
    return TWO_PI * epsilon * math.hypot(TWO_PI, delta)


@inline
def relative_force_amplitude(delta, epsilon):
    """Return the amplitude of the contact force divided by its mean. Above 1 the force changes sign."""
    return epsilon * math.hypot(TWO_PI, delta) / (2.0 * delta)


@inline
def has_force_amplitude_above(share, delta, epsilon):
    """Return whether the amplitude of the contact force exceeds `share` times its mean."""
    return epsilon * math.hypot(TWO_PI, delta) > share * 2.0 * delta


@inline
def relative_contact_force(swing, share):
    """Return the contact force divided by its mean, `share` half periods away from the phase of the least force.

    swing: the amplitude of the contact force divided by its mean, as `relative_force_amplitude` returns it.

    Returns
    -------
    float
        Negative where the force points into the gap.
    """
    return 1.0 - swing * math.cos(math.pi * share)


@inline
def phase_of_least_force(delta):
    """Return the phase at which the contact force is least."""
    return math.atan2(delta, TWO_PI) / TWO_PI


@inline
def force_fourier_coefficients(wall, sin0, cos0, delta, epsilon):
    """Return mean, a and b of the contact force mean + a cos 2πs + b sin 2πs at a time s after a phase.

    sin0, cos0: sine and cosine of 2πτ at the phase τ.

    Returns
    -------
    tuple[float, float, float]
        Mean, a and b. A positive force presses on the wall.
    """
    size = wall * TWO_PI * epsilon
    a = -size * (TWO_PI * cos0 + delta * sin0)
    return wall * abs(delta) * DRIFT, a, size * (TWO_PI * sin0 - delta * cos0)


@inline
def force_integral(duration, mean, a, b):
    """Return the integral of the force mean + a cos 2πs + b sin 2πs from s = 0 to `duration`."""
    omc, sine, _defect = versines(duration)
    return mean * duration + (a * sine + b * omc) / TWO_PI


@kernel
def find_negative_force_arc(delta, epsilon):
    """Return the arc of phases where the contact force is negative; a forcing of one cosine has at most one.

    g = δq − 2πε (2π cos θ + δ sin θ) < 0 means cos(θ − φ) > δq / (2πε √(4π² + δ²)) with φ = atan2(δ, 2π).

    Returns
    -------
    NegativeArc
        Its field `exists` is False, and the others are 0, if the force keeps its sign.
    """
    largest = contact_force_amplitude(delta, epsilon)
    mean = abs(delta) * DRIFT
    if not largest > mean:
        return NegativeArc(False, 0.0, 0.0, 0.0, 0.0)
    middle, half = math.atan2(delta, TWO_PI), math.acos(mean / largest)
    leave = (middle + half) / TWO_PI
    return NegativeArc(
        True, leave - math.floor(leave), half / math.pi, math.sin(middle - half), math.sin(middle + half)
    )


# ---- guesses and proofs in single precision


@inline
def mean_cosine32(angle, sin0, cos0):
    """Return an estimate of the mean of cos 2πt over the time angle/2π after a phase, for angle ≤ 2π."""
    square = angle * angle
    return (
        evaluate_degree_4(coefficients.MEAN_COSINE_32, square) * cos0
        - angle * evaluate_degree_4(coefficients.MEAN_SINE_32, square) * sin0
    )


@inline
def add_mean_acceleration32(x, mean_cosine, epsilon):
    """Return x + the mean of e'', e the forcing, over a time in which the mean of cos 2πt is `mean_cosine`."""
    return x - W2 * epsilon * mean_cosine


@inline
def forcing_third_derivative32(sine, cosine, epsilon):
    """Return the third derivative of the forcing, in single precision."""
    return W3 * epsilon * sine


@inline
def forcing_fourth_derivative32(sine, cosine, epsilon):
    """Return the fourth derivative of the forcing, in single precision."""
    return W4 * epsilon * cosine


@inline
def minus_forcing_fifth_derivative32(sine, cosine, epsilon):
    """Return minus the fifth derivative of the forcing, in single precision."""
    return W5 * epsilon * sine


@inline
def forcing_remainder_bound32(s):
    """Return an upper bound of |e(t + s) − e(t) − s e'(t)|/ε, e the forcing. Bounds of rounding errors of F use it."""
    y = W1 * s
    return min(y * y * (f32(0.5) + y * f32(1 / 6)), y + f32(3.0))


@inline
def coarse_forcing_remainder_bound32(s, epsilon):
    """Return an upper bound of |e(t + s) − e(t) − s e'(t)|, e the forcing.

    ε times `forcing_remainder_bound32` is a closer bound, but takes longer to compute.

    Returns
    -------
    float
        The bound, in the unit of Φ.
    """
    return epsilon * (W1 * s + f32(3.0))


@inline
def forcing_slope_range32(epsilon):
    """Return the largest difference e'(t₁) − e'(t₀) of the forcing's derivative between two times."""
    return f32(2.0) * W1 * epsilon


@inline
def largest_slope_loss32(sin0, cos0, epsilon):
    """Return the largest e'(t₀) − e'(t₁) of the forcing for any later time t₁; sin0 and cos0 belong to t₀."""
    return W1 * epsilon * (f32(1.0) - sin0)


@inline
def largest_acceleration32(epsilon):
    """Return the largest |e''|, e'' the second derivative of the forcing."""
    return W2 * epsilon


@inline
def largest_sixth_coefficient32(epsilon):
    """Return the largest |e⁽⁶⁾|/720, e⁽⁶⁾ the sixth derivative of the forcing."""
    return SIXTH * epsilon


@inline
def sine_changes_to_arc32(inside, sin0, arc):
    """Return the changes of sin 2πτ from a departure to the beginning and to the end of the arc of negative force.

    sin0: sin 2πτ at the departure. inside: whether the departure is inside the arc; then the first change is 0, because
    the arc has begun.

    Returns
    -------
    tuple[float, float]
        The change to the beginning of the arc, and the change to its end.
    """
    return (sin0 if inside else arc.sin_entry) - sin0, arc.sin_exit - sin0


@inline
def add_slope_change32(x, dsin, epsilon):
    """Return x plus the change of the forcing's derivative e' if the sine of the phase changes by `dsin`."""
    return x - W1 * epsilon * dsin


# ---- functions of complex times, whose imaginary parts carry exact derivatives (`rattle.flight.between`)


@inline
def complex_sine_cosine(z):
    """Return sin z and cos z of a complex number."""
    sine, cosine, cosh, sinh = math.sin(z.real), math.cos(z.real), math.cosh(z.imag), math.sinh(z.imag)
    return complex(sine * cosh, cosine * sinh), complex(cosine * cosh, -sine * sinh)


@inline
def sine_cosine_of_complex_time(t):
    """Return the sine and cosine of 2πt for a complex time t."""
    return complex_sine_cosine(TWO_PI * t)


@inline
def analytic_forcing_change(t0, t1, s, epsilon):
    """Return the change e(t₁) − e(t₀) of the forcing at complex times, without cancellation; s = t₁ − t₀."""
    return epsilon * (-2.0 * complex_sine_cosine(math.pi * (t0 + t1))[0] * complex_sine_cosine(math.pi * s)[0])


@inline
def add_analytic_acceleration(x, sine, cosine, epsilon):
    """Return x + e'' for the forcing e and complex sine and cosine. Do not reorder the products: it changes results."""
    return x - TWO_PI * (TWO_PI * epsilon) * cosine


@inline
def force_fourier_coefficients_of_complex_phase(sign, sin0, cos0, delta, epsilon):
    """Return mean, a and b of the force on a wall, mean + a cos 2πs + b sin 2πs; the time s counts from a phase.

    `force_fourier_coefficients` returns the same numbers for a real phase. sign: the wall, ±1. sin0, cos0: complex sine
    and cosine of the phase. δ must be above 0.

    Returns
    -------
    tuple
        mean (real), a and b (complex).
    """
    size = sign * TWO_PI * epsilon
    mean = sign * 2 * TWO_PI * delta
    return mean, -size * (TWO_PI * cos0 + delta * sin0), size * (TWO_PI * sin0 - delta * cos0)


@inline
def forcing_change_per_epsilon(t0, t1, s):
    """Return ∂(e(t₁) − e(t₀))/∂ε for the forcing e. t0, t1: real (not complex) times; s: t₁ − t₀."""
    return -2.0 * math.sin(math.pi * (t0 + t1)) * math.sin(math.pi * s)


@inline
def forcing_slope_per_epsilon(sine, cosine):
    """Return ∂e'/∂ε, e the forcing, at the time whose phase has this sine and cosine (real, not complex)."""
    return -TWO_PI * sine


@dataclass(frozen=True)
class Forcing:
    """The forcing for code outside kernels: one cosine whose amplitude epsilon is a number or an array.

    ONE_COSINE is True for this forcing. A gear whose forcing has ONE_COSINE = False has no closed forms of A to D.
    """

    epsilon: Any

    ONE_COSINE: ClassVar[bool] = True

    def relative_force_amplitude(self, delta: ArrayLike) -> NDArray[np.float64]:
        """Return the amplitude of the contact force divided by its mean. Above 1 the force changes sign."""
        return np.asarray(0.5 * (self.epsilon * np.hypot(TWO_PI, delta) / np.asarray(delta)))

    def least_force(self, delta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the smallest contact force of a period."""
        return np.asarray(2 * TWO_PI * delta - TWO_PI * self.epsilon * np.hypot(TWO_PI, delta))

    def spectral_lines(self, delta: float) -> list[tuple[float, complex]]:
        """Return (ω, a) of each term a e^(iωt) of the contact force, the mean (ω = 0) first; ω is in rad per period."""
        size = self.epsilon * complex(-0.5 * TWO_PI**2, 0.5 * TWO_PI * delta)
        return [(0.0, complex(mean_contact_force(delta))), (TWO_PI, size), (-TWO_PI, size.conjugate())]

    def quiet_limit_residuals(self, time: NDArray, delta: NDArray) -> NDArray:
        """Return g/2π and g'/4π²ε at times (…), g the contact force: the two residuals of the quiet limit.

        At the quiet limit the least contact force is 0, so both numbers are 0 at the time of this least force.

        Returns
        -------
        ndarray, (…, 2)
            The two numbers.
        """
        sine, cosine = np.sin(TWO_PI * time), np.cos(TWO_PI * time)
        force = 2 * delta - self.epsilon * (TWO_PI * cosine + delta * sine)
        return np.stack([force, TWO_PI * sine - delta * cosine], axis=-1)


@inline
def mean_contact_force(delta: Any) -> Any:
    """Return the mean contact force δq, which balances the impulses of a periodic motion over each period."""
    return delta * DRIFT


def quiet_eccentricity(delta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest ε at which the contact force is nowhere negative, 2δ/√(4π² + δ²)."""
    return np.asarray(2 * delta / np.hypot(2 * np.pi, delta))


def damping_at_quiet_limit(epsilon: float) -> float:
    """Return the δ at which the minimum of the contact force is 0, inf if ε ≥ 2: inverse of `quiet_eccentricity`."""
    return TWO_PI * epsilon / math.sqrt(4.0 - epsilon * epsilon) if epsilon < 2.0 else math.inf


def phase_of_arc_entry(delta: float, share: float) -> float:
    """Return the phase at which the contact force becomes negative. share: the quiet limit divided by ε, at most 1.

    This is the entry into the arc of phases with a negative force.

    Returns
    -------
    float
        The phase, in forcing periods.
    """
    return float((np.arctan2(delta, 2 * np.pi) - np.arccos(share)) / (2 * np.pi))
