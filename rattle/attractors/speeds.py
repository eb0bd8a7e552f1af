"""Up to which speed states are sampled."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rattle.errors import ParameterError, require_number
from rattle.flight.law import natural_speed

NATURAL: Literal["natural"] = "natural"
SpeedLimit = float | str | None

PAPER_SPEED = 7.0  # of the paper's figures
#: Where it is the default: δ, ε and β of its plane and about it.
PLANE = ((0.3, 1.5), (0.0, 0.5), (0.2, 1.2))

Array = NDArray[np.float64]


def in_paper_plane(delta: Array, epsilon: Array, beta: Array) -> NDArray[np.bool_]:
    """Whether parameters are in the paper's plane or about it, where its figures' speeds fit all motions."""
    inside = [(low <= x) & (x <= high) for x, (low, high) in zip((delta, epsilon, beta), PLANE, strict=True)]
    return np.asarray(inside[0] & inside[1] & inside[2], np.bool_)


def sampled_speeds(v_max: SpeedLimit, delta: Array, epsilon: Array, beta: Array) -> Array:
    """The largest speed of a sample in each of these cells (n,): a number for all, "natural" for 1.5 √(16πδβ) + 2πε of
    each, None for 7 in the paper's plane and the natural one elsewhere. Raises ParameterError.
    """
    if v_max is None:
        inside = in_paper_plane(delta, epsilon, beta)
        return np.asarray(np.where(inside, PAPER_SPEED, natural_speed(delta, epsilon, beta)), np.float64)
    if isinstance(v_max, str):
        if v_max != NATURAL:
            raise ParameterError(f'v_max must be a number above 0 or "{NATURAL}", got {v_max!r}')
        return np.asarray(natural_speed(delta, epsilon, beta), np.float64)
    return np.full(np.shape(delta), require_number("v_max", v_max, positive=True))


def read_speed(text: str | None) -> SpeedLimit:
    """What somebody typed: a number, a word that `sampled_speeds` knows or refuses, None for nothing."""
    text = (text or "").strip()
    try:
        return float(text) if text else None
    except ValueError:
        return text


def sampled_speed(v_max: SpeedLimit, delta: float, epsilon: float, beta: float) -> float:
    """The same of one gear."""
    return float(sampled_speeds(v_max, *(np.array([x]) for x in (delta, epsilon, beta)))[0])
