"""A survey through a real server and a real two-process cluster, and what interrupts it."""

import os
import signal
import sqlite3
import subprocess
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from postgres import Postgres
from service_processes import (
    OPTIONS,
    REQUEST,
    assert_bit_identical,
    finish,
    free_port,
    server,
    start,
    wait_until,
)

from service.client import Client
from service.errors import ResponseError, ServiceError


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def client(data: Path) -> Iterator[Client]:
    port = free_port()
    with server(data, port), Client(f"http://127.0.0.1:{port}") as client:
        yield client


def test_a_survey_by_rest_equals_a_serial_run_bit_for_bit(
    client: Client, data: Path, expected: dict[str, np.ndarray]
) -> None:
    job = client.submit(REQUEST)
    path = job.document["links"]["events"]
    # The client goes away twice and comes back with the last id that it saw.
    seen = list(islice(client.events(path, after=0), 3))
    seen += islice(client.events(path, after=seen[-1][0]), 5)
    seen += client.events(path, after=seen[-1][0])
    assert [number for number, _ in seen] == list(range(1, len(seen) + 1))
    assert sorted(event["tile"] for _, event in seen if "tile" in event) == list(range(36))
    assert seen[-1][1]["state"] == "successful"
    assert job.refresh().document["progress"] == 100

    over_http = xr.open_zarr(f"{client.url}/v1/surveys/{job.id}/store")
    from_disk = xr.open_zarr(data / "surveys" / f"{job.id}.zarr").load()
    assert_bit_identical(from_disk, expected)
    assert over_http.load().identical(from_disk)
    assert_bit_identical(over_http, expected)
    assert job.open().identical(from_disk)
    for name, variable in over_http.variables.items():
        assert {"long_name", "units"} <= set(variable.attrs), name


def test_a_picture_is_there_while_a_survey_runs(client: Client) -> None:
    job = client.submit(REQUEST.model_copy(update={"seed": 8}))
    first_tile = next(event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
    assert first_tile["progress"] < 100
    for variable in ("region", "quiet_fraction", "lyapunov_max"):
        answer = client.call("GET", job.document["links"]["map"], params={"variable": variable})
        assert answer.headers["content-type"] == "image/png"
        assert answer.content.startswith(b"\x89PNG")
    with pytest.raises(ResponseError, match="weather") as refused:
        client.call("GET", job.document["links"]["map"], params={"variable": "weather"})
    assert refused.value.status == 422
    job.wait()


def test_a_dismissed_survey_stops_and_the_next_one_runs(client: Client) -> None:
    job = client.submit(REQUEST.model_copy(update={"seed": 9}))
    stream = client.events(job.document["links"]["events"], after=0)
    next(event for _, event in stream if "tile" in event)
    job.delete()
    assert list(stream)[-1][1]["state"] == "dismissed"
    with pytest.raises(ServiceError, match="dismissed"):
        job.wait()
    following = client.submit(REQUEST.model_copy(update={"seed": 10})).wait()
    assert following.document["tiles_done"] == 36
    assert job.refresh().document["tiles_done"] < 36
    job.delete()
    with pytest.raises(ResponseError) as gone:
        job.refresh()
    assert gone.value.status == 404


def test_a_survey_outlives_the_kill_of_its_server_and_a_row_that_lies(
    tmp_path: Path, expected: dict[str, np.ndarray]
) -> None:
    port = free_port()
    with Client(f"http://127.0.0.1:{port}") as client:
        with server(tmp_path, port) as process:
            job = client.submit(REQUEST)
            tiles = (event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
            done = list(islice(tiles, 5))[-1]["tiles_done"]
            process.kill()
            process.wait()
        with server(tmp_path, port):
            assert [found.id for found in client.surveys()] == [job.id]
            job.wait()
            assert job.document["tiles_done"] == 36 > done
            assert_bit_identical(job.open(), expected)
        # As if the server had been killed between the last tile, or the end of the store, and its commit.
        with sqlite3.connect(tmp_path / "jobs.sqlite") as database:
            database.execute("UPDATE jobs SET state = 'running', tiles_done = 35, cells_done = 140")
            database.execute('DELETE FROM tiles WHERE "index" = 11')
        with server(tmp_path, port):
            assert job.wait().document["tiles_done"] == 36
            assert_bit_identical(job.open(), expected)


def test_a_survey_outlives_a_crash_of_its_database_server(
    tmp_path: Path, postgres: Postgres, postgres_url: str, expected: dict[str, np.ndarray]
) -> None:
    port = free_port()
    settings = {"RATTLE_DATABASE_URL": postgres_url}
    with server(tmp_path, port, settings=settings), Client(f"http://127.0.0.1:{port}") as client:
        job = client.submit(REQUEST)
        tiles = (event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
        list(islice(tiles, 5))
        postgres.stop(signal.SIGQUIT)  # what pg_ctl stop -m immediate sends
        try:
            for method, path in (
                ("GET", "/v1/surveys"),
                ("GET", f"/v1/surveys/{job.id}"),
                ("DELETE", f"/v1/surveys/{job.id}"),
            ):
                with pytest.raises(ResponseError, match="database cannot answer") as refused:
                    client.call(method, path)
                assert refused.value.status == 503
                assert refused.value.problem["title"] == "Service Unavailable"
        finally:
            postgres.start()
        with Client(client.url) as again:
            found = wait_until(lambda: next(iter(again.surveys()), None))
            assert found.wait().document["tiles_done"] == 36
            assert_bit_identical(found.open(), expected)
            every = [number for number, _ in again.events(job.document["links"]["events"], 0)]
            assert every == list(range(1, len(every) + 1))


def test_an_interrupted_run_is_resumed_by_the_same_command(tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    out = tmp_path / "survey.zarr"
    command = ["run", *OPTIONS, "--out", str(out)]
    done = 0
    for number in (signal.SIGINT, signal.SIGTERM):
        errors = interrupt(start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE), number, out, done)
        assert "the same command resumes it" in errors
        assert "Traceback" not in errors
        status = xr.open_zarr(out)["status"].values
        assert done < np.count_nonzero(status) < status.size
        done = np.count_nonzero(status)

    ended = finish(*command)
    assert ended.returncode == 0, ended.stderr
    assert f"{144 - done} cells in" in ended.stdout
    assert "144 cells, 0 failed" in ended.stdout
    assert "undecided" in ended.stdout
    assert "\x1b" not in ended.stdout + ended.stderr
    assert_bit_identical(xr.open_zarr(out), expected)

    before = chunks(out)
    again = finish(*command)
    assert again.returncode == 0, again.stderr
    assert "is complete" in again.stdout
    other = finish(*command, "--beta", "0.7")
    assert other.returncode == 2
    assert "another survey" in other.stderr
    assert "Traceback" not in other.stderr
    assert chunks(out) == before


def interrupt(process: subprocess.Popen[str], number: signal.Signals, out: Path, done: int) -> str:
    """Send a signal once more cells are done than before; what the process wrote to stderr until its end."""
    wait_until(lambda: process.poll() is not None or len(list(out.glob("status/c/*/*"))) * 4 > done)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does: the processes of the cluster get it too
    else:
        process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    return errors


def chunks(store: Path) -> list[tuple[Path, int]]:
    """Every file of a store with its time of change."""
    return sorted((path, path.stat().st_mtime_ns) for path in store.rglob("*") if path.is_file())
