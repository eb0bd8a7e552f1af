"""What a slow but honest client may do within the limits of a connection, on a clock that the test turns."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from uvicorn import Config
from uvicorn.server import ServerState

from service.settings import Settings
from service.web.protocol import LEAST_READ, protocol_of

LIMIT = 20.0
PAUSE = 0.6 * LIMIT
REQUEST = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"


class TurnedClock(asyncio.SelectorEventLoop):
    """A loop whose time stands still unless it is told to pass."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0

    def time(self) -> float:
        return self.now

    async def after(self, seconds: float) -> None:
        """Let this time pass, and whatever is due happen."""
        self.now += seconds
        for _ in range(10):
            await asyncio.sleep(0)


class Connection(asyncio.Transport):
    """One that keeps what was written until the test reads it."""

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
        return self.closed or self.aborted

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.aborted = True

    def pause_reading(self) -> None: ...

    def resume_reading(self) -> None: ...


async def hello(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


async def begin(scope: Any, receive: Any, send: Any) -> None:  # noqa: ARG001 - the signature of ASGI
    await send({"type": "http.response.start", "status": 200, "headers": []})
    while (await receive())["type"] != "http.disconnect":
        pass


def converse(talk: Callable[[TurnedClock, Any, Connection], Awaitable[None]], app: Any = hello) -> Connection:
    """A connection after this conversation with an application."""
    clock, connection = TurnedClock(), Connection()

    async def main() -> None:
        limits = Settings(request_seconds=LIMIT, unread_seconds=LIMIT)
        config = Config(app, timeout_keep_alive=1000, log_config=None)
        protocol = protocol_of(limits)(config, ServerState(), {})
        protocol.connection_made(connection)
        await talk(clock, protocol, connection)
        protocol.connection_lost(None)
        await clock.after(0)

    with asyncio.Runner(loop_factory=lambda: clock) as runner:
        runner.run(main())
    return connection


def test_a_request_that_comes_slowly_but_in_time_is_answered() -> None:
    async def talk(clock: TurnedClock, protocol: Any, _: Connection) -> None:
        for start in range(0, len(REQUEST), 2):
            await clock.after(1.9 * LIMIT / len(REQUEST))
            protocol.data_received(REQUEST[start : start + 2])
        await clock.after(0)

    assert converse(talk).written.startswith(b"HTTP/1.1 200 ")


def test_a_request_that_comes_too_slowly_is_cut_off() -> None:
    async def talk(clock: TurnedClock, protocol: Any, connection: Connection) -> None:
        for byte in REQUEST[:-1]:
            await clock.after(1.1 * LIMIT / len(REQUEST))
            if not connection.closed:
                protocol.data_received(bytes([byte]))

    assert converse(talk).written.startswith(b"HTTP/1.1 408 ")


def test_a_connection_is_used_again_after_a_pause() -> None:
    async def talk(clock: TurnedClock, protocol: Any, connection: Connection) -> None:
        for _ in range(4):
            protocol.data_received(REQUEST)
            await clock.after(PAUSE)
        assert not connection.closed

    assert converse(talk).written.count(b"HTTP/1.1 200 ") == 4


def test_an_answer_that_is_read_with_pauses_is_not_dropped() -> None:
    async def talk(clock: TurnedClock, protocol: Any, connection: Connection) -> None:
        protocol.data_received(REQUEST)
        await clock.after(0)
        connection.written = bytes(10 * LEAST_READ)  # a part of the answer, more than the kernel takes
        protocol.pause_writing()
        while connection.get_write_buffer_size() > 0:
            connection.read += LEAST_READ
            await clock.after(PAUSE)
            assert not connection.aborted
        protocol.resume_writing()
        await clock.after(2 * LIMIT)

        assert not connection.closed

    assert not converse(talk, begin).aborted


def test_an_answer_that_is_no_longer_read_is_dropped() -> None:
    async def talk(clock: TurnedClock, protocol: Any, connection: Connection) -> None:
        protocol.data_received(REQUEST)
        await clock.after(0)
        connection.written = bytes(10 * LEAST_READ)  # a part of the answer, more than the kernel takes
        protocol.pause_writing()
        await clock.after(PAUSE)
        assert not connection.aborted
        await clock.after(PAUSE)

    assert converse(talk, begin).aborted
