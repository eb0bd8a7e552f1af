"""Show a map of a survey in a figure: all cells, and finer cells of the visible window."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import aclosing
from functools import partial

import numpy as np

from gear_rattle.service.explorer.common.address import Chosen, Limits, Pair, Ranges
from gear_rattle.service.explorer.common.drawings import Drawings
from gear_rattle.service.explorer.common.heading import Heading
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.map.colouring import Colouring, Shade, colouring, values_shown, window_shown
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane, Room
from gear_rattle.service.explorer.map.shared import Shared
from gear_rattle.service.explorer.state.store import Store, box_of_cells
from gear_rattle.service.operations.windows import inside, is_coarse
from gear_rattle.workers import Frame
from gear_rattle.workers.pictures.look import is_survey_only
from gear_rattle.workers.pictures.planes import drawn_numbers
from rattle import RattleError

SURVEY_ONLY = "This is shown for the cells of the survey only."


class SurveyMap(ABC):
    """Map in a figure, with a heading (`title`) and a text about the cell that a viewer points at (`said`).

    Attributes
    ----------
    plane, colours : MapPlane | None, Colouring | None
        The drawn map and its colours, None where nothing is drawn.
    finer : MapBlock | None
        Finer cells of the window that the workers have computed, None without such cells.
    """

    def __init__(
        self, shared: Shared, viewer: Viewer, store: Store, figure: MapFigure, title: Heading, said: Text
    ) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self.figure, self.title, self.said = figure, title, said
        self.plane: MapPlane | None = None
        self.colours: Colouring | None = None
        self.finer: MapBlock | None = None
        self.drawings = Drawings(viewer)
        self._chosen: Chosen | None = None
        self._how: tuple[Limits | Pair, bool] = "auto", False
        self._seen: Callable[[], MapBlock] | None = None  # returns the cells of the window; None for the whole survey
        self._refined: tuple[MapPlane, Ranges] | None = None
        self._refining: asyncio.Task[None] | None = None
        self._counting: asyncio.Task[None] | None = None

    @abstractmethod
    def show_shades(self, shades: Sequence[Shade]) -> None:
        """Show the meaning of each colour of the map, and its share of the visible cells."""

    def draw_map(
        self,
        plane: MapPlane,
        block: MapBlock,
        colours: Colouring,
        chosen: Chosen | None,
        limits: Limits | Pair = "auto",
        log: bool = False,
    ) -> None:
        """Draw the cells of a map.

        Parameters
        ----------
        chosen : Chosen | None
            Map that the workers compute in finer windows; None for a map that only surveys have.
        limits, log
            Range of the colours that the view requests, and True for a log scale.
        """
        is_new = plane is not self.plane
        self.plane, self.colours, self._chosen, self._how = plane, colours, chosen, (limits, log)
        self.figure.cells(block, colours)
        if is_new:
            self.refine()
        else:
            self._count()

    def show_nothing(self, why: str) -> None:
        """Show no cells, and why (HTML)."""
        self.title.instead(why)
        self.colours = None
        self.figure.no_cells()
        self.forget_window()
        self._count()
        self.said.html = ""

    def end(self) -> None:
        """Stop all work for a page that was closed."""
        self.forget_window()
        self.drawings.stop()

    def forget_window(self) -> None:
        """Show only the cells of the whole survey, and cancel the computation of finer cells."""
        self.figure.no_frame()
        self.finer = self._seen = self._refined = None
        if self._refining is not None:
            self._refining.cancel()

    def refine(self) -> None:
        """Draw the survey's cells in the visible window, and then finer cells."""
        self.forget_window()
        self._say("")
        plane, window, chosen = self.plane, self._store.view.window, self._chosen
        if plane is None:
            return
        if window is None:
            self._count()
            return
        self._refined, pixels = (plane, window), self.figure.pixels
        if self.figure.is_too_close:  # shown until the workers answer, and if they do not
            self._seen = partial(plane.enlarged, window)
            self.figure.frame(values_shown(plane, self._seen()), window)
        else:
            self._seen = partial(plane.block, window, pixels)
        self._count()
        is_coarser = is_coarse(plane.delta, plane.epsilon, window, pixels)
        if is_coarser and (chosen is None or is_survey_only(chosen.variable, plane.request)):
            self._say(SURVEY_ONLY)
        elif is_coarser and chosen is not None:
            self._refining = self._viewer.start(self._compute(plane, chosen, window, pixels))
        elif plane.is_thinned(pixels):
            self._refining = self._viewer.start(self._draw_all_cells(plane, window, pixels))

    async def _draw_all_cells(self, plane: MapPlane, window: Ranges, room: Room) -> None:
        """Draw all cells of a window, some of which are left out in the drawing of the whole survey."""
        values, box = await self._viewer.read(partial(window_shown, plane, window, room))
        self._viewer.change(lambda: self.figure.frame(values, box) if (plane, window) == self._refined else None)

    async def _compute(self, plane: MapPlane, chosen: Chosen, window: Ranges, pixels: Room) -> None:
        """Let the workers compute a window, and draw its finer cells as they come, until the window changes."""
        self._say("Computing this window …")
        windows = self._shared.overlaid.windows
        try:
            frames = windows.frames(plane.request, chosen.variable, chosen.index, inside(*window), pixels)
            async with aclosing(frames):
                async for frame in frames:
                    self.show_finer(block_of(frame))
                    self._say(f"Computing this window: {frame.done:.0%}" if frame.done < 1 else "")
        except RattleError as error:
            self._say(f"This window is not shown finer: {error}")

    def show_finer(self, finer: MapBlock) -> None:
        """Draw finer cells of the window."""
        self.finer, self._seen = finer, lambda: finer
        self._viewer.change(lambda: self.figure.frame(finer.values, finer.box))
        self._count()

    def _count(self) -> None:
        """Count the share of the visible cells that each colour has."""
        if self._counting is not None:
            self._counting.cancel()
        if self.plane is not None and self._seen is not None:
            self._counting = self._viewer.start(self._count_seen(self.plane, self._seen))
        else:
            self.show_shades(self.colours.shades if self.colours is not None else ())

    async def _count_seen(self, plane: MapPlane, seen: Callable[[], MapBlock]) -> None:
        limits, log = self._how
        shades = await self._viewer.read(lambda: colouring(plane, seen(), limits, log).shades)
        self._viewer.change(lambda: self.show_shades(shades))

    def _say(self, text: str) -> None:
        self._viewer.change(lambda: self.title.progress(text))


def block_of(frame: Frame) -> MapBlock:
    """Return the cells of a computed window as a block of a map, with the modulus of complex values."""
    values = drawn_numbers(frame.values).astype(np.float32)
    status = np.ones(values.shape, np.int8)
    return MapBlock(frame.delta, frame.epsilon, values, status, box_of_cells(frame.delta, frame.epsilon))
