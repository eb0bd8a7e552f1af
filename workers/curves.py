"""The curves and points that divide the plane of a survey, for its store and its picture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import rattle
from rattle import curves
from workers.quantities import DOI


@dataclass(frozen=True)
class Curve:
    """A curve ε(δ) for a half-backlash β; NaN where it does not exist."""

    long_name: str
    reference: str
    epsilon: Callable[[np.ndarray, float], np.ndarray]


def codimension_two(name: str, beta: float) -> tuple[float, float]:
    """Return (δ, ε) of a codimension-two point, NaN where this β has none."""
    points = {point.name: (point.delta, point.epsilon) for point in curves.codimension_two(beta)}
    return points.get(name, (float("nan"), float("nan")))


def _until(name: str, epsilon: np.ndarray, delta: np.ndarray, beta: float) -> np.ndarray:
    """End a curve at a codimension-two point, beyond which its orbit would cross the other wall."""
    return np.where(delta > codimension_two(name, beta)[0], np.nan, epsilon)


_FIGURE_7 = f"doi:{DOI} section 5.2, Figure 7"

CURVES = {
    "SN1": Curve(
        "saddle-node of A and C, up to COD22",
        f"doi:{DOI} equation 4.1",
        lambda delta, beta: _until("COD22", rattle.sn1(delta), delta, beta),
    ),
    "PDC": Curve(
        "flip (period doubling) of C, up to COD20",
        f"doi:{DOI} section 3.3",
        lambda delta, beta: _until("COD20", rattle.flip(delta), delta, beta),
    ),
    "G1": Curve("grazing of C", _FIGURE_7, lambda delta, beta: rattle.grazing("G1", delta, beta).epsilon),
    "G2": Curve("grazing of A", _FIGURE_7, lambda delta, beta: rattle.grazing("G2", delta, beta).epsilon),
    "quiet_limit": Curve(
        "limit of permanent contact", f"doi:{DOI} section 3.1", lambda delta, _: rattle.quiet_limit(delta)
    ),
}

POINTS = ("COD20", "COD21", "COD22")
