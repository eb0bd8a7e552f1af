"""The map of a survey with its controls, its key and what is known of the cell that is pointed at."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import panel as pn

from gear_rattle.service.database.tables import UNREADABLE, JobRow, State
from gear_rattle.service.errors import MissingError
from gear_rattle.service.explorer.common.address import UNCHOSEN, Entered, Pair, Pin, Ranges, View, numbered, pin_of
from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.common.drawings import PAUSE
from gear_rattle.service.explorer.common.heading import Heading
from gear_rattle.service.explorer.common.news import JobStatus
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.common.viewer import Viewer
from gear_rattle.service.explorer.design.axes import in_revolutions
from gear_rattle.service.explorer.design.go_to import GoTo
from gear_rattle.service.explorer.design.places import Bookmark
from gear_rattle.service.explorer.map.beside import Beside
from gear_rattle.service.explorer.map.closer import Closer
from gear_rattle.service.explorer.map.colouring import Colouring, colouring
from gear_rattle.service.explorer.map.controls import ControlCallbacks, Controls, meaning_of
from gear_rattle.service.explorer.map.cursor import Cursor, History
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import WHOLE, MapLines
from gear_rattle.service.explorer.map.picture import AsSeen
from gear_rattle.service.explorer.map.planes import SIDE, MapBlock, MapPlane, maps_of, window_of
from gear_rattle.service.explorer.map.readout import cell_in_words
from gear_rattle.service.explorer.map.shared import Shared, in_closed_form, usual_variable
from gear_rattle.service.explorer.point.panel import Below
from gear_rattle.service.explorer.point.state import TAB, marks_of, stands_for
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.pictures.look import LARGEST, LIMIT
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle import RattleError
from rattle.models import BETA, DEFAULT_MODEL, MODELS, Model

#: What does not stay when another survey is chosen.
OF_A_SURVEY = {"delta": None, "epsilon": None, "point": None, "machine": None, "slice": 0, "family": None}
BEGINS = "<p class=faint>The first cells of this survey are being computed.</p>"
WAITS = "<p class=faint>This survey waits for its turn.</p>"


class MapView:
    """The middle of the page; `view` is what it shows, `remember` is told when that changes."""

    def __init__(
        self,
        shared: Shared,
        viewer: Viewer,
        view: View,
        theme: str,
        sheet: str,
        remember: Callable[[View], None],
        save_window: Callable[[], None],
        below: Below | None = None,
        on_pointed: Callable[[Pair], None] = lambda _at: None,
    ) -> None:
        self._shared, self._viewer, self.view, self._remember = shared, viewer, view, remember
        self._has_chosen_variable = bool(view.variable)
        self._on_pointed = on_pointed
        self._job: JobRow | None = None
        self._whole: SurveyRequest | None = None  # of the survey that is chosen, which may have no numbers yet
        self._request: SurveyRequest | None = None  # of its slice, if it has a third axis
        self._plane: MapPlane | None = None
        self._drawing: asyncio.Task[None] | None = None
        self._drawn: tuple[Any, ...] = ()
        self._colours: Colouring | None = None
        self._told: AsSeen | None = None
        self._gone = ""  # a survey of which it has been said that it is not there
        self.map = MapFigure(theme, self.open_point, self.through, self._hover, self.moved, self.reset)
        for size in ("inner_width", "inner_height"):  # a browser tells them after the first drawing
            self.map.figure.on_change(size, in_event_loop(self._on_size))
        self._closer = Closer(shared.overlaid.windows, viewer, self.map, self._say_zoom, self._count)
        heard = self._on_lines, self._on_share
        self._lines = MapLines(shared.overlaid, viewer, self.map, view.overlays, view.share, *heard, sheet)
        self._history = History()
        self._lines.tell(self.model, self.window[0])
        words: dict[str, Callable[[Pair], None]] = {
            "all": lambda _at: self.reset(),
            "open": lambda at: self.open_point(*at),
            "close": lambda _at: self._beside.close(tell=True),
            "through": lambda at: self.through(*at),
            "back": lambda _at: self._show(self._history.back(self._zoomed)),
            "forward": lambda _at: self._show(self._history.forward(self._zoomed)),
        }
        self._cursor = Cursor(viewer.document, self.map.figure, self._shown, self._look, self._go, words)
        uses = ControlCallbacks(
            self._on_variable, self._on_index, self._on_slice, self._on_limits, self._on_own, save_window
        )
        self._controls = Controls(sheet, view.log, uses)
        self._title = Heading(sheet)
        self._said = Text("", sheet, is_spoken=True)
        go_to = GoTo(sheet, self.open_point, self._machine_point, self._on_place)
        self._beside = Beside(viewer, theme, sheet, self._close_point, self._remember_point, go_to, below)
        self.parts = {
            "featured": self._controls.featured,
            "controls": self._controls.panel,
            "title": self._title.pane,
            "plot": pn.pane.Bokeh(self.map.figure, sizing_mode="stretch_both", margin=0),
            "said": self._said.pane,
            "key": self._lines.panel,
            "beside": self._beside.panel,
        }  # fmt: skip
        self._controls.show_limits(self.view.limits, None)

    @property
    def model(self) -> Model:
        """The model of the survey that is chosen."""
        return self._request.gear_model if self._request else MODELS[DEFAULT_MODEL]()

    @property
    def request(self) -> SurveyRequest | None:
        """The survey that is chosen, of a third axis its slice."""
        return self._request

    @property
    def machine(self) -> SurveyedMachine | None:
        """The machine of the survey that is chosen, if it is of one."""
        return self._request.machine if self._request else None

    @property
    def seen(self) -> AsSeen | None:
        """Drawn settings beside the view's; None if nothing is drawn."""
        return AsSeen.of(self._colours, self.map.pixels if self._zoomed else None) if self._colours else None

    @property
    def window(self) -> Ranges:
        """(low, high) of δ and of ε that is shown."""
        if self._zoomed is not None:
            return self._zoomed
        if self._request is None:
            return UNCHOSEN
        return window_of(self._request)

    def choose(self, job: JobRow) -> None:
        """Show another survey; the window and the point stay only with the one they were chosen on."""
        if self.view.survey != job.id:
            other = bool(self.view.survey)
            self._change(survey=job.id, **(OF_A_SURVEY if other else {}))
            if other:
                self._beside.close()
                self._mark()
        self._plane, self._drawn = None, ()
        self._closer.stop()
        self._follow(job)

    def follow(self, standing: JobStatus | None) -> None:
        """Follow the survey that is shown: it may have more to show."""
        if standing is not None:
            self._follow(standing.job)
        elif self.view.survey and self._gone != self.view.survey:
            self._gone = self.view.survey
            self._job, self._request, self._plane = None, None, None
            self._show_nothing("<p>This survey is no longer there. Choose another one.</p>")
            self._shared.atlas.forget(lambda survey_id: survey_id != self.view.survey)
        elif not self.view.survey and self._whole is None:
            self._offer(self._shared.exact.request, self._shared.exact.maps)
            self._redraw()

    async def _draw_exact(self) -> None:
        """Draw what is known without any survey."""
        view = self.view
        plane, block, colours = await self._viewer.read(partial(self._shared.exact_map, view))
        # a survey may have come meanwhile
        self._viewer.change(lambda: self._draw(plane, block, colours, view) if self._job is None else None)

    def _follow(self, job: JobRow) -> None:
        if not job.is_readable:
            self._job, self._request, self._plane = job, None, None
            self._show_nothing(f"<p>{UNREADABLE}</p>")
            return
        known = self._job if self._job is not None and self._job.id == job.id else None
        self._job = job
        begins = known is not None and known.state != job.state and self._is_computed
        if known is None or (begins and not self._has_chosen_variable):
            self._offer(SurveyRequest.model_validate(job.request))
        if self._drawing is None or self._drawing.done():
            self._drawing = self._viewer.start(self._keep_drawing())

    def _offer(self, request: SurveyRequest, maps: Mapping[str, Any] | None = None) -> None:
        """Offer the maps that a survey has, or these of them."""
        self._whole = request
        maps = maps_of(request) if maps is None else maps
        self._cut(request, self.view.slice)
        self.map.in_si(request.machine)
        stays = self._has_chosen_variable and self.view.variable in maps
        variable = self.view.variable if stays else usual_variable(request, self._is_waiting)
        self._maps = maps
        self._controls.offer_variables(maps, variable)
        self._change(variable=variable)
        self._offer_index()

    def _cut(self, whole: SurveyRequest, number: int) -> None:
        """Choose the plane that is shown: of a third axis one slice."""
        along = whole.along(number)
        self._request = whole.at(along)
        window = None if whole.machine is None else window_of(whole)
        self._lines.tell(self.model, (whole.delta.start, whole.delta.stop), window)
        self._controls.offer_slices(whole, sum(along))
        self._change(slice=sum(along))

    def _offer_index(self) -> None:
        names = self._maps[self.view.variable]
        index = self.view.index if self.view.index < len(names) else 0
        self._controls.offer_indices(names, index)
        self._change(index=index)

    def _change(self, **values: Any) -> None:
        changed = replace(self.view, **values)
        if changed != self.view:
            self.view = changed
            self._remember(changed)

    def _redraw(self) -> None:
        if self._job is not None:
            self._follow(self._job)
        elif not self.view.survey:
            self._viewer.start(self._draw_exact())

    def _on_size(self, _attribute: str, _old: object, _new: object) -> None:
        self._tell_seen()
        self._redraw()

    async def _keep_drawing(self) -> None:
        """Draw until what is drawn is what is wanted; a survey that runs is drawn at most once in PAUSE."""
        while (wanted := self._wanted()) != self._drawn:
            job = self._job
            if job is None:
                return
            if await self._draw_once(job, self.view):
                self._drawn = wanted
            if not State(job.state).final:
                await asyncio.sleep(PAUSE)

    async def _draw_once(self, job: JobRow, view: View) -> bool:
        """Draw what is known; whether that is all there is by now."""

        def show(what: Callable[[], None]) -> None:
            if self._job is not None and self._job.id == job.id:  # none other was chosen meanwhile
                what()

        is_known = self._whole is not None and in_closed_form(self._whole, view.variable)
        if job.state == State.ACCEPTED and not job.started and not is_known:
            self._viewer.change(lambda: show(lambda: self._show_nothing(WAITS)))
            return True
        try:
            plane, is_whole, block, colours = await self._viewer.read(
                partial(self._shared.map_of, job, view, self.map.pixels)
            )
        except RattleError as error:
            begins = isinstance(error, MissingError) and job.state == State.RUNNING and not job.cells_done
            text = BEGINS if begins else f'<p class="notice" role="alert">{escape(str(error))}</p>'
            self._viewer.change(lambda: show(lambda: self._show_nothing(text)))
            return True
        await self._viewer.changed(lambda: show(lambda: self._draw(plane, block, colours, view)))
        return is_whole

    def _wanted(self) -> tuple[Any, ...]:
        job, view = self._job, self.view
        if job is None:
            return ()
        is_large = self._request is not None and max(self._request.shape) > SIDE
        room = self.map.pixels if is_large or view.variable == LARGEST else ()  # what is drawn depends on it
        return job.id, job.state, job.cells_done, view.variable, view.index, view.slice, view.limits, view.log, room

    def _show_nothing(self, why: str) -> None:
        """No numbers, and nothing that belongs to those of another survey."""
        self._title.instead(why)
        self._colours = None
        self.map.no_cells()
        self._closer.forget()
        self._count()
        self._controls.show_limits(self.view.limits, None)
        self._said.html = ""
        self._beside.forget()
        if self._plane is None:
            self._lines.clear()
            self.map.window(*self.window)

    def _draw(self, plane: MapPlane, block: MapBlock, colours: Colouring, view: View) -> None:
        first = self._plane is None or self._plane.id != plane.id
        other = first or self._plane is not plane
        self._plane, self._colours = plane, colours
        self.map.cells(block, colours)
        note = f" <span class=faint>({escape(colours.note)})</span>" if colours.note else ""
        meaning = meaning_of(view.variable)
        title = f"{f'<b>{escape(meaning)}</b><br>' if meaning else ''}{escape(colours.title)}{note}"
        self._title.show(title if plane.request.machine is None else in_revolutions(title))
        if isinstance(view.limits, tuple) and view.limits == self.view.limits and not colours.categorical:
            self._change(limits=(colours.low, colours.high))  # on a log scale, from the least positive value on
        self._controls.show_limits(self.view.limits, colours)
        if first:
            self.map.window(*self.window)
            if self.view.point:
                self._open(*self.view.point, self.view.machine)
            self._draw_lines(self.view.overlays)
        if other:
            self._refine()
        else:
            self._count()
        self._tell_seen()
        self._shared.looked()

    def _tell_seen(self) -> None:
        """Set the links to pictures of the visible map."""
        if self.seen != self._told:
            self._told = self.seen
            self._remember(self.view)

    @property
    def _is_computed(self) -> bool:
        """True if the survey that is shown is being computed."""
        return self._job is not None and self._job.state == State.RUNNING

    @property
    def _is_waiting(self) -> bool:
        """True if the survey that is shown waits for its turn."""
        return self._job is not None and self._job.state == State.ACCEPTED

    def show_usual_variable(self) -> None:
        """Let the next survey decide which map is shown, whatever was chosen before."""
        self._has_chosen_variable = False

    def _on_variable(self) -> None:
        self._has_chosen_variable = True
        self._change(variable=self._controls.variable, index=0, limits="auto")
        self._offer_index()
        self._draw_anew()

    def _on_index(self) -> None:
        self._change(index=self._controls.index)
        self._draw_anew()

    def _on_slice(self) -> None:
        if self._whole is not None:
            self._cut(self._whole, self._controls.slice)
        self._change(family=None)  # each slice has its own
        self._plane = None  # lines, and what is open of a point, are of another model
        self._lines.clear()
        self._draw_anew()

    def _draw_anew(self) -> None:
        self._closer.forget()
        self._redraw()

    def _on_limits(self) -> None:
        limits = self._controls.limits(self.view.limits, self._colours)
        if limits is not None:
            self._change(limits=limits, log=self._controls.log)
            self._redraw()

    def _on_own(self) -> None:
        own = self._controls.own
        if isinstance(own, str):
            self._title.notice(own)
        else:
            self._change(limits=own)
            self._redraw()

    def _on_lines(self) -> None:
        chosen = self._lines.chosen
        new = set(chosen) - set(self.view.overlays)
        self._change(overlays=chosen)
        self.map.choose(chosen)
        self._draw_lines(name for name in chosen if name in new)

    def _on_share(self, share: float) -> None:
        self._change(share=share)
        self._draw_lines([LIMIT])

    def _draw_lines(self, names: Iterable[str]) -> None:
        if self._plane is not None:
            self._lines.draw(tuple(names), self.model, self.window)

    def _shown(self) -> tuple[MapPlane, Ranges, Pair | None] | None:
        return (self._plane, self.window, self.view.point) if self._plane is not None else None

    def _look(self, at: Pair) -> None:
        assert self._plane is not None
        self.map.cursor(at)
        self._on_pointed(at)
        self._said.html = f"<p>{escape(cell_in_words(self._plane, *at, self.window, self._closer.finer))}</p>"
        self._read(*at)

    def _go(self, window: Ranges) -> None:
        if window != self.window and window[0][1] > 0:
            self.map.window(*window)
            self.moved(*window)

    def moved(self, delta: Pair, epsilon: Pair) -> None:
        """Follow the viewer to this window; of maps with one window each of them tells."""
        if (delta, epsilon) == self._zoomed:
            return
        if delta[0] >= delta[1] or epsilon[0] >= epsilon[1]:
            return
        self._history.leave(self._zoomed)
        self._change(delta=delta, epsilon=epsilon)
        self.map.moved(delta)
        self._draw_lines(name for name in self.view.overlays if name not in WHOLE)
        self._refine()

    @property
    def _zoomed(self) -> Ranges | None:
        return (self.view.delta, self.view.epsilon) if self.view.delta and self.view.epsilon else None

    def reset(self) -> None:
        """Show the whole survey."""
        self._history.leave(self._zoomed)
        self._show(None)

    def _show(self, window: Ranges | None) -> None:
        """Show a window, or the whole survey, which the history knows already."""
        delta, epsilon = window or (None, None)
        self._change(delta=delta, epsilon=epsilon)
        self.map.window(*self.window)
        self._draw_lines(self.view.overlays)
        self._refine()

    def _on_place(self, place: Bookmark) -> str:
        """Go to a place that has a name; why not, if not."""
        if self.model != MODELS[DEFAULT_MODEL]():
            named = f"{DEFAULT_MODEL} gear at β = {BETA.default}"
            return f"The places that have names are of the {named}. Choose a survey of it."
        self._go(place.window)
        self._open(*place.point, None, place.state) if place.point else self._beside.close(tell=True)
        return ""

    def _refine(self) -> None:
        if self._plane is None:
            self._closer.forget()
            self._say_zoom("")
        else:
            self._closer.show(self._plane, self.view.variable, self.view.index, self._zoomed)

    def _count(self) -> None:
        """Count the shares of the key, over the visible cells."""
        plane, view, seen = self._plane, self.view, self._closer.seen
        if plane is not None and seen is not None:
            self._lines.count(lambda: colouring(plane, seen(), view.limits, view.log).shades)
        else:
            self._lines.show(self._colours.shades if self._colours is not None else ())

    def _say_zoom(self, text: str) -> None:
        self._viewer.change(lambda: self._title.progress(text))

    def _hover(self, delta: float, epsilon: float) -> None:
        self._cursor.forget()
        self.map.cursor(None)
        self._said.html = ""
        self._on_pointed((delta, epsilon))
        self._read(delta, epsilon)

    def point_at(self, delta: float, epsilon: float) -> None:
        """Read a point that is pointed at in another map, and mark it."""
        self._hover(delta, epsilon)
        self.map.cursor((delta, epsilon))

    def _read(self, delta: float, epsilon: float) -> None:
        if self._plane is not None:
            self._beside.read(self._plane, self._closer.finer, delta, epsilon, self.window)

    def open_point(self, delta: float, epsilon: float) -> None:
        """Look closer at a point."""
        self._open(delta, epsilon, None)

    def open_with(self, at: Pair, state: Mapping[str, str]) -> None:
        """Look closer at a point, whose view begins like this."""
        self._open(*at, None, state)

    def through(self, delta: float, epsilon: float) -> None:
        """Follow what happens on the way from the point that is open to this one."""
        if not self._beside.go_through((delta, epsilon)):
            self.open_point(delta, epsilon)

    def _machine_point(self, entered: Entered) -> None:
        machine = entered.machine
        self._open(machine.delta, machine.epsilon, entered)

    def _open(
        self, delta: float, epsilon: float, entered: Entered | None, asked: Mapping[str, str] | None = None
    ) -> None:
        """Look closer at a point of the map, or at that of a machine which was entered."""
        if delta <= 0 or epsilon < 0:
            return
        known = (self.view.point, self.view.machine) == ((delta, epsilon), entered)
        tab = {name: value for name, value in self.view.point_state.items() if name == TAB}
        state = asked or (self.view.point_state if known else tab)
        machine, model = stands_for((delta, epsilon), entered, self.machine, self.model)
        self._beside.open(delta, epsilon, model, machine, state)
        self._change(point=(delta, epsilon), point_state=state, machine=entered)
        self._mark()
        self._read(delta, epsilon)

    def _mark(self) -> None:
        """Mark the point that is open, with its tolerances, if it is one of this plane."""
        at, ellipse = marks_of(self.view, self.model, self.machine)
        self.map.cross(at)
        self.map.ellipse(ellipse)

    def offer(self, control: Any) -> None:
        """Put another control beside those of the map."""
        self._controls.panel.append(control)

    def keep(self, **values: Any) -> None:
        """Remember what another part of the page shows."""
        self._change(**values)

    @property
    def pin(self) -> Pin | None:
        """The point that is open, to be pinned; None if none is, or of what gear it is has not been read."""
        if self.view.point is None or (self.view.survey and self._request is None):
            return None
        _, model = stands_for(self.view.point, self.view.machine, self.machine, self.model)
        return pin_of(*self.view.point, model)

    def mark_pins(self, pins: Sequence[Pin]) -> None:
        """Mark those that are of this plane."""
        self.map.pins(numbered(pins, self.model))

    def go_to_pin(self, pin: Pin) -> bool:
        """Look closer at the point of a pin; whether it is one of this plane."""
        if pin.model == self.model:
            self.open_point(pin.delta, pin.epsilon)
        return pin.model == self.model

    def end(self) -> None:
        """Give up what is at work for a page that was closed."""
        self._closer.stop()
        self._beside.end()

    def _close_point(self) -> None:
        self._change(point=None, point_state={}, machine=None)
        self._mark()

    def _remember_point(self, state: dict[str, Any]) -> None:
        if self.view.point is not None:
            self._change(point_state={name: str(value) for name, value in state.items()})
            self._mark()
