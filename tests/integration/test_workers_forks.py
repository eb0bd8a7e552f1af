"""Workers of this machine are forked from one process that has loaded what they need."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import psutil
import pytest
from depth import deep
from distributed import Client
from faults import REQUEST
from needed import note_needed
from service_processes import assert_bit_identical, forked
from waiting import HANG, wait_until

import rattle
import workers.cluster.forks
import workers.cluster.submission
from rattle import warm
from workers import create_store, embedded_cluster, finish_store, open_survey, run_tiles, tiles_of


@pytest.fixture(scope="module", autouse=True)
def _compiled_before() -> None:
    """Or the first workers compile, and what they are forked from has nothing to load."""
    rattle.warm_up()
    assert warm.is_compiled()


@pytest.fixture(scope="module")
def cluster(own_fork_server: None) -> Iterator[Client]:  # noqa: ARG001
    with embedded_cluster(2) as client:
        yield client


#: A process without its parent whose end takes longer than until the next look; its status is how often it ended.
ENDS_SLOWLY = """
import os, time
parents, times, end = [1], [], os._exit
os.getppid = lambda: parents.pop() if parents else 2
def slowly(_):
    times.append(1)
    time.sleep(0 if len(times) > 1 else 0.5)
    end(len(times))
os._exit = slowly
import gear_rattle.loaded
"""
#: How many processes are forked, and what one answers.
ASKS_ONE = """
import os
from service_processes import forked
from workers import embedded_cluster
with embedded_cluster(1) as client:
    print(len(forked(os.getpid())), client.submit(abs, -3).result())
"""


def pids(client: Client) -> set[int]:
    return set(client.run(os.getpid).values())


def test_they_are_forked_from_a_process_of_one_thread(cluster: Client) -> None:
    """Locks that other threads hold would never be given back in what is forked."""
    assert {each.pid for each in forked(os.getpid())} == pids(cluster)
    (server,) = {psutil.Process(pid).parent() for pid in pids(cluster)}
    assert server.ppid() == os.getpid()
    assert server.num_threads() == 1


@pytest.mark.usefixtures("cluster")
def test_what_is_forked_has_all_kernels_of_a_survey(tmp_path: Path) -> None:
    process = get_context("forkserver").Process(target=note_needed, args=(tmp_path / "needed",))
    process.start()
    process.join(HANG)
    assert process.exitcode == 0
    assert (tmp_path / "needed").read_text() == ""


@pytest.mark.usefixtures("cluster")
def test_they_have_the_environment_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    """As credentials that were set since the first cluster."""
    monkeypatch.setenv("SINCE_THEN", "1")
    with embedded_cluster(1) as client:
        assert client.submit(os.getenv, "SINCE_THEN").result() == "1"


def test_they_end_with_what_would_tell_of_their_end(
    cluster: Client, tmp_path: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are taken for dead, and would compute beside those that take their place."""
    monkeypatch.setattr(workers.cluster.submission, "WORKERLESS_SECONDS", HANG)
    create_store(REQUEST, tmp_path / "survey.zarr")
    before, done = pids(cluster), list[int]()

    def kill(record: workers.TileRecord) -> None:
        done.append(record.index)
        if len(done) == 5:
            psutil.Process(next(iter(before))).parent().send_signal(signal.SIGKILL)

    run_tiles(REQUEST, tmp_path / "survey.zarr", tiles_of(REQUEST), cluster, kill, lambda: False)
    finish_store(tmp_path / "survey.zarr")
    assert_bit_identical(open_survey(tmp_path / "survey.zarr"), expected)
    wait_until(lambda: not any(psutil.pid_exists(pid) for pid in before))
    wait_until(lambda: len(cluster.nthreads()) == 2)
    assert {each.pid for each in forked(os.getpid())} == pids(cluster)


def test_what_loads_for_nobody_ends_once() -> None:
    """However long that takes: as long as nothing is written, it is looked again, and written again from the start."""
    assert subprocess.run([sys.executable, "-c", ENDS_SLOWLY], timeout=HANG).returncode == 1


@pytest.mark.parametrize(("length", "expected"), [(75, "1 3"), (76, "0 3")])
def test_where_sockets_have_no_names_they_start_by_themselves(short_path: Path, length: int, expected: str) -> None:
    """As deep in the directories of a cluster's job; the socket's name must be shorter than 108 bytes."""
    named = short_path / ("é" + "d" * (length - len(os.fsencode(short_path)) - len("/é".encode())))
    named.mkdir()
    told = subprocess.run(
        [sys.executable, "-c", ASKS_ONE],
        env=os.environ | {"TMPDIR": str(named), "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
        timeout=HANG,
    )
    assert len(os.fsencode(named)) == length
    assert told.stdout.split() == expected.split()


@deep
def test_elsewhere_they_start_by_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers.cluster.forks, "METHOD", "spawn")
    with embedded_cluster(1) as client:
        (pid,) = pids(client)
        assert psutil.Process(pid).ppid() == os.getpid()
