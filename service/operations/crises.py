"""Compute the boundary crisis for maps, and keep the curves, because they take half a minute to compute."""

from __future__ import annotations

import asyncio
from functools import partial

import numpy as np
from anyio import BrokenWorkerProcess, CapacityLimiter, to_process

from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.state import ApplicationState
from rattle import RattleError
from rattle.models import Capability, Model, require_capability

RESOLUTION = 0.02  # largest step in δ; it is twice the default of `crisis_curve`, so that a curve takes half the time
KEPT_CRISIS_CURVES = 16  # at most this many crisis curves are kept, one for each half-backlash


def _compute_crisis_points(beta: float) -> np.ndarray:
    """Return points (δ, ε) of the crisis curve, shape (k, 2). This takes half a minute: use a process."""
    from rattle.crisis import crisis_curve

    curve = crisis_curve(beta=beta, resolution=RESOLUTION)
    return np.column_stack([curve.delta, curve.epsilon])


class CrisisCurves:
    """The crisis curves that pages and pictures request. The latest curves are kept, one for each half-backlash."""

    def __init__(self, front: ApplicationState) -> None:
        self._front = front
        self._found: dict[float, asyncio.Task[np.ndarray]] = {}
        self._limiter = CapacityLimiter(1)

    async def crisis_curve_of(self, model: Model) -> np.ndarray:
        """Return a model's crisis curve as points (δ, ε), shape (k, 2). Raises RattleError if it cannot be computed."""
        require_capability(Capability.CRISIS, model)
        beta = model.beta
        if beta not in self._found:
            while len(self._found) >= KEPT_CRISIS_CURVES:
                self._found.pop(next(iter(self._found)))
            self._found[beta] = asyncio.get_running_loop().create_task(self._compute_crisis_curve(beta))
        task = self._found[beta]
        try:
            return await asyncio.shield(task)
        except Exception as error:
            if not isinstance(error, RattleError):  # the next request may succeed
                self._found.pop(beta, None)
            raise

    async def _compute_crisis_curve(self, beta: float) -> np.ndarray:
        try:
            with self._front.interruptible_work():
                work = partial(_compute_crisis_points, beta)
                return await to_process.run_sync(work, cancellable=True, limiter=self._limiter)
        except BrokenWorkerProcess as error:
            raise UnavailableError(
                "The process that computed the boundary crisis has died. Try again; on the page, switch its line off "
                "and on."
            ) from error
