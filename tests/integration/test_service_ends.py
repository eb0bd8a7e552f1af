"""SIGTERM ends a service whatever it is doing, and nothing that it has recorded is lost."""

import signal
import socket
import sqlite3
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
import xarray as xr
from depth import deep
from faults import NO_DEADLINE, Faults
from service_processes import REQUEST, client_of, finish, free_port, server, start
from waiting import HANG, wait_until

from gear_rattle.service.web.server import STOP_SECONDS

MIDDLE = 3  # tiles that are done; the next tile never ends
PROMISED = 5.0  # seconds until the service has ended, according to CHANGELOG.md
#: The computation of POINT never ends.
ENDLESS = """
    @patch("rattle.impacting.gear")
    def endless(gear):
        def act(self, *_, **__):
            if self.delta == 0.61:
                note("point")
                while True:
                    time.sleep(1)
        before(gear.Gear, "attractors", act)
"""
POINT = "/v1/attractors?delta=0.61&epsilon=0.1&count=4"


def stop(process: Any) -> None:
    """Send SIGTERM, and wait until the process and all its descendants have ended."""
    children = psutil.Process(process.pid).children(recursive=True)
    assert children
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=HANG) == 0
    wait_until(lambda: all(is_dead(child) for child in children))


def is_dead(process: psutil.Process) -> bool:
    """Return whether a process has ended, or is a zombie."""
    try:
        return bool(process.status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True


def test_a_busy_service_ends_by_itself_with_its_tiles(tmp_path: Path) -> None:
    """The service ends without its deadline, because it ends requests, streams, points and surveys itself."""
    faults, port, data = Faults(tmp_path), free_port(), tmp_path / "data"
    faults.inject(NO_DEADLINE, ENDLESS)
    faults.hold(MIDDLE)
    begun: list[str] = []
    answers: list[tuple[str, int, str]] = []

    def ask(path: str) -> None:
        with httpx.stream("GET", f"http://127.0.0.1:{port}{path}", timeout=HANG, verify=False) as answer:
            begun.append(path)
            answers.append((path, answer.status_code, answer.read().decode("latin-1")))

    settings = faults.environment | {"RATTLE_MAX_POINT_SECONDS": str(HANG)}
    with server(data, port, "--workers", "1", settings=settings) as process, client_of(port) as client:
        job = client.submit(REQUEST)
        events, picture = job.document["links"]["events"], f"{job.document['links']['map']}?variable=orbit_phase"
        wait_until(lambda: faults.executions()[MIDDLE])
        wait_until(lambda: job.refresh().document["tiles_done"] == MIDDLE)
        asking = [threading.Thread(target=ask, args=(path,)) for path in [events] * 20 + [POINT] * 3 + [picture] * 2]
        for thread in asking:
            thread.start()
        wait_until(lambda: faults.notes("point").total() == 2)  # the third waits in the queue
        wait_until(lambda: begun.count(events) == 20 and begun.count(picture) == 2)
        stop(process)
        for thread in asking:
            thread.join()
    assert sorted(status for path, status, _ in answers if path == POINT) == [503] * 3
    assert all("The service is ending" in text for path, _, text in answers if path == POINT)
    assert sum(path == events and status == 200 for path, status, _ in answers) == 20  # streams were closed properly
    with sqlite3.connect(data / "jobs.sqlite") as database:
        state, tiles = database.execute("SELECT state, tiles_done FROM jobs").fetchone()
        rows = database.execute("SELECT count(*), sum(cells) FROM tiles").fetchone()
    assert state == "running"
    assert rows == (tiles, 4 * tiles) == (MIDDLE, 4 * MIDDLE)
    written = xr.open_zarr(data / "surveys" / f"{job.id}.zarr")["status"].values
    assert (written > 0).sum() == 4 * MIDDLE


#: Stages of a start at which the signal may come. In the last two the cluster starts: before and after it has workers.
STAGES = {
    "begun": """
        @patch("gear_rattle.service.web.server")
        def begun(server):
            after(server, "bind_sockets", lambda *_: [note("begun"), wait_for_signal()])
        """,
    "opened": """
        @patch("gear_rattle.service.jobs.manager")
        def opened(jobs):
            before(jobs.JobManager, "start", lambda self: [note("opened"), wait_for_signal()])
        """,
    "processes": """
        @patch("gear_rattle.workers.survey.tiles")
        def processes(tiles):
            if any("multiprocessing" in each for each in sys.orig_argv):  # a worker that is being loaded
                note("processes")
                wait_for_signal()
        """,
    "warming": """
        @patch("gear_rattle.workers.cluster.cluster")
        def warming(cluster):
            async def setup(self, worker):
                note("warming")
                wait_for_signal()
            cluster.KernelLoader.setup = setup
        """,
}
EARLY = ("begun", "opened")
USUAL = ("begun", "processes", "warming")  # one of each kind
#: Wait until the test has sent the signal and created the file; in stages other than EARLY, for ever.
WAIT_FOR_SIGNAL = """
    def wait_for_signal():
        while not os.path.exists(LOG + ".signal"):
            time.sleep(0.01)
"""


def semaphores(pid: int) -> set[Path]:
    """Return the semaphores that a process and its descendants have open."""
    process = psutil.Process(pid)
    found: set[Path] = set()
    for each in (process, *process.children(recursive=True)):
        with suppress(psutil.Error):
            found |= {Path(mapped.path) for mapped in each.memory_maps() if mapped.path.startswith("/dev/shm/sem.")}
    return {path for path in found if path.exists()}


def of_all_workers(pid: int) -> set[Path]:
    """Return the semaphores of a service and its descendants once all exist: six for each of two workers."""
    return found if len(found := semaphores(pid)) >= 12 else set()


@pytest.mark.parametrize("stage", [pytest.param(stage, marks=() if stage in USUAL else deep) for stage in STAGES])
def test_a_service_that_starts_ends_by_itself_and_leaves_nothing(tmp_path: Path, short_path: Path, stage: str) -> None:
    """The service ends without its deadline at any stage, because it does not wait for a cluster that is starting."""
    faults, log = Faults(tmp_path), tmp_path / "log"
    faults.inject(NO_DEADLINE, WAIT_FOR_SIGNAL, STAGES[stage])
    settings = faults.environment | {"TMPDIR": str(short_path)}
    with log.open("w") as stderr:
        arguments = ("--port", "0", "--data", str(tmp_path / "data"), "--workers", "2")
        process = start("serve", *arguments, settings=settings, stderr=stderr)
        try:
            wait_until(lambda: faults.notes(stage) or process.poll() is not None)
            found = wait_until(lambda: of_all_workers(process.pid)) if stage == "warming" else set()
            children = psutil.Process(process.pid).children(recursive=True)
            process.send_signal(signal.SIGTERM)
            if stage in EARLY:  # in the other stages, the processes that wait are ended
                (tmp_path / "executed.signal").touch()
            assert process.wait(timeout=HANG) == 0
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    wait_until(lambda: all(is_dead(child) for child in children))
    assert not [path for path in found if path.exists()]
    assert not list(short_path.glob("rattle-*"))
    said = log.read_text()
    assert "Traceback" not in said
    assert "no cluster" not in said
    assert "leaked" not in said


def test_what_cannot_be_ended_is_killed_in_time(tmp_path: Path) -> None:
    faults, port, log = Faults(tmp_path), free_port(), tmp_path / "log"
    faults.inject("""
        @patch("gear_rattle.workers.cluster.cluster")
        def endless(cluster):
            def act(*_):
                note("started")
                while True:
                    time.sleep(1)
            after(cluster._WorkerProcesses, "wait_for_workers", act)
            cluster.WATCH_SECONDS = 1e6
    """)
    with (
        log.open("w") as stderr,
        server(tmp_path / "data", port, "--workers", "1", settings=faults.environment, stderr=stderr) as process,
    ):
        wait_until(lambda: faults.notes("started"))
        found = semaphores(process.pid)
        assert found
        stop(process)  # the start of its cluster never ends
    assert f"still busy {STOP_SECONDS:g} s after the signal" in log.read_text()
    assert STOP_SECONDS < PROMISED
    wait_until(lambda: not [path for path in found if path.exists()])


def test_a_port_that_is_taken_is_told_before_anything_starts(tmp_path: Path) -> None:
    faults = Faults(tmp_path)
    faults.inject("""
        @patch("gear_rattle.service.jobs.manager")
        def noted(jobs):
            before(jobs.JobManager, "start", lambda self: note("manager"))
    """)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        told = finish("serve", "--port", str(port), "--data", str(tmp_path / "data"), settings=faults.environment)
    assert told.returncode == 2
    assert f"port {port} of 127.0.0.1" in told.stderr
    assert "--port" in told.stderr
    assert "Traceback" not in told.stderr
    assert not faults.notes("manager")
