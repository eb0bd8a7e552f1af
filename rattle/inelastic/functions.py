"""What the package of any gear has for its plane, and this one has not yet: each says so."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rattle.errors import RattleError, require_one_of
from rattle.intensity.table import one_by_one

stretch = one_by_one  # of chaotic motions

NAMES: tuple[str, ...] = ()  # of bifurcation curves


def rests_late(delta: NDArray[np.float64], *_: Any, **__: Any) -> NDArray[np.bool_]:
    """Return False for every cell: contact that does not end is seen when its chatter is certain to complete."""
    return np.zeros(delta.size, np.bool_)


def _refused(what: str) -> NoReturn:
    raise RattleError(f"{what} are not computed for the inelastic gear: use the impacting or the stiff one")


def period_one(*_: Any, **__: Any) -> NoReturn:
    """Raise RattleError: `InelasticGear.orbits` has the period-one motions of one point."""
    _refused("period-one motions of many points at once")


def diagram(*_: Any, **__: Any) -> NoReturn:
    """Raise RattleError."""
    _refused("bifurcation diagrams")


def describe(name: str) -> str:
    """Raise ParameterError: it has no curves."""
    require_one_of("a curve", name, NAMES)
    return ""


def trace(*_: Any, **__: Any) -> NoReturn:
    """Raise RattleError."""
    _refused("bifurcation curves")
