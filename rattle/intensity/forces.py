"""The Fourier terms of the contact force at a parameter point of any gear."""

from functools import singledispatch
from typing import Any

from rattle.flight.forcing import Forcing


@singledispatch
def spectral_lines_of_force(point: Any) -> list[tuple[float, complex]]:
    """Return (frequency, size) of the terms of the contact force Σ size e^(i frequency t), the mean first.

    This function serves points whose forcing is one cosine. For points of another forcing, a function for their type is
    registered with `spectral_lines_of_force.register`.

    Returns
    -------
    list of (float, complex)
        Frequencies in radians per forcing period, and complex amplitudes.
    """
    return Forcing(point.epsilon).spectral_lines(point.delta)
