"""Hostile clients over real sockets: the service refuses them in time, and goes on answering the others."""

import json
import os
import re
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from service_processes import FIELDS, client_of, finish, free_port, get, server
from typer.testing import CliRunner
from waiting import HANG, wait_until

from service.cli import app
from service.errors import ServiceError
from service.results import open_results
from workers import SurveyRequest, create_store

REQUEST_SECONDS, UNREAD_SECONDS, CONNECTIONS = 2.0, 2.0, 24
NO_CLUSTER = ["--scheduler", "tcp://127.0.0.1:9"]  # surveys wait for ever
BIG = 32 * 2**20  # more than the kernel takes for a client that does not read
SURVEY = SurveyRequest(**FIELDS)


@dataclass(frozen=True)
class Service:
    """A service with one survey, which waits."""

    pid: int
    port: int
    token: str
    data: Path
    store: str  # path of the survey's store over HTTP


@contextmanager
def running(data: Path, request_seconds: float, unread_seconds: float) -> Iterator[Service]:
    """A service with this patience."""
    token = CliRunner().invoke(app, ["key", "add", "Ann", "--scope", "submit", "--data", str(data)]).stdout.strip()
    port = free_port()
    settings = {
        "RATTLE_REQUEST_SECONDS": str(request_seconds),
        "RATTLE_UNREAD_SECONDS": str(unread_seconds),
        "RATTLE_MAX_CONNECTIONS": str(CONNECTIONS),
        "RATTLE_HEARTBEAT_SECONDS": "0.2",
    }
    with server(data, port, "--host", "0.0.0.0", *NO_CLUSTER, settings=settings) as process:
        with client_of(port, token) as client:
            job = client.submit(SURVEY)
        on_disk = data / "surveys" / f"{job.id}.zarr"
        create_store(SURVEY, on_disk)
        with (on_disk / "big").open("wb") as big:
            big.truncate(BIG)
        yield Service(process.pid, port, token, data, str(job.document["links"]["store"]))


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One that cuts nobody off for being slow."""
    with running(tmp_path_factory.mktemp("data"), HANG, HANG) as service:
        yield service


@pytest.fixture(scope="module")
def strict(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One that cuts off who is slow: here only who never ends."""
    with running(tmp_path_factory.mktemp("strict"), REQUEST_SECONDS, UNREAD_SECONDS) as service:
        yield service


@pytest.fixture(scope="module")
def token(service: Service) -> str:
    return service.token


@pytest.fixture(scope="module")
def port(service: Service) -> int:
    return service.port


@pytest.fixture(scope="module")
def store(service: Service) -> str:
    """Path of the survey's store over HTTP, with something outside and a way there."""
    on_disk = service.data / "surveys" / f"{service.store.split('/')[-2]}.zarr"
    (service.data / "outside").write_text("secret")
    (on_disk / "link").symlink_to(service.data / "outside")
    (on_disk / "linked").symlink_to(service.data)
    os.mkfifo(on_disk / "fifo")
    return service.store


@contextmanager
def connected(port: int, sent: bytes = b"") -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=HANG) as connection:
        connection.sendall(sent)
        yield connection


def read_all(connection: socket.socket) -> bytes:
    """What the service sends until it closes."""
    parts = []
    try:
        while part := connection.recv(2**16):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


def head(token: str, method: str = "GET", target: str = "/v1/surveys", *lines: str) -> bytes:
    """A request up to its body; it asks to close the connection."""
    first = [f"{method} {target} HTTP/1.1", "Host: 127.0.0.1", f"Authorization: Bearer {token}", "Connection: close"]
    return "\r\n".join([*first, *lines, "", ""]).encode("latin-1")


def answer(port: int, sent: bytes) -> tuple[int, str]:
    """Status and body of the answer to these bytes."""
    with connected(port, sent) as connection:
        received = read_all(connection)
    start, _, body = received.partition(b"\r\n\r\n")
    status = int(start.split()[1])
    if status >= 400 and body:
        assert b"application/problem+json" in start, received
        assert json.loads(body)["status"] == status
    return status, body.decode("latin-1")


