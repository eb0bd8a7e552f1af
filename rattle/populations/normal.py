"""The standard normal distribution."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def ndtr(z: Any) -> NDArray[np.float64]:
    """Return the standard normal distribution function at z."""
    from scipy import special  # scipy is imported here, because this takes a fifth of a second

    return np.asarray(special.ndtr(z))


def ndtri(u: Any) -> NDArray[np.float64]:
    """Return the standard normal quantile at u in (0, 1)."""
    from scipy import special

    return np.asarray(special.ndtri(u))
