"""Ball arithmetic with python-flint, which the extra `proof` installs.

A ball is an interval midpoint ± radius. The result of an operation is a ball that contains the results for all numbers
of the operands. A comparison is True only if it holds for all numbers of both balls. Proofs therefore write
`if not (x > 0)` before they refuse: this also refuses where x > 0 is neither proved nor disproved.
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

#: Precision of a proof in bits.
BITS = 128
PI = arb.pi
VERSIONS = {"python-flint": flint.__version__, "flint": flint.__FLINT_VERSION__}
_PRECISION = threading.RLock()


@contextmanager
def precision(bits: int = BITS) -> Iterator[None]:
    """Compute with balls of this precision in bits, and with power series to first order, within a `with` block.

    Precision and order are settings of the whole process, so a second thread waits until the block of the first ends.
    """
    with _PRECISION, ctx.workprec(bits):
        before, ctx.cap = ctx.cap, 2
        try:
            yield
        finally:
            ctx.cap = before


def negligible_radius() -> float:
    """Return 2^(−0.7 p) at a precision of p bits: balls of smaller radius need not be made narrower."""
    return float(2.0 ** (-0.7 * ctx.prec))


def ball(number: Fraction) -> arb:
    """Return the narrowest ball that contains an exact number."""
    return arb(fmpq(number.numerator, number.denominator))


def interval_ball(centre: Fraction, radius: Fraction) -> arb:
    """Return a ball that contains the interval centre ± radius."""
    return ball(centre) + arb(0, 1) * ball(radius)


def exact_ends(x: arb) -> tuple[Fraction, Fraction]:
    """Return a lower and an upper bound of a ball as exact numbers."""
    return exact_midpoint(x.lower()), exact_midpoint(x.upper())


def exact_midpoint(x: arb) -> Fraction:
    """Return the midpoint of a ball as an exact number."""
    mantissa, exponent = (int(each) for each in x.mid().man_exp())
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def rounded_midpoint(x: arb, places: int) -> Fraction:
    """Return the midpoint of a ball, rounded down to `places` decimals."""
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
    "ball",
    "exact_ends",
    "exact_midpoint",
    "interval_ball",
    "negligible_radius",
    "precision",
    "rounded_midpoint",
]
