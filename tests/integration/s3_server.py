"""A real S3 server in a process of its own, with a switch that makes it fail (moto's server; see Makefile)."""

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

#: After POST /-/fail?N the next N requests, and no other, are answered with 503; after POST /-/trouble?N every Nth, and
#: every other waits a while. Answers how many have been so since it was asked last.
SCRIPT = """
import itertools
import sys
import time
from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

failing = [0]
every, refused, counted = [0], [0], itertools.count(1)
dispatcher = DomainDispatcherApplication(create_backend_app)

def application(environ, start_response):
    if environ["PATH_INFO"] == "/-/fail":
        failing[0] = int(environ["QUERY_STRING"])
        start_response("204 No Content", [])
        return []
    if environ["PATH_INFO"] == "/-/trouble":
        every[0], before, refused[0] = int(environ["QUERY_STRING"]), refused[0], 0
        start_response("200 OK", [])
        return [str(before).encode()]
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

server = make_server("127.0.0.1", 0, application, threaded=True)
print(server.server_port, flush=True)
server.serve_forever()
"""


class S3:
    """A running server with one bucket."""

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
        """Let the server answer slowly, and every so many requests with 503; 0 ends it. Returns how many were so."""
        return int(httpx.post(f"{self.url}/-/trouble?{every}", timeout=HANG).raise_for_status().text)

    def fail(self, requests: int) -> None:
        """Let the server answer the next requests with 503."""
        httpx.post(f"{self.url}/-/fail?{requests}", timeout=HANG).raise_for_status()


@contextmanager
def s3_server() -> Iterator[S3]:
    """Start the server, with an empty bucket."""
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
