"""Call functions when a viewer changes a widget, but not when the page itself sets the widget's value."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.changes import act_in_event_loop


class WidgetWatcher:
    """Watcher that calls functions when a viewer, not the page itself, changes a widget."""

    def __init__(self) -> None:
        self._is_paused = False
        self._newest: dict[Any, Any] = {}

    def call_on_change(self, widget: Any, callback: Callable[[], None], name: str = "value") -> None:
        """Call `callback` whenever a viewer has changed the parameter `name` of a widget."""

        def on_change(event: Any) -> None:
            if not self._is_paused:
                self._newest[widget] = event
                act_in_event_loop(lambda: act_on_newest(event))

        def act_on_newest(event: Any) -> None:
            if self._newest[widget] is event:  # an older event is ignored: the call for the newest one follows
                with (
                    self.ignore_changes()
                ):  # restores the viewer's value, which the page may have overwritten meanwhile
                    setattr(widget, name, event.new)
                callback()

        widget.param.watch(on_change, name)

    @contextmanager
    def ignore_changes(self) -> Iterator[None]:
        """Ignore all changes of widgets inside this context, in which the page itself sets their values."""
        self._is_paused = True
        try:
            yield
        finally:
            self._is_paused = False


def call_on_press(button: pn.widgets.Button, act: Callable[[], object]) -> None:
    """Call `act` in the event loop whenever a button is pressed."""
    button.on_click(lambda _event: act_in_event_loop(act))
