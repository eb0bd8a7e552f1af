"""Equations of saddle-nodes, flips and grazes of any periodic motion in the (δ, ε) plane.

Also motions to follow along a line in it.
"""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem, plane_scale
from rattle.errors import RattleError
from rattle.numerics.complex_step import Array, bordered
from rattle.orbits.periodic import Equations


class Kind(StrEnum):
    """Event of a periodic motion; the names are those of continuation codes."""

    SADDLE_NODE = "SN"
    FLIP = "PD"
    GRAZING = "GR"


MULTIPLIER = {Kind.SADDLE_NODE: 1.0, Kind.FLIP: -1.0}


def scale_at(x: Array) -> Array:
    """Return the scale of unknowns (N,) of which δ and ε are the last."""
    scale = np.ones(x.size)
    scale[-2:] = plane_scale(x[-2])
    return scale


def condition(itinerary: Equations, kind: Kind, impact: int | None = None) -> ContinuationProblem:
    """Return the equations (…, n + 2) → (…, n + 1) of a bifurcation in two parameters.

    Times, δ and ε are unknown. SN: det J(1) = 0. PD: det J(−1) = 0. GR: impact number `impact` is reached with velocity
    0.

    Returns
    -------
    ContinuationProblem
        Equations and derivatives, for pseudo-arclength continuation.

    Raises
    ------
    RattleError
        If a graze is requested without its impact.
    """
    if kind is Kind.GRAZING:
        if impact is None:
            raise RattleError("a graze needs the number of the impact that grazes")
        return ContinuationProblem(lambda x: itinerary.with_graze(x, impact), scale=scale_at)
    multiplier = MULTIPLIER[kind]
    borders: list[Array] = []

    def prepare(x: Array) -> None:
        left, _, right = np.linalg.svd(itinerary.jacobian(x, multiplier))
        side = np.sign(np.linalg.det(left @ right))  # of the null vectors, so that det changes no sign
        borders[:] = (side[..., None] * left[..., -1])[..., None, :], right[..., None, -1, :]

    def equations(x: NDArray) -> NDArray:
        residual, jacobian = itinerary.with_jacobian(x, multiplier)
        return np.concatenate([residual, bordered(jacobian, *borders)[..., None]], axis=-1)

    return ContinuationProblem(equations, prepare, scale_at)
