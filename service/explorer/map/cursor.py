"""The map by the keyboard: the cell under inspection, where a key takes it, and the window that follows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.models import ColumnDataSource, CustomAction, CustomJS
from bokeh.plotting import figure

from gear_rattle.service.explorer.common.address import Pair, Ranges
from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.files import asset
from gear_rattle.service.explorer.map.planes import MapPlane
from gear_rattle.service.explorer.point.state import point_of_view

FEWEST = 8  # cells across a window whose cells are stepped through; a finer one has STEPS steps across
STEPS = 40
FAR = 0.1  # of the window: a step with Shift
MOST = 1000  # steps of a key that is held down
CLOSER = 0.5
EDGE = 0.25  # of the window, between its edge and a cell that was outside
WIDEST = 3.0  # windows, of what the survey covers
WINDOWS = {"back": "Back to the window before", "forward": "Forward to the window after"}
GO = "point "  # before a point that a link names
MOST_WINDOWS = 200  # that are remembered


class History:
    """The windows that were shown, to go back to and forward again; None for the whole survey."""

    def __init__(self) -> None:
        self._before: list[Ranges | None] = []
        self._after: list[Ranges | None] = []

    def leave(self, window: Ranges | None) -> None:
        """Remember this window when it gives way to one that the viewer has chosen."""
        self._before = [*self._before, window][-MOST_WINDOWS:]
        self._after = []

    def back(self, now: Ranges | None) -> Ranges | None:
        """Return the window before this one; this one if there is none."""
        return self._turn(self._before, self._after, now)

    def forward(self, now: Ranges | None) -> Ranges | None:
        """Return the window after this one, that `back` has left."""
        return self._turn(self._after, self._before, now)

    @staticmethod
    def _turn(source: list[Ranges | None], target: list[Ranges | None], now: Ranges | None) -> Ranges | None:
        if not source:
            return now
        target.append(now)
        return source.pop()


class Cursor:
    """Keyboard control of one page.

    `where` says what is shown: the map, its window and the point that is open; `look` is told of the cell that the keys
    have come to, `go` of a new window; `do` has the other words of keyboard.js.
    """

    def __init__(
        self,
        document: Document,
        plot: figure,
        where: Callable[[], tuple[MapPlane, Ranges, Pair | None] | None],
        look: Callable[[Pair], None],
        go: Callable[[Ranges], None],
        do: Mapping[str, Callable[[Pair], None]],
    ) -> None:
        self._where, self._look, self._go, self._do = where, look, go, do
        self._at: Pair | None = None
        keys = ColumnDataSource({"steps": [], "word": [], "number": []})
        keys.on_change("data", in_event_loop(self._pressed))
        plot.tags = [keys]  # or it would not be in the document, and what is pressed not sent
        for word, icon in (("back", "undo"), ("forward", "redo")):
            code = f"keys.data = {{steps: [0, 0, 0, 0], word: ['{word}'], number: [Date.now()]}}"
            act = CustomJS(args={"keys": keys}, code=code)
            plot.add_tools(CustomAction(icon=icon, description=WINDOWS[word], callback=act))
        document.js_on_event(DocumentReady, CustomJS(args={"keys": keys}, code=asset("keyboard.js")))

    def forget(self) -> None:
        """Begin anew: something else is pointed at."""
        self._at = None

    def _pressed(self, _attribute: str, _old: object, new: Any) -> None:
        if (shown := self._where()) is None:
            return
        plane, window, point = shown
        at = self._at or point or window_middle(window)
        steps, words = new["steps"], new["word"]
        if len(steps) == 4 and all(isinstance(each, int) and abs(each) <= MOST for each in steps) and any(steps):
            if plane.request.machine is not None:  # speeds grow to the right, and δ to the left
                steps = [-steps[0], steps[1], -steps[2], steps[3]]
            at = cursor_after_steps(plane, at, window, steps)
            self._go(following(window, at))
            self._stay(at)
        for word in words[:1]:
            if word in ("closer", "farther"):
                self._go(zoomed(window, at, CLOSER if word == "closer" else 1 / CLOSER, plane.box))
                self._stay(at)
            elif word in self._do:
                self._do[word](at)
            elif str(word).startswith(GO) and (named := point_of_view(str(word)[len(GO) :])) is not None:
                self._do["open"](named)

    def _stay(self, at: Pair) -> None:
        self._at = at
        self._look(at)


def window_middle(window: Ranges) -> Pair:
    """Return the start of a cursor."""
    (left, right), (bottom, top) = window
    return (left + right) / 2, (bottom + top) / 2


def cursor_after_steps(plane: MapPlane, at: Pair, window: Ranges, steps: list[int]) -> Pair:
    """Return the cursor after steps, as `listen` has them: cells of the survey, or of a finer window parts of it."""
    return (
        _along(plane.delta, at[0], window[0], steps[0], steps[2]),
        _along(plane.epsilon, at[1], window[1], steps[1], steps[3]),
    )


def _along(axis: np.ndarray, at: float, span: Pair, steps: int, far: int) -> float:
    cell, width = (axis[-1] - axis[0]) / (axis.size - 1), span[1] - span[0]
    if width < FEWEST * cell:
        found = at + (steps / STEPS + far * FAR) * width
        return float(min(max(found, axis[0]), axis[-1]))
    here = int(np.abs(axis - at).argmin())
    return float(axis[min(max(here + steps + far * max(1, round(FAR * width / cell)), 0), axis.size - 1)])


def following(window: Ranges, at: Pair) -> Ranges:
    """Return the window, moved so that it holds the cursor, if it does not."""
    delta, epsilon = (_following(span, value) for span, value in zip(window, at, strict=True))
    return delta, epsilon


def _following(span: Pair, value: float) -> Pair:
    low, high = span
    edge = EDGE * (high - low)
    if value < low:
        return value - edge, value - edge + (high - low)
    if value > high:
        return value + edge - (high - low), value + edge
    return span


def zoomed(window: Ranges, at: Pair, factor: float, box: Ranges) -> Ranges:
    """Return the window, narrower by a factor about the cursor; none wider than WIDEST times the survey."""
    delta, epsilon = (
        (value - (value - low) * least, value + (high - value) * least)
        for (low, high), value, (left, right) in zip(window, at, box, strict=True)
        for least in (min(factor, WIDEST * (right - left) / (high - low)),)
    )
    return delta, epsilon
