"""Refine the visible window, over the cells of a whole survey.

All of its cells, or finer ones that the workers compute while the viewer stays there and no longer.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import aclosing
from functools import partial

import numpy as np

from gear_rattle.service.explorer.common.address import Ranges
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.map.colouring import values_shown, window_shown
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane, Room, box_of_cells
from gear_rattle.service.operations.windows import Windows, inside, is_coarse
from gear_rattle.workers import Frame
from gear_rattle.workers.pictures.look import is_of_survey_only
from gear_rattle.workers.pictures.planes import drawn_numbers
from rattle import RattleError

SURVEY_ONLY = "This is shown for the cells of the survey only."


class Closer:
    """Over one map. `say` gets what goes on, `on_seen` is called when other cells than before are seen.

    `finer` is what the workers have computed of the window; `seen` gives the cells of the window, and is None where
    that is the whole survey.
    """

    def __init__(
        self,
        windows: Windows,
        viewer: Viewer,
        canvas: MapFigure,
        say: Callable[[str], None],
        on_seen: Callable[[], None],
    ) -> None:
        self._viewer, self._map, self._say, self._on_seen = viewer, canvas, say, on_seen
        self._zoom = Zoom(windows, viewer, self._frame, say)
        self._shown: tuple[MapPlane, Ranges] | None = None
        self.finer: MapBlock | None = None
        self.seen: Callable[[], MapBlock] | None = None

    def stop(self) -> None:
        """Compute nothing more."""
        self._zoom.stop()

    def forget(self) -> None:
        """Show the cells of the whole survey alone."""
        self._map.no_frame()
        self.finer = self.seen = self._shown = None
        self._zoom.stop()

    def show(self, plane: MapPlane, variable: str | None, index: int, window: Ranges | None) -> None:
        """Draw what the survey has of this window, or all of it, and then what is finer.

        Parameters
        ----------
        variable : str | None
            Which map is computed finer, None for one that only surveys have.
        """
        self.forget()
        self._say("")
        if window is None:
            self._on_seen()
            return
        self._shown, pixels = (plane, window), self._map.pixels
        if self._map.is_too_close:  # until the workers answer, and where they do not
            self.seen = partial(plane.enlarged, window)
            self._map.frame(values_shown(plane, self.seen()), window)
        else:
            self.seen = partial(plane.block, window, pixels)
        self._on_seen()
        is_coarser = is_coarse(plane.delta, plane.epsilon, window, pixels)
        if is_coarser and (variable is None or is_of_survey_only(variable, plane.request)):
            self._say(SURVEY_ONLY)
        elif is_coarser and variable is not None:
            self._zoom.start(plane, variable, index, window, pixels)
        elif plane.is_thinned(pixels):
            self._viewer.start(self._all_cells(plane, window, pixels))

    async def _all_cells(self, plane: MapPlane, window: Ranges, room: Room) -> None:
        """Draw those cells of a window that are left out where the whole survey is drawn."""
        values, box = await self._viewer.read(partial(window_shown, plane, window, room))
        self._viewer.change(lambda: self._map.frame(values, box) if (plane, window) == self._shown else None)

    def _frame(self, finer: MapBlock) -> None:
        self.finer, self.seen = finer, lambda: finer
        self._viewer.change(lambda: self._map.frame(finer.values, finer.box))
        self._on_seen()


class Zoom:
    """The refinement of one page; `show` gets each frame in the event loop, `say` what goes on."""

    def __init__(
        self, windows: Windows, viewer: Viewer, show: Callable[[MapBlock], None], say: Callable[[str], None]
    ) -> None:
        self._windows, self._viewer, self._show, self._say = windows, viewer, show, say
        self._task: asyncio.Task[None] | None = None

    def start(self, plane: MapPlane, variable: str, index: int, window: Ranges, pixels: tuple[int, int]) -> None:
        """Refine this window; what was refined before is given up."""
        self.stop()
        self._task = self._viewer.start(self._refine(plane, variable, index, window, pixels))

    def stop(self) -> None:
        """Stop the refinement."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _refine(
        self, plane: MapPlane, variable: str, index: int, window: Ranges, pixels: tuple[int, int]
    ) -> None:
        self._say("Computing this window …")
        try:
            frames = self._windows.frames(plane.request, variable, index, inside(*window), pixels)
            async with aclosing(frames):
                async for frame in frames:
                    self._show(block_of(frame))
                    self._say(f"Computing this window: {frame.done:.0%}" if frame.done < 1 else "")
        except RattleError as error:
            self._say(f"This window is not shown finer: {error}")


def block_of(frame: Frame) -> MapBlock:
    """Cells of a window as those of a map; of complex values the modulus."""
    values = drawn_numbers(frame.values).astype(np.float32)
    status = np.ones(values.shape, np.int8)
    return MapBlock(frame.delta, frame.epsilon, values, status, box_of_cells(frame.delta, frame.epsilon))
