"""Databases for the tests of the service: SQLite, and a PostgreSQL that is started for them where it is installed."""

import gc
import logging
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer.testing
from depth import DEEP
from postgres import Postgres, missing
from s3_server import S3, s3_server
from xdist.scheduler import LoadFileScheduling

from rattle.numerics.processes import SAFE_PATH

#: Files in memory, where there is so much room. A run makes 200,000, and to delete as many on a disk took minutes.
IN_MEMORY, ROOM = Path("/dev/shm"), 4 << 30
OBJECTS = 300_000  # that are made between two collections of garbage; Python's own default is 700

MODULE_PATH: list[str] = []  # with the directories of the tests, which pytest adds while it collects them
GIVEN_SAFE_PATH = {SAFE_PATH: os.environ[SAFE_PATH]} if SAFE_PATH in os.environ else {}
#: Files that share what takes long to start (a browser with its service, a bucket) run in one process.
TOGETHER = {
    "tests/browser/": "browser",
    "tests/integration/test_bucket_": "bucket",
    "tests/contracts/service/test_service_damage.py": "bucket",
}


class Files(LoadFileScheduling):
    """A file is run by one process, and so are those that belong together."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        return next((shared for several, shared in TOGETHER.items() if file.startswith(several)), file)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Files:
    """Instead of `--dist loadfile`."""
    return Files(config, log)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:  # noqa: ARG001
    """One more than there are processors: that of the browser waits for other processes nearly all the time."""
    return len(os.sched_getaffinity(0)) + 1


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the deep tests out, unless they are asked for."""
    left_out = [] if DEEP else [item for item in items if item.get_closest_marker("deep")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


def _find_modules_as_before() -> None:
    sys.path[:] = dict.fromkeys([*MODULE_PATH, *sys.path])  # dask has added a directory of its own
    os.environ.pop(SAFE_PATH, None)
    os.environ.update(GIVEN_SAFE_PATH)


@pytest.fixture(autouse=True)
def _modules_are_found_where_they_were() -> Iterator[None]:
    """Applications leave the working directory out of where their process finds modules, for good."""
    _find_modules_as_before()  # those of a whole file have begun before the first of its tests
    yield
    _find_modules_as_before()


def pytest_configure() -> None:
    """Nothing is thrown away while tests are loaded: to look for garbage took a third of that time."""
    gc.disable()
    if _is_like_a_disk(IN_MEMORY):
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(IN_MEMORY))


def _is_like_a_disk(directory: Path) -> bool:
    """Return whether there is room for a run, and programs that tests write can be executed."""
    if not os.access(directory, os.W_OK):
        return False
    there = os.statvfs(directory)
    return there.f_bavail * there.f_frsize > ROOM and not there.f_flag & os.ST_NOEXEC


def pytest_collection_finish() -> None:
    """Freeze loaded objects: collecting garbage among them repeatedly took a tenth of the time."""
    MODULE_PATH[:] = sys.path
    gc.freeze()
    gc.set_threshold(OBJECTS)
    gc.enable()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server of this session."""
    if reason := missing():
        pytest.skip(reason)
    server = Postgres()
    try:
        yield server
    finally:
        server.close()


@pytest.fixture(scope="session")
def storage() -> Iterator[S3]:
    """An S3 server of this session, with an empty bucket at its start."""
    with s3_server() as running:
        yield running


@pytest.fixture
def postgres_url(postgres: Postgres) -> Iterator[str]:
    """URL of an empty database on PostgreSQL."""
    url = postgres.create()
    yield url
    postgres.drop(url)


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty job database, on SQLite and on PostgreSQL."""
    if request.param == "postgresql":
        return str(request.getfixturevalue("postgres_url"))
    (tmp_path / "database").mkdir()
    return f"sqlite:///{tmp_path}/database/jobs.sqlite"


@pytest.fixture(autouse=True, scope="session")
def _commands_are_made_once() -> Iterator[None]:
    """Make the commands once, not for each that runs in this process: there are thirty with all their options."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", cache(typer.testing._get_command))
        yield


@pytest.fixture(autouse=True)
def _no_log_to_a_closed_stream() -> Iterator[None]:
    """A command that a test runs in this process logs to the standard error of that test: gone with it."""
    root = logging.getLogger()
    before = list(root.handlers)
    yield
    for handler in list(root.handlers):
        if type(handler) is logging.StreamHandler and handler not in before:
            root.removeHandler(handler)
