"""Worker processes of this machine: how they are started, what they import, and when they end."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from distributed import Client
from faults import REQUEST
from service_processes import ENVIRONMENT, OPTIONS, assert_bit_identical, nannies_of, workers_of
from waiting import HANG, wait_until

import gear_rattle.workers.cluster.submission
from gear_rattle.workers import (
    TileRecord,
    create_store,
    embedded_cluster,
    finish_store,
    open_survey,
    run_tiles,
    tiles_of,
)
from gear_rattle.workers.cluster.scratch import HELD, PREFIX, scratch_directory


@pytest.fixture(scope="module")
def cluster() -> Iterator[Client]:
    with embedded_cluster(2) as client:
        yield client


def pids(client: Client) -> set[int]:
    return set(client.run(os.getpid).values())


#: A program that starts a worker, prints "started", and waits for ever.
STARTS_ONE = """
import time
from gear_rattle.workers import embedded_cluster
with embedded_cluster(1):
    print("started", flush=True)
    time.sleep(1e6)
"""
#: A script as in docs/how-to/surveys.md, without an `if __name__` guard.
SCRIPT = """
from pathlib import Path
with Path("runs").open("a") as runs:
    runs.write("x")
from gear_rattle import run_survey
survey = run_survey(delta=(0.5, 0.7, 3), epsilon=(0.05, 0.15, 2), out="survey.zarr", cluster=2)
print(dict(survey.sizes)["delta"])
"""
#: Names of modules that our processes import or try to import; a module of this name in the poisoned directory raises.
POISONED = (
    "random",
    "json",
    "queue",
    "logging",
    "pickle",
    "socket",
    "ssl",
    "struct",
    "subprocess",
    "tempfile",
    "threading",
    "uuid",
    "heapq",
    "bisect",
    "copy",
    "csv",
    "dataclasses",
    "decimal",
    "fractions",
    "inspect",
    "platform",
    "secrets",
    "selectors",
    "shutil",
    "statistics",
    "string",
    "traceback",
    "weakref",
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "zarr",
    "xarray",
    "dask",
    "distributed",
    "tornado",
    "msgpack",
    "psutil",
    "cryptography",
    "pydantic",
)


@pytest.fixture
def poisoned(tmp_path: Path) -> Path:
    """Return a directory of modules that write a note and raise when they are imported."""
    directory = tmp_path / "poisoned"
    directory.mkdir()
    for name in POISONED:
        (directory / f"{name}.py").write_text(
            f"open({str(tmp_path / 'imported')!r}, 'a').write('{name} ')\nraise SystemExit('{name}')\n"
        )
    return directory


def imported(tmp_path: Path) -> str:
    note = tmp_path / "imported"
    return note.read_text() if note.exists() else ""


#: The installed command. The tests' usual way to start it would itself import from the working directory.
COMMAND = Path(sys.executable).with_name("rattle")


def test_they_have_the_environment_of_now(cluster: Client, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ARG001
    """Credentials, for example, may have been set after the first cluster was started."""
    monkeypatch.setenv("SINCE_THEN", "1")
    with embedded_cluster(1) as client:
        assert client.submit(os.getenv, "SINCE_THEN").result() == "1"


def test_another_process_starts_them_again_when_that_process_is_killed(
    cluster: Client, tmp_path: Path, expected: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gear_rattle.workers.cluster.submission, "WORKERLESS_SECONDS", HANG)
    create_store(REQUEST, tmp_path / "survey.zarr")
    before, done = pids(cluster), list[int]()

    def kill(record: TileRecord) -> None:
        done.append(record.index)
        if len(done) == 5:
            psutil.Process(next(iter(before))).parent().send_signal(signal.SIGKILL)

    run_tiles(REQUEST, tmp_path / "survey.zarr", tiles_of(REQUEST), cluster, kill, lambda: False)
    finish_store(tmp_path / "survey.zarr")
    assert_bit_identical(open_survey(tmp_path / "survey.zarr"), expected)
    wait_until(lambda: not any(psutil.pid_exists(pid) for pid in before))
    wait_until(lambda: len(cluster.nthreads()) == 2)
    assert {each.pid for each in workers_of(os.getpid())} == pids(cluster)


def test_they_end_with_their_parent_also_if_it_is_killed_and_the_next_start_tidies_up(tmp_path: Path) -> None:
    """This holds also for a frozen worker, which cannot notice the end of its parent."""
    environment = ENVIRONMENT | {"TMPDIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", STARTS_ONE], env=environment, stdout=subprocess.PIPE) as parent:
        try:
            assert parent.stdout is not None
            assert parent.stdout.readline() == b"started\n"
            every = psutil.Process(parent.pid).children(recursive=True)
            (worker,) = workers_of(parent.pid)
            worker.suspend()
        finally:
            parent.kill()
    wait_until(lambda: not any(each.is_running() and each.status() != psutil.STATUS_ZOMBIE for each in every))
    (left,) = tmp_path.glob(f"{PREFIX}*")
    with scratch_directory(str(tmp_path)) as path:
        assert not left.exists()
        with scratch_directory(str(tmp_path)) as beside:  # a directory in use is not removed
            assert Path(path).is_dir()
            assert Path(beside, HELD).stat().st_mode & 0o777 == 0o600
            assert Path(beside).stat().st_mode & 0o777 == 0o700
    assert not list(tmp_path.iterdir())


def test_only_directories_of_this_kind_are_removed(tmp_path: Path) -> None:
    mine, elsewhere = tmp_path / f"{PREFIX}results", tmp_path / "elsewhere"
    for directory in (mine, elsewhere):
        directory.mkdir()
        (directory / "numbers").touch()
    (elsewhere / HELD).touch()
    (tmp_path / f"{PREFIX}link").symlink_to(elsewhere)
    with scratch_directory(str(tmp_path)):
        pass
    assert (mine / "numbers").exists()
    assert (elsewhere / "numbers").exists()


@pytest.mark.parametrize("piped", [False, True])
def test_a_script_needs_no_guard_and_its_directory_hides_nothing(tmp_path: Path, poisoned: Path, piped: bool) -> None:
    """The workers do not run the script again, and import neither from its directory nor from the working directory."""
    script = tmp_path / "script" / "survey.py"
    shutil.copytree(poisoned, script.parent)
    script.write_text(SCRIPT)
    # -P: Python itself does not import from the script's directory; this test is about the workers.
    command = [sys.executable, "-P", "-" if piped else str(script)]
    ran = subprocess.run(
        command, cwd=poisoned, env=ENVIRONMENT, input=SCRIPT, capture_output=True, text=True, timeout=HANG
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout == "3\n"
    assert ran.stderr == ""
    assert (poisoned / "runs").read_text() == "x"
    assert imported(tmp_path) == ""


def test_the_command_imports_nothing_from_the_working_directory(tmp_path: Path, poisoned: Path) -> None:
    command = [COMMAND, "run", *OPTIONS, "--workers", "1", "--out", str(tmp_path / "survey.zarr")]
    ran = subprocess.run(command, cwd=poisoned, env=ENVIRONMENT, capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    assert imported(tmp_path) == ""


def test_a_service_imports_nothing_from_the_working_directory(tmp_path: Path, poisoned: Path) -> None:
    """Neither do its workers and the processes that compute points."""
    import httpx

    command = [COMMAND, "serve", "--port", "0", "--workers", "1", "--data", str(tmp_path / "data")]
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=poisoned, env=ENVIRONMENT, stderr=log)
    try:
        address = wait_until(lambda: listening_at((tmp_path / "log").read_text()))
        wait_until(lambda: httpx.get(f"{address}/v1/health").json()["cluster"] == "ready")
        point = httpx.get(f"{address}/v1/attractors?delta=0.6&epsilon=0.1&count=4", timeout=HANG)
        assert point.is_success, point.text
    finally:
        process.terminate()
        assert process.wait(HANG) == 0
    assert imported(tmp_path) == ""


def listening_at(log: str) -> str:
    found = [word for word in log.split() if word.startswith("http://127.0.0.1:")]
    return found[0] if found else ""


def test_no_process_is_left() -> None:
    """Not even a frozen worker is left."""
    before = {each.pid for each in nannies_of(os.getpid())}
    with embedded_cluster(1):
        (nannies,) = [each for each in nannies_of(os.getpid()) if each.pid not in before]
        family = [nannies, *nannies.children(recursive=True)]
        for worker in workers_of(os.getpid()):
            if worker.ppid() == nannies.pid:
                worker.suspend()
    assert len(family) == 3  # nannies, worker, and the tracker of semaphores
    wait_until(lambda: not any(each.is_running() and each.status() != psutil.STATUS_ZOMBIE for each in family))
