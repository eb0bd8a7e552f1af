"""Finer blocks for a window that shows more than the survey has: while the viewer stays there, and no longer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import aclosing

from rattle import RattleError
from service.explorer.address import Pair
from service.explorer.planes import Plane
from service.explorer.viewer import Viewer
from service.explorer.windows import refine
from workers import Frame, Window

LEAST_DELTA = 1e-3  # of the upper end, where the window reaches to no damping at all
COARSEST = 3.0  # pixels of a cell of the survey, beyond which it is computed finer


class Zoom:
    """The refinement of one page; `show` gets each frame in the event loop, `say` what goes on."""

    def __init__(self, viewer: Viewer, show: Callable[[Frame], None], say: Callable[[str], None]) -> None:
        self._viewer, self._show, self._say = viewer, show, say
        self._task: asyncio.Task[None] | None = None

    def start(
        self, plane: Plane, variable: str, index: int, window: tuple[Pair, Pair], pixels: tuple[int, int]
    ) -> None:
        """Refine this window; what was refined before is given up."""
        self.stop()
        self._task = self._viewer.start(self._refine(plane, variable, index, window, pixels))

    def stop(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _refine(
        self, plane: Plane, variable: str, index: int, window: tuple[Pair, Pair], pixels: tuple[int, int]
    ) -> None:
        delta, epsilon = window
        inside = Window((max(delta[0], LEAST_DELTA * delta[1]), delta[1]), (max(epsilon[0], 0.0), epsilon[1]))
        self._say("Computing this window …")
        try:
            frames = refine(self._viewer.front, plane.request, variable, index, inside, pixels)
            async with aclosing(frames):
                async for frame in frames:
                    self._show(frame)
                    self._say(f"Computing this window: {frame.done:.0%}" if frame.done < 1 else "")
        except RattleError as error:
            self._say(f"This window is not shown finer: {error}")


def coarser(plane: Plane, window: tuple[Pair, Pair], pixels: tuple[int, int]) -> bool:
    """Whether cells of the survey are large on the screen, or the window shows more than the survey."""
    for axis, (low, high), size in zip((plane.delta, plane.epsilon), window, pixels, strict=True):
        step = (axis[-1] - axis[0]) / (axis.size - 1)
        if step / (high - low) * size > COARSEST:
            return True
    return False
