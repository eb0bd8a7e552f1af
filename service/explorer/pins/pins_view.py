"""Show the pinned points side by side; they are computed one after the other."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any

import param
from panel.custom import JSComponent

from gear_rattle.service.explorer.common.address import MOST_PINS, Pin
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.files import read_asset
from gear_rattle.service.explorer.pins.table import PinResults, build_pin_table, compute_pin_results, csv_text
from gear_rattle.service.explorer.point.state import pin_of_open_point
from gear_rattle.service.explorer.point.work import PointTasks
from gear_rattle.service.explorer.state.events import PinAdded, PinRemoved, PointOpened
from gear_rattle.service.explorer.state.store import JOBS, PageStore
from rattle import RattleError

COUNT = 1024  # initial conditions of each pinned point
FULL = f"{MOST_PINS} points are pinned already, and no more can be pinned. Remove a pinned point first."
OTHER = "The map is not of the model of this pinned point. To go to the point, choose a survey of its model."
FAILED = "The point could not be computed because of an error of the service, which is in its log."
log = logging.getLogger(__name__)


class PinTable(JSComponent):
    """Table of pinned points, with buttons to pin the open point, to remove a pin, and to go to a pin."""

    offered = param.String(default="")
    heads = param.List(default=[])
    lines = param.List(default=[])
    csv = param.String(default="")

    _esm = read_asset("component.js") + read_asset("pins.js")
    _stylesheets = [read_asset("pins.css")]  # noqa: RUF012 - Panel's own components declare this as a list

    def __init__(self, on_action: Callable[[str, int], None], **values: Any) -> None:
        super().__init__(**values)
        self._on_action = on_action
        self.on_msg(handler_in_event_loop(lambda event: self.handle_message(event.data)))

    def handle_message(self, message: Any) -> None:
        """Carry out the action that a button of the table sends."""
        if isinstance(message, Mapping) and isinstance(number := message.get("pin", 0), int):
            self._on_action(str(message.get("action")), number)


class PinsView:
    """Table of the pinned points, with a button that pins the open point. The store has the pinned points."""

    def __init__(self, viewer: PageSession, store: PageStore) -> None:
        self._viewer, self._store = viewer, store
        self._results: dict[Pin, PinResults | str] = {}
        self._work: dict[Pin, PointTasks] = {}
        self.table = PinTable(self._on_table_action, margin=0, sizing_mode="stretch_width")
        self._task: asyncio.Task[None] | None = None
        self._show_pins_and_results()
        store.subscribe(self._on_view_change, "pins", "point", "machine", "survey", "slice", JOBS)

    def _on_view_change(self) -> None:
        pins = self._store.view.pins
        for pin in [each for each in self._work if each not in pins]:
            self._work.pop(pin).stop()
            self._results.pop(pin, None)
        self._show_pins_and_results()
        self._start_computing()

    def end(self) -> None:
        """Give up all computations, because the page was closed."""
        for work in self._work.values():
            work.stop()

    def _on_table_action(self, action: str, number: int) -> None:
        pins, opened = self._store.view.pins, pin_of_open_point(self._store)
        if action == "pin" and opened is not None and opened not in pins:
            if len(pins) == MOST_PINS:
                self._viewer.show_message(FULL)
            else:
                self._store.dispatch(PinAdded(opened))
        elif action == "remove" and 0 <= number < len(pins):
            self._store.dispatch(PinRemoved(pins[number]))
        elif action == "go" and 0 <= number < len(pins):
            pin = pins[number]
            if pin.model == self._store.model:
                self._store.dispatch(PointOpened((pin.delta, pin.epsilon)))
            else:
                self._viewer.show_message(OTHER)

    def _start_computing(self) -> None:
        if self._next_pin_to_compute() is not None and (self._task is None or self._task.done()):
            self._task = self._viewer.start(self._compute_all_pins())

    def _next_pin_to_compute(self) -> Pin | None:
        return next((each for each in self._store.view.pins if each not in self._work), None)

    async def _compute_all_pins(self) -> None:
        while (pin := self._next_pin_to_compute()) is not None:
            self._work[pin] = work = PointTasks(self._viewer.front, self._viewer.document, pin.model.name)
            # `asyncio.wait` does not raise the CancelledError of a task whose pin was removed meanwhile
            await asyncio.wait([work.start(self._compute_pin(pin, work))])

    async def _compute_pin(self, pin: Pin, work: PointTasks) -> None:
        count = min(COUNT, self._viewer.front.settings.max_point_count)
        result: PinResults | str
        try:
            result = await work.compute(
                compute_pin_results, pin, count, what="The attractors of a pinned point", slow=True
            )
        except RattleError as error:
            result = str(error)
        except Exception:
            log.exception("a pinned point could not be computed")
            result = FAILED

        def show() -> None:
            self._results[pin] = result
            self._show_pins_and_results()

        await work.apply_document_change(show)

    def _show_pins_and_results(self) -> None:
        pins, opened = self._store.view.pins, pin_of_open_point(self._store)
        self.table.param.update(
            offered=opened.label if opened is not None and opened not in pins else "",
            heads=[f"{i}: {each.label}" for i, each in enumerate(pins, start=1)],
            lines=build_pin_table(pins, self._results),
            csv=csv_text(pins, self._results),
        )
