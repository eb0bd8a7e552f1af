"""Free flight between the walls in closed form (compiled), in double and in single precision.

A flight leaves a wall (+1: Φ = β, −1: Φ = −β) with phase τ and velocity w. With θ = 2πτ, A = q − 2πε sin θ − w and
k(x) = e^(−x) − 1 + x, equation (3.1) of Mason and Piiroinen (2009) becomes, free of cancellation for short flights,

    F(s) = Φ(s) − Φ(0) = w s + A k(δs)/δ − ε [cos θ (1 − cos 2πs) − sin θ (2πs − sin 2πs)].

q = 4π is the mean drift. Running time backwards is the same law with δ → −δ, q → −q, τ → −τ, w → −w, so one kernel
serves both directions.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.flight import coefficients
from rattle.numerics.compile import inline, kernel
from rattle.numerics.polynomial import degree_4, degree_5, degree_6, degree_10, degree_12

TWO_PI = 2.0 * math.pi
DRIFT = 4.0 * math.pi
FASTEST = 1e100  # natural speed: of parameters beyond it nothing can be computed
LONGEST_DECAY = 2.0  # largest δs of the polynomials

Real = float | np.float32


class Flight(NamedTuple):
    """What F of one flight is made of, in double or in single precision."""

    w: Real  # velocity of departure
    a: Real  # A = q − 2πε sin θ − w
    sin0: Real  # of the forcing at the departure
    cos0: Real
    delta: Real
    epsilon: Real


class Arc(NamedTuple):
    """The phases where the contact force is negative, if there are any."""

    exists: bool
    leave: Real  # its end
    length: Real
    sin_entry: Real  # of 2π its beginning
    sin_exit: Real


@inline
def folded(tau):
    """The phase in [0, 1); a tiny negative one would round up to 1."""
    fraction = tau - np.floor(tau)
    return fraction if fraction < 1.0 else 0.0


@inline
def wrapped(difference):
    """A phase difference in [−1/2, 1/2]."""
    return difference - np.rint(difference)


@inline
def contact_force(sine, cosine, delta, epsilon, drift):
    """g = Φ'' + δΦ' = δq − 2πε (2π cos θ + δ sin θ), which presses on Σ⁺ where it is positive."""
    return delta * drift - TWO_PI * epsilon * (TWO_PI * cosine + delta * sine)


@inline
def natural_speed(delta, epsilon, beta):
    """The speeds that motions have, 7 at (0.6, 0.1, 0.6) to a part in 700: √(16πδβ) is reached across the gap under the
    drift, 2πε is the largest speed of the forcing.
    """
    across = 6.0 * math.sqrt(math.pi) * np.sqrt(delta) * np.sqrt(beta)  # the product of both may be beyond all numbers
    return np.minimum(across + TWO_PI * np.minimum(epsilon, FASTEST), FASTEST)


@inline
def speed_unit(delta, epsilon, beta):
    """What a distance of speeds is measured in, beside phases: 1 at (0.6, 0.1, 0.6)."""
    return natural_speed(delta, epsilon, beta) / 7.0


@inline
def decay64(x):
    """(e^(−x) − 1 + x)/x², x in [−0.05, 2]."""
    return degree_12(coefficients.DECAY, x)


@inline
def versine64(q):
    """(1 − cos z)/z² for q = z², |z| ≤ π."""
    return degree_10(coefficients.VERSINE, q)


@inline
def sine_defect64(q):
    """(z − sin z)/z³ for q = z², |z| ≤ π."""
    return degree_10(coefficients.SINE_DEFECT, q)


@inline
def decay32(x):
    """As decay64, x in [0, 2]."""
    return degree_6(coefficients.DECAY_32, x)


@inline
def versine32(q):
    """As versine64."""
    return degree_5(coefficients.VERSINE_32, q)


@inline
def sine_defect32(q):
    """As sine_defect64."""
    return degree_4(coefficients.SINE_DEFECT_32, q)


