"""What is left of a connection when it closes."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from uvicorn import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState
from waiting import eventually

from service.settings import Settings
from service.web.protocol import LEAST_READ, protocol_of

LIMITS = Settings(request_seconds=16, unread_seconds=32)
KEEP_ALIVE = 100


class UnreadTransport(asyncio.Transport):
    """A connection whose client reads nothing: what was written stays, and so does the connection, until aborted."""

    def __init__(self) -> None:
        super().__init__({"peername": ("127.0.0.1", 1), "sockname": ("127.0.0.1", 2)})
        self.written = b""
        self.read = 0
        self.closed = self.aborted = False

    def write(self, data: Any) -> None:
        self.written += bytes(data)

    def get_write_buffer_size(self) -> int:
        return len(self.written) - self.read

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.aborted = True

    def pause_reading(self) -> None: ...

    def resume_reading(self) -> None: ...


class Clock:
    """The event loop of a connection, whose timers run when the test says so."""

    def __init__(self) -> None:
        self.now = 0.0
        self.timers: dict[object, tuple[float, Callable[[], None]]] = {}
        self.create_task = asyncio.get_running_loop().create_task

    def call_later(self, seconds: float, act: Callable[[], None]) -> "Timer":
        timer = Timer(self)
        self.timers[timer] = self.now + seconds, act
        return timer

    def go_on(self, seconds: float) -> None:
        until = self.now + seconds
        while self.timers and (first := min(at for at, _ in self.timers.values())) <= until:
            self.now = first
            self.timers.pop(next(timer for timer, (at, _) in self.timers.items() if at == first))[1]()
        self.now = until


class Timer:
    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def cancel(self) -> None:
        self._clock.timers.pop(self, None)


def connected(application: Any) -> tuple[H11Protocol, UnreadTransport, Clock]:
    """A new connection."""
    clock, transport = Clock(), UnreadTransport()
    config = Config(application, timeout_keep_alive=KEEP_ALIVE, log_config=None)
    protocol = protocol_of(LIMITS)(config, ServerState(), {}, clock)  # type: ignore[arg-type] # enough of a loop
    protocol.connection_made(transport)
    return protocol, transport, clock


async def hello(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


async def wait(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    while (await receive())["type"] != "http.disconnect":
        pass


async def closed(way: str) -> tuple[UnreadTransport, Clock]:
    """A connection that has just been closed in this way."""
    protocol, transport, clock = connected(hello)
    ending = "close" if way == "asked" else "keep-alive"
    if way == "late":
        clock.go_on(LIMITS.request_seconds - 1)
        assert not transport.closed
        clock.go_on(1)
    else:
        protocol.data_received(f"GET / HTTP/1.1\r\nHost: x\r\nConnection: {ending}\r\n\r\n".encode())
        await eventually(lambda: protocol.cycle.response_complete)
    if way == "idle":
        clock.go_on(KEEP_ALIVE)
    if way == "shutdown":
        protocol.shutdown()
    if way == "nonsense":
        protocol.data_received(b"nonsense\r\n\r\n")
    assert transport.closed
    return transport, clock


@pytest.mark.parametrize("way", ["asked", "idle", "shutdown", "nonsense", "late"])
def test_a_closed_connection_does_not_wait_for_its_reader_for_ever(way: str) -> None:
    async def leave() -> UnreadTransport:
        transport, clock = await closed(way)
        clock.go_on(LIMITS.unread_seconds - 1)
        assert not transport.aborted
        clock.go_on(1)
        return transport

    transport = asyncio.run(leave())
    assert transport.aborted
    assert transport.written.startswith(b"HTTP/1.1 " + (b"408" if way == "late" else b"200"))


async def reads(size: int, closing: bool) -> bool:
    """Whether a client that reads this much, eight times in the longest wait, is kept until it has read everything."""
    protocol, transport, clock = connected(hello)
    transport.written = bytes(5 * LEAST_READ)
    protocol.pause_writing()
    if closing:
        transport.close()
        protocol._leave()
        protocol.resume_writing()  # asyncio says so when little is left, which somebody must still read
    while transport.get_write_buffer_size() > 0 and not transport.aborted:
        transport.read += size
        clock.go_on(LIMITS.unread_seconds / 8)
    protocol.connection_lost(None)
    return not transport.aborted


@pytest.mark.parametrize("closing", [False, True])
def test_a_slow_reader_is_kept_and_one_that_all_but_stands_still_is_not(closing: bool) -> None:
    assert asyncio.run(reads(LEAST_READ // 8, closing))
    assert not asyncio.run(reads(LEAST_READ // 8 - 1, closing))


def test_a_head_request_gets_no_body_even_when_it_is_late() -> None:
    async def late() -> bytes:
        protocol, transport, clock = connected(wait)
        protocol.data_received(b"HEAD / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n\r\n")
        clock.go_on(LIMITS.request_seconds)
        await asyncio.gather(*protocol.tasks)  # the application hears that nobody is there, and ends
        return transport.written

    head, _, body = asyncio.run(late()).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 408 ")
    assert body == b""


def test_a_connection_that_goes_by_itself_leaves_no_timer() -> None:
    async def come_and_go() -> dict[object, Any]:
        protocol, _, clock = connected(hello)
        protocol.pause_writing()
        assert len(clock.timers) == 2
        protocol.connection_lost(None)
        return clock.timers

    assert asyncio.run(come_and_go()) == {}
