"""The motions A and C, which are P(1,1,0), over a piece of the plane (lemma 15 of docs/proofs.md).

They close if and only if, with X = ε cos 2πτ and Y = ε sin 2πτ,

    v = 2πδ,
    Y = 2 − δ coth(δ/2),
    X = ±√(ε² − Y²),    − for A, + for C.

Their height over Σ⁺ at the time s after the impact is, with E = e^(−δ),

    F(s; δ, X) = 4πs − 4π (1 − e^(−δs))/(1 − E) − X (1 − cos 2πs) − Y sin 2πs.

They are admissible if and only if −2β < F < 0 for 0 < s < 1. F falls with X, so the upper bound needs the least X and
the lower bound the largest.
"""

from __future__ import annotations

import numpy as np

from rattle.proof.areas.piece import FINEST, PlanePiece, centred, hull, lower, upper
from rattle.proof.balls import PI, arb, arb_series


def offset(delta: arb_series) -> arb_series:
    """Return −Y = δ coth(δ/2) − 2."""
    end = (-delta).exp()
    return delta * (1 + end) / (1 - end) - 2


def most_stable(delta: arb_series) -> arb_series:
    """Return the X at which C loses stability by a flip, δ² coth(δ/2)/2π."""
    return delta * (offset(delta) + 2) / (2 * PI())


def flight_height(s: arb, delta: arb_series, x: arb) -> arb_series:
    """Return F(s; δ, X) and its derivative by δ."""
    end, kept = (-delta).exp(), (-delta * s).exp()
    sine, cosine = (2 * s).sin_cos_pi()
    return 4 * PI() * (s - (1 - kept) / (1 - end)) - x * (1 - cosine) + offset(delta) * sine


def slope_enclosure(s: arb, delta: arb, x: arb) -> arb:
    """Enclose ∂F/∂s."""
    sine, cosine = (2 * s).sin_cos_pi()
    driven = 2 - 2 * delta * (-delta * s).exp() / (1 - (-delta).exp()) - x * sine
    return 2 * PI() * (driven + offset(arb_series([delta]))[0] * cosine)


def exists(piece: PlanePiece, letter: str) -> bool | None:
    """Return whether A (C) exists at all points of the piece: False if at none, None if undecided."""
    y = centred(offset, piece.delta)
    if upper(piece.epsilon) < lower(y):
        return False
    x = cosines(piece, letter, y)
    if lower(piece.epsilon) > upper(y) and _stays(piece, lower(x), upper(x)):
        return True
    return False if _touches(piece, lower(x)) else None


def attracts(piece: PlanePiece, letter: str) -> bool | None:
    """Return whether a motion that exists has both multipliers inside the unit circle.

    Returns
    -------
    bool | None
        True if both lie inside at all points, False if one lies outside at all points, None if undecided.
    """
    if letter == "A":
        return False  # X < 0, so the trace 1 + E − 4π (1 − E) X/δ² exceeds 1 + E
    x, limit = cosines(piece, letter, centred(offset, piece.delta)), centred(most_stable, piece.delta)
    return True if upper(x) < lower(limit) else False if lower(x) > upper(limit) else None


def cosines(piece: PlanePiece, letter: str, y: arb) -> arb:
    """Enclose X over the points of the piece where the motion exists."""
    least, most = (end * end - far * far for end, far in zip(_ends(piece.epsilon), _ends(y)[::-1], strict=True))
    x = hull(least.sqrt() if least > 0 else arb(0), most.sqrt())
    return x if letter == "C" else -x


def _ends(x: arb) -> tuple[arb, arb]:
    return lower(x), upper(x)


def _stays(piece: PlanePiece, least: arb, most: arb) -> bool:
    """Return whether −2β < F < 0 is proved for 0 < s < 1 and all X between least and most."""
    parts = [(arb(0), arb(1))]
    while parts:
        start, end = parts.pop()
        if not _stays_in(piece, start, end, least, most):
            if end - start < FINEST:
                return False
            middle = (start + end) / 2
            parts += [(start, middle), (middle, end)]
    return True


def _stays_in(piece: PlanePiece, start: arb, end: arb, least: arb, most: arb) -> bool:
    s, middle = hull(start, end), (start + end) / 2

    def over(x: arb) -> arb:
        return centred(lambda delta: flight_height(middle, delta, x), piece.delta) + slope_enclosure(
            s, piece.delta, x
        ) * (s - middle)

    if not over(most) > -2 * piece.beta:
        return False
    if start == 0:
        return bool(slope_enclosure(s, piece.delta, least) < 0)
    return bool(slope_enclosure(s, piece.delta, least) > 0 if end == 1 else over(least) < 0)


def _touches(piece: PlanePiece, least: arb) -> bool:
    """Return whether F < −2β is proved at some s for all X ≥ least."""
    s = arb(_lowest(float(piece.delta.mid()), float(least.mid())))
    return bool(0 < s < 1 and centred(lambda delta: flight_height(s, delta, least), piece.delta) < -2 * piece.beta)


def _lowest(delta: float, x: float) -> float:
    """Guess in doubles the s at which F is least. A bad guess makes a proof fail, never false."""
    s, step = 0.5, 0.5
    for _ in range(4):
        near = s + np.linspace(-step, step, 101)[1:-1]
        y, lost = 2 - delta / np.tanh(delta / 2), np.expm1(-delta * near) / np.expm1(-delta)
        turn = 2 * np.pi * near
        s = float(near[np.argmin(4 * np.pi * (near - lost) - x * (1 - np.cos(turn)) - y * np.sin(turn))])
        step /= 25
    return s
