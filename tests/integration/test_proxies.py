"""nginx and Caddy in front of a service, with the configurations of docs/operations.md."""

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from faults import Faults
from proxies import BEGIN, PATH, PROGRAMS, Proxied, nginx
from service_processes import (
    ENVIRONMENT,
    FIELDS,
    REQUEST,
    assert_bit_identical,
    finish,
    free_port,
    serial_run,
    server,
)
from waiting import HANG, wait_until

from gear_rattle.service.client import Client
from gear_rattle.workers import open_survey

BEHIND = {"RATTLE_BEHIND_PROXY": "true", "RATTLE_REQUIRE_KEYS": "true", "RATTLE_EXPLORER": "true"}
LARGE = 100_000_000  # bytes
PLACES = ("root", "below")
PARTS = ("/v1/health", "/v1/surveys", "/docs", "/redoc", "/openapi.json", "/help/", "/")


class Front:
    """A service that can be stopped and started again at the same port, and an API key for it."""

    def __init__(self, directory: Path) -> None:
        self.faults = Faults(directory)
        self.data, self.port = directory / "data", free_port()
        made = finish("key", "add", "me", "--scope", "submit", "--data", str(self.data))
        assert made.returncode == 0, made.stderr
        self.key = made.stdout.strip()
        self.log = directory / "front.log"
        self._stack = ExitStack()

    def start(self, *arguments: str) -> None:
        log = self._stack.enter_context(self.log.open("a"))
        settings = self.faults.environment | BEHIND
        self._stack.enter_context(server(self.data, self.port, *arguments, settings=settings, stdout=log, stderr=log))

    def stop(self) -> None:
        self._stack.pop_all().close()


@pytest.fixture(scope="module")
def front(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Front]:
    found = Front(tmp_path_factory.mktemp("front"))
    found.start()
    try:
        yield found
    finally:
        found.stop()


@pytest.fixture(scope="module", params=BEGIN)
def proxied(
    request: pytest.FixtureRequest, front: Front, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Proxied]:
    if PROGRAMS[request.param] is None:
        pytest.skip(f"{request.param} is not installed (apt-get install {request.param})")
    with BEGIN[request.param](front.port, tmp_path_factory.mktemp(request.param)) as found:
        yield found


def client_of(proxied: Proxied, place: str, key: str) -> Client:
    url = getattr(proxied, place)
    return Client(url, http=httpx.Client(base_url=url, timeout=HANG, verify=proxied.trust), key=key)


@pytest.fixture(scope="module")
def survey_id(front: Front) -> str:
    """Return the id of a survey that has been computed."""
    url = f"http://127.0.0.1:{front.port}"
    with Client(url, http=httpx.Client(base_url=url, timeout=HANG), key=front.key) as client:
        return client.submit(REQUEST).wait().id


def links_of(text: str) -> list[str]:
    """Return the addresses in a page that a browser would request from the service."""
    found = re.findall(r"""(?:href|src|action)=["']([^"'#]+)""", text)
    return [each for each in found if not each.startswith(("data:", "http:", "https:"))]


@pytest.mark.parametrize("place", PLACES)
def test_every_page_and_every_link_is_below_the_path(proxied: Proxied, front: Front, place: str) -> None:
    url = getattr(proxied, place)
    headers = {"Authorization": f"Bearer {front.key}"}
    with httpx.Client(verify=proxied.trust, timeout=HANG, headers=headers) as http:
        for part in PARTS:
            answer = http.get(url + part)
            assert answer.is_success, (part, answer.text)
            if "html" in answer.headers["content-type"]:
                links = links_of(answer.text)
                assert links or part == "/", part
                for link in dict.fromkeys(links):
                    there = answer.url.join(link)
                    assert str(there).startswith(f"{url}/"), (part, link)
                    if "/help/" not in str(there):  # other tests check the links of the help
                        assert http.get(there).is_success, (part, link)
        api = http.get(f"{url}/openapi.json").json()
        assert [each["url"] for each in api.get("servers", [])] == ([PATH] if place == "below" else [])
        assert f"{PATH if place == 'below' else ''}/openapi.json" in http.get(f"{url}/docs").text
        found = http.get(f"{url}/help", follow_redirects=False)
        assert answer.url.join(found.headers["location"]).path == httpx.URL(f"{url}/help/").path
        lost = http.get(f"{url}/v1/nothing")
        assert lost.status_code == 404
        assert lost.json()["instance"] == httpx.URL(f"{url}/v1/nothing").path


