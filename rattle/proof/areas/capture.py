"""Prove a speed below which every motion becomes quiet, over a piece of the plane (lemmas 20 and 21 of docs/proofs.md).

The transformed time x, dx = e^(−δ(t − t₀)) dt, removes the damping: the height y = β − Φ of a bounce obeys

    y'' = −a(x),    a = e^(2δ(t − t₀)) g.

A bounce of duration 2h with its middle at x = 0 has speeds m₀ and m₁ and accelerations a₀ and a₁ at its ends. They obey

    ln (m₁³/a₁) − ln (m₀³/a₀) = h³ Q,
    Q = (a'''/5 − a'a''/3a)/(a + h²a''/6) + 2θ ((a'/3 + h²a'''/30)/(a + h²a''/6))³ − (ln a)'''/3.

Here a and a' are taken in the middle; a'', a''' and (ln a)''' are taken somewhere in the bounce; θ lies between 1 and
1/(1 − z²), where z = h (a'/3 + h²a'''/30)/(a + h²a''/6).

In the time t, ln (v³/g) therefore changes by h³Q − δs over a bounce of duration s ≥ 2h.
So v³/g falls from bounce to bounce where h²Q < 2δ.
"""

from __future__ import annotations

from fractions import Fraction

from rattle.errors import NotProvedError
from rattle.proof.areas.piece import PlanePiece, hull, upper
from rattle.proof.areas.quiet import quiet_limit_enclosure
from rattle.proof.balls import PI, arb, arb_series

PARTS = 128  # intervals into which the forcing period is cut
KEPT = 0.95  # at most this share of the damping is compensated by growth; the remainder makes v³/g decay


def require_captures(piece: PlanePiece, speed: Fraction) -> None:
    """Raise NotProvedError unless every motion that leaves Σ⁺ slower than `speed`, at any phase, becomes quiet."""
    share = piece.epsilon / quiet_limit_enclosure(arb_series([piece.delta]))[0]
    if not share < 1:
        raise NotProvedError("the contact force is not proved positive at all times")
    mean = 4 * PI() * piece.delta
    # g = 4πδ γ, γ = 1 − share cos θ; v³/g ≤ invariant from the first bounce on
    invariant = (arb(speed.numerator) / speed.denominator / mean) ** 3 / (1 - upper(share))
    longest = _longest(piece, share, invariant)
    h = longest / (1 - piece.delta * longest)
    if not piece.delta * h < 1:
        raise NotProvedError("the duration of bounces is not bounded")
    for i in range(PARTS):
        here = hull(arb(i) / PARTS, arb(i + 1) / PARTS)
        if not h * h * _growth(here, h, piece.delta, share) < 2 * KEPT * piece.delta:
            raise NotProvedError("v³/g is not proved to fall from each bounce to the next")


def _force(t: arb, share: arb) -> tuple[arb, arb, arb, arb]:
    """Return γ = g/(4πδ) and its first three derivatives at the time t after its minimum."""
    sine, cosine = (2 * t).sin_cos_pi()
    turn = 2 * PI()
    return 1 - share * cosine, turn * share * sine, turn**2 * share * cosine, -(turn**3) * share * sine


def _longest(piece: PlanePiece, share: arb, invariant: arb) -> arb:
    """Return a bound H such that every bounce lasts less than 2H in the transformed time x.

    A bounce returns within 2H because y ≤ x (v − H min g) at x = 2H. Its height stays below the gap because
    y ≤ v²/(2 min g).

    Returns
    -------
    arb
        The bound H.

    Raises
    ------
    NotProvedError
        If no bound is found, or a bounce may reach Σ⁻.
    """
    mean, longest = 4 * PI() * piece.delta, arb(0)
    for i in range(PARTS):
        here = hull(arb(i) / PARTS, arb(i + 1) / PARTS)
        v = upper(invariant * upper(_force(here, share)[0])).root(3)
        h = upper(v / (1 - upper(share))) * (1 + arb(2.0**-10))
        for _ in range(4):  # a shorter bounce has a tighter lower bound of g, which shortens the bound again
            time = upper(-(1 - 2 * h * piece.delta).log() / piece.delta)
            least = _force(hull(here, here + time), share)[0].lower()
            if not least > 0:
                raise NotProvedError("the duration of bounces is not bounded")
            if v < h * least:
                h = upper(v / least) * (1 + arb(2.0**-20))
        if not (v < h * least and v * v * mean < 4 * piece.beta * least):
            raise NotProvedError("bounces are not proved to end before they reach Σ⁻")
        longest = h if h > longest else longest
    return longest


def _growth(middle: arb, h: arb, delta: arb, share: arb) -> arb:
    """Enclose Q for all bounces whose middle lies in the ball `middle` and whose duration is at most 2h."""
    w = hull(1 / (1 + delta * h), 1 / (1 - delta * h))  # encloses e^(δ(t − t₀)) along the bounce
    time = hull(-(1 + delta * h).log() / delta, -(1 - delta * h).log() / delta)
    a, a1, _, _ = _derivatives(middle, arb(1), delta, share)
    b, b1, b2, b3 = _derivatives(middle + time, w, delta, share)
    h = hull(arb(0), h)
    lower = a + h * h * b2 / 6
    ratio = (a1 / 3 + h * h * b3 / 30) / lower
    theta = hull(arb(1), 1 / (1 - (h * ratio) ** 2))
    third = b3 / b - 3 * b1 * b2 / b**2 + 2 * (b1 / b) ** 3
    return (b3 / 5 - a1 * b2 / (3 * a)) / lower + 2 * theta * ratio**3 - third / 3


def _derivatives(t: arb, w: arb, delta: arb, share: arb) -> tuple[arb, arb, arb, arb]:
    """Return a = w²γ and its first three derivatives by x, where w = e^(δ(t − t₀)) and dt/dx = w."""
    g, g1, g2, g3 = _force(t, share)
    first, second = 2 * delta * g + g1, 6 * delta**2 * g + 5 * delta * g1 + g2
    third = 24 * delta**3 * g + 26 * delta**2 * g1 + 9 * delta * g2 + g3
    return w**2 * g, w**3 * first, w**4 * second, w**5 * third
