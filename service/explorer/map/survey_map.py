"""Show a map of a survey in a figure: all cells, and finer cells of the visible window."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import aclosing
from functools import partial
from typing import TypeVar

import numpy as np

from gear_rattle.service.explorer.common.address import Limits, MapChoice, Pair, Ranges
from gear_rattle.service.explorer.common.drawings import DrawingRunner
from gear_rattle.service.explorer.common.text import MapHeading, TextPane, alert_html
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.map.colouring import (
    Colouring,
    LegendColour,
    block_values_or_nan,
    compute_colouring,
    values_in_window,
)
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane, Room
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.state.store import PageStore, box_of_cells
from gear_rattle.service.operations.windows import clip_to_plane, has_too_coarse_cells
from gear_rattle.workers import WindowFrame
from gear_rattle.workers.pictures.look import needs_whole_survey
from gear_rattle.workers.pictures.planes import values_to_draw
from rattle import RattleError

Read = TypeVar("Read")

SURVEY_ONLY = "This map has no finer cells than those of the survey."


class SurveyMap(ABC):
    """Map in a figure.

    title: the heading. said: the text that describes the cell at which a viewer points.

    Attributes
    ----------
    plane : MapPlane | None
        Map that was drawn last, None if no map of the chosen survey was drawn.
    colours : Colouring | None
        Colours of the drawn map, None while no map is shown.
    finer : MapBlock | None
        Finer cells of the window that the workers have computed, None without such cells.
    """

    def __init__(
        self,
        shared: SharedState,
        viewer: PageSession,
        store: PageStore,
        figure: MapFigure,
        title: MapHeading,
        said: TextPane,
    ) -> None:
        self._shared, self._viewer, self._store = shared, viewer, store
        self.figure, self.title, self.said = figure, title, said
        self.plane: MapPlane | None = None
        self.colours: Colouring | None = None
        self.finer: MapBlock | None = None
        self.drawings = DrawingRunner(viewer, self.show_error)
        self._chosen: MapChoice | None = None
        self._colour_range_and_scale: tuple[Limits | Pair, bool] = "auto", False
        # function that returns the drawn cells of the window; None while the whole survey is shown
        self._visible_cells: Callable[[], MapBlock] | None = None
        self._refined: tuple[MapPlane, Ranges] | None = None
        self._refining: asyncio.Task[None] | None = None
        self._counting: asyncio.Task[None] | None = None
        self._reading: asyncio.Task[None] | None = None

    @abstractmethod
    def show_legend_colours(self, shades: Sequence[LegendColour]) -> None:
        """Show the meaning of each colour of the map, and its share of the visible cells."""

    def draw_map(
        self,
        plane: MapPlane,
        block: MapBlock,
        colours: Colouring,
        chosen: MapChoice | None,
        limits: Limits | Pair = "auto",
        log: bool = False,
    ) -> None:
        """Draw the cells of a map.

        Parameters
        ----------
        chosen : MapChoice | None
            Map that the workers can compute in finer windows; None if they cannot, as for a difference.
        limits, log
            The viewer's choice of the colour range, (low, high) or a rule such as "auto"; True for a log scale.
        """
        is_new = plane is not self.plane
        self.plane, self.colours, self._chosen, self._colour_range_and_scale = plane, colours, chosen, (limits, log)
        self.figure.draw_cells(block, colours)
        if is_new:
            self.draw_visible_window()
        else:
            self._show_colour_shares()

    def show_nothing(self, why: str) -> None:
        """Remove all cells, and write why no map is shown. why: the reason, in HTML."""
        self.title.show_reason_for_no_map(why)
        self.colours = None
        self.figure.remove_cells()
        self.forget_window()
        self._show_colour_shares()
        self.said.html = ""

    def show_error(self, error: RattleError) -> None:
        """Remove the map, and write why it could not be drawn."""
        self.show_nothing(alert_html(str(error)))

    def end(self) -> None:
        """Stop all work for a page that was closed."""
        self.forget_window()
        self.drawings.stop()

    def forget_window(self) -> None:
        """Show only the cells of the whole survey, and cancel the computation of finer cells."""
        self.figure.remove_finer_cells()
        self.finer = self._visible_cells = self._refined = None
        if self._refining is not None:
            self._refining.cancel()

    def draw_visible_window(self) -> None:
        """Draw the survey's cells in the visible window. If they are coarse, have finer cells computed and drawn."""
        self.forget_window()
        self._show_progress("")
        plane, window, chosen = self.plane, self._store.view.window, self._chosen
        if plane is None:
            return
        if window is None:
            self._show_colour_shares()
            return
        self._refined, pixels = (plane, window), self.figure.pixels
        if self.figure.has_too_large_cells:  # the enlarged cells stay until the workers send finer cells
            self._visible_cells = partial(plane.enlarged_block, window)
            self.figure.draw_finer_cells(block_values_or_nan(plane, self._visible_cells()), window)
        else:
            self._visible_cells = partial(plane.block, window, pixels)
        self._show_colour_shares()
        is_coarser = has_too_coarse_cells(plane.delta, plane.epsilon, window, pixels)
        if is_coarser and (chosen is None or needs_whole_survey(chosen.variable, plane.request)):
            self._show_progress(SURVEY_ONLY)
        elif is_coarser and chosen is not None:
            self._refining = self._viewer.start(self._compute_window(plane, chosen, window, pixels))
        elif plane.has_more_cells_than_pixels(pixels):
            self._refining = self._viewer.start(self._draw_all_cells(plane, window, pixels))

    async def _draw_all_cells(self, plane: MapPlane, window: Ranges, room: Room) -> None:
        """Draw a window's cells in more detail than the drawing of the whole survey has."""
        values, box = await self._viewer.run_in_thread(partial(values_in_window, plane, window, room))
        self._viewer.schedule_document_change(
            lambda: self.figure.draw_finer_cells(values, box) if (plane, window) == self._refined else None
        )

    async def _compute_window(self, plane: MapPlane, chosen: MapChoice, window: Ranges, pixels: Room) -> None:
        """Let the workers compute a window, and draw its finer cells whenever new ones arrive."""
        self._show_progress("Computing this window …")
        windows = self._shared.overlaid.windows
        try:
            frames = windows.frames(plane.request, chosen.variable, chosen.index, clip_to_plane(*window), pixels)
            async with aclosing(frames):
                async for frame in frames:
                    self.show_finer_cells(map_block_of_frame(frame))
                    self._show_progress(f"Computing this window: {frame.done:.0%}" if frame.done < 1 else "")
        except RattleError as error:
            self._show_progress(f"No finer cells of this window could be computed: {error}")

    def show_finer_cells(self, finer: MapBlock) -> None:
        """Draw finer cells of the window."""
        self.finer, self._visible_cells = finer, lambda: finer
        self._viewer.schedule_document_change(lambda: self.figure.draw_finer_cells(finer.values, finer.box))
        self._show_colour_shares()

    def _show_colour_shares(self) -> None:
        """Compute the share of each colour among the visible cells, and show it in the key."""
        if self._counting is not None:
            self._counting.cancel()
        if self.plane is not None and self._visible_cells is not None:
            self._counting = self._viewer.start(self._compute_legend_colours(self.plane, self._visible_cells))
        else:
            self.show_legend_colours(self.colours.shades if self.colours is not None else ())

    async def _compute_legend_colours(self, plane: MapPlane, visible_cells: Callable[[], MapBlock]) -> None:
        limits, log = self._colour_range_and_scale
        shades = await self._viewer.run_in_thread(lambda: compute_colouring(plane, visible_cells(), limits, log).shades)
        self._viewer.schedule_document_change(lambda: self.show_legend_colours(shades))

    def read_cell(self, read: Callable[[], Read], show: Callable[[Read], object]) -> None:
        """Call `read` in a thread, and then `show` with its result. Cancel the reading that an earlier call began."""
        self.stop_reading()
        self._reading = self._viewer.start(self._read_and_show(read, show))

    async def _read_and_show(self, read: Callable[[], Read], show: Callable[[Read], object]) -> None:
        found = await self._viewer.run_in_thread(read)
        self._viewer.schedule_document_change(lambda: show(found))

    def stop_reading(self) -> None:
        """Cancel the reading of a cell."""
        if self._reading is not None:
            self._reading.cancel()

    def _show_progress(self, text: str) -> None:
        self._viewer.schedule_document_change(lambda: self.title.show_progress(text))


def map_block_of_frame(frame: WindowFrame) -> MapBlock:
    """Return the cells of a computed window as a block of a map, with the modulus of complex values."""
    values = values_to_draw(frame.values).astype(np.float32)
    status = np.ones(values.shape, np.int8)
    return MapBlock(frame.delta, frame.epsilon, values, status, box_of_cells(frame.delta, frame.epsilon))