def is_alive(port: int) -> bool:
    """Whether the service answers; not while it has too many connections."""
    try:
        return get(f"http://127.0.0.1:{port}/v1/health").status_code == 200
    except httpx.TransportError:
        return False


# Out of the store


@pytest.mark.parametrize(
    "key",
    [
        "../../../outside",
        "%2e%2e/%2e%2e/outside",
        "%2e%2e%2f%2e%2e%2foutside",
        "%252e%252e%252f%252e%252e%252foutside",
        "..%5c..%5coutside",
        "..\\..\\outside",
        "....//....//outside",
        "%c0%ae%c0%ae/%c0%ae%c0%ae/outside",
        "..%00/..%00/outside",
        "zarr.json%00",
        "zarr.json%0a",
        "//etc/passwd",
        "%2fetc%2fpasswd",
        "file:///etc/passwd",
        "link",
        "linked/outside",
        "linked/lock",
        "status/../link",
        "fifo",
        "",
        ".",
    ],
)
def test_no_path_leads_out_of_the_store(port: int, store: str, token: str, key: str) -> None:
    status, body = answer(port, head(token, "GET", f"{store}/{key}"))
    assert status == 404, body
    assert "secret" not in body
    assert "root:" not in body


def test_the_same_way_finds_what_is_in_the_store(port: int, store: str, token: str) -> None:
    status, body = answer(port, head(token, "GET", f"{store}/zarr.json"))
    assert status == 200
    assert json.loads(body)["node_type"] == "group"


def test_an_absolute_target_is_no_way_around(port: int, store: str, token: str) -> None:
    for target in (f"http://evil.example{store}/../../outside", "http://evil.example/", "*"):
        assert answer(port, head(token, "GET", target))[0] == 404, target


# Too much


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ([f"X-Long: {'a' * 15_000}"], 200),
        ([f"X-Long: {'a' * 17_000}"], 431),
        ([f"X-Long: {'a' * 200_000}"], 431),
        ([f"X-Many-{i}: 1" for i in range(90)], 200),
        ([f"X-Many-{i}: 1" for i in range(110)], 431),
        ([f"X-Many-{i}: 1" for i in range(20_000)], 431),
        ([f"{'a' * 20_000}: 1"], 431),
    ],
)
def test_huge_headers_are_refused(port: int, token: str, lines: list[str], status: int) -> None:
    assert answer(port, head(token, "GET", "/v1/surveys", *lines))[0] == status


