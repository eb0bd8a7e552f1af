"""Call functions when a viewer uses a widget, and none when the page itself sets it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import panel as pn

from gear_rattle.service.explorer.common.changes import act_in_event_loop


class Watch:
    """Watches some widgets."""

    def __init__(self) -> None:
        self._is_paused = False
        self._newest: dict[Any, Any] = {}

    def on(self, widget: Any, used: Callable[[], None], name: str = "value") -> None:
        """Call a function when a viewer has given a widget another value of this parameter."""

        def changed(event: Any) -> None:
            if not self._is_paused:
                self._newest[widget] = event
                act_in_event_loop(lambda: act(event))

        def act(event: Any) -> None:
            if self._newest[widget] is event:  # else the newer one follows
                with self.paused():  # the page may have written another value meanwhile
                    setattr(widget, name, event.new)
                used()

        widget.param.watch(changed, name)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Return a context in which the page sets widgets."""
        self._is_paused = True
        try:
            yield
        finally:
            self._is_paused = False


def on_press(button: pn.widgets.Button, act: Callable[[], object]) -> None:
    """Act when a button is pressed."""
    button.on_click(lambda _event: act_in_event_loop(act))
