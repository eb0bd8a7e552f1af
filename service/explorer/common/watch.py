"""Controls that call somebody when a viewer uses them, and nobody when the page itself sets them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import panel as pn


class Watch:
    """Over some widgets."""

    def __init__(self) -> None:
        self._is_paused = False

    def on(self, widget: Any, used: Callable[[], None]) -> None:
        """Have somebody called when a viewer has given a widget another value."""
        widget.param.watch(lambda _event: None if self._is_paused else used(), "value")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Set widgets here."""
        self._is_paused = True
        try:
            yield
        finally:
            self._is_paused = False


def on_press(button: pn.widgets.Button, act: Callable[[], object]) -> None:
    """Act when a button is pressed, once nothing else changes the document: of a press that follows an entry at once,
    Panel tells without the document's lock, and no text could be changed then.
    """

    def acted() -> None:  # a task that it returns would be waited for, under the lock
        act()

    def pressed(_event: object) -> None:
        document = pn.state.curdoc
        if document is None or document.session_context is None:
            acted()
        else:
            document.add_next_tick_callback(acted)

    button.on_click(pressed)
