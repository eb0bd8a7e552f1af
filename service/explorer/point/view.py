"""Show one parameter point: its motions, how likely and how safe they are; basins, one motion, a diagram."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from functools import partial
from html import escape

import panel as pn

import rattle
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.text import Text
from gear_rattle.service.explorer.design import extents, rattling
from gear_rattle.service.explorer.point import basins, loudness, parts, words
from gear_rattle.service.explorer.point.choices import Choices
from gear_rattle.service.explorer.point.panel import PointPanel
from gear_rattle.service.explorer.point.parts import PlaneLines
from gear_rattle.service.explorer.point.state import ANSWER, BASINS, DIAGRAM, MOTION, NUMBERS, PointState
from gear_rattle.service.explorer.point.work import PointTasks, waiting_html
from gear_rattle.service.explorer.state.events import PointChanged
from gear_rattle.service.explorer.state.store import Store, window_of
from gear_rattle.service.state import Front
from rattle import Machine
from rattle.models import Capability, Model, lacking
from rattle.plot import Palette

COUNT = 1024  # number of initial conditions from which the basin fractions are estimated
RESOLUTIONS = (300, 600)  # cells along each axis of the refined basins, in the first and in the last picture
PAINT_SECONDS = 0.05  # seconds for a browser to show the words before it lays out pictures
OF_ONE_COSINE = "The motions A to D and their regions are defined for a forcing of one cosine only."
SURVEYED = ' <span class="faint">(from the survey\'s grid cell; the point itself is being computed)</span>'
Part = tuple[Text, Callable[[], Awaitable[None]]]  # the text that shows an error of the work, and the work
COMPILING = "Kernels are being compiled, once after the service was installed or updated. This takes a minute or so …"


class PointView:
    """Show one point (δ, ε) in a panel. Other processes compute the slow parts, until `stop` is called.

    The state of the tabs is `point_state` of the store's view, see `PointState`.

    Parameters
    ----------
    machine : Machine | None
        Machine that the point stands for, shown in SI units too; None if there is none.
    """

    def __init__(
        self,
        panel: PointPanel,
        front: Front,
        store: Store,
        delta: float,
        epsilon: float,
        model: Model,
        machine: Machine | None = None,
    ) -> None:
        is_possible = delta > 0 and epsilon >= 0  # if it is not possible, `model.gear` below raises the error
        self._fastest = parts.largest_sampled_speed(delta, epsilon, model.beta) if is_possible else 0.0
        self.store = store
        chosen = PointState.read(store.view.point_state, self._fastest)
        self.panel, self._model, self._machine, self._front = panel, model, machine, front
        self.work = PointTasks(front, pn.state.curdoc, model.name)
        self._orbits: tuple[rattle.Orbit, ...] = ()
        self._found: parts.SampledAttractors | None = None
        self.lines: PlaneLines | None = None
        self._basins: rattle.Basins | None = None
        self._palette = Palette()  # one for all pictures and tables of the point
        self._is_there = False  # whether the point has a gear
        self._is_told = False  # whether its attractors are known
        self._at_work: set[str] = set()  # tabs that are being filled
        try:
            self.gear = model.gear(delta, epsilon)
        except rattle.RattleError as error:
            panel.clear()
            panel.likely.html = f'<p class="wrong">{escape(str(error))}</p>'
            return
        self._period = words.period_name(machine)
        self._show_position()
        panel.clear_results()
        self._choices = Choices(
            panel, self.work, self.gear, machine, self._palette, chosen, self._dispatch_state, self._show_own_basins
        )
        self._is_there = True
        self._dispatch_state(chosen)
        self._link_notebook(chosen)
        self._left: dict[str, list[Part]] = {
            ANSWER: [(panel.safe, self._compute_margin)],
            BASINS: [
                (panel.under_basins, partial(self._compute_basins, 100, "cells")),
                (panel.about_lines, self._compute_lines),
                (panel.under_basins, partial(self._compute_basins, RESOLUTIONS[0], "refined")),
                (panel.under_basins, partial(self._compute_basins, RESOLUTIONS[1], "refined")),
            ],
        }
        self._show_waiting_texts()
        panel.show_tab(chosen.shown_tab)
        self.work.start(self._fill())

    def _dispatch_state(self, chosen: PointState) -> None:
        self.store.dispatch(PointChanged(chosen.text()))

    def show_state(self) -> None:
        """Show the state of the tabs that the store's view has now."""
        if self._is_there:
            chosen = PointState.read(self.store.view.point_state, self._fastest)
            self._choices.show_state(chosen)
            self._link_notebook(chosen)
            self._fill_tab()

    def _link_notebook(self, chosen: PointState) -> None:
        self.panel.take.html = words.notebook_link(self.gear, chosen.direction, chosen.span, chosen.to)

    def stop(self) -> None:
        """Give up the computations that still run, because another point is shown."""
        self.work.stop()

    # The methods below compute the parts of the view, in the order in which viewers read them.

    def _show_position(self) -> None:
        """Show where the point is, first of all: removing the last point's results keeps a browser busy for 0.5 s."""
        self.panel.where.html = f"<p>{escape(words.point_in_words(self.gear, self._period))}</p>" + (
            f"<p>{escape(words.machine_in_words(self._machine, self.gear))}</p>" if self._machine else ""
        )

    def _show_waiting_texts(self) -> None:
        panel, ready = self.panel, self._front.kernels.is_compiled(self._model.name)
        for text, what in (
            (panel.orbits, "the period-one orbits"),
            (panel.likely, "how likely quiet running is"), (panel.under_basins, "the basins"),
            (panel.under_motion, "a motion"), (panel.under_diagram, "the diagram"), (panel.events, "the diagram"),
            (panel.safe, "the margin"), (panel.extents, "where each motion begins and ends"),
        ):  # fmt: skip
            text.html = waiting_html(what)
        if not ready:
            panel.likely.html = f'<p class="faint">{COMPILING}</p>'
        if self._model.in_closed_form:
            if ready:
                self._show_orbits(parts.period_one(self.gear))
            else:
                self.work.start(self.work.run_part(panel.orbits, self._show_closed_form_orbits))

    async def _fill(self) -> None:
        """Fill in the words first, and then the open tab, so that the next click is answered at once.

        Pictures come last, because the service takes time to draw them, and the browser to lay them out.
        """
        part, panel = self.work.run_part, self.panel
        await part(panel.likely, self._compute_attractors)
        await part(panel.loud, self._compute_intensities)
        await asyncio.sleep(PAINT_SECONDS)
        self._is_told = True
        self._fill_tab()
        if self.gear.parameters.harmonics:
            await self.work.set_text(panel.orbits, f"<p>{OF_ONE_COSINE}</p>")
        elif not self._model.in_closed_form:
            await part(panel.orbits, self._compute_orbits)
        await part(panel.extents, self._compute_extents)

    def _fill_tab(self) -> None:
        """Compute the content of the open tab, unless it is known or being computed."""
        tab = self._choices.tab
        if not self._is_told:
            return
        if tab == MOTION:
            self._choices.show_motion()
        elif tab in (DIAGRAM, NUMBERS):
            self._choices.request_diagram()
        elif tab not in self._at_work:
            self._at_work.add(tab)
            self.work.start(self._fill_one_tab(tab))

    async def _fill_one_tab(self, tab: str) -> None:
        """Compute the missing parts of a tab one after the other, as long as the tab is open."""
        left = self._left[tab]
        while left and self._choices.tab == tab:
            await self.work.run_part(*left[0])
            left.pop(0)
        self._at_work.discard(tab)

    async def _compute_attractors(self) -> None:
        count = min(COUNT, self._front.settings.max_point_count)
        found = await self.work.compute(parts.sampled_attractors, self.gear, count, what="The attractors")

        def show() -> None:
            self._show_attractors(found)
            self._choices.offer_results(found.attractors)

        await self.work.change(show)

    def show_survey_answer(self, found: parts.SampledAttractors) -> None:
        """Show the attractors of the survey's cell around the point, unless the attractors of the point are known."""
        if self._is_there and self._found is None:
            self._show_answer(found, SURVEYED)

    def _show_answer(self, found: parts.SampledAttractors, note: str = "") -> None:
        said = escape(words.likelihood_in_words(self.gear, found, self._period))
        self.panel.likely.html = f'<p class="answer"><strong>{said}</strong>{note}</p>'
        self.panel.shares.html = words.shares_bar(found, self._palette)

    def _show_attractors(self, found: parts.SampledAttractors) -> None:
        self._found = found
        self._show_answer(found)
        self.panel.table.html = words.attractors_table(found, self._palette)

    async def _compute_intensities(self) -> None:
        if self._found is None:
            return
        attractors = self._found.attractors
        found = await self.work.compute(rattling.motion_intensities, self.gear, attractors, what="The intensities")
        said = loudness.intensity_table(attractors, found, self.gear.delta, self._machine, self._palette)
        await self.work.set_text(self.panel.loud, said)
        loudest = loudness.loudest_in_words(attractors, found, self.gear.delta, self._machine)
        await self.work.set_text(self.panel.loudest, f"<p>{escape(loudest)}</p>" if loudest else "")

    async def _compute_extents(self) -> None:
        """Compute one motion after the other, so that the table grows and each computation is short."""
        if self._found is None:
            return
        attractors, request = self._found.attractors, self.store.request
        within = extents.followed_range(self.gear, None if request is None else window_of(request)[1])
        known: list[extents.Extent | None] = []
        for each in attractors[: extents.MOST_FOLLOWED]:
            try:
                found = await self.work.compute(
                    extents.motion_extent, self.gear, each, within, what="The range of a motion", slow=True
                )
            except UnavailableError:  # it takes too long: the other motions are followed nevertheless
                found = None
            known.append(found)
            await self.work.change(partial(self._show_extents, known))
        if extents.has_swept_chaos(attractors, known):
            with suppress(UnavailableError):  # then the end stays the bracket of the sweep
                known[:] = await self.work.compute(
                    extents.add_crisis, self.gear, known, what="The boundary crisis", slow=True
                )
            await self.work.change(partial(self._show_extents, known))
        chaos = words.chaos_events(self.gear, attractors, known)
        if chaos:  # once: a table that is replaced folds its rows again
            await self.work.change(partial(self._choices.show_chaos, chaos))

    def _show_extents(self, known: Sequence[extents.Extent | None]) -> None:
        if self._found is not None:
            self.panel.extents.html = words.extents_table(self._found, known, self._machine, self._palette)

    async def _show_closed_form_orbits(self) -> None:
        await self.work.wait_for_kernels()
        await self.work.change(lambda: self._show_orbits(parts.period_one(self.gear)))

    async def _compute_orbits(self) -> None:
        found = await self.work.compute(parts.period_one, self.gear, what="The period-one orbits", slow=True)

        def show() -> None:
            self._show_orbits(found)
            if self._found is not None:
                self._show_attractors(parts.add_letters(self._found, found.orbits))
            if self._basins is not None and not self._choices.is_away:
                self.panel.picture.show_orbits(found.orbits)

        await self.work.change(show)

    def _show_orbits(self, found: parts.PeriodOneOrbits) -> None:
        self._orbits = found.orbits
        self.panel.orbits.html = words.orbits_table(found)

    async def _compute_margin(self) -> None:
        if Capability.MARGIN not in self._model.has:
            await self.work.set_text(self.panel.safe, f"<p>{lacking(Capability.MARGIN, self._model)}</p>")
            return
        found = await self.work.compute(parts.margin, self.gear, what="The margin", slow=True)
        await self.work.set_text(
            self.panel.safe, f"<p>{escape(words.margin_in_words(self.gear, found, self._period))}</p>"
        )

    async def _compute_basins(self, side: int, method: str) -> None:
        slow = method != "cells"
        found = await self.work.compute(parts.basins, self.gear, side, method, what="The basins", slow=slow)

        def show() -> None:
            self._basins = found
            if not self._choices.is_away:
                self._show_cells(found)

        await self.work.change(show)

    async def _compute_lines(self) -> None:
        found = await self.work.compute(parts.plane_lines, self.gear, what="The manifolds", slow=True)

        def show() -> None:
            self.lines = found
            if not self._choices.is_away:
                self._show_lines(found)

        await self.work.change(show)

    def _show_own_basins(self) -> None:
        """Show the point's own basins and lines again, after another place on its diagram was shown."""
        if self._basins is not None:
            self._show_cells(self._basins)
        if self.lines is not None:
            self._show_lines(self.lines)

    def _show_cells(self, found: rattle.Basins) -> None:
        self.panel.picture.show_cells(found, self._palette)
        self.panel.picture.show_orbits(self._orbits)
        self._choices.mark_initial_state()
        self._show_legend()

    def _show_lines(self, found: PlaneLines) -> None:
        self.panel.picture.show_lines(found.lines)
        notes = "".join(f"<li>{escape(each)}</li>" for each in found.missing)
        self.panel.about_lines.html = f'<ul class="faint">{notes}</ul>' if notes else ""
        self._show_legend()

    def _show_legend(self) -> None:
        if self._basins is not None:
            lines = self.lines.lines if self.lines is not None else ()
            self.panel.under_basins.html = basins.basins_caption(self._basins, lines, self._palette)
