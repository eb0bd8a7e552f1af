"""Show one parameter point: how likely and how safe quiet running is, all motions, basins, one motion, a diagram."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from html import escape

import panel as pn

import rattle
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.point_state import ANSWER
from gear_rattle.service.explorer.common.text import faint_html
from gear_rattle.service.explorer.design import extents, rattling
from gear_rattle.service.explorer.point import loudness, parts, words
from gear_rattle.service.explorer.point.basins_tab import BasinsTab
from gear_rattle.service.explorer.point.panel import PointPanel
from gear_rattle.service.explorer.point.state import READY, OpenPoint
from gear_rattle.service.explorer.point.tabs import DiagramTab, MotionTab, YieldSection
from gear_rattle.service.explorer.point.work import PointTasks, waiting_html
from gear_rattle.service.explorer.state.store import PageStore, window_of_request
from gear_rattle.service.state import ApplicationState
from rattle import Machine
from rattle.models import Capability, Model, missing_capability_error, model_of_gear

COUNT = 1024  # number of initial conditions from which the basin fractions are estimated
PAINT_SECONDS = 0.05  # pause after the first texts of a point, so that a browser shows them before it lays out pictures
OF_ONE_COSINE = "The motions A to D and their regions are defined for a forcing of one cosine only."
FROM_SURVEY_CELL = ' <span class="faint">(from the survey\'s grid cell; the point itself is being computed)</span>'
COMPILING = "Kernels are being compiled, once after the service was installed or updated. This takes a minute or so …"


class PointView:
    """The view of one point (δ, ε) in a panel. Other processes compute the slow parts, until `stop` is called.

    The state of the tabs is `point_state` of the store's view. Each part of the panel has a class of its own, which
    subscribes to this state and to the results of the point.

    Parameters
    ----------
    machine : Machine | None
        Machine that the point stands for, shown in SI units too; None if there is none.
    """

    def __init__(
        self,
        panel: PointPanel,
        front: ApplicationState,
        store: PageStore,
        delta: float,
        epsilon: float,
        model: Model,
        machine: Machine | None = None,
    ) -> None:
        self.panel, self.store = panel, store
        self.work = PointTasks(front, pn.state.curdoc, model.name)
        self._point: OpenPoint | None = None  # None if no gear is possible at the point
        try:
            self.gear = model.gear(delta, epsilon)
        except rattle.RattleError as error:
            panel.clear()
            panel.likelihood_text.html = f'<p class="wrong">{escape(str(error))}</p>'
            return
        self._point = point = OpenPoint(store, self.work, self.gear, machine)
        # The position is written first, because a browser then needs 0.5 s to remove the previous point's results.
        panel.parameters_text.html = f"<p>{escape(words.point_in_words(self.gear))}</p>"
        panel.clear_results()
        panel.quiet_limit_text.html = f"<p>{escape(words.quiet_limit_in_words(self.gear, point.period))}</p>" + (
            f"<p>{escape(words.machine_in_words(machine, self.gear))}</p>" if machine else ""
        )
        for text, what in (
            (panel.orbits, "the period-one orbits"),
            (panel.likelihood_text, "how likely quiet running is"), (panel.under_basins, "the basins"),
            (panel.under_motion, "a motion"), (panel.under_diagram, "the diagram"), (panel.events, "the diagram"),
            (panel.margin_text, "the margin"), (panel.extents, "where each motion begins and ends"),
        ):  # fmt: skip
            text.html = waiting_html(what)
        self._answer = PointAnswer(point, panel, front)
        for tab in (BasinsTab, MotionTab, DiagramTab, YieldSection):
            tab(point, panel)

    def show_survey_attractors(self, found: parts.SampledAttractors) -> None:
        """Show the attractors of the survey's cell that contains the point, unless the point's own are known."""
        if self._point is not None and self._point.attractors is None:
            self._answer.show_likelihood(found, FROM_SURVEY_CELL)

    def stop(self) -> None:
        """Give up the computations that still run, because another point is shown."""
        if self._point is not None:
            self._point.end()


class PointAnswer:
    """The words and tables of a point's panel, which fill its answer tab and its numbers tab.

    `OpenPoint.is_ready` is set when the words are shown. Pictures come after the words, because the service takes time
    to draw them, and the browser to lay them out.
    """

    def __init__(self, point: OpenPoint, panel: PointPanel, front: ApplicationState) -> None:
        self._point, self._panel = point, panel
        self._count = min(COUNT, front.settings.max_point_count)
        self._gear, self._model = point.gear, model_of_gear(point.gear)
        self._is_margin_requested = False
        is_compiled = front.kernels.is_compiled(self._model.name)
        if not is_compiled:
            panel.likelihood_text.html = faint_html(COMPILING)
        if self._model.has_closed_forms and is_compiled:
            self._show_orbits(parts.compute_period_one_orbits(self._gear))
        elif self._model.has_closed_forms:
            point.work.start(point.work.run_part_or_show_error(panel.orbits, self._show_closed_form_orbits))
        point.subscribe_to_view(self._on_view_change, "point_state")
        point.subscribe(self._on_view_change, READY)
        self._on_view_change()
        point.work.start(self._compute_in_order())

    def _on_view_change(self) -> None:
        point, state = self._point, self._point.tabs_state
        self._panel.show_tab(state.shown_tab)
        self._panel.notebook_link_text.html = words.notebook_link(self._gear, *state.diagram_choice)
        if point.is_ready and state.shown_tab == ANSWER and not self._is_margin_requested:
            self._is_margin_requested = True
            point.work.start(point.work.run_part_or_show_error(self._panel.margin_text, self._compute_margin))

    async def _compute_in_order(self) -> None:
        """Compute and show attractors and intensities, then set `is_ready`; then compute and show orbits and extents.

        `is_ready` lets the open tab begin its computations.
        """
        point, panel = self._point, self._panel
        await point.work.run_part_or_show_error(panel.likelihood_text, self._compute_attractors)
        await point.work.run_part_or_show_error(panel.intensities_text, self._compute_intensities)
        await asyncio.sleep(PAINT_SECONDS)
        await point.work.apply_document_change(lambda: point.update(is_ready=True))
        if self._gear.parameters.harmonics:
            await point.work.set_text(panel.orbits, f"<p>{OF_ONE_COSINE}</p>")
        elif not self._model.has_closed_forms:
            await point.work.run_part_or_show_error(panel.orbits, self._compute_orbits)
        await point.work.run_part_or_show_error(panel.extents, self._compute_extents)

    async def _compute_attractors(self) -> None:
        found = await self._point.work.compute(parts.sampled_attractors, self._gear, self._count, what="The attractors")
        await self._point.work.apply_document_change(lambda: self._show_attractors(found))

    def show_likelihood(self, found: parts.SampledAttractors, note: str = "") -> None:
        """Show in a sentence how likely the gear is to run quietly. note: HTML after the sentence."""
        said = escape(words.likelihood_in_words(self._gear, found, self._point.period))
        self._panel.likelihood_text.html = f'<p class="answer"><strong>{said}</strong>{note}</p>'
        self._panel.basin_fractions_text.html = words.basin_fractions_bar_html(found, self._point.palette)

    def _show_attractors(self, found: parts.SampledAttractors) -> None:
        self.show_likelihood(found)
        self._panel.table.html = words.attractors_table(found, self._point.palette)
        self._point.update(attractors=found)

    async def _compute_intensities(self) -> None:
        point, gear = self._point, self._gear
        if point.attractors is None:
            return
        attractors = point.attractors.attractors
        found = await point.work.compute(rattling.motion_intensities, gear, attractors, what="The intensities")
        said = loudness.intensity_table(attractors, found, gear.delta, point.machine, point.palette)
        await point.work.set_text(self._panel.intensities_text, said)
        loudest = loudness.describe_loudest_motion(attractors, found, gear.delta, point.machine)
        await point.work.set_text(self._panel.loudest_motion_text, f"<p>{escape(loudest)}</p>" if loudest else "")

    async def _compute_extents(self) -> None:
        """Compute the extents of the motions one by one, so that their table grows and each computation is short."""
        point, gear = self._point, self._gear
        if point.attractors is None:
            return
        attractors, request = point.attractors.attractors, point.store.request
        within = extents.epsilon_search_range(gear, None if request is None else window_of_request(request)[1])
        known: list[extents.MotionExtent | None] = []
        for each in attractors[: extents.MOST_FOLLOWED]:
            try:
                found = await point.work.compute(
                    extents.epsilon_extent_of_motion, gear, each, within, what="The range of a motion", slow=True
                )
            except UnavailableError:  # not computed in time: the other motions are followed nevertheless
                found = None
            known.append(found)
            await point.work.apply_document_change(partial(self._show_extents, known))
        if extents.has_bracketed_chaos_end(attractors, known):
            with suppress(UnavailableError):  # if this fails, the end of chaos stays the bracket that the sweep found
                known[:] = await point.work.compute(
                    extents.add_crisis_to_extents, gear, attractors, known, what="The boundary crisis", slow=True
                )
            await point.work.apply_document_change(partial(self._show_extents, known))
        chaos = words.chaos_events(gear, attractors, known)
        if chaos:  # only at the end, because a new table of events folds rows that a viewer has unfolded
            await point.work.apply_document_change(lambda: point.update(chaos=chaos))

    def _show_extents(self, known: Sequence[extents.MotionExtent | None]) -> None:
        point = self._point
        if point.attractors is not None:
            self._panel.extents.html = words.extents_table(point.attractors, known, point.machine, point.palette)

    async def _show_closed_form_orbits(self) -> None:
        await self._point.work.wait_for_kernels()
        await self._point.work.apply_document_change(
            lambda: self._show_orbits(parts.compute_period_one_orbits(self._gear))
        )

    async def _compute_orbits(self) -> None:
        found = await self._point.work.compute(
            parts.compute_period_one_orbits, self._gear, what="The period-one orbits", slow=True
        )

        def show() -> None:
            self._show_orbits(found)
            if self._point.attractors is not None:
                self._show_attractors(parts.add_orbit_letters(self._point.attractors, found.orbits))

        await self._point.work.apply_document_change(show)

    def _show_orbits(self, found: parts.PeriodOneOrbits) -> None:
        self._panel.orbits.html = words.orbits_table(found)
        self._point.update(orbits=found.orbits)

    async def _compute_margin(self) -> None:
        point, safe = self._point, self._panel.margin_text
        if Capability.MARGIN not in self._model.has:
            await point.work.set_text(safe, f"<p>{missing_capability_error(Capability.MARGIN, self._model)}</p>")
            return
        found = await point.work.compute(parts.compute_quiet_margin, self._gear, what="The margin", slow=True)
        said = words.margin_in_words(self._gear, found, point.period)
        await point.work.set_text(safe, f"<p>{escape(said)}</p>")
