"""Components in plain HTML: the list of the surveys, the buttons of the maps, and the key of the map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import param
from panel.custom import JSComponent

from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.files import read_asset


class SurveyMenu(JSComponent):
    """List of the surveys. chosen: id of the chosen survey, empty if none is chosen.

    When a viewer presses a button, `on_action` is called with the action's name, the survey's id and the message, which
    holds the values that the viewer entered.
    """

    rows = param.List(default=[])
    chosen = param.String(default="")
    ready = param.Boolean(default=False)
    signed_in = param.Boolean(default=False)

    _esm = read_asset("component.js") + read_asset("surveys.js")
    _stylesheets = [read_asset("surveys.css")]  # noqa: RUF012 - Panel's own components declare this as a list

    def __init__(self, on_action: Callable[[str, str, Mapping[str, Any]], None], **values: Any) -> None:
        super().__init__(**values)
        self._on_action = on_action
        self.on_msg(handler_in_event_loop(lambda event: self.handle_message(event.data)))

    def handle_message(self, message: Any) -> None:
        """Call `on_action` for the message that a button of the list sends."""
        if isinstance(message, dict):
            self._on_action(str(message.get("action")), str(message.get("survey")), message)


class MapLegend(JSComponent):
    """Legend of a map: meanings of its colours (`shades`) and lines (`overlays`). chosen: names of drawn lines."""

    shades = param.List(default=[])
    overlays = param.List(default=[])
    chosen = param.List(default=[])

    _esm = read_asset("key.js")
    _stylesheets = [read_asset("key.css")]  # noqa: RUF012 - Panel's own components declare this as a list


class MapButtons(JSComponent):
    """Buttons of the featured maps.

    Attributes
    ----------
    buttons : list of dict
        For each button its `label`, the `variable` of its map, its tooltip `about`, and `missing`: True if the survey
        lacks the map.
    chosen : str
        Variable of the map that is shown, empty if it has no button.
    """

    buttons = param.List(default=[])
    chosen = param.String(default="")

    _esm = read_asset("component.js") + read_asset("maps.js")
    _stylesheets = [read_asset("maps.css")]  # noqa: RUF012 - Panel's own components declare this as a list
