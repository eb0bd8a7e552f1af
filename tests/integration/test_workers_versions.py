"""Existing clusters: over TLS, with other versions of packages, and without this package."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from dask.distributed import Client
from depth import either
from parts import authority, dask_part, environment
from service_processes import ENVIRONMENT, OPTIONS, REQUEST, assert_bit_identical, finish, free_port, serial_run
from waiting import HANG, SELDOM, wait_until

import rattle
from gear_rattle.workers import open_survey, run_survey
from gear_rattle.workers.cluster.cluster import connect
from gear_rattle.workers.errors import ClusterLostError

OTHER = "0.0.1"
#: Code that a worker runs first: the worker then reports another version of a package.
ANOTHER_VERSION = """
import importlib.metadata as metadata
version = metadata.version
metadata.version = lambda name: {other!r} if name == {package!r} else version(name)
"""
#: Code that a worker runs first: the worker then reports another version of Python, which the check asks of `platform`.
ANOTHER_PYTHON = """
import platform
platform.python_version_tuple = lambda: ("3", "1", "0")
"""
#: Code after which a worker cannot import this package, neither from an editable installation nor from a path.
WITHOUT = """
import sys
sys.meta_path[:] = [each for each in sys.meta_path if "editable" not in repr(each).lower()]
sys.path[:] = [each for each in sys.path if {root!r} not in each or "site-packages" in each]
"""
WITHOUT_PACKAGE = WITHOUT.format(root=str(Path(rattle.__file__).parents[1]))
ONE_WORKER = ("--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1")


@contextmanager
def cluster(directory: Path, first: str, settings: dict[str, str] | None = None) -> Iterator[str]:
    """Start a scheduler with a worker that first runs the code `first`; yield the scheduler's address."""
    settings = settings or {}
    (directory / "first").mkdir()
    (directory / "first" / "sitecustomize.py").write_text(first)
    protocol, port = "tls" if settings else "tcp", free_port()
    url, file = f"{protocol}://127.0.0.1:{port}", directory / "scheduler.json"
    base = ENVIRONMENT | ({"PYTHONPATH": str(directory / "first")} if first else {})
    elsewhere = ("env", f"--chdir={directory}") if first else ()
    address = ["--protocol", protocol, "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    with ExitStack() as stack:
        stack.enter_context(dask_part(settings, "scheduler", *address, "--scheduler-file", str(file)))
        local = ["--local-directory", str(directory / "local")]
        stack.enter_context(dask_part(settings, "worker", url, *ONE_WORKER, *local, base=base, prefix=elsewhere))
        wait_until(file.exists)
        yield url


def run(url: str, store: Path, settings: dict[str, str] | None = None) -> tuple[int, str]:
    """Run a survey, again until the cluster has workers; return the exit status and stderr."""
    ran = None

    def answered() -> bool:
        nonlocal ran
        ran = finish("run", *OPTIONS, "--out", str(store), "--scheduler", url, settings=environment(settings or {}))
        return "no dask scheduler with workers" not in ran.stderr

    wait_until(answered, SELDOM)
    assert ran is not None
    return ran.returncode, ran.stderr


@pytest.mark.parametrize("package", either(["gear-rattle"], ["gear-rattle", "numba"]))
def test_another_version_is_named_beside_this_one(tmp_path: Path, package: str) -> None:
    with cluster(tmp_path, ANOTHER_VERSION.format(other=OTHER, package=package)) as url:
        status, said = run(url, tmp_path / "survey.zarr")
    said = " ".join(said.split())
    assert status == 2
    assert f"has {package} {OTHER}, and this process has {package} " in said
    assert package != "gear-rattle" or rattle.__version__ in said
    assert "the worker at tcp://127.0.0.1:" in said
    assert "Traceback" not in said


def test_a_worker_without_this_package_says_so(tmp_path: Path) -> None:
    with cluster(tmp_path, WITHOUT_PACKAGE) as url:
        status, said = run(url, tmp_path / "survey.zarr")
    said = " ".join(said.split())
    assert status == 2
    assert "cannot import gear_rattle: install gear-rattle on these workers" in said
    assert rattle.__version__ in said
    assert "Traceback" not in said


@contextmanager
def late_worker(directory: Path, url: str, first: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A worker that begins with some Python, and its log."""
    log = directory / "worker.log"
    (directory / "later").mkdir()
    (directory / "later" / "sitecustomize.py").write_text(first)
    command = [sys.executable, "-m", "dask", "worker", url, *ONE_WORKER, "--local-directory", str(directory / "later")]
    with log.open("wb") as file:
        worker = subprocess.Popen(
            command, cwd=directory, env=ENVIRONMENT | {"PYTHONPATH": str(directory / "later")}, stdout=file, stderr=file
        )
        try:
            yield worker, log
        finally:
            worker.terminate()
            worker.wait(timeout=HANG)


@contextmanager
def connected(url: str) -> Iterator[Client]:
    """A client of a cluster that has workers by then."""
    with ExitStack() as stack:
        clients: list[Client] = []

        def is_there() -> bool:
            try:
                clients.append(stack.enter_context(connect(url)))
            except ClusterLostError:
                return False
            return True

        wait_until(is_there, SELDOM)
        yield clients[0]


LATE = {
    "another version": (ANOTHER_VERSION.format(other=OTHER, package="gear-rattle"), f"has gear-rattle {OTHER}, and"),
    "another numba": (ANOTHER_VERSION.format(other=OTHER, package="numba"), f"has numba {OTHER}, and"),
    "another Python": (ANOTHER_PYTHON, "has Python 3.1, and"),
    "no package": (WITHOUT_PACKAGE, "cannot import gear_rattle, and"),
}


@pytest.mark.parametrize("kind", either(["another version", "no package"], list(LATE)))
def test_a_worker_with_other_software_that_joins_later_is_named_and_computes_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str
) -> None:
    first, found = LATE[kind]
    with cluster(tmp_path, "") as url, connected(url) as client:
        before = set(client.nthreads())
        with late_worker(tmp_path, url, first) as (worker, log):
            worker.wait(timeout=HANG)  # its nanny does not start it again
            wait_until(lambda: "is refused" in caplog.text)
            required = f"{found} the process that runs surveys has "
            for said in (log.read_text(), caplog.text):
                assert required in said
            assert found.startswith("has Python") or "numba" in found or rattle.__version__ in caplog.text
        assert set(client.nthreads()) == before  # the other worker is still there
        with run_survey(REQUEST, out=tmp_path / "survey.zarr", cluster=client) as dataset:
            assert_bit_identical(dataset, serial_run(REQUEST))


def test_the_command_uses_a_cluster_over_tls_by_its_scheduler_file(tmp_path: Path) -> None:
    settings = authority(tmp_path / "ca") | {"distributed.comm.require-encryption": "true"}
    store = tmp_path / "survey.zarr"
    with cluster(tmp_path, "", settings):
        status, said = run(str(tmp_path / "scheduler.json"), store, settings)
        assert status == 0, said
        status, said = run(str(tmp_path / "nothing.json"), tmp_path / "other.zarr", settings)
        assert status == 2
        assert "scheduler file" in said
    with open_survey(store) as dataset:
        assert_bit_identical(dataset, serial_run(REQUEST))
