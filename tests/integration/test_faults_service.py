"""The service is killed at every instant of a survey's life; surveys are dismissed, deleted and repaired by REST."""

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import xarray as xr
from depth import deep, either
from faults import BOUNDED, FEW_AUDITED, IN_PROCESS, REQUEST, SPARE, Faults
from service_processes import assert_bit_identical, client_of, free_port, server, start, workers_of, written_in
from waiting import HANG, wait_until

from gear_rattle.service.client import Client
from gear_rattle.service.errors import ResponseError, ServiceError
from gear_rattle.workers import SurveyRequest, open_survey, run_survey

N_TILES = REQUEST.n_tiles

#: Instants at which the service kills itself, in the order in which they occur in the life of one survey.
INSTANTS = {
    "template creation": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            before(os, "rename", lambda _, path: str(path).endswith(".zarr") and die())
    """,
    "template renamed": """
        @patch("gear_rattle.workers.storage.store")
        def kill(store):
            before(store, "_require_same_survey", lambda *_: in_service() and die())
    """,
    "tile half written": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            third = at_call(3, die)
            before(location.StoreDirectory, "put", lambda _, key, content: key.startswith("status/c/") and third())
    """,
    "tile written, manifest not": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            third = at_call(3, die)
            before(location.StoreDirectory, "put", lambda _, key, content: key == "manifest.json" and third())
    """,
    "tile written, row not": """
        @patch("gear_rattle.service.database")
        def kill(database):
            before(database.Database, "add_tile", at_call(3, die))
    """,
    "row committed": """
        @patch("gear_rattle.service.database")
        def kill(database):
            after(database.Database, "add_tile", at_call(3, die))
    """,
    "all tiles done": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            before(location.StoreDirectory, "remove_leftovers", lambda *_: die())
    """,
    "whole, about to be dated": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            after(location.StoreDirectory, "put", lambda _, key, content: key == "manifest.json" and die())
    """,
    "whole, not dated": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            before(location.StoreDirectory, "put", lambda _, key, content: key == "zarr.json" and die())
    """,
    "root dated, manifest not": """
        @patch("gear_rattle.workers.storage.location")
        def kill(location):
            after(location.StoreDirectory, "put", lambda _, key, content: key == "zarr.json" and die())
    """,
    "dated, not published": """
        @patch("gear_rattle.service.database")
        def kill(database):
            before(database.Database, "set_state", lambda _, id, state, *__: state == "successful" and die())
    """,
    "published": """
        @patch("gear_rattle.service.database")
        def kill(database):
            after(database.Database, "set_state", lambda _, id, state, *__: state == "successful" and die())
    """,
}
STATUS_HALF_WRITTEN = """
    @patch("gear_rattle.workers.storage.location")
    def kill(location):
        last = at_call({}, die)
        before(location.StoreDirectory, "put", lambda _, key, content: key.startswith("status/c/") and last())
"""
#: The instants that are needed for protections.py to notice that a protection is missing.
TELLING = (
    "template creation",
    "tile half written",
    "tile written, manifest not",
    "tile written, row not",
    "dated, not published",
    "published",
)


