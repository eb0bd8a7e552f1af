"""Use an installed service: open the page, submit a survey, read its store; and `rattle run`.

Packages of other projects with the same names as ours in the checkout are installed beside it.

Runs in the tested environment, in an empty directory, with the path of the checkout, which must not be imported.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import xarray as xr
from bokeh.protocol import Protocol
from websockets.sync.client import connect

import rattle
import service as foreign_service  # noqa: TID251
import workers as foreign_workers  # noqa: TID251
from gear_rattle import run_survey, service, workers

RATTLE = str(Path(sys.executable).with_name("rattle"))
HANG = 600.0  # seconds: nothing takes as long unless it hangs
LOG = Path("service.log")
SURVEY: dict[str, Any] = {
    "delta": {"start": 0.5, "stop": 0.7, "num": 3},
    "epsilon": {"start": 0.05, "stop": 0.15, "num": 3},
    "initial_conditions": {"count": 4},
}


def wait_until(condition: Callable[[], Any]) -> Any:
    """Poll until the condition is true; its value."""
    deadline = time.monotonic() + HANG
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{condition} has not become true in {HANG:g} s"
        time.sleep(0.1)
    return value


@contextmanager
def served() -> Iterator[str]:
    """The URL of a service with an empty data directory; what it logs is told if something goes wrong."""
    with LOG.open("w") as log:
        command = [RATTLE, "serve", "--port", "0", "--data", "data", "--workers", "1"]
        # Kernels of points, which nobody asks for here, would take 20 s to compile.
        process = subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | {"RATTLE_PRELOAD": "false"})
    try:

        def address() -> str | None:
            assert process.poll() is None, "the service ended"
            found = re.search(r"http://127\.0\.0\.1:\d+", LOG.read_text())
            return found and found.group()

        yield wait_until(address)
        process.terminate()
        process.wait(HANG)
    except BaseException:
        process.kill()
        print(LOG.read_text())
        raise


def is_installed(checkout: Path) -> None:
    """The packages are those of this environment."""
    for package in (rattle, workers, service):
        where = Path(str(package.__file__)).resolve()
        assert where.is_relative_to(Path(sys.prefix).resolve()), where
        assert not where.is_relative_to(checkout), where
    assert foreign_service.WHOSE == foreign_workers.WHOSE == "somebody else"


def is_the_version_of(checkout: Path) -> None:
    """A survey of the checkout is resumed by the wheel, and the other way round."""
    asked = """
import sys
sys.path.insert(0, sys.argv[1])
from gear_rattle.workers.survey.version import code_version
print(code_version())
"""
    said = subprocess.run([sys.executable, "-c", asked, str(checkout)], check=True, capture_output=True, text=True)
    assert said.stdout.strip() == workers.survey.version.code_version()


def survey_is_right(client: httpx.Client) -> None:
    """A survey is computed, and plain xarray reads it over HTTP."""
    answer = client.post("/v1/surveys", json=SURVEY)
    assert answer.status_code == 202, answer.text
    here = answer.json()["links"]["self"]

    def ended() -> Any:
        job = client.get(here).json()
        return job["state"] not in ("accepted", "running") and job

    job = wait_until(ended)
    assert job["state"] == "successful", job
    is_right(xr.open_zarr(f"{str(client.base_url).rstrip('/')}{here}/store"))


def is_right(survey: xr.Dataset) -> None:
    """Known values: of Figure 7 of the paper, and of every cell."""
    here = survey.sel(delta=0.6, epsilon=0.1, method="nearest").load()
    assert abs(here.delta - 0.6) < 1e-12
    assert abs(here.epsilon - 0.1) < 1e-12
    meanings = dict(zip(here.region.attrs["flag_values"], here.region.attrs["flag_meanings"].split(), strict=True))
    assert meanings[int(here.region)] == "IV", here.region
    shares = survey.quiet_fraction + survey.periodic_fraction + survey.chaotic_fraction
    assert ((shares > 0) & (shares <= 1)).all(), shares


def page_is_right(client: httpx.Client) -> None:
    """The page comes with all that it asks for, and its websocket brings the document."""
    url = str(client.base_url).rstrip("/")
    page = client.get("/")
    assert page.status_code == 200, page.text
    assets = set(re.findall(r'(?:src|href)="((?:static|components)/[^"]+)"', page.text))
    assert any("bokeh" in each for each in assets), page.text
    assert any("panel" in each for each in assets), page.text
    for each in assets:
        assert client.get(f"/{each}").status_code == 200, each
    (token,) = set(re.findall(r'"token":\s*"([^"]+)"', client.get("/page").text))
    for path in ("/docs", "/redoc", "/docs/static/swagger-ui-bundle.js", "/docs/static/redoc.standalone.js", "/help/"):
        assert client.get(path).status_code == 200, path
    named = client.get("/page", params={"bokeh-session-id": "of-another-page"})
    assert token not in named.text
    assert '"token"' in named.text  # a page of its own all the same
    where = url.replace("http", "ws", 1) + "/ws"
    with connect(where, origin=url, subprotocols=["bokeh", token], max_size=None, open_timeout=HANG) as socket:
        assert "ACK" in received(socket)[0]
        asked = Protocol().create("PULL-DOC-REQ")
        for part in (asked.header_json, asked.metadata_json, asked.content_json):
            socket.send(part)
        header, content = received(socket)
        while "PULL-DOC-REPLY" not in header:  # changes may come before
            header, content = received(socket)
        assert json.loads(content)["doc"]["roots"]


def received(socket: Any) -> tuple[str, str]:
    """Header and content of a message."""
    header, _metadata, content = (str(socket.recv(HANG)) for _ in range(3))
    for _ in range(2 * json.loads(header).get("num_buffers", 0)):
        socket.recv(HANG)
    return header, content


def command_is_right() -> None:
    """`rattle run` needs neither a service nor, for so few cells, a worker."""
    axes = ["--delta", "0.6:0.7:2", "--epsilon", "0.05:0.1:2"]
    subprocess.run([RATTLE, "run", *axes, "--count", "4", "--out", "own.zarr"], check=True)
    is_right(xr.open_zarr("own.zarr"))


def notebook_is_right() -> None:
    """Compute a survey as a notebook does, where an event loop runs already, and read results as tables."""

    async def cell() -> xr.Dataset:
        return run_survey(
            delta=(0.6, 0.7, 2), epsilon=(0.05, 0.1, 2), initial_conditions={"count": 4}, out="notebook.zarr"
        )

    is_right(asyncio.run(cell()))
    gear = rattle.Gear(0.6, 0.1)
    for shown in (gear, gear.attractors(16)[0], gear.orbits()[0]):
        assert "<table" in shown._repr_html_(), shown


def workers_are_loaded() -> None:
    """Workers find the modules, and a script needs no guard."""
    script = "from gear_rattle import run_survey; run_survey(delta=(0.6, 0.7, 2), epsilon=(0.05, 0.1, 2), cluster=1)"
    subprocess.run([sys.executable, "-"], input=script, text=True, check=True)


def main() -> None:
    is_installed(Path(sys.argv[1]))
    is_the_version_of(Path(sys.argv[1]))
    command_is_right()
    notebook_is_right()
    workers_are_loaded()
    with served() as url, httpx.Client(base_url=url, timeout=HANG) as client:
        survey_is_right(client)
        page_is_right(client)
    used = [resource.getrusage(which) for which in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    print(f"{sum(each.ru_utime + each.ru_stime for each in used):.0f} s of processor time")


if __name__ == "__main__":
    main()
