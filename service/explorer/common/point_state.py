"""State of the open point's tabs (motion, diagram, tolerances), and the texts that describe it in a page's address."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from gear_rattle.service.explorer.common.address_fields import (
    address_field,
    address_field_texts,
    pair_text,
    parse_address_fields,
    parse_pair,
    parse_point,
    parse_text_or_default,
    require_allowed_text,
    require_between,
)
from gear_rattle.service.operations.diagrams import LEAST_SPAN, MOST_SPAN, SPANS, Pair

MOST_ATTRACTORS = 1000
LARGEST = sys.float_info.max
ANSWER, BASINS, MOTION, DIAGRAM, NUMBERS = TABS = ("answer", "basins", "motion", "diagram", "numbers")


class PointTolerances(NamedTuple):
    """Tolerances of a point, and the requirement on its gears.

    first, second: the standard deviations of δ and ε, or of a machine's speed (rpm) and eccentricity (m). share: the
    least probability of quiet running with which a gear passes.
    """

    first: float
    second: float
    share: float


def _parse_attractor(text: str) -> int:
    return require_between(int(text), 0, MOST_ATTRACTORS - 1)


def _parse_initial_condition(text: str) -> Pair:
    tau, v = parse_pair(text)
    if not 0 <= tau < 1 or v <= 0:
        raise ValueError(f"An initial condition needs a phase from 0 to below 1 and a speed above 0, not {text!r}.")
    return tau, v


def _parse_span(text: str) -> float:
    return require_between(float(text), LEAST_SPAN, MOST_SPAN)


def _parse_fraction(text: str) -> float:
    return require_between(float(text), 0.0, 1.0)


def _parse_tolerance(text: str) -> PointTolerances:
    first, second, share = (require_between(float(part), 0.0, LARGEST) for part in text.split(","))
    return PointTolerances(first, second, share)


@dataclass(frozen=True)
class PointTabsState:
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
        Extent of the diagram in δ or ε on either side of the point; None for the default.
    to : Pair | None
        Point (δ, ε) at which the diagram ends; None for a diagram along `direction`.
    tolerance : PointTolerances | None
        Tolerances that a viewer entered; None if there are none.
    at : float | None
        Position of the point whose basins and motion are shown, from 0 to 1 along the line of the diagram; None for the
        open point itself.
    tab : str | None
        Open tab; None if the other values decide which tab is open, see `shown_tab`.
    """

    attractor: int | None = address_field(None, _parse_attractor)
    start: Pair | None = None
    direction: str = address_field("epsilon", partial(require_allowed_text, SPANS))
    span: float | None = address_field(None, _parse_span, repr)
    to: Pair | None = address_field(None, parse_point, pair_text)
    tolerance: PointTolerances | None = address_field(
        None, _parse_tolerance, lambda widths: ",".join(map(repr, widths))
    )
    at: float | None = address_field(None, _parse_fraction, repr)
    tab: str | None = address_field(None, partial(require_allowed_text, TABS))

    @property
    def diagram_choice(self) -> tuple[str, float | None, Pair | None]:
        """Values that choose the diagram: `direction`, `span` and `to`."""
        return self.direction, self.span, self.to

    @property
    def shown_tab(self) -> str:
        """Name of the open tab. If `tab` is None, as in older addresses, the other fields decide which tab is open."""
        if self.tab is not None:
            return self.tab
        if self.to is not None or self.span is not None or self.direction != "epsilon":
            return DIAGRAM
        if self.start is not None or self.attractor is not None:
            return MOTION
        return ANSWER if self.at is None else BASINS

    def without_start_above(self, v_max: float) -> PointTabsState:
        """Return the state; if the speed of its initial condition `start` is above v_max, without `start`."""
        return self if self.start is None or self.start[1] <= v_max else replace(self, start=None)

    def with_changes(self, **fields: Any) -> PointTabsState:
        """Return the state with other values of some fields. A value that `parse` would refuse becomes the default."""
        return PointTabsState.parse(replace(self, **fields).address_texts())

    @classmethod
    def parse(cls, texts: Mapping[str, str]) -> PointTabsState:
        """Return the state that texts in an address describe.

        texts: {name of a field: its text}; the initial condition `start` has the names "tau" and "v".

        Returns
        -------
        PointTabsState
            The state. A field whose text is missing or cannot be read has its default.
        """
        found = parse_address_fields(cls, texts)
        start = parse_text_or_default(
            {"start": f"{texts.get('tau')},{texts.get('v')}"}, "start", _parse_initial_condition, None
        )
        if start is not None:
            found.pop("attractor", None)
        return cls(**found, start=start)

    def address_texts(self) -> dict[str, str]:
        """Return {name: text}, the texts from which `parse` makes this state; a field with its default has no text."""
        texts = address_field_texts(self)
        if self.start is not None:
            texts.pop("attractor", None)
            texts |= {"tau": repr(self.start[0]), "v": repr(self.start[1])}
        if self.tab == ANSWER and replace(self, tab=None).shown_tab == ANSWER:
            del texts["tab"]
        return texts
