"""An S3 server in a process of its own (moto; see the Makefile) that can be told to fail."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
from waiting import HANG, wait_until

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-s3" / "bin" / "python"
BUCKET = "surveys"

#: After POST /-/fail?N, the next N requests are answered with 503. After POST /-/trouble?N, every Nth request is
#: answered with 503 and the others are delayed; the answer is the number of 503 since the last POST /-/trouble. After
#: POST /-/restart?S, the server does not listen for S seconds, and then goes on with the same objects. GET /-/used
#: lists the kinds of requests so far.
SCRIPT = """
import itertools
import json
import sys
import threading
import time
from urllib.parse import parse_qsl
from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

failing = [0]
every, refused, counted = [0], [0], itertools.count(1)
dispatcher = DomainDispatcherApplication(create_backend_app)
away, servers, used = [0.0], [], set()
PARTS = ("delete", "list-type", "uploads", "uploadId", "partNumber")

def kind_of(environ):
    query = dict(parse_qsl(environ["QUERY_STRING"], keep_blank_values=True))
    conditions = {"HTTP_RANGE": "Range", "HTTP_IF_NONE_MATCH": "If-None-Match", "HTTP_IF_MATCH": "If-Match"}
    said = [word for name, word in conditions.items() if name in environ]
    return " ".join([environ["REQUEST_METHOD"], *said, *("?" + name for name in PARTS if name in query)])

def application(environ, start_response):
    if environ["PATH_INFO"] == "/-/fail":
        failing[0] = int(environ["QUERY_STRING"])
        start_response("204 No Content", [])
        return []
    if environ["PATH_INFO"] == "/-/used":
        start_response("200 OK", [])
        return [json.dumps(sorted(used)).encode()]
    if environ["PATH_INFO"] == "/-/restart":
        away[0] = float(environ["QUERY_STRING"])
        threading.Thread(target=servers[-1].shutdown).start()
        start_response("204 No Content", [])
        return []
    if environ["PATH_INFO"] == "/-/trouble":
        every[0], before, refused[0] = int(environ["QUERY_STRING"]), refused[0], 0
        start_response("200 OK", [])
        return [str(before).encode()]
    used.add(kind_of(environ))
    if every[0]:
        if next(counted) % every[0] == 0:
            refused[0] += 1
            start_response("503 Service Unavailable", [("Content-Length", "0")])
            return []
        time.sleep(0.02)
    if failing[0] > 0:
        failing[0] -= 1
        start_response("503 Service Unavailable", [("Content-Length", "0")])
        return []
    return dispatcher(environ, start_response)

port = 0
while True:
    servers.append(make_server("127.0.0.1", port, application, threaded=True))
    if not port:
        port = servers[-1].server_port
        print(port, flush=True)
    servers[-1].serve_forever()
    servers[-1].server_close()
    time.sleep(away[0])
"""


class S3:
    """A running S3 server with one bucket."""

    def __init__(self, port: int) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self.settings = {
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
            "AWS_ENDPOINT": self.url,
            "AWS_ALLOW_HTTP": "true",
        }

    def trouble(self, every: int) -> int:
        """Answer slowly, and every Nth request with 503; 0 ends this. Return how many had 503 since the last call."""
        return int(httpx.post(f"{self.url}/-/trouble?{every}", timeout=HANG).raise_for_status().text)

    def restart(self, seconds: float) -> None:
        """Let the server stop listening for some seconds."""
        httpx.post(f"{self.url}/-/restart?{seconds}", timeout=HANG).raise_for_status()

    def used(self) -> set[str]:
        """Return the kinds of requests so far: method, conditions and subresources."""
        return set(httpx.get(f"{self.url}/-/used", timeout=HANG).raise_for_status().json())

    def fail(self, requests: int) -> None:
        """Let the server answer the next `requests` requests with 503."""
        httpx.post(f"{self.url}/-/fail?{requests}", timeout=HANG).raise_for_status()


@contextmanager
def s3_server() -> Iterator[S3]:
    """Start an S3 server with an empty bucket."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("AWS_")}
    process = subprocess.Popen(
        [str(PYTHON), "-c", SCRIPT], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.strip(), "the S3 server does not start: make .venv-s3/.installed"
        s3 = S3(int(line))
        wait_until(lambda: httpx.put(f"{s3.url}/{BUCKET}", timeout=HANG).status_code == 200)
        yield s3
    finally:
        process.kill()
        process.communicate()


if __name__ == "__main__":
    with s3_server() as running:
        print(running.url)
        sys.stdin.read()
