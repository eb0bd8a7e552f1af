"""A piece of the plane in balls, and enclosures over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rattle.proof.balls import arb, arb_series

FINEST = arb(2.0**-12)  # part of a flight, in periods; what is not told of it counts as not told


@dataclass(frozen=True)
class PlanePiece:
    """A piece of the plane: all δ and ε of two balls, at one β."""

    delta: arb
    epsilon: arb
    beta: arb


def lower(x: arb) -> arb:
    """Return no number of the ball is below this one."""
    return x.lower()


def upper(x: arb) -> arb:
    """Return no number of the ball is above this one."""
    return x.upper()


def hull(a: arb, b: arb) -> arb:
    """Return a ball that holds both and all between."""
    return a.union(b)


def centred(of: Callable[[arb_series], arb_series], at: arb) -> arb:
    """Return of(x) over a ball of x, by the mean value theorem: of(middle) + of'(x)(x − middle)."""
    middle = at.mid()
    return of(arb_series([middle]))[0] + of(arb_series([at, 1]))[1] * (at - middle)
