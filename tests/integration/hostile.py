"""A service that requires keys and has a waiting survey, and clients that write raw bytes to their sockets."""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
from service_processes import FIELDS, client_of, free_port, get, server
from typer.testing import CliRunner
from waiting import HANG

from gear_rattle.service.cli import app
from gear_rattle.workers import SurveyRequest, create_store

CONNECTIONS = 24
NO_CLUSTER = ["--scheduler", "tcp://127.0.0.1:9"]  # nothing listens there: surveys wait for ever
BIG = 32 * 2**20  # bytes; more than the kernel buffers for a client that does not read
SURVEY = SurveyRequest(**FIELDS)
UVICORNS = (b"Invalid HTTP request received.", b"Service Unavailable")  # answers of uvicorn itself
HEALTH = b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\n"


@dataclass(frozen=True)
class Service:
    """A service with one survey, which waits for a cluster."""

    pid: int
    port: int
    token: str
    data: Path
    store: str  # path of the survey's store over HTTP


@contextmanager
def running(data: Path) -> Iterator[Service]:
    """Run a service that requires API keys and accepts few connections."""
    token = CliRunner().invoke(app, ["key", "add", "Ann", "--scope", "submit", "--data", str(data)]).stdout.strip()
    port = free_port()
    settings = {
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


@contextmanager
def connected(port: int, sent: bytes = b"") -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=HANG) as connection:
        connection.sendall(sent)
        yield connection


def read_all(connection: socket.socket) -> bytes:
    """Return everything that the service sends until it closes the connection."""
    parts = []
    try:
        while part := connection.recv(2**16):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


def head(token: str, method: str = "GET", target: str = "/v1/surveys", *lines: str) -> bytes:
    """Return the head of a request, with `Connection: close`."""
    first = [f"{method} {target} HTTP/1.1", "Host: 127.0.0.1", f"Authorization: Bearer {token}", "Connection: close"]
    return "\r\n".join([*first, *lines, "", ""]).encode("latin-1")


def answer(port: int, sent: bytes) -> tuple[int, str]:
    """Return status and body of the answer to these bytes: a problem document, or an answer of uvicorn itself."""
    with connected(port, sent) as connection:
        received = read_all(connection)
    start, _, body = received.partition(b"\r\n\r\n")
    status = int(start.split()[1])
    if status >= 400 and body not in (b"", *UVICORNS):
        assert b"application/problem+json" in start, received
        assert json.loads(body)["status"] == status
    return status, body.decode("latin-1")


def is_alive(port: int) -> bool:
    """Return whether the service answers. While it has too many connections, it does not."""
    try:
        return get(f"http://127.0.0.1:{port}/v1/health").status_code == 200
    except httpx.TransportError:
        return False
