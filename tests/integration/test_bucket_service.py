"""Surveys in a bucket, computed by `rattle run` and by the service: killed in the middle, and read over HTTP."""

import os
import re
import signal
from pathlib import Path

import httpx
import numpy as np
import pytest
from depth import deep
from faults import Faults
from s3_server import BUCKET, S3
from service_processes import (
    FIELDS,
    OPTIONS,
    ROOT,
    assert_bit_identical,
    client_of,
    finish,
    free_port,
    get,
    server,
    start,
)
from typer.testing import CliRunner
from waiting import HANG, wait_until

from gear_rattle.service.cli import app
from gear_rattle.workers import StoreInBucket, SurveyRequest, open_survey

ONE = ("--workers", "1")
SOME = ("region", "attractors")
REQUEST = SurveyRequest(**FIELDS, quantities=SOME)
RUN = ("run", *OPTIONS, *ONE, *(word for name in SOME for word in ("--quantity", name)))
MIDDLE = 3  # tiles that are done while the others are held


@pytest.fixture
def s3(storage: S3, monkeypatch: pytest.MonkeyPatch) -> S3:
    for name, value in storage.settings.items():
        monkeypatch.setenv(name, value)
    return storage


def tiles_in(place: StoreInBucket) -> int:
    return sum(1 for _ in place.keys("status/c"))


@deep
def test_run_killed_and_resumed(s3: S3, expected: dict[str, np.ndarray], tmp_path: Path) -> None:
    faults, url = Faults(tmp_path), f"s3://{BUCKET}/some/where/survey.zarr"
    place, settings = StoreInBucket(url), faults.environment | s3.settings
    faults.hold(MIDDLE)
    process = start(*RUN, "--out", url, settings=settings)
    wait_until(lambda: tiles_in(place) == MIDDLE)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert tiles_in(place) == MIDDLE
    assert place.has(".lock")  # the lock of a process that is known to be dead
    faults.release()
    ended = finish(*RUN, "--out", url, settings=settings)
    assert ended.returncode == 0, ended.stderr
    assert not place.has(".lock")
    with open_survey(url) as dataset:
        assert_bit_identical(dataset, expected)
    assert CliRunner().invoke(app, ["verify", url]).exit_code == 0


def test_a_server_that_fails_in_five_of_a_hundred_requests_and_restarts(
    s3: S3, expected: dict[str, np.ndarray], tmp_path: Path
) -> None:
    """The service sends only the kinds of requests that the documentation names."""
    faults, url, target = Faults(tmp_path), f"s3://{BUCKET}/restarts/survey.zarr", f"s3://{BUCKET}/restarts/copy.zarr"
    place, settings = StoreInBucket(url), faults.environment | s3.settings
    faults.hold(MIDDLE)
    process = start(*RUN, "--out", url, settings=settings)
    try:
        wait_until(lambda: tiles_in(place) == MIDDLE)
        s3.trouble(20)
        s3.restart(2.0)
        faults.release()
        assert process.wait(timeout=HANG) == 0
        assert finish("copy", url, target, settings=settings).returncode == 0
        s3.restart(1.0)
        assert finish("verify", target, settings=settings).returncode == 0
    finally:
        faults.release()
        refused = s3.trouble(0)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert refused > 10
    for each in (url, target):
        with open_survey(each) as dataset:
            assert_bit_identical(dataset, expected)
    StoreInBucket(target).delete()
    text = (ROOT / "docs" / "operations.md").read_text()
    named = set(re.findall(r"`([^`]+)`", text.partition("A provider must offer")[2].partition("\n\n")[0]))
    assert s3.used() <= named, s3.used() - named


@deep
def test_a_server_that_is_slow_and_fails_in_five_of_a_hundred_requests(s3: S3, expected: dict[str, np.ndarray]) -> None:
    url = f"s3://{BUCKET}/trouble/survey.zarr"
    s3.trouble(20)
    try:
        ended = finish("run", *OPTIONS, "--quantity", "region", "--out", url, settings=s3.settings)
        assert ended.returncode == 0, ended.stderr
        assert finish("verify", url, settings=s3.settings).returncode == 0
    finally:
        refused = s3.trouble(0)
    assert refused > 10
    with open_survey(url) as dataset:
        np.testing.assert_array_equal(dataset["region"], expected["region"])


@deep
def test_service_killed_and_resumed(s3: S3, expected: dict[str, np.ndarray], tmp_path: Path) -> None:
    faults, port, url, data = Faults(tmp_path), free_port(), f"s3://{BUCKET}/stores", tmp_path / "data"
    options = {"settings": faults.environment | s3.settings}
    faults.hold(MIDDLE)
    with server(data, port, *ONE, "--store", url, **options) as process, client_of(port) as client:
        job = client.submit(REQUEST)
        place = StoreInBucket(f"{url}/{job.id}.zarr")
        wait_until(lambda: tiles_in(place) == MIDDLE)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    faults.release()
    with server(data, port, *ONE, "--store", url, **options), client_of(port) as client:
        job = client.job(job.id)
        with job.wait().open() as dataset:
            assert_bit_identical(dataset, expected)
        base = f"http://127.0.0.1:{port}/v1/surveys/{job.id}"
        assert_reads_like_files(f"{base}/store", place)
        assert get(f"{base}/map.png").content.startswith(b"\x89PNG")
        assert not list((data / "surveys").iterdir())
        assert httpx.delete(base, timeout=HANG).status_code == 204
        assert list(place.keys()) == []
        assert get(f"{base}/store/zarr.json").status_code == 404


def test_a_bucket_that_is_not_there_is_said_at_the_start(s3: S3, tmp_path: Path) -> None:
    ended = finish("serve", "--port", "0", "--data", str(tmp_path), "--store", "s3://nobody/x", settings=s3.settings)
    assert ended.returncode == 2
    assert ended.stderr.startswith("rattle: s3://nobody/x: there is no such bucket")


def assert_reads_like_files(store: str, place: StoreInBucket) -> None:
    whole = place.read("region/c/0/0")
    answer = get(f"{store}/region/c/0/0")
    assert answer.content == whole
    head = httpx.head(f"{store}/region/c/0/0", timeout=HANG)
    assert (head.content, head.headers["content-length"]) == (b"", str(len(whole)))
    known = get(f"{store}/region/c/0/0", headers={"If-None-Match": answer.headers["etag"]})
    assert (known.status_code, known.content) == (304, b"")
    for asked, part in {"0-3": whole[:4], "5-": whole[5:], "-4": whole[-4:], "2-9999": whole[2:]}.items():
        ranged = get(f"{store}/region/c/0/0", headers={"Range": f"bytes={asked}"})
        assert (ranged.status_code, ranged.content) == (206, part), asked
    beyond = get(f"{store}/region/c/0/0", headers={"Range": f"bytes={len(whole)}-"})
    assert (beyond.status_code, beyond.headers["content-range"]) == (416, f"bytes */{len(whole)}")
    assert get(f"{store}/zarr.json").headers["content-type"] == "application/json"
    for nothing in ("region/c/9/9", ".lock", "../x", "region"):
        assert get(f"{store}/{nothing}").status_code == 404, nothing