def _law(real, decay, versine, sine_defect):
    """The flight law in one precision: two inline kernels, straight-line code that a loop over flights vectorises."""
    one, two_pi = real(1.0), real(TWO_PI)
    rounder = real(1.5 * 2.0 ** (52 if real is np.float64 else 23))  # x + rounder − rounder is the nearest integer

    @inline
    def versines(s):
        """1 − cos 2πs, sin 2πs and 2πs − sin 2πs, none with cancellation."""
        turns = (s + rounder) - rounder
        z = two_pi * (s - turns)
        q = z * z
        defect = z * q * sine_defect(q)
        return q * versine(q), z - defect, two_pi * turns + defect

    @inline
    def evaluate(s, flight):
        """F, F' and F'' after s, with 1 − e^(−δs) and the forcing's sine and cosine there; δs in [−0.05, 2]."""
        w, a, sin0, cos0, delta, epsilon = flight
        omc, siny, defect = versines(s)
        x = delta * s
        k = x * decay(x)  # k(δs)/(δs)
        lost = x * (one - k)  # 1 − e^(−δs)
        dsin = cos0 * siny - sin0 * omc
        cos1 = cos0 - (cos0 * omc + sin0 * siny)
        f0 = s * (w + a * k) - epsilon * (cos0 * omc - sin0 * defect)
        f1 = w + a * lost - (two_pi * epsilon) * dsin
        f2 = delta * a * (one - lost) - (two_pi * two_pi * epsilon) * cos1
        return f0, f1, f2, lost, sin0 + dsin, cos1

    return versines, evaluate


versines, evaluate_short = _law(np.float64, decay64, versine64, sine_defect64)
versines32, evaluate32 = _law(np.float32, decay32, versine32, sine_defect32)


@inline
def leaving(tau, w, delta, epsilon, drift):
    """The flight that leaves a wall at this phase with this velocity."""
    versine, sin0, _defect = versines(tau)
    return Flight(w, drift - TWO_PI * epsilon * sin0 - w, sin0, 1.0 - versine, delta, epsilon)


@kernel
def evaluate(s, flight):
    """As `evaluate_short`, for any δs."""
    w, a, sin0, cos0, delta, epsilon = flight
    x = delta * s
    f0, f1, f2, lost, sin1, cos1 = evaluate_short(s, flight)
    if -0.05 <= x <= LONGEST_DECAY:
        return f0, f1, f2, lost, sin1, cos1
    omc, _siny, defect = versines(s)
    lost = -math.expm1(-x)
    f0 = w * s + a * ((x - lost) / delta) - epsilon * (cos0 * omc - sin0 * defect)
    f1 = w + a * lost - TWO_PI * epsilon * (sin1 - sin0)
    return f0, f1, second_derivative(lost, cos1, flight), lost, sin1, cos1


@inline
def second_derivative(lost, cos1, flight):
    """F'' from 1 − e^(−δs) and the forcing's cosine after s."""
    return flight.delta * flight.a * (1.0 - lost) - TWO_PI * TWO_PI * flight.epsilon * cos1


@inline
def third_derivative(lost, sin1, flight):
    """F''' likewise."""
    delta = flight.delta
    return TWO_PI * TWO_PI * TWO_PI * flight.epsilon * sin1 - delta * delta * flight.a * (1.0 - lost)


@inline
def fourth_derivative(lost, cos1, flight):
    """F⁗ likewise."""
    delta = flight.delta
    return TWO_PI**4 * flight.epsilon * cos1 + delta * delta * delta * flight.a * (1.0 - lost)


@kernel
def negative_arc(delta, epsilon):
    """The phases where the contact force is negative.

    g = δq − 2πε (2π cos θ + δ sin θ) < 0 means cos(θ − φ) > δq / (2πε √(4π² + δ²)) with φ = atan2(δ, 2π).
    """
    largest = TWO_PI * epsilon * math.hypot(TWO_PI, delta)
    mean = abs(delta) * DRIFT
    if not largest > mean:
        return Arc(False, 0.0, 0.0, 0.0, 0.0)
    middle, half = math.atan2(delta, TWO_PI), math.acos(mean / largest)
    leave = (middle + half) / TWO_PI
    return Arc(True, leave - math.floor(leave), half / math.pi, math.sin(middle - half), math.sin(middle + half))
