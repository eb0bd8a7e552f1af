"""Changes of the documents of pages: in the event loop, one after the other, none while a browser takes a document in.

Bokeh runs a coroutine in the event loop, and since its version 3.10 every other callback in a thread. Pages share
surveys and tasks with each other, so all that they do begins as a coroutine.
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

Change = Callable[[], Any]  # returns a coroutine, which Bokeh does not tell in its types

log = logging.getLogger(__name__)

_waiting: WeakKeyDictionary[Document, list[Change]] = WeakKeyDictionary()


def wait_for_browser(document: Document) -> None:
    """Keep back the changes of a document whose browser has connected, until the browser says that it has the document.

    A change that is sent before the document arrives a second time with it, and Panel drops one that it holds before
    then. Changes that are made before a browser connects are in the document. Called in the event loop.
    """
    loop = asyncio.get_running_loop()
    _waiting.setdefault(document, [])

    def let_go() -> None:
        for change in _waiting.pop(document, []):
            document.add_next_tick_callback(change)

    def on_load() -> None:
        loop.call_soon_threadsafe(let_go)

    with set_curdoc(document):
        pn.state.onload(on_load)


def change_document(document: Document, change: Callable[[], object]) -> None:
    """Change a document when nothing else does. Called in any thread."""

    async def act() -> None:
        if document in _waiting:
            _waiting[document].append(act)
            return
        with set_curdoc(document):
            document.hold("combine")  # or Panel sends its changes by itself, and after later ones of Bokeh
            try:
                change()
            except Exception:  # Bokeh would say nothing
                log.exception("a page of the explorer could not be changed")
            finally:
                document.unhold()

    schedule: Any = document.add_next_tick_callback  # which takes coroutines, too, unlike its type
    schedule(act)


async def change_and_wait(document: Document, change: Callable[[], object]) -> None:
    """Change a document when nothing else does, and wait until that is done.

    Raises
    ------
    Exception
        Whatever `change` raises.
    """
    done: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def act() -> None:
        error: Exception | None = None
        try:
            change()
        except Exception as raised:
            error = raised
        if done.done():  # its task was cancelled
            return
        if error is None:
            done.set_result(None)
        else:
            done.set_exception(error)

    change_document(document, act)
    await done


def act_in_event_loop(act: Callable[[], object]) -> None:
    """Act when nothing else changes the document of the page at hand; at once where there is no page, as in a test."""
    document = pn.state.curdoc
    if document is None or document.session_context is None:
        act()
    else:
        change_document(document, act)


def in_event_loop(handle: Callable[..., object]) -> Callable[..., None]:
    """Return a handler of a browser's events that runs in the event loop."""

    @wraps(handle)
    def handler(*arguments: Any) -> None:
        act_in_event_loop(partial(handle, *arguments))

    return handler
