"""Ball arithmetic: every operation encloses what it stands for (python-flint, which the extra `proof` installs).

A comparison of balls is true if it holds for all of their numbers, so what cannot be told is refused: `not (x > 0)`.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

from rattle.errors import MissingExtraError

try:
    import flint
    from flint import arb, arb_mat, arb_series, ctx, fmpq
except ImportError as error:
    raise MissingExtraError("proofs need python-flint: pip install 'gear-rattle[proof]'") from error

BITS = 128
PI = arb.pi
VERSIONS = {"python-flint": flint.__version__, "flint": flint.__FLINT_VERSION__}
_PRECISION = threading.RLock()


@contextmanager
def precision(bits: int = BITS) -> Iterator[None]:
    """Within it, balls have so many bits and series first order: both are of the whole process; threads take turns."""
    with _PRECISION, ctx.workprec(bits):
        before, ctx.cap = ctx.cap, 2
        try:
            yield
        finally:
            ctx.cap = before


def tight() -> float:
    """Return a radius that leaves three tenths of the bits to what is computed from such a ball."""
    return float(2.0 ** (-0.7 * ctx.prec))


def ball(number: Fraction) -> arb:
    """Return the smallest ball that holds an exact number."""
    return arb(fmpq(number.numerator, number.denominator))


def around(centre: Fraction, radius: Fraction) -> arb:
    """Return a ball that holds centre ± radius."""
    return ball(centre) + arb(0, 1) * ball(radius)


def ends(x: arb) -> tuple[Fraction, Fraction]:
    """Return both ends of a ball, exactly or wider."""
    return exactly(x.lower()), exactly(x.upper())


def exactly(x: arb) -> Fraction:
    """Return the midpoint of a ball."""
    mantissa, exponent = (int(each) for each in x.mid().man_exp())
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def nearest(x: arb, places: int) -> Fraction:
    """Return a decimal of so many places beside the midpoint of a ball."""
    mantissa, exponent = (int(each) for each in x.mid().man_exp())
    whole = mantissa * 10**places
    return Fraction(whole << exponent if exponent >= 0 else whole >> -exponent, 10**places)


__all__ = [
    "BITS",
    "PI",
    "VERSIONS",
    "arb",
    "arb_mat",
    "arb_series",
    "around",
    "ball",
    "ends",
    "exactly",
    "nearest",
    "precision",
    "tight",
]
