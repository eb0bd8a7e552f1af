"""Interval arithmetic of the checker, and numbers with their derivatives with respect to the time s and the damping δ.

The operations + − × ÷ and roots are mpmath's. Its values of pi, sin and cos are widened by 2⁻⁶⁰, and those of exp by
the relative amount 2⁻⁶⁰.
"""

import re
from fractions import Fraction
from typing import Any

from mpmath.ctx_iv import MPIntervalContext

Interval = Any
IV = MPIntervalContext()
IV.prec = 80
ZERO, ONE, SLACK = IV.mpf(0), IV.mpf(1), IV.mpf([-(2.0**-60), 2.0**-60])
PI = IV.pi + SLACK
NUMBER = re.compile(r"\d{1,40}(\.\d{1,100}|/[1-9]\d{0,100})?")


class BlockRefusal(Exception):  # noqa: N818 - a refusal is an answer of the checker, not a fault
    """The claim of a block is not proved; the message says why."""


def require(ok: Any, why: str) -> None:
    """Raise BlockRefusal with the message `why` unless ok."""
    if not ok:
        raise BlockRefusal(why)


def number_from_text(text: str) -> Fraction:
    """Return the number ≥ 0 that a text states exactly, as a decimal or a ratio. Raises BlockRefusal."""
    require(bool(NUMBER.fullmatch(text)), f"{text[:40]!r} must be a decimal or a ratio of integers, and not negative")
    return Fraction(text)


def interval_between(low: Fraction, high: Fraction) -> Interval:
    """Return a narrow interval that contains two exact numbers and all numbers between them."""
    first, last = (IV.mpf(x.numerator) / IV.mpf(x.denominator) for x in (low, high))
    return IV.mpf([first.a, last.b])


def is_certainly_less(x: Any, y: Any) -> bool:
    """Return whether every number of x is below every number of y; False if an end is not a number."""
    try:
        return bool((x - y).b < 0)
    except ValueError:
        return False


def multiply_enclosures(x: Interval, y: Interval) -> Interval:
    """Return the product of two enclosures; if one of them is the constant ZERO, return ZERO without computing it."""
    return ZERO if x is ZERO or y is ZERO else x * y


def add_enclosures(x: Interval, y: Interval) -> Interval:
    """Return the sum of two enclosures; if one of them is the constant ZERO, return the other without computing it."""
    return y if x is ZERO else x if y is ZERO else x + y


class Jet:
    """A number x with its derivatives with respect to the time s (`s`) and to the damping δ (`d`), all as intervals."""

    __slots__ = ("d", "s", "x")

    def __init__(self, x: Interval, s: Interval = ZERO, d: Interval = ZERO) -> None:
        self.x, self.s, self.d = x, s, d

    def __add__(self, y: Any) -> "Jet":
        """Return this number plus y, a Jet or a constant."""
        if not isinstance(y, Jet):
            return Jet(self.x + y, self.s, self.d)
        return Jet(self.x + y.x, add_enclosures(self.s, y.s), add_enclosures(self.d, y.d))

    def __mul__(self, y: Any) -> "Jet":
        """Return this number times y, a Jet or a constant."""
        if not isinstance(y, Jet):
            return Jet(self.x * y, multiply_enclosures(self.s, y), multiply_enclosures(self.d, y))
        s, d = (
            add_enclosures(multiply_enclosures(a, y.x), multiply_enclosures(self.x, b))
            for a, b in ((self.s, y.s), (self.d, y.d))
        )
        return Jet(self.x * y.x, s, d)

    def __neg__(self) -> "Jet":
        """Return minus this number."""
        return Jet(-self.x, ZERO if self.s is ZERO else -self.s, ZERO if self.d is ZERO else -self.d)

    def __sub__(self, y: Any) -> "Jet":
        """Return this number minus y, a Jet or a constant."""
        return self + -y

    def __rsub__(self, y: Any) -> "Jet":
        """Return the constant y minus this number."""
        return -self + y

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, y: "Jet") -> "Jet":
        """Return this number divided by the Jet y."""
        x = self.x / y.x
        s, d = (add_enclosures(a, -multiply_enclosures(x, b)) for a, b in ((self.s, y.s), (self.d, y.d)))
        return Jet(x, ZERO if s is ZERO else s / y.x, ZERO if d is ZERO else d / y.x)

    def apply_chain_rule(self, x: Interval, slope: Interval) -> "Jet":
        """Return f(self) with its derivatives, by the chain rule; x and slope are the values of f and f' at self."""
        return Jet(x, multiply_enclosures(slope, self.s), multiply_enclosures(slope, self.d))

    def exp_of_negative(self) -> "Jet":
        """Return e^(−x), x being this number, with its derivatives."""
        x = exp_of_negative(self.x)
        return self.apply_chain_rule(x, -x)

    def sine_and_cosine(self, factor: int) -> "tuple[Jet, Jet]":
        """Return the sine and the cosine of factor · πx, for this number x."""
        sine, cosine = sine_and_cosine_of(factor * PI * self.x)
        return self.apply_chain_rule(sine, factor * PI * cosine), self.apply_chain_rule(cosine, -factor * PI * sine)


def midpoint(x: Interval) -> Interval:
    """Return the middle of an interval, as an interval of width 0."""
    return IV.mpf(x.mid)


def sine_and_cosine_of(angle: Interval) -> tuple[Interval, Interval]:
    """Return the sine and the cosine of an angle in radians."""
    return IV.sin(angle) + SLACK, IV.cos(angle) + SLACK


def exp_of_negative(x: Interval) -> Interval:
    """Return an enclosure of e^(−x)."""
    return IV.exp(-x) * (1 + SLACK)


def contact_force_enclosure(d: Any, cosine: Any, sine: Any) -> Any:
    """Return the contact force g at damping d and a time t, from cosine = ε cos 2πt and sine = ε sin 2πt."""
    return d * (4 * PI) - cosine * (4 * PI**2) - d * sine * (2 * PI)


class ParameterBox:
    """A rectangle of s and δ, over which functions are enclosed by the mean value theorem.

    jets: s and δ over the rectangle; centre: s and δ at its centre.
    """

    def __init__(self, s: Interval, d: Interval) -> None:
        self.s, self.d = s, d
        self.ds, self.dd = s - midpoint(s), d - midpoint(d)
        self.jets, self.centre = (Jet(s, s=ONE), Jet(d, d=ONE)), (Jet(midpoint(s)), Jet(midpoint(d)))

    def enclose_by_mean_value(self, centre: Interval, function: Jet) -> Interval:
        """Return an enclosure of a function over the rectangle.

        centre: its value at the centre. function: its values and derivatives over the rectangle.

        Returns
        -------
        Interval
            The enclosure by the mean value theorem.
        """
        return centre + function.s * self.ds + function.d * self.dd
