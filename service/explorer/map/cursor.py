"""Control the map by the keyboard: a cursor that steps through cells, and a window that follows the cursor."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.models import ColumnDataSource, CustomAction, CustomJS
from bokeh.plotting import figure

from gear_rattle.service.explorer.common.address import KEYBOARD, Pair, Ranges
from gear_rattle.service.explorer.common.address_fields import parse_point
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.files import read_asset
from gear_rattle.service.explorer.state.events import (
    DiagramEndChosen,
    PointClosed,
    PointerMoved,
    PointOpened,
    WindowBackChosen,
    WindowForwardChosen,
    WindowMoved,
    WindowReset,
)
from gear_rattle.service.explorer.state.store import PageStore, window_of_request

# A step of the cursor is one cell; along an axis on which the window has fewer than FEWEST_CELLS cells, it is 1/STEPS
# of the window.
FEWEST_CELLS = 8
STEPS = 40
FAR_STEP = 0.1  # length of a step with Shift, as a share of the window
MOST_STEPS_AT_ONCE = 1000  # most steps in one message of the browser; a key that is held down sends many steps
ZOOM_FACTOR = 0.5  # factor of the window's width and height when a viewer zooms in by the keyboard
# distance of the cursor from the window's edge after the window has moved to contain it, as a share of the window
EDGE_SHARE = 0.25
LARGEST_ZOOM_OUT = 3.0  # greatest width of a window after zooming out, in widths of the survey
WINDOWS = {"back": "Back to the window before", "forward": "Forward to the window after"}
POINT_COMMAND = "point "  # start of the command that opens a point; δ and ε of the point follow


class CursorKeys:
    """Keyboard control of the map of a page: it dispatches events for the messages of keyboard.js."""

    def __init__(self, document: Document, plot: figure, store: PageStore) -> None:
        self._store = store
        keys = ColumnDataSource({"steps": [], "word": [], "number": []})
        keys.on_change("data", handler_in_event_loop(self._on_keys))
        plot.tags = [keys]  # a tag puts the source into the document, so that a browser can send pressed keys
        for word, icon in (("back", "undo"), ("forward", "redo")):
            code = f"keys.data = {{steps: [0], word: ['{word}'], number: [Date.now()]}}"
            act = CustomJS(args={"keys": keys}, code=code)
            plot.add_tools(CustomAction(icon=icon, description=WINDOWS[word], callback=act))
        document.js_on_event(DocumentReady, CustomJS(args={"keys": keys}, code=read_asset("keyboard.js")))

    def _on_keys(self, _attribute: str, _old: object, new: Any) -> None:
        view, request = self._store.view, self._store.request
        if request is None or view.seen is None:  # keys do nothing while no map is shown
            return
        steps, words = new["steps"], new["word"]
        if (
            len(steps) == 4
            and all(isinstance(each, int) and abs(each) <= MOST_STEPS_AT_ONCE for each in steps)
            and any(steps)
        ):
            if request.machine is not None:  # a machine's speed grows to the right, and so δ grows to the left
                steps = [-steps[0], steps[1], -steps[2], steps[3]]
            axes = request.delta.values(), request.epsilon.values()
            at = cursor_after_steps(axes, self.position, self._store.window, steps)
            self._move_cursor(move_window_to_cursor(self._store.window, at), at)
        for word in words[:1]:
            self.execute(str(word))

    @property
    def position(self) -> Pair:
        """Point (δ, ε) of the cursor: as moved by keys, else the open point, else the middle of the window."""
        view = self._store.view
        if view.pointer is not None and view.pointer.source == KEYBOARD:
            return view.pointer.at
        return view.point or window_middle(self._store.window)

    def execute(self, word: str) -> None:
        """Carry out a command that keyboard.js sends, such as "closer", or "point " with δ and ε."""
        at, dispatch = self.position, self._store.dispatch
        match word:
            case "closer" | "farther":
                factor = ZOOM_FACTOR if word == "closer" else 1 / ZOOM_FACTOR
                request = self._store.request
                assert request is not None
                self._move_cursor(zoomed_window(self._store.window, at, factor, window_of_request(request)), at)
            case "all":
                dispatch(WindowReset())
            case "open":
                dispatch(PointOpened(at))
            case "close":
                dispatch(PointClosed())
            case "through":
                dispatch(DiagramEndChosen(at))
            case "back":
                dispatch(WindowBackChosen())
            case "forward":
                dispatch(WindowForwardChosen())
            case _ if word.startswith(POINT_COMMAND):
                with suppress(ValueError):  # raised if the text after the command is no point
                    dispatch(PointOpened(parse_point(word.removeprefix(POINT_COMMAND))))

    def _move_cursor(self, window: Ranges, at: Pair) -> None:
        if window != self._store.window:
            self._store.dispatch(WindowMoved(window))
        self._store.dispatch(PointerMoved(at, KEYBOARD))


def window_middle(window: Ranges) -> Pair:
    """Return the middle of a window, where the cursor starts if no point is open."""
    (left, right), (bottom, top) = window
    return (left + right) / 2, (bottom + top) / 2


def cursor_after_steps(axes: tuple[np.ndarray, np.ndarray], at: Pair, window: Ranges, steps: list[int]) -> Pair:
    """Return the point to which steps move the cursor from the point `at`.

    steps: numbers of steps to the right, steps up, far steps to the right and far steps up; negative numbers go left or
    down. A step is one cell of the survey. In a window less than FEWEST_CELLS cells wide, a step is 1/STEPS of the
    window's width; likewise for the height. A far step is the share FAR_STEP of the window.

    Returns
    -------
    Pair
        (δ, ε) of the cursor.
    """
    (delta, epsilon), (right, up, far_right, far_up) = axes, steps
    return _step_cursor(delta, at[0], window[0], right, far_right), _step_cursor(epsilon, at[1], window[1], up, far_up)


def _step_cursor(axis: np.ndarray, at: float, span: Pair, steps: int, far: int) -> float:
    cell, width = (axis[-1] - axis[0]) / (axis.size - 1), span[1] - span[0]
    if width < FEWEST_CELLS * cell:
        found = at + (steps / STEPS + far * FAR_STEP) * width
        return float(min(max(found, axis[0]), axis[-1]))
    here = int(np.abs(axis - at).argmin())
    return float(axis[min(max(here + steps + far * max(1, round(FAR_STEP * width / cell)), 0), axis.size - 1)])


def move_window_to_cursor(window: Ranges, at: Pair) -> Ranges:
    """Return the window, moved to contain the cursor if the cursor is outside."""
    delta, epsilon = (_span_containing(span, value) for span, value in zip(window, at, strict=True))
    return delta, epsilon


def _span_containing(span: Pair, value: float) -> Pair:
    low, high = span
    edge = EDGE_SHARE * (high - low)
    if value < low:
        return value - edge, value - edge + (high - low)
    if value > high:
        return value + edge - (high - low), value + edge
    return span


def zoomed_window(window: Ranges, at: Pair, factor: float, box: Ranges) -> Ranges:
    """Return the window, scaled by a factor about the cursor `at`, which keeps its position on the screen.

    factor: below 1 to zoom in, above 1 to zoom out. box: the ranges of the survey. The window becomes at most
    LARGEST_ZOOM_OUT times as wide and as high as `box`.

    Returns
    -------
    Ranges
        The scaled window.
    """
    delta, epsilon = (
        (value - (value - low) * least, value + (high - value) * least)
        for (low, high), value, (left, right) in zip(window, at, box, strict=True)
        for least in (min(factor, LARGEST_ZOOM_OUT * (right - left) / (high - low)),)
    )
    return delta, epsilon
