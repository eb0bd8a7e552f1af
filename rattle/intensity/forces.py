"""The lines of the contact force, which every gear's point knows."""

from functools import singledispatch
from typing import Any

from rattle.flight.forcing import Forcing


@singledispatch
def force_lines(point: Any) -> list[tuple[float, complex]]:
    """Return (frequency, size) of the contact force Σ size e^(i frequency t) of a point, the mean first.

    Points whose forcing is not one cosine register a function of their own.

    Returns
    -------
    list of (float, complex)
        Frequencies in radians per forcing period, and complex amplitudes.
    """
    return Forcing(point.epsilon).lines(point.delta)
