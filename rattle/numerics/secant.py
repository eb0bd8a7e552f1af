"""Secant steps inside a bracket, for kernels."""

from rattle.numerics.compile import inline


@inline
def narrow_bracket(lo, f_lo, hi, f_hi, side, x, f):
    """Return the bracket of a sign change after a step to `x`, and the side (±1) that was replaced.

    lo, hi: ends of the bracket, with the function values f_lo and f_hi. f: the function value at x. side: the end
    that the step before replaced, 1 for hi and −1 for lo.

    If an end stays for the second time, the function value at this end is halved, so that the next secant step moves
    it (Illinois method: Dowell and Jarratt 1971).

    Returns
    -------
    tuple
        (lo, f_lo, hi, f_hi, side).
    """
    if (f > 0.0) == (f_hi > 0.0):
        return lo, (f_lo * 0.5 if side == 1 else f_lo), x, f, 1
    return x, f, hi, (f_hi * 0.5 if side == -1 else f_hi), -1
