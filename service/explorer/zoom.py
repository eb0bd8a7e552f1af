"""Finer blocks for a window that shows more than the survey has: while the viewer stays there, and no longer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import aclosing

from service.explorer.address import Pair
from service.explorer.planes import Plane
from service.explorer.viewer import Viewer
from service.explorer.windows import refine
from workers import Frame, Window

COARSEST = 3.0  # pixels of a cell of the survey, beyond which it is computed finer


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
        self._say("computing this window …")
        async with aclosing(
            refine(self._viewer.front, plane.request, variable, index, Window(*window), pixels)
        ) as frames:
            async for frame in frames:
                self._show(frame)
        self._say("")


def coarser(plane: Plane, window: tuple[Pair, Pair], pixels: tuple[int, int]) -> bool:
    """Whether cells of the survey are large on the screen, or the window shows more than the survey."""
    for axis, (low, high), size in zip((plane.delta, plane.epsilon), window, pixels, strict=True):
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        if step / (high - low) * size > COARSEST:
            return True
    return False
