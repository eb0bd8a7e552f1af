"""Krawczyk's operator: prove that a box holds exactly one zero of n equations (lemma 2 of docs/proofs.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.errors import NotProvedError
from rattle.proof.balls import arb, arb_mat, around, ball, nearest, tight

#: Half-widths of boxes, tried in this order. The largest box gives the strongest theorem.
RADII = tuple(Fraction(1, 10**k) for k in (11, 13, 15, 17, 20))
PLACES = 28  # decimals to which centres are rounded
MOST_REPEATED = 12  # most applications of the operator to its own result, which tighten it
MOST_MOVED = 1e-9  # largest distance between a computed motion and the exact one


class Evaluated(Protocol):
    """The values and the Jacobian of n equations at n unknowns, in balls."""

    @property
    def residual(self) -> list[arb]:
        """Values R (n,) of the equations."""

    @property
    def jacobian(self) -> arb_mat:
        """Jacobian ∂R/∂x (n, n)."""


Equations = Callable[[Sequence[arb]], Evaluated]


@dataclass(frozen=True)
class Enclosure:
    """The box centre ± radius holds exactly one zero, which lies in the balls `zero` (n,)."""

    centre: list[Fraction]
    radius: Fraction
    zero: list[arb]


def enclosed(equations: Equations, start: NDArray[np.float64]) -> Enclosure:
    """Prove that exactly one zero lies near a computed one.

    The operator is, for any matrix C,

        K(X) = c − C R(c) + (1 − C ∂R(X)) (X − c).

    If K(X) lies inside the box X, the box holds exactly one zero, and K(X) holds it. Source: R. Krawczyk, Computing 4
    (1969) 187–201.

    Returns
    -------
    Enclosure
        The box and the enclosed zero.

    Raises
    ------
    NotProvedError
        If no box is mapped into itself, or the zero is farther away than rounding allows.
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
                moved = _moved(equations, x, step, about, moved)  # the image holds the zero as well, and is smaller
            return Enclosure(centre, radius, [a + b for a, b in zip(x, moved, strict=True)])
    raise NotProvedError(
        "Krawczyk's operator maps no box about the motion into itself; the motion is too close to a bifurcation"
    )


def refined_zero(equations: Equations, start: NDArray[np.float64]) -> tuple[arb_mat, list[Fraction]]:
    """Improve a computed zero by two steps of Newton's method, and return an approximate inverse of ∂R/∂x.

    After two steps all decimals depend on the equations alone, not on how a machine rounds doubles.

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
        raise NotProvedError(
            f"the nearest exact motion is {moved:.1e} away, farther than rounding of the computed one explains"
        )
    x = [(a - b).mid() for a, b in zip(x, step, strict=True)]
    step = (about * column(equations(x).residual)).entries()
    return about, [nearest(a - b, PLACES) for a, b in zip(x, step, strict=True)]


def inverse(matrix: arb_mat) -> arb_mat:
    """Return an approximate inverse (n, n) of a matrix, computed in doubles."""
    middle = np.array([[float(each) for each in row] for row in matrix.tolist()])
    try:
        found = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        found = np.full(middle.shape, np.nan)
    if not np.isfinite(found).all():
        raise NotProvedError("the equations of the motion are singular")
    return arb_mat(found.tolist())


def column(entries: Sequence[arb]) -> arb_mat:
    """Return a vector as a matrix (n, 1)."""
    return arb_mat(len(entries), 1, list(entries))


def _moved(equations: Equations, x: Sequence[arb], step: arb_mat, about: arb_mat, box: Sequence[arb]) -> list[arb]:
    """Return K(x + box) − x, where step = C R(x)."""
    n = len(x)
    unit = arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    jacobian = equations([a + b for a, b in zip(x, box, strict=True)]).jacobian
    return ((unit - about * jacobian) * column(box) - step).entries()
