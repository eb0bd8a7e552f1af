"""Interval arithmetic, and intervals with their derivatives by s and δ.

The operations + − × ÷ and roots are mpmath's. Its pi, exp, sin and cos are widened by 2⁻⁶⁰.
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


class BlockRefused(Exception):  # noqa: N818 - it is an answer, no fault
    """The certificate of a block is not proved; the message gives the reason."""


def require(ok: Any, why: str) -> None:
    """Raise BlockRefused with the reason `why` unless `ok` is true."""
    if not ok:
        raise BlockRefused(why)


def exact(text: str) -> Fraction:
    """Return the fraction that a text stands for exactly."""
    require(bool(NUMBER.fullmatch(text)), f"{text[:40]!r} is not an exact number of at least 0")
    return Fraction(text)


def interval_between(low: Fraction, high: Fraction) -> Interval:
    """Return the interval from low to high."""
    first, last = (IV.mpf(x.numerator) / IV.mpf(x.denominator) for x in (low, high))
    return IV.mpf([first.a, last.b])


def less(x: Any, y: Any) -> bool:
    """Return whether every number of x is below every number of y. NaN is below nothing."""
    try:
        return bool((x - y).b < 0)
    except ValueError:
        return False


def times(x: Interval, y: Interval) -> Interval:
    """Return the product of two enclosures. Most derivatives are exactly 0, which skips the work."""
    return ZERO if x is ZERO or y is ZERO else x * y


def plus(x: Interval, y: Interval) -> Interval:
    """Return the sum of two enclosures. Most derivatives are exactly 0, which skips the work."""
    return y if x is ZERO else x if y is ZERO else x + y


class Jet:
    """A function's value x and its derivatives by s and by δ, as intervals."""

    __slots__ = ("d", "s", "x")

    def __init__(self, x: Interval, s: Interval = ZERO, d: Interval = ZERO) -> None:
        self.x, self.s, self.d = x, s, d

    def __add__(self, y: Any) -> "Jet":
        """Return the sum."""
        if not isinstance(y, Jet):
            return Jet(self.x + y, self.s, self.d)
        return Jet(self.x + y.x, plus(self.s, y.s), plus(self.d, y.d))

    def __mul__(self, y: Any) -> "Jet":
        """Return the product."""
        if not isinstance(y, Jet):
            return Jet(self.x * y, times(self.s, y), times(self.d, y))
        s, d = (plus(times(a, y.x), times(self.x, b)) for a, b in ((self.s, y.s), (self.d, y.d)))
        return Jet(self.x * y.x, s, d)

    def __neg__(self) -> "Jet":
        """Return the negative."""
        return Jet(-self.x, ZERO if self.s is ZERO else -self.s, ZERO if self.d is ZERO else -self.d)

    def __sub__(self, y: Any) -> "Jet":
        """Return the difference."""
        return self + -y

    def __rsub__(self, y: Any) -> "Jet":
        """Return the difference."""
        return -self + y

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, y: "Jet") -> "Jet":
        """Return the quotient."""
        x = self.x / y.x
        s, d = (plus(a, -times(x, b)) for a, b in ((self.s, y.s), (self.d, y.d)))
        return Jet(x, ZERO if s is ZERO else s / y.x, ZERO if d is ZERO else d / y.x)

    def of(self, x: Interval, slope: Interval) -> "Jet":
        """Return f(self) from the value and the derivative of f (chain rule)."""
        return Jet(x, times(slope, self.s), times(slope, self.d))

    def decay(self) -> "Jet":
        """Return e^(−self)."""
        x = decayed(self.x)
        return self.of(x, -x)

    def turn(self, half: int) -> "tuple[Jet, Jet]":
        """Return the sine and cosine of half · π · self."""
        sine, cosine = sine_and_cosine_of(half * PI * self.x)
        return self.of(sine, half * PI * cosine), self.of(cosine, -half * PI * sine)


def middle(x: Interval) -> Interval:
    """Return the midpoint of an interval as an interval."""
    return IV.mpf(x.mid)


def sine_and_cosine_of(angle: Interval) -> tuple[Interval, Interval]:
    """Enclose the sine and cosine of an angle in radians."""
    return IV.sin(angle) + SLACK, IV.cos(angle) + SLACK


def decayed(x: Interval) -> Interval:
    """Enclose e^(−x)."""
    return IV.exp(-x) * (1 + SLACK)


def force(d: Any, cosine: Any, sine: Any) -> Any:
    """Return the contact force g at the time when ε cos 2πt = cosine and ε sin 2πt = sine."""
    return d * (4 * PI) - cosine * (4 * PI**2) - d * sine * (2 * PI)


class ParameterBox:
    """A box of s and δ over which functions are enclosed by the mean value theorem."""

    def __init__(self, s: Interval, d: Interval) -> None:
        self.s, self.d = s, d
        self.ds, self.dd = s - middle(s), d - middle(d)
        self.jets, self.centre = (Jet(s, s=ONE), Jet(d, d=ONE)), (Jet(middle(s)), Jet(middle(d)))

    def about(self, centre: Interval, over: Jet) -> Interval:
        """Enclose a function from its value at the midpoint and its derivatives over the box."""
        return centre + over.s * self.ds + over.d * self.dd
