"""One map beside the first: what it shows is chosen above it, its window and its cursor are those of the first."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import Chosen, Further, Pair, Ranges, View, numbered
from gear_rattle.service.explorer.common.drawings import Drawings, Show
from gear_rattle.service.explorer.common.heading import Heading
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.common.watch import Watch, on_press
from gear_rattle.service.explorer.further.difference import Difference, require_small
from gear_rattle.service.explorer.further.surveys import request_of_job
from gear_rattle.service.explorer.map.closer import Closer
from gear_rattle.service.explorer.map.colouring import Colouring, Shade, colouring
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import WHOLE, pieces_of, points_in
from gear_rattle.service.explorer.map.picture import AsSeen, links, picture_query
from gear_rattle.service.explorer.map.planes import MapBlock, MapPlane, map_names
from gear_rattle.service.explorer.map.readout import cell_in_words
from gear_rattle.service.explorer.map.shared import Shared
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import POINTS
from rattle import RattleError
from rattle.models import Capability

SHOWN = "shown"
GONE = "This survey is no longer there."
NO_FIRST = "The first map is of no survey: choose one."
MINUS = "first map less this one"


@dataclass(frozen=True)
class Around:
    """Surroundings of a comparison map: the first map, and the surveys, as they are chosen (see `surveys_of`)."""

    view: View
    window: Ranges
    jobs: Mapping[str, JobRow]
    surveys: Mapping[str, str]


@dataclass(frozen=True)
class FurtherCallbacks:
    """Reactions of the first map when a comparison map is used."""

    point: Callable[[float, float], None]
    through: Callable[[float, float], None]
    pointer: Callable[[float, float], None]
    window: Callable[[Pair, Pair], None]
    reset: Callable[[], None]


class FurtherMap:
    """`change` is called with what is chosen, None to take the map away."""

    def __init__(
        self,
        shared: Shared,
        viewer: Viewer,
        theme: str,
        sheet: str,
        first: MapFigure,
        number: int,
        uses: FurtherCallbacks,
        change: Callable[[Further | None], None],
    ) -> None:
        self._shared, self._viewer, self._change = shared, viewer, change
        self.map = MapFigure(
            theme, uses.point, uses.through, uses.pointer, uses.window, uses.reset, first, f"further{number}"
        )
        self._closer = Closer(shared.overlaid.windows, viewer, self.map, self._say, self._count)
        self._title, self._key, self._said, self._links = Heading(sheet), *(Text("", sheet) for _ in range(3))
        self._watch = Watch()
        styled: dict[str, Any] = {"stylesheets": [sheet], "margin": (2, 8, 2, 0)}
        self._survey = pn.widgets.Select(label=f"Survey of map {number}", options={}, width=120, **styled)
        self._variable = pn.widgets.Select(label=f"Map {number}", options={}, width=175, **styled)
        self._minus = pn.widgets.CheckBoxGroup(options=[MINUS], **{**styled, "margin": (2, 8, 8, 4)})
        for widget in (self._survey, self._variable, self._minus):
            self._watch.on(widget, self._on_chosen)
        remove = pn.widgets.Button(label=f"Remove map {number}", **styled)
        on_press(remove, lambda: change(None))
        choices = pn.FlexBox(
            self._survey, self._variable, self._minus, remove, margin=0, sizing_mode="stretch_width",
            align_items="flex-end",
        )  # fmt: skip
        plot = pn.pane.Bokeh(self.map.figure, sizing_mode="stretch_both", margin=0)
        self.panel = pn.Column(
            choices, self._title.pane, plot, self._key.pane, self._links.pane, self._said.pane,
            sizing_mode="stretch_both", margin=0, css_classes=[SHOWN],
        )  # fmt: skip
        self._plane: MapPlane | None = None
        self._further: Further | None = None  # what it is of
        self._around: Around | None = None
        self._drawings = Drawings(viewer)
        self._lines: tuple[Any, ...] = ()
        self._window: Ranges | None = None
        self._colours: Colouring | None = None
        self._over: asyncio.Task[None] | None = None
        self._reading: asyncio.Task[None] | None = None
        self._counting: asyncio.Task[None] | None = None

    def follow(self, further: Further, around: Around) -> None:
        """Show this beside what the first map shows."""
        view, job = around.view, around.jobs.get(further.survey)
        first = around.jobs.get(view.survey)
        if job is None or not job.is_readable:
            self._miss(GONE)
            return
        self._around, further = around, self._offer(further, around, job)
        if further.minus and (first is None or not first.is_readable):
            self._miss(NO_FIRST)
            return
        of_first = (view.survey, view.variable, view.index, view.slice) if further.minus else ()
        jobs = (job, first) if first is not None and further.minus else (job,)
        self._drawings.want((further, of_first), jobs, partial(self._draw, further, view, *jobs))
        if self._plane is not None:
            self._follow_window(self._plane)

    def end(self) -> None:
        """Give up what is at work."""
        self._closer.stop()
        self._drawings.stop()
        for task in (self._over, self._reading, self._counting):
            self._stop(task)

    @staticmethod
    def _stop(task: asyncio.Task[None] | None) -> None:
        if task is not None:
            task.cancel()

    def _offer(self, further: Further, around: Around, job: JobRow) -> Further:
        """Offer the surveys and the maps to choose from.

        Return the choice, another one where a survey has no such map.

        Returns
        -------
        Further
            The choice.
        """
        request = request_of_job(job)
        maps, number = map_names(request), sum(request.along(further.slice))
        chosen = Chosen(further.variable, further.index)
        if chosen not in maps.values():
            chosen = next(iter(maps.values()))
        with self._watch.paused():
            self._survey.param.update(options=dict(around.surveys), value=f"{further.survey},{number}")
            options = {words: each.written for words, each in maps.items()}
            self._variable.param.update(options=options, value=chosen.written, visible=not further.minus)
            self._minus.param.update(value=[MINUS] if further.minus else [])
        return replace(further, variable=chosen.variable, index=chosen.index, slice=number)

    def _on_chosen(self) -> None:
        survey, _, number = str(self._survey.value).partition(",")
        chosen = Chosen.read(str(self._variable.value))
        self._change(Further(survey, chosen.variable, chosen.index, int(number), bool(self._minus.value)))

    async def _draw(self, further: Further, view: View, job: JobRow, first: JobRow | None = None) -> Show:
        def read() -> tuple[MapPlane, MapBlock, Colouring]:
            if first is not None:
                for each in (first, job):
                    require_small(request_of_job(each))
                wanted = view.variable, view.index
                other = self._shared.plane(job, *wanted, further.slice)
                plane: MapPlane = Difference(self._shared.plane(first, *wanted, view.slice), other)
            else:
                plane = self._shared.plane(job, further.variable, further.index, further.slice)
            block = plane.block(room=self.map.pixels)
            return plane, block, colouring(plane, block, "auto", False, self.map.pixels)

        try:
            plane, block, colours = await self._viewer.read(read)
        except RattleError as error:
            said = f'<p class="notice" role="alert">{escape(str(error))}</p>'
            return partial(self._nothing, said)

        def show() -> None:
            other = plane is not self._plane
            self._plane, self._colours, self._further = plane, colours, further
            self.map.in_si(plane.request.machine)
            self.map.cells(block, colours)
            self._title.show(escape(_titled(plane, colours, job, first, request_of_job(job))))
            if other:
                self._window = None
            else:
                self._count()
            self._follow_window(plane)

        return show

    def _miss(self, why: str) -> None:
        self._drawings.stop()
        self._nothing(f"<p>{why}</p>")

    def _nothing(self, why: str) -> None:
        self._plane, self._colours, self._lines = None, None, ()
        self._stop(self._over)
        self.map.no_cells()
        self.map.no_lines()
        self.map.pins({})
        self._closer.forget()
        self._title.instead(why)
        self._key.html = self._said.html = self._links.html = ""

    def _follow_window(self, plane: MapPlane) -> None:
        assert self._further is not None
        assert self._around is not None
        view, window, model = self._around.view, self._around.window, plane.request.gear_model
        if self._window != window:
            self._window = window
            self.map.moved(window[0])
            variable = None if isinstance(plane, Difference) else self._further.variable
            self._closer.show(plane, variable, self._further.index, window if view.delta and view.epsilon else None)
        self.map.pins(numbered(view.pins, model))
        self._links.html = self._pictures(plane, view)
        if (lines := (model, view.overlays, window)) != self._lines:
            if self._lines[:1] != (model,):  # those of another gear
                self.map.no_lines()
            self._lines = lines
            self.map.choose(view.overlays)
            self._stop(self._over)
            self._over = self._viewer.start(self._draw_lines(plane, view.overlays, window))

    def _pictures(self, plane: MapPlane, first: View) -> str:
        """Links to this map as a picture, in HTML; a difference has none."""
        further, colours = self._further, self._colours
        if further is None or colours is None or self._around is None or isinstance(plane, Difference):
            return ""
        lines = tuple(name for name in first.overlays if name not in WHOLE)
        seen = AsSeen.of(colours, self.map.pixels if first.delta and first.epsilon else None)
        request = self._around.jobs[further.survey].request
        shown = replace(
            first, variable=further.variable, index=further.index, slice=further.slice, family=None, overlays=lines
        )
        query = picture_query(request, shown, seen)
        return f"<p class=faint>Picture: {links(further.survey, further.variable, query)}</p>"

    async def _draw_lines(self, plane: MapPlane, names: tuple[str, ...], window: Ranges) -> None:
        """Draw the lines of the first map, as they are of this one's gear."""
        model = plane.request.gear_model
        await self._shared.front.kernels.require(model.name, patience=float("inf"))
        for name in names:
            if name in model.curve_names and name not in WHOLE:
                pieces, _ = await self._viewer.read(partial(pieces_of, name, model, *window))
                self._viewer.change(partial(self.map.line, name, pieces))
        points = (
            await self._viewer.read(partial(points_in, model, window))
            if POINTS in names and Capability.CORNERS in model.has
            else []
        )
        self._viewer.change(partial(self.map.points, points))

    def point_at(self, at: Pair) -> None:
        """Mark a point, and tell what is there."""
        self.map.cursor(at)
        self._stop(self._reading)
        if self._plane is not None and self._window is not None:
            self._reading = self._viewer.start(self._read(self._plane, at, self._window))

    async def _read(self, plane: MapPlane, at: Pair, window: Ranges) -> None:
        said = await self._viewer.read(lambda: cell_in_words(plane, *at, window, self._closer.finer))

        def show() -> None:
            self._said.html = f"<p>{escape(said)}</p>"

        self._viewer.change(show)

    def _say(self, text: str) -> None:
        self._viewer.change(lambda: self._title.progress(text))

    def _count(self) -> None:
        """Count the shares of the key, over the visible cells."""
        plane, seen, colours = self._plane, self._closer.seen, self._colours
        self._stop(self._counting)
        if plane is not None and seen is not None:
            self._counting = self._viewer.start(self._counted(lambda: colouring(plane, seen(), "auto", False).shades))
        elif colours is not None:
            self._key.html = key_of(colours.shades)

    async def _counted(self, shades: Callable[[], tuple[Shade, ...]]) -> None:
        found = key_of(await self._viewer.read(shades))

        def show() -> None:
            self._key.html = found

        self._viewer.change(show)


def _titled(plane: MapPlane, colours: Colouring, job: JobRow, first: JobRow | None, request: SurveyRequest) -> str:
    if not isinstance(plane, Difference) or first is None:  # the choices above tell the rest
        return f"{plane.request.gear_model}{f' ({colours.note})' if colours.note else ''}"
    cells = "the same cells"
    if not plane.is_same_grid:
        size = " × ".join(str(axis.num) for axis in (request.delta, request.epsilon))
        cells = f"each cell of the first with the nearest of {size}, which has other ones"
    return f"{first.called} less {job.called}, {cells}: {colours.title}"


def key_of(shades: tuple[Shade, ...]) -> str:
    """Return the meaning of colours, in HTML."""
    entries = "".join(
        f'<li><span style="display:inline-block;width:.8rem;height:.8rem;background:{each.colour};'
        f'border:1px solid var(--strong-line)" aria-hidden="true"></span> {escape(each.label)}'
        f" {100 * each.share:.2g} %</li>"
        for each in shades
    )
    style = "display:flex;flex-wrap:wrap;gap:.1rem .8rem;margin:0;padding:0;list-style:none"
    return f'<ul style="{style}" aria-label="colours of this map">{entries}</ul>' if entries else ""
