"""The bifurcation curves of one half-backlash as plain values; imports the library alone, for a process that starts."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from rattle import ParameterError, RattleError
from rattle.curves import NAMES, Curve, codimension_two, describe, trace

Pair = tuple[float, float]


@lru_cache(maxsize=64)
def curves_document(beta: float, delta: Pair, epsilon: Pair) -> dict[str, Any]:
    """Curves and codimension-two points of the body of `GET /v1/curves`. Raises ParameterError."""
    with np.errstate(all="ignore"):  # extreme windows overflow on the way
        return {
            "curves": [_curve(name, beta, delta, epsilon) for name in NAMES],
            "points": [
                {
                    "name": point.name,
                    "meaning": point.meaning,
                    "delta": point.delta,
                    "epsilon": point.epsilon,
                    "curves": point.curves,
                    "tangency": [{"curves": pair, "order": number(p)} for pair, p in point.tangency.items()],
                }
                for point in codimension_two(beta)
            ],
        }


def _curve(name: str, beta: float, delta: Pair, epsilon: Pair) -> dict[str, Any]:
    head = {"name": name, "meaning": describe(name)}
    try:
        return head | _points(trace(name, beta, delta, epsilon)) | {"missing": None}
    except ParameterError:
        raise
    except RattleError as error:
        empty = ("delta", "epsilon", "tau", "v", "multipliers", "arclength", "piece", "folds", "ends")
        return head | dict.fromkeys(empty, ()) | {"missing": str(error)}


def _points(curve: Curve) -> dict[str, Any]:
    columns = {name: getattr(curve, name).tolist() for name in ("delta", "epsilon", "tau", "v", "arclength", "piece")}
    return columns | {
        "multipliers": [[{"re": number(z.real), "im": number(z.imag)} for z in pair] for pair in curve.multipliers.T],
        "folds": curve.folds,
        "ends": [{"index": end.index, "reason": end.reason} for end in curve.ends],
    }


def number(value: float) -> float | None:
    """JSON has neither NaN nor infinity; both occur where something overflows at extreme parameters."""
    return float(value) if math.isfinite(value) else None
