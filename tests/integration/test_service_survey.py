"""Surveys through a server process and a cluster of two processes, interrupted in several ways."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import postgres as server_of_tests
import pytest
import xarray as xr
from depth import deep, either
from faults import Faults
from postgres import Postgres
from service_processes import (
    OPTIONS,
    REQUEST,
    assert_bit_identical,
    client_of,
    finish,
    free_port,
    server,
    start,
    workers_of,
    written_in,
)
from typer.testing import CliRunner
from waiting import HANG, wait_until

from gear_rattle.service.cli import app
from gear_rattle.service.client import Client
from gear_rattle.service.errors import ResponseError, ServiceError
from gear_rattle.workers import SurveyError, SurveyRequest, examine, open_survey, run_survey

MIDDLE = 3  # tiles that are done while the others are held
#: 16 cells in 8 tiles and two slices, some with contact phases. Its harmonics pass through the database to the workers.
INELASTIC = SurveyRequest(
    delta=(0.5, 0.8, 4),
    epsilon=(0.2, 0.3, 2),
    model="inelastic",
    restitution=(0.5, 0.7, 2),
    harmonics=((3, 0.12, 0.3),),
    initial_conditions={"count": 8},
    tile={"delta": 2, "epsilon": 1},
)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def faults(tmp_path_factory: pytest.TempPathFactory) -> Faults:
    return Faults(tmp_path_factory.mktemp("faults"))


@pytest.fixture(scope="module")
def settings(request: pytest.FixtureRequest, faults: Faults) -> dict[str, str]:
    """Return settings with the job database on PostgreSQL, if that is installed."""
    url = {} if server_of_tests.missing() else {"RATTLE_DATABASE_URL": request.getfixturevalue("postgres").create()}
    return faults.environment | url


@pytest.fixture(scope="module")
def client(data: Path, settings: dict[str, str]) -> Iterator[Client]:
    port = free_port()
    with server(data, port, "--workers", "2", settings=settings), client_of(port) as client:
        yield client


def test_a_survey_by_rest_equals_a_serial_run_bit_for_bit(
    client: Client, data: Path, expected: dict[str, np.ndarray]
) -> None:
    job = client.submit(REQUEST)
    path = job.document["links"]["events"]
    # The client disconnects twice, and reconnects with the id of the last event that it saw.
    seen = list(islice(client.events(path, after=0), 3))
    seen += islice(client.events(path, after=seen[-1][0]), 5)
    seen += client.events(path, after=seen[-1][0])
    assert [number for number, _ in seen] == list(range(1, len(seen) + 1))
    assert sorted(event["tile"] for _, event in seen if "tile" in event) == list(range(REQUEST.n_tiles))
    assert seen[-1][1]["state"] == "successful"
    assert job.refresh().document["progress"] == 100

    over_http = xr.open_zarr(f"{client.url}/v1/surveys/{job.id}/store").load()
    from_disk = xr.open_zarr(data / "surveys" / f"{job.id}.zarr").load()
    assert_bit_identical(from_disk, expected)
    assert over_http.identical(from_disk)
    assert job.open().load().identical(open_survey(data / "surveys" / f"{job.id}.zarr").load())
    for name, variable in over_http.variables.items():
        assert {"long_name", "units"} <= set(variable.attrs), name


@deep
def test_a_picture_is_there_while_a_survey_runs_and_the_next_one_runs_after_its_dismissal(
    client: Client, faults: Faults
) -> None:
    faults.hold(MIDDLE)
    job = client.submit(REQUEST.model_copy(update={"seed": 8}))
    stream = client.events(job.document["links"]["events"], after=0)
    first_tile = next(event for _, event in stream if "tile" in event)
    assert first_tile["progress"] < 100
    for variable in ("region", "quiet_fraction", "lyapunov_max"):
        answer = client.call("GET", job.document["links"]["map"], params={"variable": variable})
        assert answer.headers["content-type"] == "image/png"
        assert answer.content.startswith(b"\x89PNG")
    with pytest.raises(ResponseError, match="weather") as refused:
        client.call("GET", job.document["links"]["map"], params={"variable": "weather"})
    assert refused.value.status == 422

    assert job.refresh().state == "running"
    job.delete()
    assert list(stream)[-1][1]["state"] == "dismissed"  # although its tiles do not end by themselves
    with pytest.raises(ServiceError, match="dismissed"):
        job.wait()
    faults.release()
    following = client.submit(REQUEST.model_copy(update={"seed": 9})).wait()
    assert following.document["tiles_done"] == REQUEST.n_tiles
    assert job.refresh().document["tiles_done"] <= MIDDLE
    job.delete()
    with pytest.raises(ResponseError) as gone:
        job.refresh()
    assert gone.value.status == 404


@deep
@pytest.mark.skipif(bool(server_of_tests.missing()), reason=server_of_tests.missing())
def test_a_survey_outlives_a_crash_of_its_database_server(
    client: Client, faults: Faults, postgres: Postgres, expected: dict[str, np.ndarray]
) -> None:
    faults.hold(MIDDLE)
    job = client.submit(REQUEST, force=True)
    tiles = (event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
    list(islice(tiles, MIDDLE))
    postgres.stop(signal.SIGQUIT)  # the signal that pg_ctl stop -m immediate sends
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
        faults.release()
    finally:
        postgres.start()
    found = wait_until(lambda: first_of(client))
    assert found.id == job.id
    assert found.wait().document["tiles_done"] == REQUEST.n_tiles
    assert_bit_identical(found.open(), expected)
    every = [number for number, _ in client.events(job.document["links"]["events"], 0)]
    assert every == list(range(1, len(every) + 1))


def first_of(client: Client) -> Any:
    """Return the newest survey, or None while the service has not found its database again."""
    try:
        return next(iter(client.surveys()))
    except ResponseError as error:
        if error.status != 503:
            raise
        return None


@pytest.mark.parametrize("victim", ["server", "worker"])
@pytest.mark.parametrize("survey", [pytest.param(REQUEST, id="plane", marks=deep), pytest.param(INELASTIC, id="third")])
def test_a_survey_outlives_a_kill_in_its_middle(tmp_path: Path, survey: SurveyRequest, victim: str) -> None:
    """The server dies and a row of the database is lost, or the worker dies: the bytes are those of a serial run."""
    faults, port, data = Faults(tmp_path), free_port(), tmp_path / "data"
    faults.hold(MIDDLE)
    arguments: dict[str, Any] = {"settings": faults.environment}
    with client_of(port) as client:
        with server(data, port, "--workers", "1", **arguments) as process:
            job = client.submit(survey)
            tiles = (event for _, event in client.events(job.document["links"]["events"], 0) if "tile" in event)
            assert list(islice(tiles, MIDDLE))[-1]["tiles_done"] == MIDDLE
            wait_until(lambda: faults.executions()[MIDDLE])
            if victim == "worker":
                (worker,) = workers_of(process.pid)
                worker.kill()
                worker.wait()
                faults.release()
                assert job.wait().document["tiles_done"] == survey.n_tiles
            else:
                process.kill()
                process.wait()
        if victim == "server":
            with sqlite3.connect(data / "jobs.sqlite") as database:  # as if killed before it committed the tile
                database.execute('DELETE FROM tiles WHERE "index" = 1')
            faults.release()
            with server(data, port, "--workers", "1", **arguments):
                assert [found.id for found in client.surveys()] == [job.id]
                assert job.wait().document["tiles_done"] == survey.n_tiles
    lost = {"server": {1: 2, MIDDLE: 2}, "worker": {MIDDLE: 2}}[victim]  # its row was lost, or it was running
    assert faults.executions() == dict.fromkeys(range(survey.n_tiles), 1) | lost

    store, undisturbed = data / "surveys" / f"{job.id}.zarr", tmp_path / "undisturbed.zarr"
    run_survey(survey, out=undisturbed).close()
    assert examine(store).is_whole
    assert written_in(store) == written_in(undisturbed)
    assert opened_elsewhere(store) == opened_elsewhere(undisturbed)
    assert opened_elsewhere(store)["restitution"] == (survey is INELASTIC) * [0.5, 0.7]


#: A program that opens a store with xarray and zarr only, without this project.
ELSEWHERE = """
import json, sys, xarray as xr
with xr.open_zarr(sys.argv[1]) as survey, xr.open_dataset(sys.argv[1], engine="zarr") as other:
    assert survey.load().identical(other.load())
    assert not {"rattle", "gear_rattle"} & {name.partition(".")[0] for name in sys.modules}
    found = {"sizes": dict(survey.sizes), "variables": sorted(survey.variables)}
    found["restitution"] = survey.coords["restitution"].values.tolist() if "restitution" in survey.coords else []
    found["harmonics"] = json.loads(survey.attrs.get("harmonics", "[]"))
