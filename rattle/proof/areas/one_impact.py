"""A and C, the motions P(1,1,0), over a piece of the plane: equations (15.1) to (15.4) of docs/proofs.md.

With τ the phase of the impact, X = ε cos 2πτ, which is negative for A and positive for C, and Y = ε sin 2πτ. A motion
that closes is admissible if its displacement F(s; δ, X) from Σ⁺, at a time s after the impact, satisfies −2β < F < 0
for 0 < s < 1. F falls as X grows, so F < 0 is proved for the least X, and F > −2β for the largest.
"""

from __future__ import annotations

import numpy as np

from rattle.proof.areas.piece import SHORTEST_PART, PlanePiece, hull, lower_end, mean_value_enclosure, upper_end
from rattle.proof.balls import PI, arb, arb_series


def minus_epsilon_sine(delta: arb_series) -> arb_series:
    """Return −Y = −ε sin 2πτ = δ coth(δ/2) − 2, τ the phase of the impact: (15.1) of docs/proofs.md."""
    end = (-delta).exp()
    return delta * (1 + end) / (1 - end) - 2


def epsilon_cosine_at_flip(delta: arb_series) -> arb_series:
    """Return the X = ε cos 2πτ at which C flips, δ² coth(δ/2)/2π: (15.4) of docs/proofs.md."""
    return delta * (minus_epsilon_sine(delta) + 2) / (2 * PI())


def flight_height(s: arb, delta: arb_series, x: arb) -> arb_series:
    """Return the displacement F(s; δ, X) from Σ⁺, (15.3) of docs/proofs.md, as a power series in δ."""
    end, kept = (-delta).exp(), (-delta * s).exp()
    sine, cosine = (2 * s).sin_cos_pi()
    return 4 * PI() * (s - (1 - kept) / (1 - end)) - x * (1 - cosine) + minus_epsilon_sine(delta) * sine


def velocity_enclosure(s: arb, delta: arb, x: arb) -> arb:
    """Return the velocity ∂F/∂s over balls of s, δ and X; F, (15.3) of docs/proofs.md, is the displacement from Σ⁺."""
    sine, cosine = (2 * s).sin_cos_pi()
    driven = 2 - 2 * delta * (-delta * s).exp() / (1 - (-delta).exp()) - x * sine
    return 2 * PI() * (driven + minus_epsilon_sine(arb_series([delta]))[0] * cosine)


def exists(piece: PlanePiece, letter: str) -> bool | None:
    """Return True if the motion A (or C) exists at all points of the piece, False if at none, None if not proved."""
    y = mean_value_enclosure(minus_epsilon_sine, piece.delta)
    if upper_end(piece.epsilon) < lower_end(y):
        return False
    x = epsilon_cosine_enclosure(piece, letter, y)
    if lower_end(piece.epsilon) > upper_end(y) and _stays_between_walls(piece, lower_end(x), upper_end(x)):
        return True
    return False if _passes_sigma_minus(piece, lower_end(x)) else None


def attracts(piece: PlanePiece, letter: str) -> bool | None:
    """Return whether the motion A (or C) attracts, where it exists.

    Returns
    -------
    bool | None
        True if both multipliers are inside the unit circle at all points of the piece.
        False if one is outside at all points.
        None if neither is proved.
    """
    if letter == "A":
        # X < 0 for A, so the trace 1 + E − 4π (1 − E) X/δ² of A, with E = e^(−δ), is above 1 + E: A is a saddle
        return False
    x, limit = (
        epsilon_cosine_enclosure(piece, letter, mean_value_enclosure(minus_epsilon_sine, piece.delta)),
        mean_value_enclosure(epsilon_cosine_at_flip, piece.delta),
    )
    return True if upper_end(x) < lower_end(limit) else False if lower_end(x) > upper_end(limit) else None


