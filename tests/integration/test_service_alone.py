"""A second service on a data directory or database, and several server processes, are refused with a clear message."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from depth import deep
from service_processes import ENVIRONMENT, ROOT, finish, free_port
from waiting import HANG

from gear_rattle.service.database import Database
from gear_rattle.service.jobs.directory import DataDirectory

NO_CLUSTER = "tcp://127.0.0.1:1"

# A program that writes surveys and tiles without end, and prints what it has committed.
WRITER = """
import sys
from gear_rattle.service.database import Database, DoneTile, NewJob
from gear_rattle.service.database.tables import State
database = Database(sys.argv[1])
while True:
    survey_id = database.add_or_find_job(NewJob("", {}, "c", "b", 60, 10), 10**6).id
    print("accepted", survey_id, flush=True)
    database.set_state(survey_id, State.RUNNING)
    for tile in range(10):
        database.add_tile(survey_id, DoneTile(tile, 6, 0.1, 0, []))
        print("tile", survey_id, tile, flush=True)
    database.set_state(survey_id, State.SUCCESSFUL)
    print("successful", survey_id, flush=True)
"""


@contextmanager
def running(*command: str, **options: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, *command],
        cwd=ROOT,
        text=True,
        start_new_session=True,
        **options,  # type: ignore[call-overload]
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def assert_refused(data: Path, database_url: str | None, words: str) -> None:
    settings = {"RATTLE_DATABASE_URL": database_url} if database_url else {}
    refused = finish("serve", "--port", "0", "--data", str(data), settings=settings)
    assert refused.returncode == 2, refused.stderr
    assert words in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_second_service_is_refused_by_data_directory_and_by_database(tmp_path: Path, database_url: str) -> None:
    with closing(Database(database_url)) as database:  # this process stands in for the first service
        assert_refused(tmp_path / "second", database_url, "Another service uses the job database")
        assert database.jobs(1) == ([], 0)
    if database_url.startswith("sqlite"):  # does not depend on the database: once is enough
        with DataDirectory(tmp_path / "first").lock():
            assert_refused(tmp_path / "first", None, "Another service uses the data directory")


def test_several_workers_of_uvicorn_are_refused(tmp_path: Path) -> None:
    arguments = [
        "-m",
        "uvicorn",
        "gear_rattle.service.app:create_app",
        "--factory",
        "--workers",
        "2",
        "--port",
        str(free_port()),
    ]
    environment = ENVIRONMENT | {"RATTLE_DATA": str(tmp_path), "RATTLE_SCHEDULER": NO_CLUSTER}
    with running(*arguments, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        said, _ = process.communicate(timeout=HANG)  # both end, although one worker could run
    assert "Another service uses the data directory" in said
    assert "start uvicorn without --workers" in said


@pytest.mark.parametrize("told", [pytest.param(2, marks=deep), 60])
def test_what_was_committed_outlives_sigkill_at_any_instant(database_url: str, told: int) -> None:
    with running("-c", WRITER, database_url, env=ENVIRONMENT, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(told)]
        process.kill()  # it is writing: it does not wait for this reader
        lines += process.stdout.readlines()
    committed = [line.split() for line in lines if line.endswith("\n")]
    assert len(committed) >= told
    database = Database(database_url)  # the lock was released when the process died
    surveys, count = database.jobs(500)
    assert count == len(surveys)
    known = {job.id: job for job in surveys}
    for word, survey_id, *tile in committed:
        assert survey_id in known
        if word == "tile":
            assert int(tile[0]) in database.recorded_tile_indices(survey_id)
        if word == "successful":
            assert known[survey_id].state == "successful"
    for job in surveys:
        events = database.events(job.id, 0)
        assert [event.id for event in events] == list(range(1, job.last_event + 1))
        assert (
            job.tiles_done
            == len(database.recorded_tile_indices(job.id))
            == sum(event.kind == "tile" for event in events)
        )
    database.close()
