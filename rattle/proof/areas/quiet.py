"""Quiet running over a piece of the plane: g > 0 at all times if and only if ε < 2δ/√(4π² + δ²)."""

from __future__ import annotations

from rattle.proof.areas.piece import PlanePiece, centred
from rattle.proof.balls import PI, arb_series


def quiet_limit_enclosure(delta: arb_series) -> arb_series:
    """Enclose the quiet limit 2δ/√(4π² + δ²). At larger ε the contact force g is not positive throughout."""
    return 2 * delta / (delta * delta + 4 * PI() ** 2).sqrt()


def possible(piece: PlanePiece) -> bool | None:
    """Return whether quiet running is possible at all points of the piece: False if at none, None if undecided."""
    share = centred(quiet_limit_enclosure, piece.delta)
    return True if piece.epsilon < share else False if piece.epsilon > share else None
