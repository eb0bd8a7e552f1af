"""The open point: its machine, its model, its gear, and the results that are computed so far."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

import rattle
from gear_rattle.service.explorer.common.address import EnteredMachine, Pair, Pin, View, create_pin
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.design.fields import machine_at
from gear_rattle.service.explorer.design.tolerance import tolerance_outline
from gear_rattle.service.explorer.point.parts import SampledAttractors, largest_sampled_speed
from gear_rattle.service.explorer.point.words import ChaosEvent, period_name
from gear_rattle.service.explorer.point.work import PointTasks
from gear_rattle.service.explorer.state.store import ObservableValues, PageStore
from gear_rattle.service.operations.diagrams import diagram_ends
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle import Machine, RattleError
from rattle.models import AnyGear, Model, model_of_gear
from rattle.plot import Palette

ATTRACTORS, CHAOS, ORBITS, SHOWN_POINT, READY = "attractors", "chaos", "orbits", "shown_point", "is_ready"


class ShownPoint(NamedTuple):
    """The point whose basins and motion are shown: the open point, or another point (δ, ε) of its diagram.

    gear: the gear at this point. attractors: the attractors of its basins; () for the open point, which has them in
    `OpenPoint.attractors`.
    """

    gear: AnyGear
    attractors: tuple[rattle.Attractor, ...] = ()


class OpenPoint(ObservableValues):
    """The open point: its gear, the results that are computed so far, and the tasks that compute further results.

    The tabs of the point subscribe to the results by name (ATTRACTORS, CHAOS, ORBITS, SHOWN_POINT, READY), and to
    fields of the store's view by `subscribe_to_view`.

    Attributes
    ----------
    attractors : SampledAttractors | None
        Attractors of the point; None until they are computed.
    orbits : tuple[rattle.Orbit, ...]
        Orbits A to D of the point, empty until they are known.
    chaos : list[ChaosEvent]
        Beginnings and ends of chaos along ε, empty until they are known.
    shown_point : ShownPoint
        Point whose basins and motion are shown: the open point, or another point (δ, ε) of its diagram once the basins
        there are known.
    is_ready : bool
        True once the page shows how likely quiet running is. Then the open tab begins its computations.
    """

    def __init__(self, store: PageStore, work: PointTasks, gear: AnyGear, machine: Machine | None) -> None:
        super().__init__()
        self.store, self.work, self.gear, self.machine = store, work, gear, machine
        self.period = period_name(machine)
        self.palette = Palette()  # all pictures and tables of the point share this palette
        self._fastest = largest_sampled_speed(gear.delta, gear.epsilon, gear.beta)
        self.attractors: SampledAttractors | None = None
        self.orbits: tuple[rattle.Orbit, ...] = ()
        self.chaos: list[ChaosEvent] = []
        self.shown_point = ShownPoint(gear)
        self.is_ready = False
        self._followed: list[Callable[[], object]] = []

    def subscribe_to_view(self, listener: Callable[[], object], *names: str) -> None:
        """Call a listener after changes of the named fields of the view, until `end` is called."""
        self.store.subscribe(listener, *names)
        self._followed.append(listener)

    def update(self, **results: Any) -> None:
        """Set results by name, and call their listeners."""
        for name, value in results.items():
            setattr(self, name, value)
        self.call_listeners(set(results))

    def end(self) -> None:
        """Give up all computations and all subscriptions, because another point is shown."""
        self.work.stop()
        for listener in self._followed:
            self.store.unsubscribe(listener)

    @property
    def tabs_state(self) -> PointTabsState:
        """State of the tabs. An initial condition above the largest speed in the picture of the basins is left out."""
        return self.store.view.point_state.without_start_above(self._fastest)

    @property
    def is_at_other_point(self) -> bool:
        """True if the basins and the motion of another point (δ, ε) of the diagram are shown."""
        return self.shown_point.gear is not self.gear

    @property
    def _known_attractors(self) -> tuple[rattle.Attractor, ...]:
        return () if self.attractors is None else self.attractors.attractors

    @property
    def attractor_number(self) -> int:
        """Number of the attractor to show: the chosen one, else the first that is not quiet, else 0."""
        chosen, known = self.tabs_state.attractor, self._known_attractors
        if chosen is not None and chosen < len(known):
            return chosen
        return next((i for i, each in enumerate(known) if each.kind != "quiet"), 0)

    @property
    def shown_attractor(self) -> rattle.Attractor | None:
        """Attractor to show, None if none is known.

        At the open point it is the attractor with the number `attractor_number`. At another point of the diagram it is
        the attractor of the same name as the open point's; if there is none, the first that is not quiet; if all are
        quiet, the first.
        """
        own = self._known_attractors[self.attractor_number] if self._known_attractors else None
        if not self.is_at_other_point:
            return own
        there = self.shown_point.attractors
        named = [each for each in there if own is not None and each.name == own.name]
        return (named or [each for each in there if each.kind != "quiet"] or list(there))[0]


def ends_of_diagram_line(gear: AnyGear, state: PointTabsState) -> tuple[Pair, Pair]:
    """Return the points (δ, ε) at which the diagram of a point begins and ends."""
    return diagram_ends(gear, *state.diagram_choice)


def chosen_diagram_point(gear: AnyGear, state: PointTabsState) -> Pair | None:
    """Return the point (δ, ε) of the diagram that the slider chooses; None for the open point itself."""
    if state.at is None:
        return None
    (delta, epsilon), (to_delta, to_epsilon) = ends_of_diagram_line(gear, state)
    left = 1.0 - state.at  # in this form `at` = 0 and 1 give exactly the ends of the line
    return left * delta + state.at * to_delta, left * epsilon + state.at * to_epsilon


def machine_and_model(
    point: Pair, entered: EnteredMachine | None, machine: SurveyedMachine | None, model: Model
) -> tuple[Machine | None, Model]:
    """Return the machine and the model of a point: those of the entered machine, else those of the survey."""
    if entered is None:
        return machine_at(machine, model, *point), model
    found = entered.machine
    return found, model_of_gear(found.gear)


def machine_and_model_of_open_point(store: PageStore) -> tuple[Machine | None, Model] | None:
    """Return the machine and the model of the open point; None if no point is open or the map's survey is unknown."""
    view = store.view
    if view.point is None or not store.is_list_loaded or (view.survey and store.request is None):
        return None
    return machine_and_model(view.point, view.machine, store.machine, store.model)


