"""A free flight between the walls: its law, a guess of its end, a proof that this is its first impact, its tangent."""

from rattle.flight.law import wrap_phase_difference

__all__ = [
    "wrap_phase_difference",
]
