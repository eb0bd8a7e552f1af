"""Controls that call somebody when a viewer uses them, and nobody when the page itself sets them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import panel as pn

log = logging.getLogger(__name__)


class Watch:
    """Over some widgets."""

    def __init__(self) -> None:
        self._is_paused = False
        self._newest: dict[Any, Any] = {}

    def on(self, widget: Any, used: Callable[[], None]) -> None:
        """Have somebody called when a viewer has given a widget another value."""

        def changed(event: Any) -> None:
            if not self._is_paused:
                self._newest[widget] = event
                _when_free(lambda: act(event))

        def act(event: Any) -> None:
            if self._newest[widget] is event:  # else the newer one follows
                with self.paused():  # the page may have written another value meanwhile
                    widget.value = event.new
                used()

        widget.param.watch(changed, "value")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Set widgets here."""
        self._is_paused = True
        try:
            yield
        finally:
            self._is_paused = False


def on_press(button: pn.widgets.Button, act: Callable[[], object]) -> None:
    """Act when a button is pressed."""
    button.on_click(lambda _event: _when_free(act))


def _when_free(act: Callable[[], object]) -> None:
    """Act once nothing else changes the document. Of an entry that an event follows at once Panel tells without the
    document's lock, and nothing could be changed then.
    """

    def acted() -> None:  # a task that it returns would be waited for, under the lock
        try:
            act()
        except Exception:  # Bokeh would say nothing, and keep the document locked
            log.exception("a control of the explorer failed")

    document = pn.state.curdoc
    if document is None or document.session_context is None:
        act()
    else:
        document.add_next_tick_callback(acted)
