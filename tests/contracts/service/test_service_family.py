"""One family of a survey whose service asks for a key."""

import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from gear_rattle.service.client import Client, Job
from gear_rattle.service.results import open_family
from gear_rattle.service.web.examples import SURVEY
from gear_rattle.workers import (
    SurveyRequest,
    create_store,
    finish_store,
    join_attractors_of_survey,
    place_of,
    run_tiles_in_this_process,
    tiles_of,
)
from gear_rattle.workers import open_family as open_stored
from rattle import RattleError

KEY = "rattle_key"
REQUEST = SurveyRequest.model_validate(
    {
        "delta": {"start": 0.42, "stop": 0.46, "num": 4},
        "epsilon": {"start": 0.1, "stop": 0.12, "num": 4},
        "quantities": ["attractors", "lyapunov", "families"],
        "initial_conditions": {"count": 4},
    }
)


class Guarded(SimpleHTTPRequestHandler):
    """Files for who has the key."""

    def do_GET(self) -> None:
        if self.headers.get("Authorization") != f"Bearer {KEY}":
            self.send_error(401)
        else:
            super().do_GET()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "v1" / "surveys" / SURVEY["id"] / "store"
    path.parent.mkdir(parents=True)
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, tiles_of(REQUEST), lambda _: None, lambda: False)
    with place_of(path).lock_for_writing():
        join_attractors_of_survey(REQUEST, path)
    finish_store(path)
    return path


@pytest.fixture
def url(store: Path) -> Iterator[str]:
    files = partial(Guarded, directory=str(store.parents[3]))
    with ThreadingHTTPServer(("127.0.0.1", 0), files) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_family_is_opened_with_the_key(store: Path, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = open_stored(store, 0).load()
    with Client(url, key=KEY) as client:
        assert Job(client, SURVEY).open_family(0).load().identical(stored)
        with pytest.raises(RattleError, match="use a number from 0 to"):
            Job(client, SURVEY).open_family(99)
    monkeypatch.setenv("RATTLE_API_KEY", KEY)
    address = f"{url}/v1/surveys/{SURVEY['id']}/store"
    assert open_family(address, 0).load().identical(stored)
    monkeypatch.delenv("RATTLE_API_KEY")
    with pytest.raises(RattleError, match="no survey can be opened"):
        open_family(address, 0)
