"""Polynomials of fixed degree by Estrin's scheme, whose short chains let a processor compute several terms at once.

c holds the coefficients, lowest power first; c and x have one type, float32 or float64.
"""

from rattle.numerics.compile import inline


@inline
def evaluate_degree_4(c, x):
    """Return the polynomial c₀ + … + c₄ x⁴."""
    x2 = x * x
    return (c[0] + c[1] * x) + x2 * ((c[2] + c[3] * x) + x2 * c[4])


@inline
def evaluate_degree_5(c, x):
    """Return the polynomial c₀ + … + c₅ x⁵."""
    x2 = x * x
    return (c[0] + c[1] * x) + x2 * ((c[2] + c[3] * x) + x2 * (c[4] + c[5] * x))


@inline
def evaluate_degree_6(c, x):
    """Return the polynomial c₀ + … + c₆ x⁶."""
    x2 = x * x
    return (c[0] + c[1] * x) + x2 * ((c[2] + c[3] * x) + x2 * ((c[4] + c[5] * x) + x2 * c[6]))


@inline
def evaluate_degree_10(c, x):
    """Return the polynomial c₀ + … + c₁₀ x¹⁰."""
    x2 = x * x
    x4 = x2 * x2
    low = (c[0] + c[1] * x) + x2 * (c[2] + c[3] * x)
    middle = (c[4] + c[5] * x) + x2 * (c[6] + c[7] * x)
    high = (c[8] + c[9] * x) + x2 * c[10]
    return low + x4 * (middle + x4 * high)


@inline
def evaluate_degree_12(c, x):
    """Return the polynomial c₀ + … + c₁₂ x¹²."""
    x2 = x * x
    x4 = x2 * x2
    first = (c[0] + c[1] * x) + x2 * (c[2] + c[3] * x)
    second = (c[4] + c[5] * x) + x2 * (c[6] + c[7] * x)
    third = (c[8] + c[9] * x) + x2 * (c[10] + c[11] * x)
    return first + x4 * (second + x4 * (third + x4 * c[12]))
