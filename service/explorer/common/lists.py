"""The two lists of the page that are made of plain HTML: the surveys, and the key to the map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import param
from panel.custom import JSComponent

from gear_rattle.service.explorer.common.changes import in_event_loop
from gear_rattle.service.explorer.files import asset


class SurveyMenu(JSComponent):
    """The surveys; `chosen` is the id of one of them.

    `on_action` is called with what is to be done to which, and with what a viewer has entered.
    """

    rows = param.List(default=[])
    chosen = param.String(default="")
    ready = param.Boolean(default=False)
    signed_in = param.Boolean(default=False)

    _esm = asset("component.js") + asset("surveys.js")
    _stylesheets = [asset("surveys.css")]  # noqa: RUF012 - as Panel has it

    def __init__(self, on_action: Callable[[str, str, Mapping[str, Any]], None], **values: Any) -> None:
        super().__init__(**values)
        self._on_action = on_action
        self.on_msg(in_event_loop(lambda event: self.press(event.data)))

    def press(self, message: Any) -> None:
        """Do what a button of the list says."""
        if isinstance(message, dict):
            self._on_action(str(message.get("action")), str(message.get("survey")), message)


class Key(JSComponent):
    """Meanings of colours and lines; `chosen` are the names of the lines that are drawn."""

    shades = param.List(default=[])
    overlays = param.List(default=[])
    chosen = param.List(default=[])

    _esm = asset("key.js")
    _stylesheets = [asset("key.css")]  # noqa: RUF012 - as Panel has it
