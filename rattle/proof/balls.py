"""Ball arithmetic with python-flint (extra `proof`): every operation returns a ball that holds all possible results.

A comparison is true only if it holds for all numbers of both balls. Code therefore tests `not (x > 0)`, which also
refuses an undecided comparison.
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
    """Set the bits of balls, and first-order series, in a `with` block. The setting is global: threads take turns."""
    with _PRECISION, ctx.workprec(bits):
        before, ctx.cap = ctx.cap, 2
        try:
            yield
        finally:
            ctx.cap = before


def tight() -> float:
    """Return a radius that leaves three tenths of the working precision to results computed from such a ball."""
    return float(2.0 ** (-0.7 * ctx.prec))


def ball(number: Fraction) -> arb:
    """Return the smallest ball that holds an exact number."""
    return arb(fmpq(number.numerator, number.denominator))


def around(centre: Fraction, radius: Fraction) -> arb:
    """Return a ball that holds [centre − radius, centre + radius]."""
    return ball(centre) + arb(0, 1) * ball(radius)


def ends(x: arb) -> tuple[Fraction, Fraction]:
    """Return the lower and the upper end of a ball as fractions, rounded outwards."""
    return exactly(x.lower()), exactly(x.upper())


def exactly(x: arb) -> Fraction:
    """Return the midpoint of a ball as an exact fraction."""
    mantissa, exponent = (int(each) for each in x.mid().man_exp())
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def nearest(x: arb, places: int) -> Fraction:
    """Return the midpoint of a ball rounded to `places` decimals."""
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
