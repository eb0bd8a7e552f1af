"""Functions that the package of every gear has for its plane; `diagram`, which this gear lacks, raises an error."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError
from rattle.intensity.table import follow_one_by_one

stretch = follow_one_by_one  # follows chaotic motions longer, for the sums of their impacts


def rests_late(delta: NDArray[np.float64], *_: Any, **__: Any) -> NDArray[np.bool_]:
    """Return False for every cell: quiet motion is recognised early, as soon as its chatter is certain to complete."""
    return np.zeros(delta.size, np.bool_)


def _refused(what: str) -> NoReturn:
    raise RattleError(f"{what} are not computed for the inelastic gear: use the impacting or the stiff gear")


def diagram(*_: Any, **__: Any) -> NoReturn:
    """Raise RattleError, because diagrams of the inelastic gear are not computed."""
    _refused("bifurcation diagrams")
