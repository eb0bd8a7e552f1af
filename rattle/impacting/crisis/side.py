"""On which side of its boundary crisis a parameter point is: whether a part of W^u(A) goes to rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import parameters
from rattle.impacting.crisis.escape import SAMPLES, FollowedManifold, saddles

CRISIS_SIDES = ("not_computed", "no_saddle", "inside", "escapes", "undecided")
NO_SADDLE, INSIDE, ESCAPES, UNSURE = range(1, 5)


def crisis_side(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Return indices of CRISIS_SIDES, of the broadcast shape of delta, epsilon and beta (dimensionless).

    no_saddle: A does not exist. inside: no sample of W^u(A), on the side of rising v, goes to rest. escapes: some do.
    undecided: there is no rest to go to, from the quiet limit on, or telling takes more than 8192 impacts, below δ =
    0.3 in proportion more: just below that and where A is born. A part of W^u(A) shorter than 1/512 of a fundamental
    domain that escapes is not seen: at δ from 0.6 to 0.768 and β = 0.6 the side is right from 1e-5 of the crisis on. A
    cell's side does not depend on the other cells. Raises ParameterError. Source: docs/crisis.md.

    Returns
    -------
    NDArray[np.int8]
        Index of each point.
    """
    broadcast = parameters(delta, epsilon, beta)
    a = saddles(*(np.array(x, order="C").ravel() for x in broadcast))
    side, known = np.where(a.exists, UNSURE, NO_SADDLE).astype(np.int8), a.decidable
    if known.any():
        a = a.at(known)
        side[known] = np.where(FollowedManifold(a, SAMPLES, a.excursions).at_rest.any(axis=1), ESCAPES, INSIDE)
    return side.reshape(np.shape(broadcast[0]))