@pytest.mark.parametrize("place", PLACES)
def test_signing_in_stays_below_the_path(proxied: Proxied, front: Front, place: str) -> None:
    url = getattr(proxied, place)
    path = httpx.URL(url).path.rstrip("/")
    with httpx.Client(verify=proxied.trust, timeout=HANG) as http:
        first = http.get(f"{url}/?delta=0.5")
        assert first.status_code == 303
        form = http.get(first.url.join(first.headers["location"]))
        assert str(form.url).startswith(f"{url}/login?next=")
        (action,) = re.findall(r'action="([^"]+)"', form.text)
        entered = http.post(form.url.join(action), data={"key": front.key})
        assert entered.headers["location"] == f"{path}/?delta=0.5"
        cookie = entered.headers["set-cookie"]
        assert f"Path={path}/;" in f"{cookie};"
        assert "Secure" in cookie
        assert http.get(entered.url.join(entered.headers["location"])).is_success
        assert http.post(f"{url}/logout").headers["location"] == f"{path}/login"
        assert http.get(f"{url}/v1/surveys").status_code == 401


@pytest.mark.parametrize("place", PLACES)
def test_the_client_follows_links_and_location(proxied: Proxied, front: Front, place: str) -> None:
    path = httpx.URL(getattr(proxied, place)).path.rstrip("/")
    with client_of(proxied, place, front.key) as client:
        answer = client.call("POST", "/v1/surveys", json=FIELDS, params={"force": "true"})
        there = answer.headers["location"]
        assert there.startswith(f"{path}/v1/surveys/")
        assert set(answer.json()["links"].values()) - {None} == {
            there,
            *(f"{there}/{part}" for part in ("events", "store", "map.png")),
        }
        job = client.job(there.rpartition("/")[2])
        seen: list[dict[str, Any]] = []
        job.wait(progress=seen.append)
        assert seen
        assert job.verify().wait().state == "successful"
        assert client.call("GET", f"/v1/surveys/{job.id}/download.nc").content.startswith(b"\x89HDF")
        job.delete()


PLAIN_XARRAY = """
import json, sys
import xarray as xr
url, key = sys.argv[1:]
with xr.open_zarr(url, storage_options={"headers": {"Authorization": "Bearer " + key}}) as survey:
    json.dump(survey.region.values.tolist(), sys.stdout)
"""