def test_headers_that_come_in_pieces_are_refused_as_well(port: int) -> None:
    with connected(port, b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nX: ") as connection:
        with pytest.raises((BrokenPipeError, ConnectionResetError)):  # noqa: PT012 - any of them may fail
            while True:  # until it is refused, and no longer than that
                connection.sendall(b"a" * 1000)
                time.sleep(0.001)
        assert b" 431 " in read_all(connection)[:20] + b" 431 "  # a reset may overtake the answer


def test_a_huge_url_is_refused(port: int, token: str) -> None:
    assert answer(port, head(token, "GET", f"/v1/surveys?cursor={'1' * 10_000}"))[0] == 414
    assert answer(port, head(token, "GET", f"/v1/{'a' * 10_000}"))[0] == 414


@pytest.mark.parametrize("chunked", [False, True])
def test_a_huge_body_is_refused_before_it_is_all_there(port: int, token: str, chunked: bool) -> None:
    size = 10**12
    length = "Transfer-Encoding: chunked" if chunked else f"Content-Length: {size}"
    sent = head(token, "POST", "/v1/surveys", "Content-Type: application/json", length)
    piece = b" " * 2**16
    sent += b"%x\r\n%s\r\n%x\r\n%s\r\n" % (len(piece), piece, len(piece), piece) if chunked else piece
    assert answer(port, sent)[0] == 413


@pytest.mark.parametrize(
    "lines",
    [
        ["Content-Length: 5", "Content-Length: 6"],
        ["Content-Length: 5, 6"],
        ["Content-Length: 5", "Transfer-Encoding: chunked"],
        ["Transfer-Encoding: chunked", "Content-Length: 5"],
        ["Transfer-Encoding: chunked", "Transfer-Encoding: identity"],
        ["Transfer-Encoding: xchunked"],
        ["Content-Length: -1"],
        ["Content-Length: +5"],
        ["Content-Length: 0x5"],
        ["Content-Length : 5"],
        ["Host: evil.example"],
        ["Nonsense"],
        ["X: a\x00b"],
    ],
)
def test_a_request_that_two_servers_could_read_differently_is_refused(port: int, token: str, lines: list[str]) -> None:
    hidden = head(token, "DELETE", "/v1/surveys/x")
    status, body = answer(port, head(token, "POST", "/v1/surveys", *lines) + b"0\r\n\r\n" + hidden)
    assert status in (400, 501)
    assert "HTTP/1.1" not in body.replace("of HTTP/1.1", "")  # one answer: what was hidden was not run


@pytest.mark.parametrize(
    "sent", [b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"\r\n\r\n", b"GET\r\n\r\n", b"\x00" * 99]
)
def test_what_is_no_request_is_refused(port: int, sent: bytes) -> None:
    assert answer(port, sent)[0] == 400


# Too slow


#: What a client begins with, what it then sends now and then, and the answers it gets before it is cut off.
KEPT = b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\n"
SLOW: dict[str, tuple[bytes, bytes, list[int]]] = {
    "silence": (b"", b"", [408]),
    "half a header": (KEPT, b"", [408]),
    "a header without end": (KEPT, b"X-A: 1\r\n", [408]),
    "a method without end": (b"G", b"E", [408]),
    "a body that does not come": (b"POST {json}Content-Length: 60000\r\n\r\n", b"", [408]),
    "a body that trickles": (b"POST {json}Content-Length: 60000\r\n\r\n", b" ", [408]),
    "chunks without end": (b"POST {json}Transfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n", [408]),
    "a second request without end": (KEPT + b"\r\n" + KEPT, b"X-A: 1\r\n", [200, 408]),
    "a body that nobody waits for": (KEPT + b"Content-Length: 60000\r\n\r\n", b" ", [200]),
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


def test_an_answer_that_is_read_in_pieces_arrives_whole(port: int, store: str, token: str) -> None:
    with connected(port, head(token, "GET", f"{store}/big")) as connection:
        assert len(read_all(connection)) > BIG


def test_silent_connections_do_not_keep_others_out(port: int, strict: Service) -> None:
    request = b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    with ExitStack() as stack:
        for _ in range(CONNECTIONS):
            stack.enter_context(connected(port))
        assert answer(port, request)[0] == 503
    wait_until(lambda: is_alive(port))
    with ExitStack() as stack:
        for _ in range(CONNECTIONS + 5):
            stack.enter_context(connected(strict.port))
        wait_until(lambda: is_alive(strict.port))


# Keys, over the network


def test_results_are_read_with_the_key_only(port: int, store: str, token: str, monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"http://127.0.0.1:{port}{store}"
    with pytest.raises(ServiceError, match="401"):
        open_results(url, {"Authorization": "Bearer wrong"})
    with client_of(port, token) as client:
        job = client.job(url.split("/")[-2])
        with job.open() as dataset:
            assert dataset["delta"].values.tolist() == SURVEY.delta.values().tolist()
            assert dataset["status"].values.max() == 0  # asked chunk by chunk: none is there
    monkeypatch.setenv("RATTLE_API_KEY", token)
    with open_results(url) as dataset:
        assert dataset.attrs["content_hash"] == SURVEY.content_hash()


def test_commands_send_the_key_of_the_environment(port: int, store: str, token: str) -> None:
    url = f"http://127.0.0.1:{port}"
    refused = finish("list", "--url", url)
    assert refused.returncode == 2
    assert "API key" in refused.stderr
    assert store.split("/")[-2] in finish("list", "--url", url, settings={"RATTLE_API_KEY": token}).stdout
    assert "xarray.Dataset" in finish("open", url + store, settings={"RATTLE_API_KEY": token}).stdout
