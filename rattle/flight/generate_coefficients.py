"""Write coefficients.py: `python -m rattle.flight.generate_coefficients > rattle/flight/coefficients.py`.

Each polynomial interpolates its function at Chebyshev nodes, computed in 60 digits (mpmath). Its error is within a few
per cent of that of the best approximation. The coefficients are then rounded to the precision in which they are used.
The stated bound is the largest error of the rounded polynomial, evaluated exactly on a fine grid: the absolute error of
polynomials whose name begins with MEAN, the relative error of all others. Evaluation in that precision adds a few
rounding errors.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np

HEADER = '''"""Polynomials of the flight law, lowest power first. Written by rattle/flight/generate_coefficients.py."""

import numpy as np
'''
GRID = 500
TERMS = 60


class PolynomialSpec(NamedTuple):
    """A function, and the interval, degree and precision of the polynomial that approximates this function."""

    name: str
    formula: str
    function: Callable[[Any], Any]
    low: Any
    high: Any
    degree: int
    real: type[np.floating]


def factorial_series(start: int, step: int, x: Any) -> Any:
    """Return Σ (−x)^k / (step·k + start)!, exact to 45 digits: for |x| ≤ 40 if step is 2, for |x| ≤ 2 if step is 1."""
    total, term = mp.mpf(0), mp.mpf(1) / mp.factorial(start)
    for k in range(TERMS):
        total += term
        for j in range(step):
            term /= step * k + start + j + 1
        term *= -x
    return total


def polynomial_specs() -> list[PolynomialSpec]:
    """Return all polynomials of the kernels.

    Kernels reduce a time s to z = 2π(s − n), where n is the integer nearest to s. So z is in [−π, π] and z² in [0, π²].

    Returns
    -------
    list of PolynomialSpec
        The polynomials, in the order of coefficients.py.
    """
    decay, versine, defect, sine = (partial(factorial_series, *x) for x in ((2, 1), (2, 2), (3, 2), (1, 2)))
    square = mp.pi**2
    return [
        PolynomialSpec("DECAY", "(e^(−x) − 1 + x)/x² in x", decay, mp.mpf("-0.05"), 2, 12, np.float64),
        PolynomialSpec("VERSINE", "(1 − cos z)/z² in z²", versine, 0, square, 10, np.float64),
        PolynomialSpec("SINE_DEFECT", "(z − sin z)/z³ in z²", defect, 0, square, 10, np.float64),
        PolynomialSpec("DECAY_32", "(e^(−x) − 1 + x)/x² in x", decay, 0, 2, 6, np.float32),
        PolynomialSpec("VERSINE_32", "(1 − cos z)/z² in z²", versine, 0, square, 5, np.float32),
        PolynomialSpec("SINE_DEFECT_32", "(z − sin z)/z³ in z²", defect, 0, square, 4, np.float32),
        PolynomialSpec(
            "MEAN_COSINE_32", "sin y/y in y², y in [0, 2π], for guesses", sine, 0, 4 * square, 4, np.float32
        ),
        PolynomialSpec("MEAN_SINE_32", "(1 − cos y)/y² in y², for guesses", versine, 0, 4 * square, 4, np.float32),
    ]


def interpolate_coefficients(p: PolynomialSpec) -> list[np.floating]:
    """Return the rounded coefficients of the polynomial that equals `p.function` at the Chebyshev nodes."""
    n = p.degree + 1
    nodes = [(p.low + p.high + (p.high - p.low) * mp.cos(mp.pi * (2 * k + 1) / (2 * n))) / 2 for k in range(n)]
    matrix, values = mp.matrix(n, n), mp.matrix(n, 1)
    for i, x in enumerate(nodes):
        values[i] = p.function(x)
        for j in range(n):
            matrix[i, j] = x**j
    return [p.real(str(mp.nstr(c, 25))) for c in mp.lu_solve(matrix, values)]


def largest_approximation_error(p: PolynomialSpec, rounded: list[np.floating]) -> Any:
    """Return the largest error of the polynomial with these coefficients, on a grid over its interval.

    Returns
    -------
    mpf
        The absolute error if the name of the polynomial begins with MEAN, else the relative error.
    """
    worst, powers = mp.mpf(0), [mp.mpf(float(c)) for c in reversed(rounded)]
    for i in range(GRID + 1):
        x = p.low + (p.high - p.low) * mp.mpf(i) / GRID
        true = p.function(x)
        size = 1 if p.name.startswith("MEAN") else abs(true)
        value = mp.mpf(0)
        for c in powers:  # mpmath.polyval takes coefficients in an order that differs between releases
            value = value * x + c
        worst = max(worst, abs(value - true) / size)
    return worst


def coefficients_module_text() -> str:
    """Return the text of rattle/flight/coefficients.py."""
    lines = [HEADER]
    with mp.workdps(60):
        for p in polynomial_specs():
            found = interpolate_coefficients(p)
            kind = "absolute" if p.name.startswith("MEAN") else "relative"
            interval = f"[{mp.nstr(mp.mpf(p.low), 5)}, {mp.nstr(mp.mpf(p.high), 5)}]"
            lines.append(
                f"# {p.formula}, on {interval}: {kind} error below "
                f"{mp.nstr(largest_approximation_error(p, found) * 1.01, 2)}"
            )
            rows = [f"    {float(c)!r}," if p.real is np.float64 else f"    np.float32({c!s})," for c in found]
            lines.append("\n".join([f"{p.name} = (", *rows, ")"]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(coefficients_module_text(), end="")
