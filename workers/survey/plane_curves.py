"""The curves and codimension-two points that divide the plane of a survey, for its store and its picture.

In xarray a group inherits the survey's coordinates delta, epsilon and multiplier, which would hide a variable of the
same name in the group. So the names of such variables begin with `point_`.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from gear_rattle.workers.survey.axes import Axis, Window
from gear_rattle.workers.survey.crossings import CurveCrossings, Polyline, find_curve_crossings
from gear_rattle.workers.survey.values.quantities import DOI
from gear_rattle.workers.survey.values.schema import PARTS
from rattle import RattleError
from rattle.curves import CodimensionTwo, Curve
from rattle.models import Model

#: Curves are traced in a window. Around a survey's cells it begins half a cell below the least δ of the cells, but not
#: below this share of that δ. On a map of the explorer it begins at the map's least δ, but not below this share of the
#: map's largest δ. The reason for both limits is that no curve is defined at δ ≤ 0.
LOWEST_DELTA = 0.1
#: A window extends beyond its cells by at least this share of its largest δ (or ε), because curves take minutes to
#: trace in narrower windows.
NARROWEST = 1e-9
LEAST_EPSILON = 1e-6  # if all ε of a survey are smaller, NARROWEST counts as a share of this ε


class MissingCurve(NamedTuple):
    """A placeholder for a curve that cannot be traced. reason: why it cannot be traced, in words."""

    reason: str


@dataclass(frozen=True)
class CurveVariable:
    """A stored variable of a curve, of the codimension-two points or of the families of a survey.

    In the store each curve has a group of its own, and so have the codimension-two points and the families. evaluate: a
    function of the curve, the points or the families that returns the variable's values. The variables of a
    `MissingCurve` are empty.
    """

    name: str
    dims: tuple[str, ...]
    dtype: Any
    long_name: str
    evaluate: Callable[[Any], Any]

    def stored_values(self, item: Any) -> np.ndarray:
        """Return the values of the variable for `item`, in the stored type.

        item: a curve, the codimension-two points or the families, whichever the variable describes.

        Returns
        -------
        np.ndarray
            An array with the dimensions `dims`; for a `MissingCurve` it has length 0 along the dimension of points.
        """
        if isinstance(item, MissingCurve):
            return np.empty([2 if dim == "multiplier" else 0 for dim in self.dims], self.dtype)
        return np.asarray(self.evaluate(item), self.dtype)

    @property
    def parts(self) -> tuple["CurveVariable", ...]:
        """The variables to store: the real and the imaginary part of a complex variable, else the variable itself."""
        if self.dtype is not complex:
            return (self,)

        def part_evaluator(part: str) -> Callable[[Any], Any]:
            return lambda item: getattr(np.asarray(self.evaluate(item), complex), part)

        return tuple(
            replace(
                self,
                name=f"{self.name}_{part}",
                dtype=float,
                long_name=f"{self.long_name}, {words}",
                evaluate=part_evaluator(part),
            )
            for part, words in PARTS.items()
        )

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes of the stored array, by the CF conventions."""
        return {"long_name": self.long_name, "units": "1"}


TEXT = np.dtypes.StringDType()  # variable-length text, the only kind of text that zarr v3 specifies
POINT, END, PAIR = ("point",), ("end",), ("pair",)

CURVE_VARIABLES: tuple[CurveVariable, ...] = (
    CurveVariable("point_delta", POINT, float, "damping δ of the point", lambda curve: curve.delta),
    CurveVariable("point_epsilon", POINT, float, "eccentricity ε of the point", lambda curve: curve.epsilon),
    CurveVariable(
        "phase", POINT, float, "phase τ of the departure from Σ+, in forcing periods", lambda curve: curve.tau
    ),
    CurveVariable("velocity", POINT, float, "speed v of the departure from Σ+", lambda curve: curve.v),
    CurveVariable(
        "point_multiplier",
        ("multiplier", "point"),
        complex,
        "Floquet multiplier of the motion; where it grazes, without the square root",
        lambda curve: curve.multipliers,
    ),
    CurveVariable(
        "arclength",
        POINT,
        float,
        "length along the curve in the (δ, ε) plane, from the start of the piece",
        lambda curve: curve.arclength,
    ),
    CurveVariable("piece", POINT, np.int64, "number of the connected piece, from 0", lambda curve: curve.piece),
    CurveVariable(
        "fold", POINT, bool, "whether δ turns back at the point", lambda curve: np.isin(range(len(curve)), curve.folds)
    ),
    CurveVariable(
        "end_point",
        END,
        np.int64,
        "number of the point, from 0, at which a piece ends; two ends of each piece in turn",
        lambda curve: [end.index for end in curve.ends],
    ),
    CurveVariable(
        "end_reason",
        END,
        TEXT,
        "why the curve ends there: a codimension-two point, the edge of existence of its motion, or, where it goes on, "
        "the window of the survey",
        lambda curve: [end.reason for end in curve.ends],
    ),
)

Points = tuple[CodimensionTwo, ...]


def _curve_pairs_at_points(points: Points) -> list[tuple[str, str, str, float]]:
    """Return an entry for each pair of curves that meet at a codimension-two point.

    Returns
    -------
    list[tuple[str, str, str, float]]
        Name of the point, names of both curves, and the measured order p of their contact: 1 if the curves cross, 2 if
        they touch. At a small distance Δδ from the point their ε differ by an amount proportional to |Δδ|^p.
    """
    return [(point.name, *pair, order) for point in points for pair, order in point.tangency.items()]


