"""A front end without a cluster, for tests of what it answers: accepted surveys stay accepted."""

import pickle
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from anyio import to_process, to_thread
from fastapi import FastAPI
from fastapi.testclient import TestClient
from waiting import HANG
from written import write_tile

from gear_rattle.service.access import keys
from gear_rattle.service.app import create_app
from gear_rattle.service.database import DoneTile
from gear_rattle.service.database.tables import Scope
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.operations import processes
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest, compute_tile, create_store, tiles_of

HERE = "http://127.0.0.1:8000"
BODY: dict[str, Any] = {
    "name": "small",
    "delta": {"start": 0.5, "stop": 0.7, "num": 6},
    "epsilon": {"start": 0.05, "stop": 0.15, "num": 4},
    "initial_conditions": {"count": 4},
    "tile": {"delta": 3, "epsilon": 2},
}
NOBODY = ("203.0.113.7", 40000)


@contextmanager
def no_cluster() -> Iterator[Any]:
    """A cluster that cannot be reached."""
    raise UnavailableError("there is no cluster in this test")
    yield


class IdleClient:
    """Enough of a dask client for surveys that never get to it."""

    status = "running"


@contextmanager
def idle_cluster() -> Iterator[Any]:
    """A cluster that is there."""
    yield IdleClient()


async def run_here(compute: Callable[..., Any], *arguments: Any, limiter: Any, **_: Any) -> Any:
    """Instead of `anyio.to_process.run_sync`: in a thread, with all that would be sent to a process and back."""

    def work() -> bytes:
        called, given = pickle.loads(sent)
        return pickle.dumps(called(*given))

    sent = pickle.dumps((compute, arguments))
    return pickle.loads(await to_thread.run_sync(work, limiter=limiter))


@contextmanager
def points_in(process: Any) -> Iterator[None]:
    """Replace the module that computes points: `anyio.to_process`, or `IN_A_THREAD`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "to_process", process)
        yield


#: Where it is not tested that a point has a process of its own: to start one takes longer than most points.
IN_A_THREAD = SimpleNamespace(run_sync=run_here)


@contextmanager
def front_end(data: Path, *, points: Any = to_process, **settings: Any) -> Iterator[TestClient]:
    """A client of an application with these settings, without a cluster; points may take as long as they like, and
    processes for them start when they are asked for.
    """
    limits = {"max_point_seconds": HANG, "preload": False} | settings
    with points_in(points), local_client(create_app(Settings(data=data, **limits), no_cluster)) as client:
        yield client


def local_client(app: FastAPI) -> TestClient:
    """A client on this machine, of whom no key is asked."""
    return TestClient(app, HERE, raise_server_exceptions=False, client=("127.0.0.1", 50000))


def front_of(client: TestClient) -> ApplicationState:
    """Return the state that the routes of this application share."""
    front: ApplicationState = client.app.state.front
    return front


def key(client: TestClient, scope: Scope = Scope.SUBMIT, **quotas: int) -> dict[str, str]:
    """Headers with a new key."""
    _, token = keys.add_key(front_of(client).database, "somebody", scope, **quotas)
    return {"Authorization": f"Bearer {token}"}


def submit(client: TestClient, headers: dict[str, str], **changes: Any) -> str:
    response = client.post("/v1/surveys?force=true", json=BODY | changes, headers=headers)
    assert response.status_code == 202, response.text
    return str(response.json()["id"])


def compute(front: ApplicationState, survey_id: str, request: SurveyRequest, tiles: slice = slice(None)) -> None:
    """Compute tiles of an accepted survey, as its workers would."""
    store = front.directory.store(survey_id)
    create_store(request, store)
    for tile in tiles_of(request)[tiles]:
        write_tile(request, str(store), tile, compute_tile(request, tile)[0])
        front.database.add_tile(survey_id, DoneTile(tile.index, tile.n_cells, 0.5, 0, []))


@contextmanager
def peer(client: TestClient, address: tuple[str, int]) -> Iterator[TestClient]:
    """The same application, asked from another address."""
    yield TestClient(client.app, HERE, raise_server_exceptions=False, client=address)


#: How the stable codes of errors are written.
CODE = "[a-z]+(_[a-z]+)*"


def assert_problem(response: Any, status: int, *words: str, code: str = "") -> dict[str, Any]:
    """Return the problem document of a response, which must be complete, have this code, and mention the words."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = response.json()
    assert problem["status"] == status
    assert problem["type"] == "about:blank"
    assert problem["title"]
    assert problem["code"] == code if code else re.fullmatch(CODE, problem["code"]), problem
    assert len(problem["detail"]) > 10
    text = problem["detail"] + " ".join(item["field"] + item["message"] for item in problem["errors"])
    for word in words:
        assert word in text, (word, problem)
    return problem
