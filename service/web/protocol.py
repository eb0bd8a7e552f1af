"""HTTP/1.1 by uvicorn, with an end to the patience that uvicorn has with slow clients (Kludex/uvicorn#157)."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from service.settings import Settings
from service.web.problems import ADVICE, RETRY_AFTER, problem_response

UNFINISHED = (h11.IDLE, h11.SEND_BODY)
CAN_ANSWER = (h11.IDLE, h11.SEND_RESPONSE)
LEAST_READ = 16 * 1024  # of an answer that waits, in unread_seconds

log = logging.getLogger(__name__)


def protocol_of(settings: Settings) -> type[H11Protocol]:
    """The protocol class for uvicorn that keeps the limits of these settings."""
    return type("BoundedProtocol", (_BoundedProtocol,), {"limits": settings})


class _BoundedProtocol(H11Protocol):
    """One connection. A request must arrive whole in time, an answer must be read in time.

    Two timers: from the first byte of a request to its last; and while an answer waits for its reader, also after the
    connection was closed.
    """

    limits: ClassVar[Settings]

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._timers: dict[str, asyncio.TimerHandle] = {}

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as uvicorn has it
        super().connection_made(transport)
        if len(self.connections) > self.limits.max_connections:
            self._refuse(503, "Too many connections are open. Try again in a few seconds.")
            return
        self._expect_request()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        if "arriving" not in self._timers:
            self._expect_request()
        super().data_received(data)
        if self.transport.is_closing():
            return
        state = self.conn.their_state
        if state is h11.IDLE and not self.conn.trailing_data[0]:
            self._expect_request()  # between two requests
        elif state not in UNFINISHED:
            self._stop("arriving")

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        self._stop()
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002 - uvicorn's words
        error = sys.exc_info()[1]  # uvicorn calls this where it caught what h11 raised
        status = error.error_status_hint if isinstance(error, h11.RemoteProtocolError) else 400
        self._refuse(status, ADVICE.get(status, f"This is not a request of HTTP/1.1 that can be answered: {error}."))

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self.transport.is_closing():
            self._leave()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._leave()

    def shutdown(self) -> None:
        super().shutdown()
        if self.transport.is_closing():
            self._leave()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._await_reader()

    def resume_writing(self) -> None:
        super().resume_writing()
        if not self.transport.is_closing():
            self._stop("unread")

    def _expect_request(self) -> None:
        self._start("arriving", self.limits.request_seconds, self._too_late)

    def _too_late(self) -> None:
        self._refuse(408, ADVICE[408])

    def _await_reader(self) -> None:
        unread = self.transport.get_write_buffer_size()
        self._start("unread", self.limits.unread_seconds, lambda: self._check_reader(unread))

    def _check_reader(self, before: int) -> None:
        if self.transport.get_write_buffer_size() <= before - LEAST_READ:
            self._await_reader()
            return
        log.info("%s does not read what it asked for: connection dropped", self.client)
        self.transport.abort()

    def _refuse(self, status: int, detail: str) -> None:
        """Answer if that is still possible, and close."""
        if self.transport.is_closing():
            return
        if self.conn.our_state in CAN_ANSWER:
            scope = self.scope if self.conn.our_state is h11.SEND_RESPONSE else None
            path = scope["path"] if scope else ""
            answer = problem_response(status, detail, path, headers=RETRY_AFTER if status == 503 else None)
            body = b"" if scope and scope["method"] == "HEAD" else bytes(answer.body)
            events = (
                h11.Response(status_code=status, headers=[*answer.raw_headers, (b"connection", b"close")]),
                h11.Data(data=body),
                h11.EndOfMessage(),
            )
            for event in events:
                self.transport.write(self.conn.send(event) or b"")
        if self.cycle is not None:  # the application shall neither wait for more nor answer again
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        self.transport.close()
        self._leave()

    def _leave(self) -> None:
        """A closed connection stays until its answer was read, or is no longer being read."""
        self._stop()
        self._await_reader()

    def _start(self, name: str, seconds: float, act: Callable[[], None]) -> None:
        self._stop(name)
        self._timers[name] = self.loop.call_later(seconds, act)

    def _stop(self, *names: str) -> None:
        for name in names or tuple(self._timers):
            if name in self._timers:
                self._timers.pop(name).cancel()
