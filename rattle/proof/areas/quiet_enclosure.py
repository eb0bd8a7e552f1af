"""Prove on a piece of the plane whether quiet motion is possible: whether ε is below the quiet limit."""

from __future__ import annotations

from rattle.proof.areas.piece import PlanePiece, mean_value_enclosure
from rattle.proof.balls import PI, arb_series


def quiet_limit_enclosure(delta: arb_series) -> arb_series:
    """Return the quiet limit 2δ/√(4π² + δ²), the ε from which on the contact force is 0 or negative at some phase."""
    return 2 * delta / (delta * delta + 4 * PI() ** 2).sqrt()


def is_quiet_possible(piece: PlanePiece) -> bool | None:
    """Return True if quiet motion is possible at all points of the piece, False if at none, None if not proved."""
    share = mean_value_enclosure(quiet_limit_enclosure, piece.delta)
    return True if piece.epsilon < share else False if piece.epsilon > share else None
