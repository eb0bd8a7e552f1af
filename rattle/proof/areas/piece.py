"""A piece of the (δ, ε) plane in ball arithmetic, and enclosures of functions over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rattle.proof.balls import arb, arb_series

#: A part of a flight that is shorter than this, in forcing periods, is not bisected again: then the proof fails.
SHORTEST_PART = arb(2.0**-12)


@dataclass(frozen=True)
class PlanePiece:
    """A piece of the plane: all δ and ε of two balls, at one β."""

    delta: arb
    epsilon: arb
    beta: arb


def lower_end(x: arb) -> arb:
    """Return a lower bound of a ball: no number of the ball is smaller."""
    return x.lower()


def upper_end(x: arb) -> arb:
    """Return an upper bound of a ball: no number of the ball is larger."""
    return x.upper()


def hull(a: arb, b: arb) -> arb:
    """Return a ball that contains two balls and all numbers between them."""
    return a.union(b)


def mean_value_enclosure(function: Callable[[arb_series], arb_series], at: arb) -> arb:
    """Return an enclosure of the function `function` over the ball `at`, by the mean value theorem.

    Returns
    -------
    arb
        function(c) + function'(at) (at − c), where c is the midpoint of `at`.
    """
    middle = at.mid()
    return function(arb_series([middle]))[0] + function(arb_series([at, 1]))[1] * (at - middle)
