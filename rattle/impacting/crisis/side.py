"""Decide on which side of the boundary crisis a parameter point lies: whether a part of W^u(A) becomes quiet.

W^u(A) is the unstable manifold of the saddle A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.errors import broadcast_parameters
from rattle.impacting.crisis.escape import SAMPLES, FollowedManifold, saddles_at

CRISIS_SIDES = ("not_computed", "no_saddle", "inside", "escapes", "undecided")
NO_SADDLE, INSIDE, ESCAPES, UNSURE = range(1, 5)


def crisis_side(delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike = 0.6) -> NDArray[np.int8]:
    """Return the side of the boundary crisis as an index of CRISIS_SIDES, of the broadcast shape of the parameters.

    W^u(A) is the unstable manifold of the saddle A; its samples are taken on its branch on the side of rising v.

    - no_saddle: A does not exist.
    - inside: no sample of W^u(A) becomes quiet.
    - escapes: at least one sample of W^u(A) becomes quiet.
    - undecided: no quiet motion exists (from the quiet limit on), or the decision may take more than 8192 impacts,
      as happens just below the quiet limit and where A is born. Below δ = 0.3 the limit of 8192 is larger, in
      proportion to 1/δ.
    - not_computed: never returned; a survey stores it for a cell that is not computed.

    A part of W^u(A) that becomes quiet is missed if it is shorter than 1/512 of a fundamental domain. At β = 0.6 and δ
    from 0.6 to 0.768 the side is right at points that are at least 1e-5 away from the crisis in ε. The side of a cell
    does not depend on other cells. Source: docs/crisis.md.

    Returns
    -------
    NDArray[np.int8]
        Index in CRISIS_SIDES of each point.

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.
    """
    broadcast = broadcast_parameters(delta, epsilon, beta)
    a = saddles_at(*(np.array(x, order="C").ravel() for x in broadcast))
    side, known = np.where(a.exists, UNSURE, NO_SADDLE).astype(np.int8), a.is_decidable_at_points
    if known.any():
        a = a.select(known)
        side[known] = np.where(
            FollowedManifold(a, SAMPLES, a.impacts_until_quiet_at_later_return).quiet_sample_flags.any(axis=1),
            ESCAPES,
            INSIDE,
        )
    return side.reshape(np.shape(broadcast[0]))
