"""The store of a page: its view, changed by events, its list of surveys, and listeners that are called on changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields

import numpy as np

from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import Ranges, View
from gear_rattle.service.explorer.common.news import JobStatus
from gear_rattle.service.explorer.state.events import Event
from gear_rattle.service.explorer.state.reducer import reduce
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle.models import DEFAULT_MODEL, MODELS, Model

JOBS = "jobs"
NAMES = tuple(each.name for each in fields(View))


class ObservableValues:
    """Listeners, functions that are called after changes of named values. Base class of objects with such values."""

    def __init__(self) -> None:
        self._listeners: dict[Callable[[], object], frozenset[str]] = {}
        self._changed: set[str] = set()
        self._is_calling = False

    def subscribe(self, listener: Callable[[], object], *names: str) -> None:
        """Call a listener after changes of the named values."""
        self._listeners[listener] = frozenset(names)

    def unsubscribe(self, listener: Callable[[], object]) -> None:
        """Stop calling a listener."""
        self._listeners.pop(listener, None)

    def call_listeners(self, changed: set[str]) -> None:
        """Call the listeners of changed values, then those of values that these listeners have changed, and so on."""
        self._changed |= changed
        if self._is_calling:
            return
        self._is_calling = True
        try:
            while self._changed:
                changed, self._changed = self._changed, set()
                for listener in tuple(self._listeners):  # a listener may end the subscription of another
                    if self._listeners.get(listener, frozenset()) & changed:
                        listener()
        finally:
            self._is_calling = False


class PageStore(ObservableValues):
    """View of a page and its list of surveys, with the listeners of changes.

    Parameters
    ----------
    view : View
        View of the page's address.
    example : SurveyRequest
        Request of the survey that is shown if none is chosen.
    """

    def __init__(self, view: View, example: SurveyRequest) -> None:
        super().__init__()
        self.view = view
        self.jobs: Mapping[str, JobStatus] = {}
        self.is_list_loaded = False  # True once the list of surveys has arrived
        self._example = example
        self._known: tuple[str, SurveyRequest] | None = None

    def subscribe(self, listener: Callable[[], object], *names: str) -> None:
        """Call a listener after changes of named fields of the view, or of the list of surveys (named JOBS).

        Without names, call the listener after every change.
        """
        super().subscribe(listener, *(names or (*NAMES, JOBS)))

    def dispatch(self, event: Event) -> None:
        """Change the view by an event, and call the listeners of the changed fields."""
        before, self.view = self.view, reduce(self.view, event)
        self.call_listeners({name for name in NAMES if getattr(before, name) != getattr(self.view, name)})

    def update_surveys(self, jobs: Mapping[str, JobStatus]) -> None:
        """Replace the list of surveys by the current one, and call its listeners."""
        self.jobs, self.is_list_loaded = jobs, True
        self.call_listeners({JOBS})

    @property
    def job(self) -> JobRow | None:
        """Chosen survey; None if no survey is chosen, or if the page's list of surveys lacks it."""
        status = self.jobs.get(self.view.survey)
        return None if status is None else status.job

    @property
    def survey_request_with_all_slices(self) -> SurveyRequest | None:
        """Request of the chosen survey or the example, with all slices; None if it is unknown or unreadable."""
        if self.view.is_example_shown:
            return self._example
        job = self.job
        if job is None or not job.is_readable:
            return None
        if self._known is None or self._known[0] != job.id:
            self._known = job.id, request_of_job(job)
        return self._known[1]

    @property
    def request(self) -> SurveyRequest | None:
        """Request of the shown survey, or of the chosen slice along its third axis; None if it is not known yet."""
        whole = self.survey_request_with_all_slices
        return whole if whole is None else whole.slice_request(whole.slice_index(self.view.slice))

    @property
    def model(self) -> Model:
        """Model of the shown survey; the paper's model if that survey is not known or cannot be read."""
        request = self.request
        return MODELS[DEFAULT_MODEL]() if request is None else request.gear_model

    @property
    def machine(self) -> SurveyedMachine | None:
        """Machine of the shown survey; None if it has no machine, is not known or cannot be read."""
        request = self.request
        return None if request is None else request.machine

    @property
    def window(self) -> Ranges:
        """Visible window: (low, high) of δ and of ε."""
        return self.view.window or window_of_request(self.request or self._example)


def request_of_job(job: JobRow) -> SurveyRequest:
    """Return the request of a survey. Its database row must be readable (`is_readable`)."""
    return SurveyRequest.model_validate(job.request)


def window_of_request(request: SurveyRequest) -> Ranges:
    """Return the box, (low, high) of δ and of ε, that the cells of a requested plane will cover."""
    return box_of_cells(request.delta.values(), request.epsilon.values())


def box_of_cells(delta: np.ndarray, epsilon: np.ndarray) -> Ranges:
    """Return the box that cells with these centres cover: half a cell beyond the outermost centres."""
    dx, dy = ((axis[-1] - axis[0]) / (2 * max(axis.size - 1, 1)) for axis in (delta, epsilon))
    return (float(delta[0] - dx), float(delta[-1] + dx)), (float(epsilon[0] - dy), float(epsilon[-1] + dy))
