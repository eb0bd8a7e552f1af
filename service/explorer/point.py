"""The view of one parameter point: what runs there, how likely, how safe; basins, one motion, a diagram."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from typing import Any

import panel as pn
import param

import rattle
from rattle.models import AnyModel
from rattle.plot.colours import colour, name_of
from service.explorer import point_basins, point_diagram, point_motion, point_parts, point_words
from service.explorer.files import asset
from service.explorer.point_parts import Chances, DiagramLines, Lines
from service.explorer.point_state import PointState
from service.explorer.point_work import Work
from service.state import Front

COUNT = 1024  # initial conditions of the probabilities
WIDE: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": (0, 4)}
POINTS = 3000  # of a motion
CLICKED = -1  # among the motions to choose from
DIRECTIONS = {"along eccentricity ε": "epsilon", "along damping δ": "delta"}


class PointView(pn.viewable.Viewer):
    """Everything about one (δ, ε); slow parts fill in from processes of their own until `stop` is called.

    `state` is what a URL keeps to reproduce the view, all of it text: the attractor (its place by falling share) or the
    initial condition (tau, v) whose motion is shown, and the direction of the diagram. What of it cannot be read is
    as by default.
    """

    state = param.Dict(default={})

    def __init__(self, front: Front, delta: float, epsilon: float, model: AnyModel, **state: str) -> None:
        self._chosen = PointState.read(state)
        super().__init__(state=self._chosen.text())
        self._front, self._work = front, Work(front, pn.state.curdoc)
        self._motion: asyncio.Task[None] | None = None
        self._diagram: asyncio.Task[None] | None = None
        self._found: Chances | None = None
        self._lines: Lines | None = None
        self._basins: rattle.Basins | None = None
        self._quiet = False  # a widget that changes says what is shown, not what to show
        try:
            self._gear = model.gear(delta, epsilon)
        except rattle.RattleError as error:
            self._panel = pn.Column(self._text(f'<p class="wrong">{escape(str(error))}</p>'), css_classes=["point"])
            return
        self._theme = "dark" if pn.config.theme == "dark" else "default"
        self._lay_out()
        self._work.start(self._fill())

    def __panel__(self) -> Any:
        return self._panel

    def _text(self, html: str = "") -> pn.pane.HTML:
        return pn.pane.HTML(html, stylesheets=self._sheets, margin=(0, 4), sizing_mode="stretch_width")

    @property
    def _sheets(self) -> list[str]:
        return [asset(name) for name in ("widgets.css", "point.css")]

    def _lay_out(self) -> None:
        gear = self._gear
        self._where = self._text(f"<p>{escape(point_words.where(gear))}</p>")
        self._likely, self._safe = self._text(_waiting("how likely quiet running is")), self._text()
        self._table, self._orbits = self._text(), self._text(_waiting("the period-one orbits"))
        self._under_basins = self._text(_waiting("the basins"))
        self._about_lines = self._text()
        self._under_motion = self._text(_waiting("a motion"))
        self._under_diagram = self._text(_waiting("the diagram"))
        self._panel = pn.Column(
            self._where,
            self._likely,
            self._safe,
            self._table,
            self._orbits,
            self._text("<h3>Basins of attraction</h3>"),
            self._basins_part(),
            self._under_basins,
            self._about_lines,
            self._text("<h3>Motion</h3>"),
            *self._motion_parts(),
            self._under_motion,
            self._text("<h3>One-parameter diagram</h3>"),
            *self._diagram_parts(),
            self._under_diagram,
            css_classes=["point"],
            sizing_mode="stretch_width",
            margin=0,
        )
        if isinstance(gear, rattle.Gear):  # in closed form
            self._show_orbits(point_parts.period_one(gear))

    def _basins_part(self) -> pn.pane.Bokeh:
        self._picture = point_basins.BasinsPicture(self._theme, self._on_tap)
        return pn.pane.Bokeh(self._picture.figure, **WIDE)

    def _motion_parts(self) -> tuple[pn.widgets.Select, pn.Row]:
        self._choice = pn.widgets.Select(
            label="Motion shown (or click in the basins)", options={}, stylesheets=self._sheets, width=330
        )
        self._choice.param.watch(self._on_choice, "value")
        self._offer_motions()
        self._motions = point_motion.MotionPictures(self._theme, self._gear.beta)
        pictures = (self._motions.trace, self._motions.portrait)
        panes = [pn.pane.Bokeh(each, margin=0, sizing_mode="stretch_width") for each in pictures]
        return self._choice, pn.Row(*panes, **WIDE)

    def _diagram_parts(self) -> tuple[pn.widgets.RadioButtonGroup, pn.pane.Bokeh]:
        self._direction = pn.widgets.RadioButtonGroup(
            label="Direction of the diagram", options=DIRECTIONS, value=self._chosen.direction, stylesheets=self._sheets
        )
        self._direction.param.watch(self._on_direction, "value")
        self._diagram_picture = point_diagram.DiagramPicture(self._theme)
        return self._direction, pn.pane.Bokeh(self._diagram_picture.figure, **WIDE)

    # What is computed, and in what order

    async def _fill(self) -> None:
        """What is quick first; one slow part after the other, so that the next click is answered at once."""
        answer = self._work.start(self._part(self._likely, self._chances))
        await self._part(self._under_basins, partial(self._some_basins, 100, "cells"))
        await answer
        self._show_motion()
        if isinstance(self._gear, rattle.Gear):
            await self._part(self._safe, partial(self._margin, self._gear))
        else:
            await self._work.change(partial(_tell, self._safe, f"<p>{point_words.NO_MARGIN}</p>"))
            await self._part(self._orbits, self._continued)
        await self._part(self._about_lines, self._some_lines)
        await self._part(self._under_basins, partial(self._some_basins, 300, "refined"))
        await self._part(self._under_diagram, self._one_diagram)
        await self._part(self._under_basins, partial(self._some_basins, 600, "refined"))

    async def _part(self, pane: pn.pane.HTML, work: Callable[[], Awaitable[None]]) -> None:
        await self._work.part(partial(_tell, pane), work)

    async def _chances(self) -> None:
        count = min(COUNT, self._front.settings.max_point_count)
        found = await self._work.compute(point_parts.chances, self._gear, count, what="The attractors")

        def show() -> None:
            self._found = found
            self._likely.object = f"<p><strong>{escape(point_words.how_likely(self._gear, found))}</strong></p>"
            self._table.object = point_words.attractors_table(found)
            self._offer_motions()

        await self._work.change(show)

    async def _continued(self) -> None:
        found = await self._work.compute(point_parts.period_one, self._gear, what="The period-one orbits", slow=True)
        await self._work.change(partial(self._show_orbits, found))

    def _show_orbits(self, found: point_parts.PeriodOne) -> None:
        self._orbits.object = point_words.orbits_table(found)
        self._picture.show_orbits(found.orbits)

    async def _margin(self, gear: rattle.Gear) -> None:
        found = await self._work.compute(point_parts.margin, gear, what="The margin", slow=True)
        said = f"<p>{escape(point_words.how_safe(gear, found))}</p>"
        await self._work.change(partial(_tell, self._safe, said))

    async def _some_basins(self, side: int, method: str) -> None:
        slow = method != "cells"
        found = await self._work.compute(point_parts.basins, self._gear, side, method, what="The basins", slow=slow)

        def show() -> None:
            self._basins = found
            self._picture.show_cells(found)
            self._show_legend()

        await self._work.change(show)

    async def _some_lines(self) -> None:
        found = await self._work.compute(point_parts.lines, self._gear, what="The manifolds", slow=True)

        def show() -> None:
            self._lines = found
            self._picture.show_lines(found.lines)
            notes = "".join(f"<li>{escape(each)}</li>" for each in found.missing)
            self._about_lines.object = f'<ul class="faint">{notes}</ul>' if notes else ""
            self._show_legend()

        await self._work.change(show)

    def _show_legend(self) -> None:
        if self._basins is not None:
            lines = self._lines.lines if self._lines is not None else ()
            side = self._basins.tau.size
            how = f'<p class="faint">{side} × {side} cells. Click one to see its motion.</p>'
            self._under_basins.object = point_basins.legend(self._basins, lines) + how

    # The motion

    def _offer_motions(self) -> None:
        """The attractors, and what was clicked, as choices."""
        names = [f"{i + 1}. {name_of(each)}" for i, each in enumerate(self._found.attractors)] if self._found else []
        options = {name: i for i, name in enumerate(names)}
        if self._chosen.start is not None:
            tau, v = self._chosen.start
            options[f"from τ = {tau:.4f}, v = {v:.4f}"] = CLICKED
        value = CLICKED if self._chosen.start is not None else self._attractor if names else None
        self._quiet = True
        self._choice.param.update(options=options, value=value)
        self._quiet = False

    @property
    def _attractor(self) -> int:
        """The attractor that is shown: the first one that rattles, unless another one is chosen."""
        found = self._found.attractors if self._found else ()
        if self._chosen.attractor is not None and self._chosen.attractor < len(found):
            return self._chosen.attractor
        return next((i for i, each in enumerate(found) if each.kind != "quiet"), 0)

    def _show_motion(self) -> None:
        self._motion = self._work.start(self._part(self._under_motion, self._one_motion), self._motion)

    async def _one_motion(self) -> None:
        chosen, periods, shade = self._chosen, 12.0, "#8a96a3"
        if self._chosen.start is not None:
            (tau, v), what = self._chosen.start, "From the chosen initial condition"
        elif self._found is None or not self._found.attractors:
            raise rattle.RattleError("There is no attractor to show: click in the basins for a motion.")
        else:
            attractor = self._found.attractors[self._attractor]
            tau, v, shade, what = attractor.tau, attractor.v, colour(attractor), name_of(attractor)
            periods = float(min(max(periods, 3 * attractor.m), 60)) if attractor.kind != "chaotic" else 30.0
        found = await self._work.compute(point_parts.motion, self._gear, tau, v, periods, POINTS, what="The motion")

        def show() -> None:
            if (chosen.attractor, chosen.start) != (
                self._chosen.attractor,
                self._chosen.start,
            ):
                return  # another one has been chosen meanwhile
            self._motions.show(found, self._gear.beta, shade)
            self._picture.show_chosen(tau, v)
            self._under_motion.object = f'<p class="faint">{escape(point_motion.caption(found, what))}</p>'

        await self._work.change(show)

    # The diagram

    def _show_diagram(self) -> None:
        self._diagram = self._work.start(self._part(self._under_diagram, self._one_diagram), self._diagram)

    async def _one_diagram(self) -> None:
        direction = self._chosen.direction
        found: DiagramLines = await self._work.compute(
            point_parts.diagram, self._gear, direction, what="The diagram", slow=True
        )
        at = self._gear.epsilon if direction == "epsilon" else self._gear.delta

        def show() -> None:
            if direction != self._chosen.direction:
                return
            self._diagram_picture.show(found, at)
            self._under_diagram.object = f'<p class="faint">{escape(point_diagram.caption(found))}</p>'

        await self._work.change(show)

    # What the viewer does

    def _on_tap(self, tau: float, v: float) -> None:
        self._choose(PointState(self._chosen.attractor, (tau, v), self._chosen.direction))
        self._offer_motions()
        self._show_motion()

    def _on_choice(self, event: Any) -> None:
        if self._quiet or event.new is None or event.new == CLICKED:
            return
        self._choose(PointState(int(event.new), None, self._chosen.direction))
        self._offer_motions()
        self._show_motion()

    def _on_direction(self, event: Any) -> None:
        self._choose(PointState(self._chosen.attractor, self._chosen.start, event.new))
        self._under_diagram.object = _waiting("the diagram")
        self._show_diagram()

    def _choose(self, chosen: PointState) -> None:
        self._chosen = chosen
        self.state = chosen.text()

    def stop(self) -> None:
        """Give up what is still being computed: another point is looked at."""
        self._work.stop()


def _tell(pane: pn.pane.HTML, html: str) -> None:
    pane.object = html


def _waiting(what: str) -> str:
    return f'<p class="faint" role="status">computing {escape(what)} …</p>'
