"""An adiabatic criterion for a bouncing motion that is certain to become quiet.

If ε is below the quiet limit, the contact force g(t) = 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt is positive for all t. A
bounce of speed v lasts 2v/g. While this duration is much shorter than a forcing period, I = v³/g(t) at the impacts is
an adiabatic invariant, which damping multiplies by e^(−δ) per period (and so v by e^(−δ/3)). Impacts are points of
time-reversal symmetry, so the error of I is of second order in

    η = max over t of (v/g) · max(|g'|/g, π, δ)    with v = (I g)^(1/3).

The net change of ln I per period beyond −δ is exponentially small: it was measured to be at most about 10 e^(−1.9/η)
for any δ and ε. A motion is certain to become quiet once η is so small that this change is below δ/2, and once its
bounces are lower than half the gap: I then falls in every period, and η with it. docs/decisions/0003-quiet-capture.md
has the measurement, and a test repeats it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import (
    DRIFT,
    Forcing,
    contact_force,
    contact_force_amplitude,
    contact_force_rate,
    sines_cosines_of_spaced_phases,
)
from rattle.numerics.compile import kernel

Array = NDArray[np.float64]

# PHASES: number of phases at which the contact force is sampled. ABREAST: number of maxima that are kept side by side,
# so that the loop over phases can use vector instructions.
PHASES, ABREAST = 2048, 16
SINES, COSINES = sines_cosines_of_spaced_phases(PHASES)
LARGEST_ETA = 0.5  # the bound 10 e^(−1.9/η), which was measured (see the top of this file), is used up to this η
# the constants of 10 e^(−1.9/η), the measured bound of the change of ln I in a period (see the top of this file)
KICK, DECAY_RATE = 10.0, 1.9
# `most_impacts_until_quiet` is LONGEST_REST from the damping STRONG on, and grows below STRONG, up to MOST_REST
LONGEST_REST, STRONG, MOST_REST = 2048.0, 0.3, 2.0**18


@kernel
def largest_eta(delta):
    """Return the largest η at which a motion is certain to become quiet.

    η is defined at the top of this file. It is small if a bounce is short compared with the times in which the contact
    force, the forcing and damping change the motion.

    Returns
    -------
    float
        The limit of η.
    """
    if delta >= 2.0 * KICK * math.exp(-DECAY_RATE / LARGEST_ETA):
        return LARGEST_ETA
    return DECAY_RATE / math.log(2.0 * KICK / delta)


@kernel
def capture_invariant_limit_kernel(delta, epsilon, beta, largest):
    """Return the result of `capture_invariant_limit` to callers in kernels. `largest` (ABREAST,) is scratch memory."""
    smallest = DRIFT * delta - contact_force_amplitude(delta, epsilon)
    if smallest <= 0.0:
        return 0.0
    rate = max(math.pi, delta)
    for j in range(ABREAST):
        largest[j] = 0.0  # becomes the maximum of η³/I over the phases with the indices j, j + ABREAST, …
    for i in range(0, PHASES, ABREAST):
        for j in range(ABREAST):
            cosine, sine = COSINES[i + j], SINES[i + j]
            g = max(contact_force(sine, cosine, delta, epsilon, DRIFT), smallest)
            r = max(abs(contact_force_rate(sine, cosine, delta, epsilon)) / g, rate)
            largest[j] = max(largest[j], r * r * r / (g * g))
    fastest = 0.0
    for j in range(ABREAST):
        fastest = max(fastest, largest[j])
    low = (2.0 * beta) ** 1.5 * math.sqrt(smallest)  # a bounce is lower than half the gap if v²/2g ≤ β
    eta = largest_eta(delta)
    return min(eta * eta * eta / fastest, low)


@kernel
def fill_capture_invariant_limits(delta, epsilon, beta, largest, found):
    """Write the results of `capture_invariant_limit` to `found` (n,). `largest` (ABREAST,) is scratch memory."""
    for i in range(delta.size):
        found[i] = capture_invariant_limit_kernel(delta[i], epsilon[i], beta[i], largest)


def capture_invariant_limits(delta: Array, epsilon: Array, beta: Array) -> Array:
    """Return `capture_invariant_limit` for each of n parameter points; delta, epsilon and beta have the shape (n,)."""
    found = np.zeros(delta.size)
    fill_capture_invariant_limits(delta, epsilon, beta, np.zeros(ABREAST), found)
    return found


def capture_invariant_limit(delta: float, epsilon: float, beta: float) -> float:
    """Return the largest v³/g at which a bounce is certain to become quiet; 0 if no quiet motion exists.

    v is the speed of the bounce, and g the contact force at its impact.

    Returns
    -------
    float
        The limit of v³/g.
    """
    return float(capture_invariant_limits(*(np.array([x]) for x in (delta, epsilon, beta)))[0])


def capture_speed(delta: float, epsilon: float, beta: float) -> float:
    """Return the impact speed below which every motion is certain to become quiet; 0 from the quiet limit on."""
    return float(capture_speeds(*(np.array([x]) for x in (delta, epsilon, beta)))[0])


def capture_speeds(delta: Array, epsilon: Array, beta: Array) -> Array:
    """Return the results of `capture_speed` at flat arrays of parameters."""
    smallest = Forcing(epsilon).least_force(delta)
    return np.asarray(
        (capture_invariant_limits(delta, epsilon, beta) * np.maximum(smallest, 0.0)) ** (1 / 3), np.float64
    )


def impacts_until_quiet(delta: Array, epsilon: Array, beta: Array) -> Array:
    """Estimate the number of impacts until quiet motion is certain, for flat arrays; inf from the quiet limit on.

    At speed v a period has 2πδ/v impacts, and v falls by e^(−δ/3) per period. This gives 6π/v_c impacts down to the
    capture speed v_c (`capture_speed`).

    Returns
    -------
    Array
        Numbers of impacts, not rounded.
    """
    with np.errstate(divide="ignore"):
        return 6.0 * np.pi / capture_speeds(delta, epsilon, beta)


def most_impacts_until_quiet(delta: Array) -> Array:
    """Return the number of impacts until quiet above which a quiet motion may look chaotic, at flat arrays of δ.

    The limit is 2048 impacts from δ = 0.3 on. Below, it grows with the relaxation time 1/δ, up to MOST_REST impacts,
    which take a few milliseconds to compute.

    Returns
    -------
    Array
        Numbers of impacts, not rounded.
    """
    return np.asarray(np.minimum(LONGEST_REST * np.maximum(1.0, STRONG / delta), MOST_REST), np.float64)


def becomes_quiet_late(delta: Array, epsilon: Array, beta: Array) -> NDArray[np.bool_]:
    """Return whether `impacts_until_quiet` exceeds `most_impacts_until_quiet`, so that quiet motions may look chaotic.

    Returns
    -------
    NDArray[np.bool_]
        False also from the quiet limit on, where no motion becomes quiet.
    """
    needed = impacts_until_quiet(delta, epsilon, beta)
    return np.isfinite(needed) & (needed > most_impacts_until_quiet(delta))
