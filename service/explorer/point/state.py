"""State of a point's view in the URL: its motion, its diagram, and tolerances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from gear_rattle.service.explorer.common.address import EnteredMachine, Pair, Pin, View, pin_of
from gear_rattle.service.explorer.design.fields import machine_at
from gear_rattle.service.explorer.design.tolerance import Tolerance, tolerance_outline
from gear_rattle.service.explorer.state.reducer import TAB
from gear_rattle.service.explorer.state.store import Store
from gear_rattle.service.operations.diagrams import LEAST_SPAN, MOST_SPAN, SPANS, diagram_ends
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle import Machine, RattleError
from rattle.models import AnyGear, Model, model_at

MOST_ATTRACTORS = 1000
ANSWER, BASINS, MOTION, DIAGRAM, NUMBERS = TABS = ("answer", "basins", "motion", "diagram", "numbers")


@dataclass(frozen=True)
class PointState:
    """State of the tabs of a point.

    Attributes
    ----------
    attractor : int | None
        Number of the chosen attractor, from 0 by falling basin fraction; None if none was chosen.
    start : tuple[float, float] | None
        Initial condition (τ, v) of the motion that is shown; None for the motion on an attractor.
    direction : str
        Axis of the diagram, "epsilon" or "delta".
    span : float | None
        Extent of the diagram on either side of the point; None for the default.
    to : Pair | None
        Point (δ, ε) at which the diagram ends; None for a diagram along `direction`.
    tolerance : Tolerance | None
        Tolerances that a viewer entered; None if there are none.
    at : float | None
        Place whose basins and motion are shown, from 0 to 1 on the line of the diagram; None for the point itself.
    tab : str | None
        Open tab; None if the other values decide which tab is open, see `shown_tab`.
    """

    attractor: int | None = None
    start: tuple[float, float] | None = None
    direction: str = "epsilon"
    span: float | None = None
    to: Pair | None = None
    tolerance: Tolerance | None = None
    at: float | None = None
    tab: str | None = None

    @property
    def way(self) -> tuple[str, float | None, Pair | None]:
        """Choice of the diagram: its direction, its span and its other end, in this order."""
        return self.direction, self.span, self.to

    @property
    def shown_tab(self) -> str:
        """The open tab. Older addresses have no `tab`; then it is the tab that shows what their other fields choose."""
        if self.tab is not None:
            return self.tab
        if self.to is not None or self.span is not None or self.direction != "epsilon":
            return DIAGRAM
        if self.start is not None or self.attractor is not None:
            return MOTION
        return ANSWER if self.at is None else BASINS

    @classmethod
    def read(cls, text: Mapping[str, object], v_max: float) -> PointState:
        """Return the state that these texts describe. An unreadable value, or a v above v_max, gets its default."""
        direction = str(text.get("direction", ""))
        return cls(
            _parse_attractor(text.get("attractor")),
            _parse_start(text.get("tau"), text.get("v"), v_max),
            direction if direction in SPANS else "epsilon",
            parse_span(text.get("span")),
            parse_point(text.get("to")),
            parse_tolerance(text.get("tolerance")),
            parse_share(text.get("at")),
            tab if (tab := str(text.get(TAB))) in TABS else None,
        )

    def text(self) -> dict[str, str]:
        """Return the texts that describe the state, by name; values that are the defaults have no text."""
        said = {"attractor": str(self.attractor)} if self.attractor is not None and self.start is None else {}
        if self.start is not None:
            # `repr` writes all digits, so that both numbers are read back unchanged
            said |= {"tau": repr(self.start[0]), "v": repr(self.start[1])}
        if self.span is not None:
            said["span"] = repr(self.span)
        if self.to is not None:
            said["to"] = ",".join(map(repr, self.to))
        if self.tolerance is not None:
            said["tolerance"] = ",".join(map(repr, self.tolerance))
        if self.at is not None:
            said["at"] = repr(self.at)
        if self.tab is not None and (self.tab != ANSWER or replace(self, tab=None).shown_tab != ANSWER):
            said[TAB] = self.tab
        return said | ({"direction": self.direction} if self.direction != "epsilon" else {})


def _parse_attractor(given: object) -> int | None:
    try:
        number = int(str(given))
    except ValueError:
        return None
    return number if 0 <= number < MOST_ATTRACTORS else None


def _parse_start(tau: object, v: object, v_max: float) -> tuple[float, float] | None:
    try:
        start = float(str(tau)), float(str(v))
    except ValueError:
        return None
    if math.isfinite(start[0]) and 0 <= start[0] < 1 and 0 < start[1] <= v_max:
        return start
    return None


def parse_span(given: object) -> float | None:
    """Return the extent of a diagram on either side; None, for the default, if the value is not an allowed number."""
    try:
        span = float(str(given))
    except ValueError:
        return None
    return span if LEAST_SPAN <= span <= MOST_SPAN else None


def parse_share(given: object) -> float | None:
    """Return a value as a number from 0 to 1; None if it is no such number."""
    try:
        share = float(str(given))
    except ValueError:
        return None
    return share if 0.0 <= share <= 1.0 else None


def diagram_line(gear: AnyGear, state: PointState) -> tuple[Pair, Pair]:
    """Return the points (δ, ε) at which the diagram of a point begins and ends."""
    return diagram_ends(gear, state.direction, state.span, state.to)


def point_on_line(way: tuple[Pair, Pair], share: float) -> Pair:
    """Return the point (δ, ε) at a fraction `share` of the line between the two ends of `way`."""
    (delta, epsilon), (to_delta, to_epsilon) = way
    left = 1.0 - share  # with this form the ends of the line are exact
    return left * delta + share * to_delta, left * epsilon + share * to_epsilon


def parse_point(given: object) -> Pair | None:
    """Return the point (δ, ε) that a text describes; None if it describes no point with δ > 0 and ε ≥ 0."""
    try:
        delta, epsilon = map(float, str(given).split(","))
    except ValueError:
        return None
    return (delta, epsilon) if 0 < delta < math.inf and 0 <= epsilon < math.inf else None


def parse_tolerance(given: object) -> Tolerance | None:
    """Return the tolerance that a text describes, None if it cannot be read."""
    try:
        found = Tolerance(*map(float, str(given).split(",")))
    except (TypeError, ValueError):
        return None
    return found if all(math.isfinite(each) and each >= 0.0 for each in found) else None


def machine_and_model(
    point: Pair, entered: EnteredMachine | None, machine: SurveyedMachine | None, model: Model
) -> tuple[Machine | None, Model]:
    """Return the machine and the model of a point: those of the entered machine, else those of the survey."""
    if entered is None:
        return machine_at(machine, model, *point), model
    found = entered.machine
    return found, model_at(found.gear)


def open_machine_and_model(store: Store) -> tuple[Machine | None, Model] | None:
    """Return the machine and the model of the open point; None if no point is open or its survey is not known yet."""
    view = store.view
    if view.point is None or not store.has_surveys or (view.survey and store.request is None):
        return None
    return machine_and_model(view.point, view.machine, store.machine, store.model)


def open_point_as_pin(store: Store) -> Pin | None:
    """Return the open point as a pin; None if no point is open, or if its survey is not known yet."""
    opened, point = open_machine_and_model(store), store.view.point
    return None if opened is None or point is None else pin_of(*point, opened[1])


def point_marks(view: View, model: Model, machine: SurveyedMachine | None) -> tuple[Pair | None, np.ndarray | None]:
    """Return the marks of the open point on the map of a survey.

    Returns
    -------
    point : Pair | None
        The point, or the shown place on the line of its diagram; None if it has another model than the survey.
    lines : np.ndarray | None
        Lines (k, 2), separated by NaN: the ellipse of its tolerances, and the line of its diagram to another point.
    """
    if view.point is None:
        return None, None
    made, of_point = machine_and_model(view.point, view.machine, machine, model)
    if of_point != model:
        return None, None
    widths, to = parse_tolerance(view.point_state.get("tolerance")), parse_point(view.point_state.get("to"))
    lines = [] if widths is None else [tolerance_outline(*view.point, made, widths)]
    if to is not None:
        lines += [np.full((1, 2), np.nan), np.array([view.point, to])]
    here, state = view.point, PointState.read(view.point_state, 0.0)
    if state.at is not None:
        with suppress(RattleError):  # no gear is possible at this point; the panel of the point says so
            here = point_on_line(diagram_line(model.gear(*view.point), state), state.at)
    return here, np.concatenate(lines) if lines else None