def test_killed_at_every_instant(tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    faults, port, data = Faults(tmp_path), free_port(), tmp_path / "data"
    executed: dict[str, int] = {}
    job = None
    with client_of(port) as client:
        for instant in either(TELLING, tuple(INSTANTS)):
            faults.inject(IN_PROCESS, INSTANTS[instant])
            with killing_itself(port, data, faults, instant):
                job = job or wait_until(lambda: try_to_submit(client, REQUEST))
            executed[instant] = faults.executions().total()
        faults.inject(IN_PROCESS)
        with server(data, port, settings=faults.environment):
            job.wait()
            assert job.document["tiles_done"] == N_TILES
            assert_bit_identical(job.open(), expected)
            assert_bit_identical(xr.open_zarr(data / "surveys" / f"{job.id}.zarr"), expected)
            assert "date_completed" in job.open().attrs
    assert executed["template creation"] == executed.get("template renamed", 0) == 0
    assert executed["tile half written"] == 3
    # One worker computes one tile at a time: each death before the last tile repeats at most one tile.
    assert executed["dated, not published"] <= N_TILES + 4
    assert faults.executions().total() == executed.get("all tiles done", executed["dated, not published"])
    assert set(faults.executions()) == set(range(N_TILES))


@deep
def test_a_refined_survey_of_a_service_that_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed among its tiles and in a further round, it has the bytes of a run here, and the values of other tiles."""
    faults, port, data = Faults(tmp_path), free_port(), tmp_path / "data"
    job = None
    with client_of(port) as client:
        for count in (4, 8):
            faults.inject(IN_PROCESS, FEW_AUDITED, STATUS_HALF_WRITTEN.format(count))
            with killing_itself(port, data, faults, count):
                job = job or wait_until(lambda: try_to_submit(client, BOUNDED))
        faults.inject(IN_PROCESS, FEW_AUDITED)
        with server(data, port, settings=faults.environment):
            job.wait()
    monkeypatch.setattr("gear_rattle.workers.survey.refined.rounds.FIRST_AUDIT_FACTOR", SPARE)
    run_survey(BOUNDED, out=tmp_path / "here.zarr").close()
    assert written_in(data / "surveys" / f"{job.id}.zarr") == written_in(tmp_path / "here.zarr")
    other = run_survey(BOUNDED, tile={"delta": 96, "epsilon": 64})
    with open_survey(tmp_path / "here.zarr") as here:
        xr.testing.assert_identical(here.drop_attrs(), other.drop_attrs())


@contextmanager
def killing_itself(port: int, data: Path, faults: Faults, when: object) -> Iterator[None]:
    """Run a service that must have killed itself by the end of the context."""
    process = start("serve", "--port", str(port), "--data", str(data), settings=faults.environment)
    try:
        yield
        assert process.wait(timeout=HANG) == -signal.SIGKILL, when
    finally:
        process.kill()
        process.wait()


def try_to_submit(client: Client, request: SurveyRequest) -> Any:
    try:
        return client.submit(request)
    except ServiceError:  # the service does not listen yet
        return None


#: A survey whose curves are never traced.
ENDLESS = "endless"
ENDLESS_CURVES = """
    @patch("gear_rattle.workers.survey.template")
    def endless(template):
        def act(request, created=None):
            if request.name == "endless":
                note(f"tracing {os.getpid()}")
                while True:
                    time.sleep(0.01)
        before(template, "template_of", act)
"""


@pytest.fixture(scope="module")
def faults(tmp_path_factory: pytest.TempPathFactory) -> Faults:
    faults = Faults(tmp_path_factory.mktemp("faults"))
    faults.inject(ENDLESS_CURVES)
    return faults


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def service(data: Path, faults: Faults) -> Iterator[tuple[Client, int]]:
    port = free_port()
    with server(data, port, "--workers", "2", settings=faults.environment) as process, client_of(port) as client:
        yield client, process.pid


def test_a_dismissal_ends_the_work_and_a_deletion_the_store(
    service: tuple[Client, int], data: Path, faults: Faults
) -> None:
    client, pid = service
    mine = data / "surveys" / "mine.zarr" / "zarr.json"
    mine.parent.mkdir()
    mine.write_text("not of the database")
    faults.hold(0)
    job = client.submit(REQUEST)
    store = data / "surveys" / f"{job.id}.zarr"
    wait_until(lambda: faults.executions().total() == 2)  # two tiles run, and do not end
    at_work = [each.pid for each in workers_of(pid)]
    assert len(at_work) == 2
    job.delete()
    wait_until(lambda: not any(psutil.pid_exists(each) for each in at_work))
    assert store.exists()
    wait_until(lambda: deleted(job))
    assert not store.exists()

    faults.release()
    following = client.submit(REQUEST).wait()
    assert following.document["tiles_done"] == N_TILES
    assert faults.executions().total() == 2 + N_TILES
    assert not store.exists()
    assert mine.read_text() == "not of the database"


def deleted(job: Any) -> bool:
    try:
        job.delete()
    except ResponseError as error:
        if error.status != 409:  # 409: its last tiles are still being stopped
            raise
        return False
    return True


def test_a_survey_that_is_being_prepared_can_be_dismissed(service: tuple[Client, int], faults: Faults) -> None:
    """An earlier version traced the curves for minutes in the thread that manages all surveys."""
    client, pid = service
    job = client.submit(REQUEST.model_copy(update={"name": ENDLESS}), force=True)
    wait_until(lambda: faults.notes("tracing"))
    (tracing,) = map(int, faults.notes("tracing"))
    assert tracing in {each.pid for each in workers_of(pid)}
    job.delete()
    wait_until(lambda: not psutil.pid_exists(tracing))
    wait_until(lambda: deleted(job))
    assert client.submit(REQUEST, force=True).wait().state == "successful"
    assert len(faults.notes("tracing")) == 1  # the curves were not traced a second time


def test_a_damaged_root_is_mended_on_request(
    service: tuple[Client, int], data: Path, faults: Faults, expected: dict[str, np.ndarray]
) -> None:
    """An earlier version verified such a store as successful, and its repair rewrote every chunk in another type."""
    client, _ = service
    job = client.submit(REQUEST, force=True).wait()
    root = data / "surveys" / f"{job.id}.zarr" / "zarr.json"
    before, document = faults.executions(), json.loads(root.read_bytes())
    document["consolidated_metadata"]["metadata"]["quiet_fraction"] |= {"data_type": "int64", "fill_value": 0}
    root.write_text(json.dumps(document))
    job.verify()
    assert job.wait().state == "successful"
    assert_bit_identical(xr.open_zarr(root.parent), expected)
    root.write_text("{}")
    job.verify()
    assert job.wait().state == "successful"
    assert_bit_identical(xr.open_zarr(root.parent), expected)
    assert faults.executions() == before


def test_damage_is_repaired_on_request(
    service: tuple[Client, int], data: Path, faults: Faults, expected: dict[str, np.ndarray]
) -> None:
    client, _ = service
    job = client.submit(REQUEST).wait()
    store = data / "surveys" / f"{job.id}.zarr"
    before = faults.executions()
    (store / "attractor_phase" / "c" / "0" / "1" / "2").write_bytes(b"not what was written")
    (store / "orbit_stable" / "c" / "0" / "3" / "3").unlink()
    assert job.verify().state == "accepted"
    assert job.wait().document["tiles_done"] == N_TILES
    assert_bit_identical(xr.open_zarr(store), expected)
    assert faults.executions() - before == {6: 1, 15: 1}
    job.verify().wait()
    assert (faults.executions() - before).total() == 2

    job.delete()
    with pytest.raises(ResponseError) as refused:
        job.verify()
    assert refused.value.status == 404
