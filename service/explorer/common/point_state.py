"""State of the tabs of the open point: its motion, its diagram, its tolerances; and its texts in an address."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

from gear_rattle.service.operations.diagrams import LEAST_SPAN, MOST_SPAN, SPANS, Pair

MOST_ATTRACTORS = 1000
LARGEST = sys.float_info.max
ANSWER, BASINS, MOTION, DIAGRAM, NUMBERS = TABS = ("answer", "basins", "motion", "diagram", "numbers")

T = TypeVar("T")
N = TypeVar("N", int, float)


class Tolerance(NamedTuple):
    """Tolerances of a point, and the requirement on its gears.

    first, second: the standard deviations of δ and ε, or of a machine's speed (rpm) and eccentricity (m). share: the
    least probability of quiet running with which a gear passes.
    """

    first: float
    second: float
    share: float


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
    start: Pair | None = None
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

    def limited_to(self, v_max: float) -> PointState:
        """Return the state, without its initial condition if the speed there is above v_max."""
        return self if self.start is None or self.start[1] <= v_max else replace(self, start=None)

    def changed(self, **fields: Any) -> PointState:
        """Return the state with other values of some fields, as an address gives it back."""
        return PointState.read(replace(self, **fields).text())

    @classmethod
    def read(cls, texts: Mapping[str, str]) -> PointState:
        """Return the state that these texts describe, by name. A value that cannot be read gets its default."""
        start = read_text({"start": f"{texts.get('tau')},{texts.get('v')}"}, "start", _parse_start, None)
        return cls(
            read_text(texts, "attractor", _parse_attractor, None) if start is None else None,
            start,
            read_text(texts, "direction", lambda text: one_of(SPANS, text), "epsilon"),
            read_text(texts, "span", _parse_span, None),
            read_text(texts, "to", parse_point, None),
            read_text(texts, "tolerance", _parse_tolerance, None),
            read_text(texts, "at", _parse_share, None),
            read_text(texts, "tab", lambda text: one_of(TABS, text), None),
        )

    def text(self) -> dict[str, str]:
        """Return the texts that describe the state, by name; values that are the defaults have no text."""
        is_tab_known = self.tab is None or (self.tab == ANSWER and replace(self, tab=None).shown_tab == ANSWER)
        # `repr` writes all digits of a number, so that it is read back unchanged
        texts = {
            "attractor": None if self.start is not None or self.attractor is None else str(self.attractor),
            "tau": None if self.start is None else repr(self.start[0]),
            "v": None if self.start is None else repr(self.start[1]),
            "direction": None if self.direction == "epsilon" else self.direction,
            "span": None if self.span is None else repr(self.span),
            "to": None if self.to is None else ",".join(map(repr, self.to)),
            "tolerance": None if self.tolerance is None else ",".join(map(repr, self.tolerance)),
            "at": None if self.at is None else repr(self.at),
            "tab": None if is_tab_known else self.tab,
        }
        return {name: text for name, text in texts.items() if text is not None}


def read_text(texts: Mapping[str, str], name: str, parse: Callable[[str], T], default: T) -> T:
    """Return the parsed text of a name; the default if there is no such text, or if `parse` raises ValueError."""
    try:
        return parse(texts[name]) if name in texts else default
    except ValueError:
        return default


def one_of(allowed: Collection[str], text: str) -> str:
    """Return an allowed text unchanged. Raises ValueError for any other text."""
    if text not in allowed:
        raise ValueError(f"One of {', '.join(allowed)} is needed, not {text!r}.")
    return text


def parse_pair(text: str) -> Pair:
    """Return two finite numbers with a comma between them. Raises ValueError for any other text."""
    first, second = (float(part) for part in text.split(","))
    if not (math.isfinite(first) and math.isfinite(second)):
        raise ValueError(f"Two finite numbers with a comma between them are needed, not {text!r}.")
    return first, second


def parse_point(text: str) -> Pair:
    """Return the point (δ, ε) that a text describes. Raises ValueError unless δ > 0 and ε ≥ 0."""
    delta, epsilon = parse_pair(text)
    if delta <= 0 or epsilon < 0:
        raise ValueError(f"A point needs a δ above 0 and an ε of at least 0, not {text!r}.")
    return delta, epsilon


def _parse_attractor(text: str) -> int:
    return _within(int(text), 0, MOST_ATTRACTORS - 1)


def _parse_start(text: str) -> Pair:
    tau, v = parse_pair(text)
    if not 0 <= tau < 1 or v <= 0:
        raise ValueError(f"An initial condition needs a phase from 0 to 1 and a speed above 0, not {text!r}.")
    return tau, v


def _parse_span(text: str) -> float:
    return _within(float(text), LEAST_SPAN, MOST_SPAN)


def _parse_share(text: str) -> float:
    return _within(float(text), 0.0, 1.0)


def _parse_tolerance(text: str) -> Tolerance:
    first, second, share = (_within(float(part), 0.0, LARGEST) for part in text.split(","))
    return Tolerance(first, second, share)


def _within(number: N, low: float, high: float) -> N:
    if not low <= number <= high:
        raise ValueError(f"A number from {low:g} to {high:g} is needed, not {number!r}.")
    return number