def pin_of_open_point(store: PageStore) -> Pin | None:
    """Return the open point as a pin; None if no point is open, or if the map's survey is not known yet."""
    opened, point = machine_and_model_of_open_point(store), store.view.point
    return None if opened is None or point is None else create_pin(*point, opened[1])


def marks_of_open_point(
    view: View, model: Model, machine: SurveyedMachine | None
) -> tuple[Pair | None, np.ndarray | None]:
    """Return the marks of the open point on the map of a survey.

    Returns
    -------
    point : Pair | None
        The point, or the chosen point of its diagram; None if no point is open, or if its model is not the survey's.
    lines : np.ndarray | None
        Points (k, 2) of the ellipse of its tolerances and of the line to the end of its diagram, separated by NaN; None
        if there are no such lines.
    """
    if view.point is None:
        return None, None
    made, of_point = machine_and_model(view.point, view.machine, machine, model)
    if of_point != model:
        return None, None
    here, state = view.point, view.point_state
    lines = [] if state.tolerance is None else [tolerance_outline(*here, made, state.tolerance)]
    if state.to is not None:
        lines += [np.full((1, 2), np.nan), np.array([here, state.to])]
    with suppress(RattleError):  # raised if no gear is possible here: the panel of the point shows the error
        here = chosen_diagram_point(model.gear(*here), state) or here
    return here, np.concatenate(lines) if lines else None
