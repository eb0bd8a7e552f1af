"""Hostile clients over real sockets: the service refuses them, and goes on answering other clients."""

import json
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from hostile import BIG, CONNECTIONS, HEALTH, SURVEY, Service, answer, connected, head, is_alive, read_all, running
from service_processes import client_of, finish
from typer.testing import CliRunner
from waiting import wait_until

from gear_rattle.service.cli import app
from gear_rattle.service.errors import ServiceError
from gear_rattle.service.results import open_results


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running(tmp_path_factory.mktemp("data")) as service:
        yield service


@pytest.fixture(scope="module")
def token(service: Service) -> str:
    return service.token


@pytest.fixture(scope="module")
def port(service: Service) -> int:
    return service.port


@pytest.fixture(scope="module")
def store(service: Service) -> str:
    """Return the path of the survey's store over HTTP; symbolic links in the store lead to a file outside."""
    on_disk = service.data / "surveys" / f"{service.store.split('/')[-2]}.zarr"
    (service.data / "outside").write_text("secret")
    (on_disk / "link").symlink_to(service.data / "outside")
    (on_disk / "linked").symlink_to(service.data)
    os.mkfifo(on_disk / "fifo")
    return service.store


# Paths that lead out of the store


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


# Requests that are too large or malformed


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
    """The application refuses them, or uvicorn with 400, because it buffers only so much of an incomplete request."""
    assert answer(port, head(token, "GET", "/v1/surveys", *lines))[0] in {status, 200 if status == 200 else 400}


def test_headers_that_come_in_pieces_are_refused_as_well(port: int) -> None:
    with connected(port, b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nX: ") as connection:
        with pytest.raises((BrokenPipeError, ConnectionResetError)):  # noqa: PT012 - any of them may fail
            while True:  # ends when the service closes the connection
                connection.sendall(b"a" * 1000)
                time.sleep(0.001)
        assert read_all(connection)[:13] in (b"", b"HTTP/1.1 400 ")  # a reset may discard the answer


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
    assert status == 400
    assert "HTTP/1.1" not in body  # one answer: the hidden request was not executed


@pytest.mark.parametrize(
    "sent", [b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", b"\r\n\r\n", b"GET\r\n\r\n", b"\x00" * 99]
)
def test_what_is_no_request_is_refused(port: int, sent: bytes) -> None:
    assert answer(port, sent)[0] == 400


# Too many connections


def test_an_answer_that_is_read_in_pieces_arrives_whole(port: int, store: str, token: str) -> None:
    with connected(port, head(token, "GET", f"{store}/big")) as connection:
        assert len(read_all(connection)) > BIG


def test_too_many_connections_are_refused_until_they_are_closed(port: int) -> None:
    with ExitStack() as stack:
        for _ in range(CONNECTIONS):
            stack.enter_context(connected(port))
        wait_until(lambda: answer(port, HEALTH + b"Connection: close\r\n\r\n")[0] == 503)
    wait_until(lambda: is_alive(port))


# API keys over the network


def test_results_are_read_with_the_key_only(port: int, store: str, token: str, monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"http://127.0.0.1:{port}{store}"
    with pytest.raises(ServiceError, match="401"):
        open_results(url, {"Authorization": "Bearer wrong"})
    with client_of(port, token) as client:
        job = client.job(url.split("/")[-2])
        with job.open() as dataset:
            assert dataset["delta"].values.tolist() == SURVEY.delta.values().tolist()
            assert dataset["status"].values.max() == 0  # read chunk by chunk: no tile is computed
    monkeypatch.setenv("RATTLE_API_KEY", token)
    with open_results(url) as dataset:
        assert dataset.attrs["content_hash"] == SURVEY.content_hash()


def test_commands_send_the_key_of_the_environment(port: int, store: str, token: str) -> None:
    url, run, given = f"http://127.0.0.1:{port}", CliRunner().invoke, {"RATTLE_API_KEY": token}
    refused = finish("list", "--url", url)
    assert refused.returncode == 2
    assert "API key" in refused.stderr
    assert store.split("/")[-2] in run(app, ["list", "--url", url], env=given).stdout
    assert "xarray.Dataset" in run(app, ["open", url + store], env=given).stdout
