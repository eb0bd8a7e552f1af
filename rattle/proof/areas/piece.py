"""A piece of the (δ, ε) plane in balls, and enclosures of functions over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rattle.proof.balls import arb, arb_series

FINEST = arb(2.0**-12)  # shortest part of a flight, in forcing periods; if it is undecided, so is the flight


@dataclass(frozen=True)
class PlanePiece:
    """All δ and ε of two balls, at one half-backlash β."""

    delta: arb
    epsilon: arb
    beta: arb


def lower(x: arb) -> arb:
    """Return a lower bound of all numbers of a ball."""
    return x.lower()


def upper(x: arb) -> arb:
    """Return an upper bound of all numbers of a ball."""
    return x.upper()


def hull(a: arb, b: arb) -> arb:
    """Return a ball that holds two balls and all numbers between them."""
    return a.union(b)


def centred(of: Callable[[arb_series], arb_series], at: arb) -> arb:
    """Enclose a function over a ball by the mean value theorem: f(c) + f'(x)(x − c), where c is the midpoint of x."""
    middle = at.mid()
    return of(arb_series([middle]))[0] + of(arb_series([at, 1]))[1] * (at - middle)
