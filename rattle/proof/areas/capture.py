"""The speed below which every motion becomes quiet, over a piece of the plane: Lemmas 20 and 21 of docs/proofs.md.

The proof measures time by x with dx = e^(−δ(t − t₀)) dt. Then the height y = β − Φ of a bounce obeys y'' = −a(x),
where a = e^(2δ(t − t₀)) g (20.2): there is no damping term. t₀ is the time at which x = 0. A bounce lasts 2h in x.
From one impact to the next ln(v³/g) changes by h³Q − δs (20.5), where v is the speed after an impact, s ≥ 2h is the
duration of the bounce in t, and Q is given by (20.4). So v³/g falls at each impact if h²Q < 2δ.

Below, `share` is ε divided by the quiet limit.
"""

from __future__ import annotations

from fractions import Fraction

from rattle.errors import NotProvedError
from rattle.proof.areas.piece import PlanePiece, hull, upper_end
from rattle.proof.areas.quiet_enclosure import quiet_limit_enclosure
from rattle.proof.balls import PI, arb, arb_series

#: Number of parts of a forcing period; the bounds are computed over each part.
PARTS = 128
#: The proof requires h²Q < GROWTH_SHARE · 2δ. By (20.5) of docs/proofs.md v³/g falls at each impact if h²Q < 2δ.
GROWTH_SHARE = 0.95


def require_captures_below_speed(piece: PlanePiece, speed: Fraction) -> None:
    """Raise NotProvedError unless all motions that leave Σ⁺ slower than `speed` provably become quiet on the piece."""
    share = piece.epsilon / quiet_limit_enclosure(arb_series([piece.delta]))[0]
    if not share < 1:
        raise NotProvedError("the block is not proved to be below the quiet limit: choose a block with smaller ε")
    mean = 4 * PI() * piece.delta
    # a departure slower than `speed` has v³/g ≤ invariant, because g ≥ 1 − share in units in which the mean of g is 1
    invariant = (arb(speed.numerator) / speed.denominator / mean) ** 3 / (1 - upper_end(share))
    longest = _half_duration_bound(piece, share, invariant)
    h = longest / (1 - piece.delta * longest)
    if not piece.delta * h < 1:
        raise NotProvedError("a bounce may be too long for Lemma 20 of docs/proofs.md: choose a smaller capture speed")
    for i in range(PARTS):
        here = hull(arb(i) / PARTS, arb(i + 1) / PARTS)
        if not h * h * _growth_coefficient(here, h, piece.delta, share) < 2 * GROWTH_SHARE * piece.delta:
            raise NotProvedError(
                "v³/g (v: speed, g: contact force) may grow from one impact to the next: choose a smaller capture speed"
            )


def _scaled_force_and_derivatives(t: arb, share: arb) -> tuple[arb, arb, arb, arb]:
    """Return the contact force in units of its mean, g/(4πδ), and three derivatives, a time t after a minimum of g.

    share: ε divided by the quiet limit.

    Returns
    -------
    tuple[arb, arb, arb, arb]
        g/(4πδ) = 1 − share cos 2πt, and its first, second and third derivative.
    """
    sine, cosine = (2 * t).sin_cos_pi()
    turn = 2 * PI()
    return 1 - share * cosine, turn * share * sine, turn**2 * share * cosine, -(turn**3) * share * sine


def _half_duration_bound(piece: PlanePiece, share: arb, invariant: arb) -> arb:
    """Return a bound H: every bounce returns to Σ⁺ before the time x of (20.2) reaches 2H, without reaching Σ⁻.

    A bounce starts at x = 0 with the speed v after an impact. Let G be the minimum of the contact force g until x = 2H.
    The height of the bounce is y ≤ x (v − xG/2). So it returns before x = 2H if v < HG, and its height stays below
    v²/(2G). Speeds and forces are in units in which the mean of g is 1; (20.2) is in docs/proofs.md.

    share: ε divided by the quiet limit. invariant: an upper bound of v³/g at the impacts.

    Returns
    -------
    arb
        H, for bounces that start at any phase.

    Raises
    ------
    NotProvedError
        If no bound is found, or a bounce may reach Σ⁻.
    """
    mean, longest = 4 * PI() * piece.delta, arb(0)
    for i in range(PARTS):
        here = hull(arb(i) / PARTS, arb(i + 1) / PARTS)
        v = upper_end(invariant * upper_end(_scaled_force_and_derivatives(here, share)[0])).root(3)
        h = upper_end(v / (1 - upper_end(share))) * (1 + arb(2.0**-10))
        for _ in range(4):  # a smaller bound h gives a larger minimum of g, which gives a smaller h
            time = upper_end(-(1 - 2 * h * piece.delta).log() / piece.delta)
            least = _scaled_force_and_derivatives(hull(here, here + time), share)[0].lower()
            if not least > 0:
                raise NotProvedError("the contact force may vanish during a bounce: choose a smaller capture speed")
            if v < h * least:
                h = upper_end(v / least) * (1 + arb(2.0**-20))
        if not (v < h * least and v * v * mean < 4 * piece.beta * least):
            raise NotProvedError(
                "the duration of a bounce is not proved to be bounded, or the bounce may reach Σ⁻: choose a smaller "
                "capture speed"
            )
        longest = h if h > longest else longest
    return longest


def _growth_coefficient(middle: arb, h: arb, delta: arb, share: arb) -> arb:
    """Return an enclosure of Q, (20.4) of docs/proofs.md, for bounces that last at most 2h in the time x of (20.2).

    From the impact before a bounce to the impact after it, ln(v³/g) changes by h³Q − δs (20.5). s is the duration of
    the bounce in forcing periods, v the speed after an impact, and g the contact force at the impact.

    middle: times, from a minimum of g, at which x = 0: the middle of the bounces. share: ε divided by the quiet limit.

    Returns
    -------
    arb
        Q.
    """
    w = hull(1 / (1 + delta * h), 1 / (1 - delta * h))  # an enclosure of e^(δ(t − t₀)) along the bounce
    time = hull(-(1 + delta * h).log() / delta, -(1 - delta * h).log() / delta)
    a, a1, _, _ = _acceleration_derivatives(middle, arb(1), delta, share)
    b, b1, b2, b3 = _acceleration_derivatives(middle + time, w, delta, share)
    h = hull(arb(0), h)
    lower = a + h * h * b2 / 6
    ratio = (a1 / 3 + h * h * b3 / 30) / lower
    theta = hull(arb(1), 1 / (1 - (h * ratio) ** 2))
    third = b3 / b - 3 * b1 * b2 / b**2 + 2 * (b1 / b) ** 3
    return (b3 / 5 - a1 * b2 / (3 * a)) / lower + 2 * theta * ratio**3 - third / 3


def _acceleration_derivatives(t: arb, w: arb, delta: arb, share: arb) -> tuple[arb, arb, arb, arb]:
    """Return a/(4πδ) and its first three derivatives by x, for the acceleration a and the time x of a bounce.

    (20.2) of docs/proofs.md defines a and x. t is the time since a minimum of the contact force,
    w = dt/dx = e^(δ(t − t₀)), and share is ε divided by the quiet limit.

    Returns
    -------
    tuple[arb, arb, arb, arb]
        a/(4πδ), and the first, second and third derivative.
    """
    g, g1, g2, g3 = _scaled_force_and_derivatives(t, share)
    first, second = 2 * delta * g + g1, 6 * delta**2 * g + 5 * delta * g1 + g2
    third = 24 * delta**3 * g + 26 * delta**2 * g1 + 9 * delta * g2 + g3
    return w**2 * g, w**3 * first, w**4 * second, w**5 * third