POINT_VARIABLES: tuple[CurveVariable, ...] = (
    CurveVariable(
        "point", POINT, TEXT, "name of the codimension-two point", lambda points: [each.name for each in points]
    ),
    CurveVariable(
        "point_delta", POINT, float, "damping δ of the point", lambda points: [each.delta for each in points]
    ),
    CurveVariable(
        "point_epsilon", POINT, float, "eccentricity ε of the point", lambda points: [each.epsilon for each in points]
    ),
    CurveVariable(
        "meaning", POINT, TEXT, "what happens at the point", lambda points: [each.meaning for each in points]
    ),
    CurveVariable(
        "curves",
        POINT,
        TEXT,
        "curves that meet at the point, groups of /curves, separated by spaces",
        lambda points: [" ".join(each.curves) for each in points],
    ),
    CurveVariable(
        "pair_point",
        PAIR,
        TEXT,
        "point at which a pair of curves meets",
        lambda points: _entries_of_curve_pairs(points, 0),
    ),
    CurveVariable("pair_first", PAIR, TEXT, "one curve of the pair", lambda points: _entries_of_curve_pairs(points, 1)),
    CurveVariable(
        "pair_second", PAIR, TEXT, "the other curve of the pair", lambda points: _entries_of_curve_pairs(points, 2)
    ),
    CurveVariable(
        "pair_tangency",
        PAIR,
        float,
        "measured order p of |ε₁ − ε₂| ∝ |Δδ|^p of the pair at the point: 1 where they cross, 2 where they touch",
        lambda points: _entries_of_curve_pairs(points, 3),
    ),
)


def _entries_of_curve_pairs(points: Points, number: int) -> list[Any]:
    """Return entry `number` (0 to 3) of each tuple that `_curve_pairs_at_points` returns."""
    return [pair[number] for pair in _curve_pairs_at_points(points)]


def window_around(delta: np.ndarray, epsilon: np.ndarray) -> Window:
    """Return the rectangle of the plane that a map of these cells shows.

    The rectangle extends half a cell beyond the cells on each side (but not to δ ≤ 0 or ε < 0), so a curve that crosses
    a cell on the border has points on both sides of that cell.

    Returns
    -------
    Window
        Ranges of δ and ε.
    """
    low, high = _widen_range(delta, 0.0)
    bottom, top = _widen_range(epsilon, LEAST_EPSILON)
    return Window((max(low, LOWEST_DELTA * float(delta[0])), high), (max(bottom, 0.0), top))


def _widen_range(axis: np.ndarray, scale: float) -> tuple[float, float]:
    """Return the range of an axis, widened on both sides by half a cell, but at least by a tiny length.

    This length is NARROWEST times the last value of the axis, or times `scale` if `scale` is larger.

    Returns
    -------
    tuple[float, float]
        Low and high end.
    """
    low, high = float(axis[0]), float(axis[-1])
    half = max((high - low) / max(2 * (axis.size - 1), 1), NARROWEST * max(abs(high), scale))
    return low - half, min(high + half, sys.float_info.max)


@lru_cache(maxsize=128)
def trace_curve_in_window(name: str, model: Model, window: Window) -> Curve | MissingCurve:
    """Trace a curve inside a window; a `MissingCurve` gives the reason if that fails. Results are cached.

    Pictures of a running survey draw the same curves repeatedly.

    Returns
    -------
    Curve or MissingCurve
        The curve, or the reason why it is not traced.
    """
    try:
        with np.errstate(all="ignore"):  # steps of the search may overflow if the window has extreme values
            return model.trace(name, window.delta, window.epsilon)
    except RattleError as error:
        return MissingCurve(f"not traced: {error}")


@lru_cache(maxsize=8)
def cell_pairs_crossed_by_curves(model: Model, delta: Axis, epsilon: Axis) -> tuple[CurveCrossings, ...]:
    """Return for each curve of a model the pairs of neighbouring cells of a grid between which the curve passes."""
    grid = delta.values(), epsilon.values()
    found = (trace_curve_in_window(name, model, window_around(*grid)) for name in model.curve_names)
    return tuple(find_curve_crossings(_polyline_of_curve(curve), *grid) for curve in found)


def _polyline_of_curve(curve: Curve | MissingCurve) -> Polyline:
    if isinstance(curve, MissingCurve):
        return np.zeros(0), np.zeros(0), np.zeros(0, np.int64)
    return curve.delta, curve.epsilon, curve.piece


def curve_attributes(name: str, model: Model, curve: Curve | MissingCurve) -> dict[str, str]:
    """Return the attributes of a curve's group. If the group has no points, the attribute `comment` says why.

    The attribute `references` names the paper of the model, although the paper does not contain all of these curves.

    Returns
    -------
    dict[str, str]
        CF attributes by name.
    """
    attributes = {"long_name": f"{name}: {model.describe(name)}", "references": f"https://doi.org/{DOI}"}
    if isinstance(curve, MissingCurve):
        attributes["comment"] = curve.reason
    elif not len(curve):
        attributes["comment"] = "no part of the curve is in the window"
    return attributes
