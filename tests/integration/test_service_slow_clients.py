"""Clients that never end what they begin: the service cuts them off, and goes on answering the others."""

import re
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import psutil
import pytest
from hostile import BIG, CONNECTIONS, HEALTH, Service, connected, head, is_alive, read_all, running
from waiting import HANG, wait_until

REQUEST_SECONDS, UNREAD_SECONDS = 2.0, 2.0


@pytest.fixture(scope="module")
def strict(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running(tmp_path_factory.mktemp("strict"), REQUEST_SECONDS, UNREAD_SECONDS) as service:
        yield service


#: What a client begins with, what it then sends now and then, and the answers it gets before it is cut off.
SLOW: dict[str, tuple[bytes, bytes, list[int]]] = {
    "silence": (b"", b"", [408]),
    "half a header": (HEALTH, b"", [408]),
    "a header without end": (HEALTH, b"X-A: 1\r\n", [408]),
    "a method without end": (b"G", b"E", [408]),
    "a body that does not come": (b"POST {json}Content-Length: 60000\r\n\r\n", b"", [408]),
    "a body that trickles": (b"POST {json}Content-Length: 60000\r\n\r\n", b" ", [408]),
    "chunks without end": (b"POST {json}Transfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n", [408]),
    "a second request without end": (HEALTH + b"\r\n" + HEALTH, b"X-A: 1\r\n", [200, 408]),
    "a body that nobody waits for": (HEALTH + b"Content-Length: 60000\r\n\r\n", b" ", [200]),
}


def slow(service: Service, name: str) -> tuple[float, bytes]:
    """Seconds until the service cuts such a client off, and what it said."""
    first, piece, answers = SLOW[name]
    post = head(service.token, "POST", "/v1/surveys", "Content-Type: application/json").removesuffix(b"\r\n")
    while True:
        begun, received = time.monotonic(), b""
        with connected(service.port, first.replace(b"POST {json}", post)) as connection:
            connection.settimeout(0.1)
            while True:
                try:
                    connection.sendall(piece)
                    part = connection.recv(2**16)
                    received += part
                    if not part:
                        break
                except TimeoutError:
                    continue
                except (BrokenPipeError, ConnectionResetError):
                    break
        if received.startswith(b"HTTP/1.1 %d " % answers[0]) or answers[0] != 200:  # else its first request was late
            return time.monotonic() - begun, received


@pytest.fixture(scope="module")
def slow_clients(strict: Service) -> dict[str, tuple[float, bytes]]:
    """All of them at once, to spare time, beside a stream of events that outlives them."""
    events = strict.store.removesuffix("store") + "events"
    with connected(strict.port, head(strict.token, "GET", events)) as stream:
        assert stream.recv(2**16).startswith(b"HTTP/1.1 200 ")
        with ThreadPoolExecutor(len(SLOW)) as pool:
            ends = {name: pool.submit(slow, strict, name) for name in SLOW}
            found = {name: end.result() for name, end in ends.items()}
        stream.setblocking(False)
        with pytest.raises(BlockingIOError):  # noqa: PT012 - what came meanwhile
            while stream.recv(2**16):
                pass
        stream.settimeout(HANG)
        assert stream.recv(2**16)
    return found


@pytest.mark.parametrize("name", SLOW)
def test_a_request_that_never_ends_is_cut_off(slow_clients: dict[str, tuple[float, bytes]], name: str) -> None:
    taken, received = slow_clients[name]
    assert taken > 0.9 * REQUEST_SECONDS  # not sooner
    assert [int(status) for status in re.findall(rb"HTTP/1.1 (\d+) ", received)] == SLOW[name][2]


def test_the_service_lives_after_slow_clients(slow_clients: dict[str, tuple[float, bytes]], strict: Service) -> None:
    assert slow_clients
    assert is_alive(strict.port)


def test_an_answer_that_nobody_reads_is_dropped(strict: Service) -> None:
    sent = head(strict.token, "GET", f"{strict.store}/big")
    with ExitStack() as stack:
        unread = [stack.enter_context(socket.socket()) for _ in range(2)]
        for connection, request in zip(unread, (sent, sent.replace(b"Connection: close\r\n", b"")), strict=True):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.settimeout(HANG)
            connection.connect(("127.0.0.1", strict.port))
            connection.sendall(request)
            connection.recv(1)
        ours = {connection.getsockname()[1] for connection in unread}
        wait_until(lambda: not ours & clients_of(strict.pid))
        for connection in unread:
            assert len(read_all(connection)) < BIG
    assert is_alive(strict.port)


def clients_of(pid: int) -> set[int]:
    """Ports of the clients that a process is connected with."""
    return {each.raddr.port for each in psutil.Process(pid).net_connections("tcp") if each.raddr}


def test_silent_connections_do_not_keep_others_out(strict: Service) -> None:
    with ExitStack() as stack:
        for _ in range(CONNECTIONS + 5):
            stack.enter_context(connected(strict.port))
        wait_until(lambda: is_alive(strict.port))