def epsilon_cosine_enclosure(piece: PlanePiece, letter: str, y: arb) -> arb:
    """Return X = ε cos 2πτ = ±√(ε² − Y²), (15.2) of docs/proofs.md, over the points of the piece at which ε ≥ |Y|.

    The sign is − for A and + for C. τ is the phase of the impact, and y is Y = ε sin 2πτ.

    Returns
    -------
    arb
        X.
    """
    least, most = (
        end * end - far * far
        for end, far in zip(_lower_and_upper_end(piece.epsilon), _lower_and_upper_end(y)[::-1], strict=True)
    )
    x = hull(least.sqrt() if least > 0 else arb(0), most.sqrt())
    return x if letter == "C" else -x


def _lower_and_upper_end(x: arb) -> tuple[arb, arb]:
    """Return a lower and an upper bound of all numbers of a ball."""
    return lower_end(x), upper_end(x)


def _stays_between_walls(piece: PlanePiece, x_low: arb, x_high: arb) -> bool:
    """Return whether −2β < F < 0 is proved for 0 < s < 1, for all δ of the piece and x_low ≤ X ≤ x_high.

    F(s; δ, X), (15.3) of docs/proofs.md, is the displacement from Σ⁺ at a time s after the impact.

    Returns
    -------
    bool
        False if this is not proved.
    """
    parts = [(arb(0), arb(1))]
    while parts:
        start, end = parts.pop()
        if not _stays_between_walls_during(piece, start, end, x_low, x_high):
            if end - start < SHORTEST_PART:
                return False
            middle = (start + end) / 2
            parts += [(start, middle), (middle, end)]
    return True


def _stays_between_walls_during(piece: PlanePiece, start: arb, end: arb, x_low: arb, x_high: arb) -> bool:
    """Return whether −2β < F < 0 is proved for start ≤ s ≤ end, as `_stays_between_walls` does for 0 < s < 1.

    F, (15.3) of docs/proofs.md, is the displacement from Σ⁺. It vanishes at s = 0 and s = 1, so next to these ends the
    sign of ∂F/∂s proves F < 0.

    Returns
    -------
    bool
        False if this is not proved.
    """
    s, middle = hull(start, end), (start + end) / 2

    def height_over(x: arb) -> arb:
        """Return an enclosure of the displacement F from Σ⁺ at X = x for start ≤ s ≤ end, by the mean value theorem."""
        return mean_value_enclosure(lambda delta: flight_height(middle, delta, x), piece.delta) + velocity_enclosure(
            s, piece.delta, x
        ) * (s - middle)

    if not height_over(x_high) > -2 * piece.beta:
        return False
    if start == 0:
        return bool(velocity_enclosure(s, piece.delta, x_low) < 0)
    return bool(velocity_enclosure(s, piece.delta, x_low) > 0 if end == 1 else height_over(x_low) < 0)


def _passes_sigma_minus(piece: PlanePiece, x_low: arb) -> bool:
    """Return whether flights are proved to pass Σ⁻ at one time s, for all δ of the piece and all X ≥ x_low.

    Returns
    -------
    bool
        True if F < −2β is proved at this time; F, (15.3) of docs/proofs.md, is the displacement from Σ⁺.
    """
    s = arb(_guess_time_of_minimum(float(piece.delta.mid()), float(x_low.mid())))
    return bool(
        0 < s < 1 and mean_value_enclosure(lambda delta: flight_height(s, delta, x_low), piece.delta) < -2 * piece.beta
    )


def _guess_time_of_minimum(delta: float, x: float) -> float:
    """Return a guess, in doubles, of the time s at which the displacement F is least; a bad guess makes proofs fail."""
    s, step = 0.5, 0.5
    for _ in range(4):
        near = s + np.linspace(-step, step, 101)[1:-1]
        y, lost = 2 - delta / np.tanh(delta / 2), np.expm1(-delta * near) / np.expm1(-delta)
        turn = 2 * np.pi * near
        s = float(near[np.argmin(4 * np.pi * (near - lost) - x * (1 - np.cos(turn)) - y * np.sin(turn))])
        step /= 25
    return s
