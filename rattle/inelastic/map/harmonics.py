"""The forcing as a sum of harmonics, the contact force that it produces, and the zeros of this force (compiled).

    e(t) = Σ a cos 2π(k t + φ),    g(t) = δq + e''(t) + δe'(t)

Here k is the order of a harmonic, a its amplitude, φ its phase in turns, and q the drift, 4π (1 + load). The zeros of g
cut a flight into pieces on which Φ has at most one extremum, and contact phases end at zeros of g. These zeros are
computed once for each parameter point, with a proof that none is missed (`isolate_force_zeros`).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import TWO_PI, sine_cosine_at
from rattle.numerics.compile import inline, kernel

ORDER, AMPLITUDE, PHASE = range(3)  # rows of an array of harmonics (3, K)
CLOSEST = 1e-9  # distance in phase below which two zeros of g may be missed or count as one
# largest number of intervals that wait to be searched: each halving adds one interval, and 30 halvings reach CLOSEST
MOST_INTERVALS = 64


class ForcingBounds(NamedTuple):
    """Upper bounds over a period of derivatives of the contact force g and of the forcing e.

    force_derivative: bound of |g'|. force_second_derivative: bound of |g''|. forcing_third_derivative: bound of |e'''|.
    """

    force_derivative: float
    force_second_derivative: float
    forcing_third_derivative: float


@inline
def contact_force_and_rate(tau, delta, drift, harmonics):
    """Return the contact force g and its derivative g' at phase tau."""
    force, rate = delta * drift, 0.0
    for j in range(harmonics.shape[1]):
        turn = TWO_PI * harmonics[ORDER, j]
        sine, cosine = sine_cosine_at(harmonics[ORDER, j] * tau + harmonics[PHASE, j])
        size = turn * harmonics[AMPLITUDE, j]
        force -= size * (turn * cosine + delta * sine)
        rate += size * turn * (turn * sine - delta * cosine)
    return force, rate


@inline
def forcing_derivative_bounds(delta, harmonics):
    """Return upper bounds of |g'|, |g''| and |e'''| (g: contact force, e: forcing), each the sum over the harmonics."""
    rate, bend, third = 0.0, 0.0, 0.0
    for j in range(harmonics.shape[1]):
        turn = TWO_PI * harmonics[ORDER, j]
        size = abs(harmonics[AMPLITUDE, j]) * turn
        rate += size * turn * math.hypot(turn, delta)
        bend += size * turn * turn * math.hypot(turn, delta)
        third += size * turn * turn
    return ForcingBounds(rate, bend, third)


@kernel
def force_zero_between(low, high, falling, delta, drift, harmonics):
    """Return the phase in (low, high) at which the contact force is 0; the force is monotone there and changes sign."""
    t = 0.5 * (low + high)
    for _ in range(100):
        force, rate = contact_force_and_rate(t, delta, drift, harmonics)
        if (force > 0.0) == falling:
            low = t
        else:
            high = t
        new = t - force / rate
        if not (low < new < high):
            new = 0.5 * (low + high)
        if new == t or not (low < new < high):
            return new
        t = new
    return t


@kernel
def isolate_force_zeros(delta, drift, harmonics, zeros):
    """Write the phases in [0, 1) at which the contact force g changes sign to `zeros`, in rising order.

    An interval with centre c and half-width h is halved until one of two conditions holds: g has no zero on it, because
    |g(c)| > h |g'(c)| + h² max|g''|/2; or g is monotone on it, because |g'(c)| > h max|g''|, so that the signs at its
    ends decide between no zero and one. The signs at the ends also decide for an interval narrower than `CLOSEST`. So
    two zeros can be missed only if they are closer than `CLOSEST`, and then |g| < 1e-18 max|g''| between them.

    Returns
    -------
    count : int
        The number of zeros.
    positive : bool
        Whether g is positive at phase 0.
    """
    bend = forcing_derivative_bounds(delta, harmonics).force_second_derivative
    positive = contact_force_and_rate(0.0, delta, drift, harmonics)[0] > 0.0
    low, high = np.empty(MOST_INTERVALS), np.empty(MOST_INTERVALS)
    low[0], high[0] = 0.0, 1.0
    waiting, found, before = 1, 0, positive
    while waiting > 0:
        waiting -= 1
        left, right = low[waiting], high[waiting]
        middle, half = 0.5 * (left + right), 0.5 * (right - left)
        force, rate = contact_force_and_rate(middle, delta, drift, harmonics)
        if abs(force) > half * (abs(rate) + 0.5 * half * bend):
            continue
        if half > 0.5 * CLOSEST and not abs(rate) > half * bend:
            low[waiting], high[waiting] = middle, right
            low[waiting + 1], high[waiting + 1] = left, middle
            waiting += 2
            continue
        after = positive if right == 1.0 else contact_force_and_rate(right, delta, drift, harmonics)[0] > 0.0
        if after != before:
            at = middle
            if abs(rate) > half * bend:
                at = force_zero_between(left, right, before, delta, drift, harmonics)
            zeros[found] = at
            found += 1
            before = after
    return found, positive


def max_zero_count(harmonics: NDArray[np.float64]) -> int:
    """Return the largest possible number of zeros of the contact force in a period: twice the highest order."""
    return 2 * int(harmonics[ORDER].max())


def harmonics_at_unit_epsilon(harmonics: Any) -> NDArray[np.float64]:
    """Return the shape (3, K) of a forcing: its K harmonics at ε = 1, the first harmonic and the given ones.

    Parameters
    ----------
    harmonics : sequence of (int, float, float)
        Order, amplitude relative to the first harmonic, and phase in turns. A harmonic of order 1 replaces the first.

    Returns
    -------
    ndarray, (3, K)
        Orders, amplitudes and phases.
    """
    given = [(float(order), size, phase) for order, size, phase in harmonics]
    rows = given if given and given[0][0] == 1.0 else [(1.0, 1.0, 0.0), *given]
    return np.ascontiguousarray(np.array(rows).T)
