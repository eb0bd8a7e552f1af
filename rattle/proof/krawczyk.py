"""Krawczyk's operator: it proves that equations have exactly one zero in a box (Lemma 2 of docs/proofs.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.errors import NotProvedError
from rattle.proof.balls import arb, arb_mat, ball, interval_ball, negligible_radius, rounded_midpoint

#: Half-widths of the boxes, the largest first, because uniqueness in a larger box says more.
RADII = tuple(Fraction(1, 10**k) for k in (11, 13, 15, 17, 20))
#: Decimals to which the centre of a box is rounded.
PLACES = 28
#: Largest number of times that the operator is applied to its own result to make the enclosure narrower.
MOST_REPETITIONS = 12
#: Largest plausible rounding error of an unknown of a computed motion. The proof fails if the proved zero, or the first
#: step of Newton's method, is farther from the computed motion.
MOST_MOVED = 1e-9


class EvaluatedEquations(Protocol):
    """The value and the derivative of n equations in n unknowns x, over balls of x."""

    @property
    def residual(self) -> list[arb]:
        """The residual R (n,), which is 0 at a solution."""

    @property
    def jacobian(self) -> arb_mat:
        """The Jacobian ∂R/∂x (n, n)."""


Equations = Callable[[Sequence[arb]], EvaluatedEquations]


@dataclass(frozen=True)
class ZeroEnclosure:
    """An enclosure: exactly one zero lies in the box centre ± radius, and it lies in the balls `zero` (n,)."""

    centre: list[Fraction]
    radius: Fraction
    zero: list[arb]


def enclose_zero(equations: Equations, start: NDArray[np.float64]) -> ZeroEnclosure:
    """Return a proved enclosure of the zero near a computed zero.

    Let R be the residual of the equations, X a box with the centre c, and C any matrix. If the box
    K(X) = c − C R(c) + (1 − C ∂R(X)) (X − c) lies inside X, then X has exactly one zero, and K(X) contains it:
    R. Krawczyk, Computing 4 (1969) 187–201.

    Parameters
    ----------
    equations : Equations
        The equations, as a function of balls.
    start : NDArray[np.float64]
        The computed zero (n,), in doubles.

    Returns
    -------
    ZeroEnclosure
        The box and the enclosure of its zero.

    Raises
    ------
    NotProvedError
        If no box is mapped into itself, or if the proved zero is farther from `start` than MOST_MOVED.
    """
    inverse, centre = refine_zero(equations, start)
    x = [ball(each) for each in centre]
    step, small = inverse * column_vector(equations(x).residual), negligible_radius()
    for radius in RADII:
        limit = ball(radius)
        moved = _krawczyk_image(equations, x, step, inverse, [interval_ball(Fraction(0), radius)] * len(x))
        if all(abs(each) < limit for each in moved):
            for _ in range(MOST_REPETITIONS):
                if all(each.rad() < small for each in moved):
                    break
                # each image contains the zero, because the box that is mapped contains it
                moved = _krawczyk_image(equations, x, step, inverse, moved)
            return ZeroEnclosure(centre, radius, [a + b for a, b in zip(x, moved, strict=True)])
    raise NotProvedError(
        "no box around the computed solution is proved to contain exactly one solution: its equations are almost "
        "singular (for a motion, next to a bifurcation), or its numbers are not exact enough"
    )


def refine_zero(equations: Equations, start: NDArray[np.float64]) -> tuple[arb_mat, list[Fraction]]:
    """Return an approximate inverse of ∂R/∂x at a computed zero, and the zero after two steps of Newton's method.

    After two steps all PLACES decimals follow from the equations, so they do not depend on how a processor rounds.

    Returns
    -------
    tuple[arb_mat, list[Fraction]]
        The inverse (n, n), and the zero (n,).

    Raises
    ------
    NotProvedError
        If the Jacobian is singular, or the first step of Newton's method is longer than MOST_MOVED.
    """
    x = [arb(float(each)) for each in start]
    here = equations(x)
    inverse = approximate_inverse(here.jacobian)
    step = (inverse * column_vector(here.residual)).entries()
    moved = max(abs(float(each)) for each in step)
    if not moved < MOST_MOVED:
        raise NotProvedError(
            f"the nearest exact solution is {moved:.1e} away from the computed motion: compute the motion again"
        )
    x = [(a - b).mid() for a, b in zip(x, step, strict=True)]
    step = (inverse * column_vector(equations(x).residual)).entries()
    return inverse, [rounded_midpoint(a - b, PLACES) for a, b in zip(x, step, strict=True)]


def approximate_inverse(matrix: arb_mat) -> arb_mat:
    """Return an approximate inverse (n, n), computed in doubles. Raises NotProvedError if the matrix is singular."""
    middle = np.array([[float(each) for each in row] for row in matrix.tolist()])
    try:
        found = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        found = np.full(middle.shape, np.nan)
    if not np.isfinite(found).all():
        raise NotProvedError("the Jacobian of the equations is singular or not finite (for a motion, at a bifurcation)")
    return arb_mat(found.tolist())


def column_vector(entries: Sequence[arb]) -> arb_mat:
    """Return the entries (n,) as a column vector (n, 1)."""
    return arb_mat(len(entries), 1, list(entries))


def _krawczyk_image(
    equations: Equations, x: Sequence[arb], step: arb_mat, inverse: arb_mat, box: Sequence[arb]
) -> list[arb]:
    """Return K(x + box) − x for Krawczyk's operator K, which `enclose_zero` defines.

    inverse: the matrix C of K, an approximate inverse of the Jacobian. step: C R(x), with the residual R.

    Returns
    -------
    list[arb]
        Balls (n,).
    """
    n = len(x)
    unit = arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    jacobian = equations([a + b for a, b in zip(x, box, strict=True)]).jacobian
    return ((unit - inverse * jacobian) * column_vector(box) - step).entries()
