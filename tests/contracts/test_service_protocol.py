"""What is left of a connection when it closes."""

import asyncio
from typing import Any

import pytest
from uvicorn import Config
from uvicorn.server import ServerState

from service.protocol import LEAST_READ, protocol_of
from service.settings import Settings

PATIENCE = 0.05


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


async def hello(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


async def wait(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    while (await receive())["type"] != "http.disconnect":
        pass


async def closed(way: str) -> UnreadTransport:
    """A connection that was closed in this way, some time ago."""
    limits = Settings(unread_seconds=PATIENCE, request_seconds=PATIENCE if way == "late" else 60)
    config = Config(hello, timeout_keep_alive=0 if way == "idle" else 60, log_config=None)
    transport = UnreadTransport()
    protocol = protocol_of(limits)(config, ServerState(), {})
    protocol.connection_made(transport)
    ending = "close" if way == "asked" else "keep-alive"
    if way != "late":
        protocol.data_received(f"GET / HTTP/1.1\r\nHost: x\r\nConnection: {ending}\r\n\r\n".encode())
        await asyncio.sleep(0.01)
    if way == "shutdown":
        protocol.shutdown()
    if way == "nonsense":
        protocol.data_received(b"nonsense\r\n\r\n")
    await asyncio.sleep(3 * PATIENCE)
    assert transport.closed
    return transport


@pytest.mark.parametrize("way", ["asked", "idle", "shutdown", "nonsense", "late"])
def test_a_closed_connection_does_not_wait_for_its_reader_for_ever(way: str) -> None:
    transport = asyncio.run(closed(way))
    assert transport.aborted
    assert transport.written.startswith(b"HTTP/1.1 " + (b"408" if way == "late" else b"200"))


async def reads(size: int, closing: bool) -> bool:
    """Whether a client that reads this much each time is kept until it has read everything."""
    transport = UnreadTransport()
    protocol = protocol_of(Settings(unread_seconds=10 * PATIENCE))(Config(hello, log_config=None), ServerState(), {})
    protocol.connection_made(transport)
    transport.written = bytes(40 * LEAST_READ)
    protocol.pause_writing()
    if closing:
        transport.close()
        protocol._leave()
        protocol.resume_writing()  # asyncio says so when little is left, which somebody must still read
    while transport.get_write_buffer_size() > 0 and not transport.aborted:
        await asyncio.sleep(PATIENCE)
        transport.read += size
    protocol.connection_lost(None)
    return not transport.aborted


@pytest.mark.parametrize("closing", [False, True])
def test_a_slow_reader_is_kept_and_one_that_all_but_stands_still_is_not(closing: bool) -> None:
    assert asyncio.run(reads(2 * LEAST_READ, closing))
    assert not asyncio.run(reads(LEAST_READ // 100, closing))


def test_a_head_request_gets_no_body_even_when_it_is_late() -> None:
    async def late() -> bytes:
        transport = UnreadTransport()
        config = Config(wait, log_config=None)
        protocol = protocol_of(Settings(request_seconds=PATIENCE))(config, ServerState(), {})
        protocol.connection_made(transport)
        protocol.data_received(b"HEAD / HTTP/1.1\r\nHost: x\r\nContent-Length: 5\r\n\r\n")
        await asyncio.sleep(3 * PATIENCE)
        return transport.written

    head, _, body = asyncio.run(late()).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 408 ")
    assert body == b""


def test_a_connection_that_goes_by_itself_leaves_no_timer() -> None:
    async def come_and_go() -> Any:
        protocol = protocol_of(Settings())(Config(hello, log_config=None), ServerState(), {})
        protocol.connection_made(UnreadTransport())
        protocol.pause_writing()
        protocol.connection_lost(None)
        return [timer for timer in asyncio.get_running_loop()._scheduled if not timer.cancelled()]

    assert asyncio.run(come_and_go()) == []