print(json.dumps(found))
"""


def opened_elsewhere(store: Path) -> dict[str, Any]:
    """Return what xarray alone finds in a store, in a process of its own."""
    ran = subprocess.run([sys.executable, "-I", "-c", ELSEWHERE, str(store)], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    found: dict[str, Any] = json.loads(ran.stdout)
    return found


@deep
def test_an_interrupted_run_is_resumed_by_the_same_command(tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    faults, out = Faults(tmp_path), tmp_path / "survey.zarr"
    command = ["run", *OPTIONS, "--workers", "1", "--out", str(out)]
    for number, tiles in either([(signal.SIGTERM, 5)], [(signal.SIGINT, 2), (signal.SIGTERM, 5)]):
        faults.hold(tiles)
        process = start(*command, settings=faults.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        errors = interrupt(process, number, lambda tiles=tiles: faults.executions()[tiles])
        assert "the same command resumes it" in errors
        assert "Traceback" not in errors
        assert np.count_nonzero(xr.open_zarr(out)["status"]) == 4 * tiles

    faults.release()
    ended = finish(*command)
    assert ended.returncode == 0, ended.stderr
    assert f"{4 * (REQUEST.n_tiles - 5)} cells in" in ended.stdout
    assert f"{REQUEST.n_cells} cells, 0 failed" in ended.stdout
    assert "undecided" in ended.stdout
    assert "\x1b" not in ended.stdout + ended.stderr
    assert_bit_identical(xr.open_zarr(out), expected)

    before = chunks(out)
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 0, again.stderr
    assert "is complete" in again.stdout
    with pytest.raises(SurveyError, match="another survey"):
        CliRunner().invoke(app, [*command, "--beta", "0.7"], catch_exceptions=False)
    assert chunks(out) == before


def interrupt(process: subprocess.Popen[str], number: signal.Signals, condition: Callable[[], Any]) -> str:
    """Send a signal once a condition holds, while a tile runs that never ends; return the whole of stderr."""
    wait_until(lambda: process.poll() is not None or condition())
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does: also to the workers
    else:
        process.send_signal(number)
    _, errors = process.communicate(timeout=HANG)
    assert process.returncode == 130, errors
    return errors


def chunks(store: Path) -> list[tuple[Path, int]]:
    """Return every file of a store with its time of modification."""
    return sorted((path, path.stat().st_mtime_ns) for path in store.rglob("*") if path.is_file())
