"""Apply changes to Bokeh documents in the event loop, one at a time, and none while a browser loads the document.

Bokeh runs a coroutine in the event loop, and since its version 3.10 every other callback in a thread. Pages share
surveys and tasks with each other, so every change of a page begins as a coroutine.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial, wraps
from typing import Any
from weakref import WeakKeyDictionary

import panel as pn
from bokeh.document import Document
from panel.io.state import set_curdoc

Change = Callable[[], Any]  # a coroutine function; the type is wider, as Bokeh's type hints exclude such functions

log = logging.getLogger(__name__)

_waiting: WeakKeyDictionary[Document, list[Change]] = WeakKeyDictionary()


def delay_changes_until_loaded(document: Document) -> None:
    """Delay all changes of a document from now until its browser has loaded the document.

    Call this function in the event loop when the browser connects. Without the delay some changes would arrive twice,
    alone and as part of the document, and Panel would lose others. Earlier changes are part of the document.
    """
    loop = asyncio.get_running_loop()
    _waiting.setdefault(document, [])

    def send_waiting_changes() -> None:
        for change in _waiting.pop(document, []):
            document.add_next_tick_callback(change)

    def on_load() -> None:
        loop.call_soon_threadsafe(send_waiting_changes)

    with set_curdoc(document):
        pn.state.onload(on_load)


def change_document(document: Document, change: Callable[[], object]) -> None:
    """Schedule a call of `change` in the event loop, at a time without another change of the document.

    The call is delayed while a browser loads the document. This function may be called in any thread.
    """

    async def call_change() -> None:
        if document in _waiting:
            _waiting[document].append(call_change)
            return
        with set_curdoc(document):
            # `hold` sends all changes together. Without it, a browser could get changes of Panel's widgets after later
            # changes of Bokeh's models.
            document.hold("combine")
            try:
                change()
            except Exception:  # logged here, because Bokeh would not report the error
                log.exception("a page of the explorer could not be changed")
            finally:
                document.unhold()

    # Bokeh accepts a coroutine function here too, although its type hint does not say so
    schedule: Any = document.add_next_tick_callback
    schedule(call_change)


async def change_and_wait(document: Document, change: Callable[[], object]) -> None:
    """Change a document as `change_document` does, and wait until `change` has returned.

    Raises
    ------
    Exception
        Every exception that `change` raises is raised here.
    """
    done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def change_and_report() -> None:
        error: Exception | None = None
        try:
            change()
        except Exception as raised:
            error = raised
        if done.done():  # the task that waited for the change was cancelled
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    change_document(document, change_and_report)
    await done


def act_in_event_loop(act: Callable[[], object]) -> None:
    """Call `act`, which changes the current page, by `change_document`; at once if there is no page, as in tests."""
    document = pn.state.curdoc
    if document is None or document.session_context is None:
        act()
    else:
        change_document(document, act)


def handler_in_event_loop(handle: Callable[..., object]) -> Callable[..., None]:
    """Return a handler of browser events that calls `handle` in the event loop."""

    @wraps(handle)
    def handler(*arguments: Any) -> None:
        act_in_event_loop(partial(handle, *arguments))

    return handler
