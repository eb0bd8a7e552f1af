"""Free flight between the walls in closed form (compiled).

A flight leaves a wall (+1: Φ = β, −1: Φ = −β) with phase τ and velocity w. With θ = 2πτ, A = q − 2πε sin θ − w and
k(x) = e^(−x) − 1 + x, equation (3.1) of Mason and Piiroinen (2009) becomes, free of cancellation for short flights,

    F(s) = Φ(s) − Φ(0) = w s + A k(δs)/δ − ε [cos θ (1 − cos 2πs) − sin θ (2πs − sin 2πs)].

q = 4π is the mean drift. Running time backwards is the same law with δ → −δ, q → −q, τ → −τ, w → −w, so one kernel
serves both directions.
"""

import math

import numpy as np

from rattle._compile import kernel

TWO_PI = 2.0 * math.pi
DRIFT = 4.0 * math.pi

# Taylor coefficients, highest power first. With z ∈ [−π, π] and |x| ≤ 1 the first term left out is below 1e-17 of the
# sum.
VERSINE = tuple((-1.0) ** k / math.factorial(2 * k + 2) for k in range(13, -1, -1))  # (1 − cos z)/z² in z²
SINE_DEFECT = tuple((-1.0) ** k / math.factorial(2 * k + 3) for k in range(13, -1, -1))  # (z − sin z)/z³ in z²
DECAY_DEFECT = tuple((-1.0) ** k / math.factorial(k + 2) for k in range(16, -1, -1))  # (e^(−x) − 1 + x)/x² in x


@kernel
def folded(tau):
    """The phase in [0, 1); a tiny negative one would round up to 1."""
    fraction = tau - math.floor(tau)
    return fraction if fraction < 1.0 else 0.0


@kernel
def polynomial(even, odd, x):
    """even(x²) + x odd(x²): two independent Horner chains halve the wait of one."""
    square = x * x
    first, second = 0.0, 0.0
    for c in even:
        first = first * square + c
    for c in odd:
        second = second * square + c
    return first + x * second


@kernel
def versines(s):
    """1 − cos 2πs, sin 2πs and 2πs − sin 2πs, none with cancellation."""
    turns = np.rint(s)
    z = TWO_PI * (s - turns)
    q = z * z
    defect = z * q * polynomial(SINE_DEFECT[1::2], SINE_DEFECT[::2], q)
    return q * polynomial(VERSINE[1::2], VERSINE[::2], q), z - defect, TWO_PI * turns + defect


@kernel
def decay_defect(x):
    """k(x) = e^(−x) − 1 + x without cancellation."""
    if abs(x) > 1.0:
        return math.expm1(-x) + x
    return x * x * polynomial(DECAY_DEFECT[::2], DECAY_DEFECT[1::2], x)


@kernel
def evaluate(s, w, a, sin0, cos0, delta, epsilon):
    """F, F' and F'' after s, with e^(−δs) and the forcing's sine and cosine there."""
    omc, siny, defect = versines(s)
    x = delta * s
    k = decay_defect(x)
    lost = x - k
    dsin = cos0 * siny - sin0 * omc
    sin1 = sin0 + dsin
    cos1 = cos0 - (cos0 * omc + sin0 * siny)
    f0 = w * s + a * k / delta - epsilon * (cos0 * omc - sin0 * defect)
    f1 = w + a * lost - TWO_PI * epsilon * dsin
    f2 = delta * a * (1.0 - lost) - TWO_PI * TWO_PI * epsilon * cos1
    return f0, f1, f2, 1.0 - lost, sin1, cos1


@kernel
def third_derivative(a, decay, sin1, delta, epsilon):
    """F''' from the same exponential and sine."""
    return TWO_PI * TWO_PI * TWO_PI * epsilon * sin1 - delta * delta * a * decay
