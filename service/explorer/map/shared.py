"""State that all pages of an application share."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol
from weakref import ReferenceType, ref

from starlette.concurrency import run_in_threadpool

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.address import UNCHOSEN, Limits, Pair, Ranges, View
from gear_rattle.service.explorer.common.news import LISTED, StatusPublisher
from gear_rattle.service.explorer.map.colouring import Colouring, compute_colouring
from gear_rattle.service.explorer.map.overlays import cache_default_lines
from gear_rattle.service.explorer.map.planes import UNSEEN, MapBlock, MapCache, MapPlane, Room, map_names_by_variable
from gear_rattle.service.explorer.state.store import PageStore, window_of_request
from gear_rattle.service.operations.overlaid import Overlays
from gear_rattle.service.operations.surveys import list_jobs
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest, quantity_of_map
from gear_rattle.workers.cluster.window import CLOSED_FORM
from gear_rattle.workers.pictures.look import LARGEST
from rattle import RattleError
from rattle.models import DEFAULT_MODEL, MODELS, Model

MOST_DRAWINGS = 4  # most drawings of completed maps in memory, a few MiB each; most pages open with one of a few maps

EXAMPLE = "example at β = 0.6, which comes with the explorer"

USUAL_VARIABLE = "quiet_fraction"  # variable that a page shows first of a survey that has it
EXACT_BEFORE_SURVEY = "exact values, shown before the survey has computed them"
WAITING = "exact values; the survey waits for its turn"

log = logging.getLogger(__name__)


def is_closed_form_map(request: SurveyRequest, variable: str) -> bool:
    """Return whether a map of a survey is a closed form, which is known before the survey is computed."""
    if variable == LARGEST:
        return False
    found = quantity_of_map(variable, 0, request)
    return request.has_closed_forms and found.group in CLOSED_FORM


def default_variable(request: SurveyRequest, is_waiting: bool) -> str:
    """Return the variable that a survey shows unless a viewer chooses another variable.

    A survey that waits for its turn shows its first map, if that map is a closed form. Every other survey shows its
    quiet fraction. A survey without a quiet fraction shows the first map that is not a closed form, or else the first
    of all maps.

    Returns
    -------
    str
        Name of the variable.
    """
    maps = [name for name in map_names_by_variable(request) if name not in ("status", LARGEST)] or ["status"]
    if is_waiting and is_closed_form_map(request, maps[0]):
        return maps[0]
    filling = [name for name in maps if not is_closed_form_map(request, name)]
    return USUAL_VARIABLE if USUAL_VARIABLE in maps else next(iter(filling), maps[0])


class UncomputedMaps(Protocol):
    """Interface of maps that need no computed survey: maps of the example, and closed forms of unfinished surveys."""

    request: SurveyRequest

    @property
    def maps(self) -> dict[str, Any]:
        """Maps of the example, in the form that `map_names_by_variable` returns."""

    def plane(self, variable: str, index: int) -> MapPlane:
        """Return a map of the example that comes with the explorer. This method blocks: use a thread.

        index: number of the attractor or the orbit, for a variable that has a map for each.
        """

    def map_of_unfinished_survey(
        self, job: JobRow, variable: str, index: int, number: int, computed: Callable[[], MapPlane]
    ) -> MapPlane:
        """Return a closed-form map of an unfinished survey. This method blocks: use a thread.

        Parameters
        ----------
        number : int
            Number of the slice; 0 without a third axis.
        computed : Callable[[], MapPlane]
            Returns the map of the cells that the survey has computed; raises MissingPartError if no cell is computed
            yet. This function is called when a viewer reads a cell.

        Returns
        -------
        MapPlane
            The map. Its colours show closed forms; `cell_at` returns the survey's cell, if it is computed already.
        """


def default_survey(jobs: Iterable[JobRow]) -> JobRow | None:
    """Return the readable survey that a page shows by default: the newest with computed cells, else the newest."""
    readable = [job for job in jobs if job.is_readable]
    shown = (job for job in readable if job.cells_done or job.state == State.SUCCESSFUL)
    return next(shown, readable[0] if readable else None)


@lru_cache(maxsize=MOST_DRAWINGS)
def cached_cells_and_colours(
    plane: ReferenceType[MapPlane], limits: Limits | Pair, log: bool, room: Room
) -> tuple[MapBlock, Colouring]:
    """Return the drawn cells and the colours of a map that does not change. This cache does not keep the map alive."""
    there = plane()
    assert there is not None  # the caller holds a reference to the map, so the map still exists
    return _cells_and_colours(there, limits, log, room)


def _cells_and_colours(plane: MapPlane, limits: Limits | Pair, log: bool, room: Room) -> tuple[MapBlock, Colouring]:
    block = plane.block(room=room)
    return block, compute_colouring(plane, block, limits, log, room)


@dataclass(frozen=True)
class SharedState:
    """State that all pages of an application share.

    on_map_drawn: function that is called in the event loop whenever a page has drawn a map.
    """

    front: ApplicationState
    news: StatusPublisher
    atlas: MapCache
    overlaid: Overlays
    exact: UncomputedMaps
    on_map_drawn: Callable[[], None] = lambda: None

    async def compute_default_map(self) -> None:
        """Compute the default map and its lines in advance; otherwise the first page would wait for them."""
        try:
            model, window = await run_in_threadpool(self._draw_default_map)
            await self.front.kernels.wait_until_compiled(model.name, patience=math.inf)
            await run_in_threadpool(cache_default_lines, model, window)
        except (RattleError, ValueError, OSError) as error:  # a page that is opened later shows the error
            log.info("the first map cannot be drawn beforehand: %s", error)

    def _draw_default_map(self) -> tuple[Model, Ranges]:
        """Draw the default map of a page, unless its survey is incomplete. Return the map's model and window."""
        jobs, _ = list_jobs(self.front, LISTED)
        job = default_survey(jobs)
        if job is None:
            self.compute_example_map(View(variable=default_variable(self.exact.request, False)))
            return MODELS[DEFAULT_MODEL](), UNCHOSEN
        whole = SurveyRequest.model_validate(job.request)
        if job.state == State.SUCCESSFUL:
            self.load_drawn_map(job, View(survey=job.id, variable=default_variable(whole, False)), UNSEEN)
        request = whole.slice_request(whole.slice_index(0))
        return request.gear_model, window_of_request(request)

    def load_drawn_map(self, job: JobRow, view: View, room: Room) -> tuple[MapPlane, bool, MapBlock, Colouring]:
        """Return the view's map of a survey, whether all computed tiles are read, the drawn cells and their colours.

        This method blocks: use a thread.

        Returns
        -------
        tuple[MapPlane, bool, MapBlock, Colouring]
            The map, whether all tiles computed so far have been read, its drawn cells and their colours.
        """
        key, how = (view.variable, view.index, view.slice), (view.limits, view.log, room)
        if not State(job.state).is_final and is_closed_form_map(
            SurveyRequest.model_validate(job.request), view.variable
        ):
            plane = self.exact.map_of_unfinished_survey(job, *key, lambda: self.atlas.plane(job, *key)[0])
            block, colours = _cells_and_colours(plane, *how)
            note = WAITING if job.state == State.ACCEPTED else EXACT_BEFORE_SURVEY
            return plane, True, block, replace(colours, note=note)
        plane, is_whole = self.atlas.plane(job, *key)
        if not is_whole or job.state != State.SUCCESSFUL:  # the map may still change, so its drawing is not cached
            return plane, is_whole, *_cells_and_colours(plane, *how)
        return plane, True, *cached_cells_and_colours(ref(plane), *how)

    def maps(self, store: PageStore) -> dict[str, Any]:
        """Return the maps, by variable, of the chosen survey, or of the example if none is chosen."""
        if store.view.is_example_shown:
            return self.exact.maps
        return (
            {}
            if store.survey_request_with_all_slices is None
            else map_names_by_variable(store.survey_request_with_all_slices)
        )

    def plane(self, job: JobRow | None, variable: str, index: int, number: int) -> MapPlane:
        """Return a map of a survey, or of the example without `job`. This blocks. Errors: see `MapCache.plane`."""
        if job is None:
            return self.exact.plane(variable, index)
        is_whole = False
        while not is_whole:  # each call reads for a limited time only
            plane, is_whole = self.atlas.plane(job, variable, index, number)
        return plane

    def compute_example_map(self, view: View) -> tuple[MapPlane, MapBlock, Colouring]:
        """Return a map of the example, its drawn cells and their colours. This method blocks: use a thread.

        view: the view whose variable is mapped.

        Returns
        -------
        tuple[MapPlane, MapBlock, Colouring]
            The map, the cells and the colours.
        """
        plane = self.exact.plane(view.variable, view.index)
        block = plane.block()
        return plane, block, replace(compute_colouring(plane, block, view.limits, view.log), note=EXAMPLE)
