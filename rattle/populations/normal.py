"""The standard normal distribution."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def ndtr(z: Any) -> NDArray[np.float64]:
    """Return the share that is below z."""
    from scipy import special  # a fifth of a second to load

    return np.asarray(special.ndtr(z))


def ndtri(u: Any) -> NDArray[np.float64]:
    """Return the number below which a share u is."""
    from scipy import special

    return np.asarray(special.ndtri(u))
