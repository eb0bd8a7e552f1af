"""Krawczyk's operator: existence and uniqueness of a zero in a box."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.errors import NotProvedError
from rattle.proof.balls import arb, arb_mat, around, ball, nearest, tight

#: Half-widths of boxes, tried in this order: the largest says most.
RADII = tuple(Fraction(1, 10**k) for k in (11, 13, 15, 17, 20))
PLACES = 28  # to which centres are rounded
MOST_REPEATED = 12  # times that the operator is applied to what it gave, which then is tight
MOST_MOVED = 1e-9  # what rounding may have left of a computed motion


class Evaluated(Protocol):
    """n equations in n unknowns, somewhere, in balls."""

    @property
    def residual(self) -> list[arb]:
        """R (n,)."""

    @property
    def jacobian(self) -> arb_mat:
        """∂R/∂x (n, n)."""


Equations = Callable[[Sequence[arb]], Evaluated]


@dataclass(frozen=True)
class Enclosure:
    """An enclosure: one zero, and only one, lies in the box centre ± radius; it lies in the balls `zero` (n,)."""

    centre: list[Fraction]
    radius: Fraction
    zero: list[arb]


def enclosed(equations: Equations, start: NDArray[np.float64]) -> Enclosure:
    """Return the zero near a computed one.

    K(X) = c − C R(c) + (1 − C ∂R(X)) (X − c) inside X proves it, whatever C is, and K(X) holds the zero: R. Krawczyk,
    Computing 4 (1969) 187–201.

    Returns
    -------
    Enclosure
        The enclosure.

    Raises
    ------
    NotProvedError
        Also if that is farther away than rounding can have left.
    """
    about, centre = refined_zero(equations, start)
    x = [ball(each) for each in centre]
    step, small = about * column(equations(x).residual), tight()
    for radius in RADII:
        limit = ball(radius)
        moved = _moved(equations, x, step, about, [around(Fraction(0), radius)] * len(x))
        if all(abs(each) < limit for each in moved):
            for _ in range(MOST_REPEATED):
                if all(each.rad() < small for each in moved):
                    break
                moved = _moved(equations, x, step, about, moved)  # which holds the zero as well, and is smaller
            return Enclosure(centre, radius, [a + b for a, b in zip(x, moved, strict=True)])
    raise NotProvedError("no box about the motion is mapped into itself: it is too close to a bifurcation")


def refined_zero(equations: Equations, start: NDArray[np.float64]) -> tuple[arb_mat, list[Fraction]]:
    """Return an approximate inverse of ∂R/∂x at a computed zero, and the zero after two steps of Newton's method.

    Then all of its places follow from the equations alone, not from how a machine adds doubles.

    Returns
    -------
    tuple[arb_mat, list[Fraction]]
        The inverse (n, n), and the zero (n,).

    Raises
    ------
    NotProvedError
        If the Jacobian is singular.
    """
    x = [arb(float(each)) for each in start]
    here = equations(x)
    about = inverse(here.jacobian)
    step = (about * column(here.residual)).entries()
    moved = max(abs(float(each)) for each in step)
    if not moved < MOST_MOVED:
        raise NotProvedError(f"the nearest motion that solves the equations is not this one, but {moved:.1e} away")
    x = [(a - b).mid() for a, b in zip(x, step, strict=True)]
    step = (about * column(equations(x).residual)).entries()
    return about, [nearest(a - b, PLACES) for a, b in zip(x, step, strict=True)]


def inverse(matrix: arb_mat) -> arb_mat:
    """About the inverse (n, n) of a matrix, in doubles."""
    middle = np.array([[float(each) for each in row] for row in matrix.tolist()])
    try:
        found = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        found = np.full(middle.shape, np.nan)
    if not np.isfinite(found).all():
        raise NotProvedError("the equations of the motion are singular")
    return arb_mat(found.tolist())


def column(entries: Sequence[arb]) -> arb_mat:
    """Return a vector (n, 1)."""
    return arb_mat(len(entries), 1, list(entries))


def _moved(equations: Equations, x: Sequence[arb], step: arb_mat, about: arb_mat, box: Sequence[arb]) -> list[arb]:
    """K(x + box) − x, where step = C R(x)."""
    n = len(x)
    unit = arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    jacobian = equations([a + b for a, b in zip(x, box, strict=True)]).jacobian
    return ((unit - about * jacobian) * column(box) - step).entries()
