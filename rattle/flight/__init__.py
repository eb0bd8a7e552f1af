"""A free flight between the walls: its law, a guess of its end, the proof that it is the first impact, its tangent."""

from rattle.flight.law import wrap_phase_difference

__all__ = [
    "wrap_phase_difference",
]
