"""Equations whose solutions are the saddle-nodes, flips and grazes of a periodic motion in the (δ, ε) plane."""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rattle.continuation.arclength import ContinuationProblem, plane_scale
from rattle.errors import RattleError
from rattle.numerics.complex_step import Array, singularity_function
from rattle.orbits.periodic_motions import Equations


class EventKind(StrEnum):
    """The kinds of events of a periodic motion; the values are the usual abbreviations of continuation codes."""

    SADDLE_NODE = "SN"
    FLIP = "PD"
    GRAZING = "GR"


#: The Floquet multiplier of a motion at a saddle-node, and at a flip.
MULTIPLIER = {EventKind.SADDLE_NODE: 1.0, EventKind.FLIP: -1.0}


def scale_of_unknowns(x: Array) -> Array:
    """Return the scale of each unknown in x (N,): 1 for times and durations, `plane_scale` for δ and ε at the end."""
    scale = np.ones(x.size)
    scale[-2:] = plane_scale(x[-2])
    return scale


def equations_of_bifurcation(itinerary: Equations, kind: EventKind, impact: int | None = None) -> ContinuationProblem:
    """Return the equations (…, n + 2) → (…, n + 1) of a bifurcation in two parameters.

    The unknowns are the n unknowns of the motion, δ and ε. The condition besides the motion's n equations is
    det J(1) = 0 for a saddle-node and det J(−1) = 0 for a flip, where J(λ) is the Jacobian for perturbations that grow
    by the factor λ over a period. For a graze the condition is that the speed at impact number `impact` is 0.

    Returns
    -------
    ContinuationProblem
        Equations and derivatives, for pseudo-arclength continuation.

    Raises
    ------
    RattleError
        If `kind` is a graze and `impact` is None.
    """
    if kind is EventKind.GRAZING:
        if impact is None:
            raise RattleError("the condition of a graze (GR) needs `impact`: give the number of the impact that grazes")
        return ContinuationProblem(lambda x: itinerary.residual_with_graze(x, impact), scale=scale_of_unknowns)
    multiplier = MULTIPLIER[kind]
    borders: list[Array] = []

    def prepare(x: Array) -> None:
        """Set `borders`, which `equations` uses, to the singular vectors of the least singular value of J at x.

        Where det J is 0, these are the left and the right null vector of J.
        """
        left, _, right = np.linalg.svd(itinerary.jacobian(x, multiplier))
        # with this sign the last number of `equations` changes its sign only where det J does
        side = np.sign(np.linalg.det(left @ right))
        borders[:] = (side[..., None] * left[..., -1])[..., None, :], right[..., None, -1, :]

    def equations(x: NDArray) -> NDArray:
        """Return the residual of the motion, and after it a number that is 0 where det J is 0."""
        residual, jacobian = itinerary.evaluate_with_jacobian(x, multiplier)
        return np.concatenate([residual, singularity_function(jacobian, *borders)[..., None]], axis=-1)

    return ContinuationProblem(equations, prepare, scale_of_unknowns)
