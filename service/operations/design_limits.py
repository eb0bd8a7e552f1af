"""Compute the design limit for maps: for each damping, the ε up to which gears run quietly with a given probability."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers.pictures.look import Pair
from rattle import Limit, design_limit
from rattle.models import Model

DAMPINGS = 17  # number of dampings, evenly spaced over a survey, at which the limit is computed
COUNT = 512  # initial conditions for each limit; more if the required probability is above 0.992
KEPT_LIMIT_CURVES = 16  # at most this many curves of limits over damping are kept

Key = tuple[Model, Pair, float]
Array = NDArray[np.float64]


def search_design_limit(model: Model, delta: float, share: float) -> Limit:
    """Return the ε up to which a gear runs quietly with at least the probability `share`, with a 95 % interval.

    The limit and each end of its interval are NaN if they lie outside the searched range.

    Returns
    -------
    Limit
        The limit, and the lower and the upper end of its interval.
    """
    given = {"delta": delta, **model.numbers}
    fewest = math.ceil(4.0 * share / (1.0 - share))
    return design_limit(given, "epsilon", share, count=max(COUNT, fewest))


class DesignLimits:
    """The design limits that pages and pictures request. The latest limits are kept for later requests."""

    def __init__(self, front: ApplicationState) -> None:
        self._front = front
        self._known: dict[Key, dict[float, Limit]] = {}

    async def limits_over_damping(self, model: Model, delta: Pair, share: float) -> AsyncIterator[tuple[Array, Array]]:
        """Compute the design limit over a range of damping. After each damping, yield all limits that are known so far.

        Yields
        ------
        tuple[Array, Array]
            Dampings (k,) in rising order; limits and both ends of their 95 % intervals (3, k).

        Raises
        ------
        RattleError
            A limit cannot be computed.
        """
        key = model, delta, share
        known = self._known.pop(key, {})
        self._known[key] = known  # the last key of the dict is the most recently used one
        while len(self._known) > KEPT_LIMIT_CURVES:
            self._known.pop(next(iter(self._known)))
        for value in dampings_coarse_first(delta):
            if value not in known:
                known[value] = await self._front.slow_point_limiter.run_in_background(
                    partial(self._find_limit, model, value, share)
                )
                yield _limits_by_damping(known)
        yield _limits_by_damping(known)

    async def _find_limit(self, model: Model, delta: float, share: float) -> Limit:
        return await compute_in_process(
            self._front,
            search_design_limit,
            *(model, delta, share),
            model=model.name,
            what="The design limit",
            advice="Use the command rattle limit.",
        )


def dampings_coarse_first(delta: Pair) -> list[float]:
    """Return DAMPINGS evenly spaced dampings of a range, the ends first, then the middle, the quarters, and so on."""
    values = np.linspace(*delta, DAMPINGS)
    order = [0, DAMPINGS - 1]
    step = DAMPINGS - 1
    while step > 1:
        order += range(step // 2, DAMPINGS, step)
        step //= 2
    return [float(values[i]) for i in order]


def _limits_by_damping(known: dict[float, Limit]) -> tuple[Array, Array]:
    """Return dampings (k,) in rising order, and their limits with both ends of the intervals (3, k)."""
    rows = sorted(known.items())
    return np.array([value for value, _ in rows]), np.array([limit for _, limit in rows], np.float64).reshape(-1, 3).T
