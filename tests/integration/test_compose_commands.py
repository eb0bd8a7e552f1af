"""The commands of docker-compose.yml, run as processes: PostgreSQL, scheduler, workers, front end and proxy."""

import re
import shutil
import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import postgres
import pytest
import yaml
from containers import Here, database
from depth import either
from service_processes import REQUEST, ROOT, assert_bit_identical, client_of, serial_run, server
from waiting import HANG, wait_until

from gear_rattle.service.client import Client
from gear_rattle.service.errors import ResponseError, ServiceError

SERVICES: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]


@pytest.mark.skipif(bool(postgres.missing()), reason=postgres.missing())
def test_a_survey_through_everything(tmp_path: Path) -> None:
    here = Here(tmp_path, SERVICES)
    for name in ("data", "tmp"):
        (tmp_path / name).mkdir()
    with ExitStack() as stack:
        stack.enter_context(database(here))
        stack.enter_context(here.started("scheduler"))
        for number in range(either(1, SERVICES["worker"]["deploy"]["replicas"])):
            stack.enter_context(here.started("worker", number))
        assert here.run("front", *here.words(SERVICES["front"]["command"])).returncode == 2  # there is no API key yet
        added = here.run("front", "rattle", "key", "add", "me", "--scope", "submit")
        assert added.returncode == 0, added.stderr
        stack.enter_context(here.started("front"))
        expected: dict[str, np.ndarray] = serial_run(REQUEST)
        with client_of(here.front, added.stdout.strip()) as client:
            job = client.submit(REQUEST)
            with job.wait().open() as dataset:
                assert_bit_identical(dataset, expected)
        assert list((tmp_path / "data" / "surveys").iterdir())
        assert not (tmp_path / "data" / "jobs.sqlite").exists()


SLOW = {
    "half a header": b"GET /v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ",
    "a body that does not come": b"POST /v1/surveys HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9\r\n\r\n",
}


@pytest.mark.skipif(shutil.which("caddy") is None, reason="Caddy is not installed (apt-get install caddy)")
def test_the_proxy_cuts_off_slow_clients_and_passes_on_what_the_front_says(tmp_path: Path) -> None:
    here = Here(tmp_path, SERVICES)
    caddyfile = (ROOT / SERVICES["proxy"]["configs"][0]["target"].replace("/etc/caddy", "deploy")).read_text()
    short = re.sub(r"read_(header|body) \d+s", r"read_\1 1s", caddyfile)  # so that the test does not take long
    assert short.count(" 1s\n") == 2
    (tmp_path / "Caddyfile").write_text(short.replace("http_port 8000", f"http_port {here.proxy}"))
    with server(tmp_path / "data", here.front), here.started("proxy", check=False), client_of(here.proxy) as client:
        wait_until(lambda: is_reached(client))
        with pytest.raises(ResponseError, match="API key"):  # requests through a proxy need a key
            client.call("GET", "/v1/surveys")
        for name, sent in SLOW.items():
            with socket.create_connection(("127.0.0.1", here.proxy), timeout=HANG) as connection:
                connection.sendall(sent)
                assert not connection.recv(2**16).startswith(b"HTTP/1.1 2"), name  # an error, or the end


def is_reached(client: Client) -> bool:
    """Return whether the proxy listens and reaches the front end."""
    try:
        return bool(client.call("GET", "/v1/health").json())
    except (ServiceError, httpx.TransportError):
        return False
