"""Finer blocks for a window that shows more than the survey has: while the viewer stays there, and no longer."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing
from typing import Any, Protocol

import numpy as np

from service.explorer.address import Pair
from service.explorer.planes import Plane
from service.explorer.viewer import Viewer
from service.state import Front
from workers import SurveyRequest

COARSEST = 3.0  # pixels of a cell of the survey, beyond which it is computed finer


class Frame(Protocol):
    """A block of a window: centres of its cells, and values (epsilon, delta), NaN where not known yet."""

    delta: np.ndarray
    epsilon: np.ndarray
    values: np.ndarray


Refine = Callable[[Front, SurveyRequest, str, int, Any, tuple[int, int]], AsyncIterator[Frame]]


class Zoom:
    """The refinement of one page; `show` gets each frame in the event loop, `say` what goes on."""

    def __init__(self, viewer: Viewer, show: Callable[[Frame], None], say: Callable[[str], None]) -> None:
        self._viewer, self._show, self._say = viewer, show, say
        self._task: asyncio.Task[None] | None = None

    def start(
        self, plane: Plane, variable: str, index: int, window: tuple[Pair, Pair], pixels: tuple[int, int]
    ) -> None:
        """Refine this window if the survey is coarser than the screen; what was refined before is given up."""
        self.stop()
        if coarser(plane, window, pixels):
            self._task = self._viewer.start(self._refine(plane, variable, index, window, pixels))

    def stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _refine(
        self, plane: Plane, variable: str, index: int, window: tuple[Pair, Pair], pixels: tuple[int, int]
    ) -> None:
        refine = refinement()
        if refine is None:
            return
        self._say("computing this window …")
        async with aclosing(refine(self._viewer.front, plane.request, variable, index, window, pixels)) as frames:  # type: ignore[type-var]
            async for frame in frames:
                self._show(frame)
        self._say("")


def refinement() -> Refine | None:
    """The function that computes windows."""
    try:
        from service.explorer.windows import refine  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        return None
    return refine  # type: ignore[no-any-return,unused-ignore]


def coarser(plane: Plane, window: tuple[Pair, Pair], pixels: tuple[int, int]) -> bool:
    """Whether cells of the survey are large on the screen, or the window shows more than the survey."""
    for axis, (low, high), size in zip((plane.delta, plane.epsilon), window, pixels, strict=True):
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        if step / (high - low) * size > COARSEST:
            return True
    return False
