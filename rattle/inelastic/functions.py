"""The inelastic gear's version of the functions that the package of each gear provides."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError
from rattle.intensity.table import follow_motions_one_by_one

stretch = follow_motions_one_by_one  # one motion after another; the impacting gear's `stretch` uses SIMD lanes


def becomes_quiet_late(delta: NDArray[np.float64], *_: Any, **__: Any) -> NDArray[np.bool_]:
    """Return False for each cell (n,): no cell needs many impacts before its quiet motion is recognised."""
    return np.zeros(delta.size, np.bool_)


def _raise_not_computed(what: str) -> NoReturn:
    """Raise RattleError, because `what`, such as "bifurcation diagrams", is not computed for the inelastic gear."""
    raise RattleError(f"{what} are not computed for the inelastic gear: use the impacting or the stiff gear")


def diagram(*_: Any, **__: Any) -> NoReturn:
    """Raise RattleError, because diagrams of the inelastic gear are not computed."""
    _raise_not_computed("bifurcation diagrams")
