"""Compute curves of a model, and orbits and intensities at a point, for answers of the service.

This module imports the library only, so that processes that compute start fast.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from rattle import REGIONS, Attractor, Intensity, ParameterError, RattleError
from rattle.attractors import SpeedLimit
from rattle.curves import Curve
from rattle.models import AnyGear, Model, model_of_gear

Pair = tuple[float, float]


@lru_cache(maxsize=64)
def curves_document(model: Model, delta: Pair, epsilon: Pair) -> dict[str, Any]:
    """Return the body of `GET /v1/curves` for a window. Raises ParameterError if the window is not allowed."""
    with np.errstate(all="ignore"):  # the search may overflow in windows with extreme values
        return {
            "curves": [_curve_document(name, model, delta, epsilon) for name in model.curve_names],
            "points": [
                {
                    "name": point.name,
                    "meaning": point.meaning,
                    "delta": point.delta,
                    "epsilon": point.epsilon,
                    "curves": point.curves,
                    "tangency": [{"curves": pair, "order": finite_or_none(p)} for pair, p in point.tangency.items()],
                }
                for point in model.codimension_two()
            ],
        }


def _curve_document(name: str, model: Model, delta: Pair, epsilon: Pair) -> dict[str, Any]:
    head = {"name": name, "meaning": model.describe(name)}
    try:
        return head | _curve_arrays(model.trace(name, delta, epsilon)) | {"missing": None}
    except ParameterError:
        raise
    except RattleError as error:
        empty = ("delta", "epsilon", "tau", "v", "multipliers", "arclength", "piece", "folds", "ends")
        return head | dict.fromkeys(empty, ()) | {"missing": str(error)}


def _curve_arrays(curve: Curve) -> dict[str, Any]:
    columns = {name: getattr(curve, name).tolist() for name in ("delta", "epsilon", "tau", "v", "arclength", "piece")}
    return columns | {
        "multipliers": [[_document_of_complex_number(z) for z in pair] for pair in curve.multipliers.T],
        "folds": curve.folds,
        "ends": [{"index": end.index, "reason": end.reason} for end in curve.ends],
    }


def orbits_document(gear: AnyGear) -> dict[str, Any]:
    """Return the body of `GET /v1/orbits` for a gear."""
    with np.errstate(all="ignore"):  # extreme parameters may overflow
        limits = model_of_gear(gear).limits(gear.delta)
        region = None if gear.parameters.harmonics else gear.region()  # regions are defined for one harmonic only
        orbits = gear.orbits()
    return {
        "region": region,
        "region_name": None if region is None else REGIONS[region],
        "sn1": _optional_json_number(limits.sn1),
        "flip": _optional_json_number(limits.flip),
        "quiet_limit": _optional_json_number(limits.quiet_limit),
        "missing": [each._asdict() | {"epsilon": _optional_json_number(each.epsilon)} for each in limits.missing],
        "orbits": [
            {
                "name": orbit.name,
                "m": orbit.m,
                "n_plus": orbit.n_plus,
                "n_minus": orbit.n_minus,
                "tau": finite_or_none(orbit.tau),
                "v": finite_or_none(orbit.v),
                "multipliers": [_document_of_complex_number(value) for value in orbit.multipliers],
                "stable": orbit.stable,
            }
            for orbit in orbits
        ],
    }


def compute_intensities(
    gear: AnyGear, count: int, v_max: SpeedLimit, seed: int, budget: int
) -> list[tuple[Attractor, Intensity]]:
    """Return each attractor of a gear together with its intensity."""
    return [(each, gear.intensity(each)) for each in gear.attractors(count, v_max, seed, budget)]


def _optional_json_number(value: float | None) -> float | None:
    return None if value is None else finite_or_none(value)


def _document_of_complex_number(value: complex) -> dict[str, float | None]:
    return {"re": finite_or_none(value.real), "im": finite_or_none(value.imag)}


def finite_or_none(value: float) -> float | None:
    """Return a number that JSON can hold; None for NaN and infinity, which occur where extreme parameters overflow."""
    return float(value) if math.isfinite(value) else None