@pytest.mark.parametrize("place", PLACES)
def test_command_line_and_plain_xarray(
    proxied: Proxied, front: Front, survey_id: str, place: str, tmp_path: Path
) -> None:
    url = getattr(proxied, place)
    settings = {"SSL_CERT_FILE": str(proxied.certificate), "RATTLE_URL": url, "RATTLE_API_KEY": front.key}
    listed = finish("list", settings=settings)
    assert survey_id in listed.stdout, listed.stderr
    watched = finish("watch", survey_id, settings=settings)
    store = f"{url}/v1/surveys/{survey_id}/store"
    assert store in watched.stdout, watched.stderr
    drawn = finish("figure", store, str(tmp_path / "map.png"), settings=settings)
    assert drawn.returncode == 0, drawn.stderr
    read = subprocess.run(
        [sys.executable, "-c", PLAIN_XARRAY, store, front.key],
        env=ENVIRONMENT | settings,
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert read.returncode == 0, read.stderr
    assert np.array_equal(json.loads(read.stdout), serial_run(REQUEST)["region"])


@pytest.mark.parametrize("place", PLACES)
def test_events_arrive_one_by_one(proxied: Proxied, front: Front, place: str) -> None:
    """The last tiles are held: if the proxy buffered events until the stream ends, none would ever arrive."""
    front.faults.hold(4)
    try:
        with client_of(proxied, place, front.key) as client:
            job = client.submit(REQUEST, force=True)
            done = 0
            for _, data in client.events(job.document["links"]["events"].removeprefix(httpx.URL(client.url).path), 0):
                done = max(done, data["cells_done"])
                if done == 4 * 4:
                    break
            assert job.refresh().state == "running"
            job.delete()
            front.faults.release()
            wait_until(lambda: job.refresh().state == "dismissed")
            job.delete()
    finally:
        front.faults.release()


@pytest.mark.parametrize("place", PLACES)
def test_a_download_of_100_mb(proxied: Proxied, front: Front, survey_id: str, place: str) -> None:
    large = front.data / "surveys" / f"{survey_id}.zarr" / "region" / "c" / "9" / "9"
    large.parent.mkdir(parents=True, exist_ok=True)
    if not large.exists():
        large.write_bytes(os.urandom(LARGE))
    whole = hashlib.sha256(large.read_bytes()).hexdigest()
    with client_of(proxied, place, front.key) as client:
        answer = client.call("GET", f"/v1/surveys/{survey_id}/store/region/c/9/9")
        assert int(answer.headers["content-length"]) == LARGE
        assert hashlib.sha256(answer.content).hexdigest() == whole
        first, last = LARGE // 2, LARGE // 2 + 999
        part = client.call("GET", str(answer.url), headers={"Range": f"bytes={first}-{last}"})
        assert part.status_code == 206
        assert part.content == answer.content[first : last + 1]


@pytest.mark.parametrize("place", PLACES)
def test_a_client_waits_through_a_restart_behind_the_proxy(proxied: Proxied, front: Front, place: str) -> None:
    front.faults.hold(4)
    try:
        with client_of(proxied, place, front.key) as client:
            job = client.submit(REQUEST, force=True)
            wait_until(lambda: job.refresh().document["tiles_done"] == 4)
            front.stop()
            away = httpx.get(f"{client.url}/v1/health", verify=proxied.trust, timeout=HANG)
            assert away.status_code == 502
            front.faults.release()
            front.start()
            job.wait()
            with open_survey(front.data / "surveys" / f"{job.id}.zarr") as dataset:
                assert_bit_identical(dataset, serial_run(REQUEST))
            job.delete()
    finally:
        front.faults.release()


@pytest.mark.parametrize("place", PLACES)
def test_a_service_with_a_root_path_needs_no_header(tmp_path: Path, place: str) -> None:
    """It works whether or not the proxy removes the path from requests."""
    if PROGRAMS["nginx"] is None:
        pytest.skip("nginx is not installed (apt-get install nginx)")
    removing = {r"proxy_pass http://127\.0\.0\.1:(\d+);(?=\s+\}\s+\}\s+\}\s*\Z)": r"proxy_pass http://127.0.0.1:\1/;"}
    port = free_port()
    changes = {r"^.*X-Forwarded-Prefix.*\n": ""} | (removing if place == "below" else {})
    settings = {"RATTLE_BEHIND_PROXY": "true", "RATTLE_INSECURE": "true"}
    with (
        server(tmp_path / "data", port, "--root-path", PATH, settings=settings),
        nginx(port, tmp_path, changes) as proxied,
        httpx.Client(verify=proxied.trust, timeout=HANG) as http,
    ):
        assert http.get(f"{proxied.below}/openapi.json").json()["servers"] == [{"url": PATH}]
        sent = http.post(f"{proxied.below}/v1/surveys", json=FIELDS)
        there = sent.headers["location"]
        assert there.startswith(f"{PATH}/v1/surveys/")
        assert http.get(sent.url.join(there)).json()["links"]["self"] == there
