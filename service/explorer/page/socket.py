"""The websocket of a page, whose messages leave whole, in the order in which they were written, and none too early.

bokeh_fastapi sends a message in parts and lets another one in between; a change that is sent before the document that
it belongs to is lost, and so is one that Panel holds before it knows that the browser has the document. After any of
these the page does not know what later changes speak of.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from bokeh.protocol.message import Message
from fastapi import WebSocket
from panel.io.document import extra_socket_handlers
from panel.io.fastapi import WSHandler, dispatch_fastapi
from panel.io.state import state

CHANGE, DOCUMENT = "PATCH-DOC", "PULL-DOC-REPLY"

log = logging.getLogger(__name__)


class PageSocket(WSHandler):
    """Messages wait in a queue from the moment they are made."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._queue: asyncio.Queue[tuple[Message[Any], asyncio.Future[int]]] = asyncio.Queue()
        self._sender: asyncio.Task[None] | None = None
        self._written = self._sent = False  # the document
        self._dropped = False
        self._early: list[tuple[Message[Any], asyncio.Future[int]]] = []

    async def _async_open(self, socket: WebSocket, token: str) -> None:
        await super()._async_open(socket, token)
        create = self.connection.protocol.create

        def created(kind: str, *args: Any, **kwargs: Any) -> Message[Any]:
            message: Message[Any] = create(kind, *args, **kwargs)
            if kind == DOCUMENT:
                self._written = True
                # Panel believes it only when its script says so, and drops what happens until then.
                state._connected[self.connection.session.document] = True
            return message

        self.connection.protocol.create = created

    def send_message(self, message: Message[Any]) -> asyncio.Future[int]:
        """Enter a message; what is awaited is that it has left."""
        sent: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        if self._dropped:
            sent.set_result(0)
            return sent
        if message.msgtype == CHANGE and not self._sent:
            if self._written:
                self._early.append((message, sent))
            else:
                sent.set_result(0)  # the document will hold it
            return sent
        self._queue.put_nowait((message, sent))
        if message.msgtype == DOCUMENT:
            self._sent = True
            for early in self._early:
                self._queue.put_nowait(early)
            self._early.clear()
        if self._sender is None or self._sender.done():
            self._sender = asyncio.create_task(self._send_all())
        return sent

    def on_close(self, code: int, reason: str) -> None:  # noqa: ARG002 - bokeh_fastapi's words
        """The browser has left: said once. Its page is let go of when the message at work has been handled."""
        if not self._dropped:
            log.info("a browser has left its page (%s) while it was being written to", code)
        self._dropped = True

    def drop(self) -> None:
        """Send nothing more, whatever waits: the browser has left, or may no longer be here."""
        self._dropped = True
        if self._sender is not None:
            self._sender.cancel()
        waiting = [*self._early, *(self._queue.get_nowait() for _ in range(self._queue.qsize()))]
        for _, sent in waiting:
            if not sent.done():
                sent.set_result(0)
        self._early.clear()

    async def _send_all(self) -> None:
        while not self._queue.empty():
            message, sent = self._queue.get_nowait()
            size = 0
            try:
                size = await super().send_message(message)
            except Exception as error:  # the browser has left
                log.debug("a message to a page is lost: %s", error)
            finally:
                if not sent.done():
                    sent.set_result(size)


extra_socket_handlers[PageSocket] = dispatch_fastapi
