"""Names and notes of surveys: who may change them, and what does not change with them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of, key, submit
from typer.testing import CliRunner

from gear_rattle.service import cli
from gear_rattle.service.client import Client
from gear_rattle.service.database.tables import State
from gear_rattle.service.errors import ServiceError
from gear_rattle.service.explorer.common.address import View
from gear_rattle.service.explorer.common.news import JobStatus
from gear_rattle.service.explorer.page.rows import survey_row

NOTES = (
    "Regions agree with Figure 7.\n\tδ below 0.5\u00a0is still to be looked at, from 1\u202f000 cells.\n"
    "\u9818\u57df\u3000\u5468\u671f \U0001f468\u200d\U0001f52c"
)
UNPRINTABLE = "\x00\x0b\x0c\x1c\x1d\x1e\x7f\x85\ue000\uffff"
UNSEEN = "\u202e\u2066\u200f\u200b\u00ad\u2060\ufeff\u2028\U000e0041"  # directions, zero width, separators, tags


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("names"), require_keys=True, explorer=False, max_jobs=100) as client:
        yield client


@pytest.mark.parametrize("ended", [False, True])
def test_a_survey_gets_another_name_and_notes_at_any_time(client: TestClient, ended: bool) -> None:
    mine = key(client)
    survey_id = submit(client, mine)
    path = f"/v1/surveys/{survey_id}"
    if ended:
        front_of(client).database.set_state(survey_id, State.SUCCESSFUL)
    before = client.get(path, headers=mine)
    events = [event.id for event in front_of(client).database.events(survey_id, 0)]
    assert (before.json()["name"], before.json()["notes"]) == ("small", "")

    renamed = client.patch(path, json={"name": "Figure 7"}, headers=mine).json()
    assert (renamed["name"], renamed["notes"]) == ("Figure 7", "")
    noted = client.patch(path, json={"notes": NOTES}, headers=mine)
    assert noted.json() == before.json() | {"name": "Figure 7", "notes": NOTES}
    assert client.get("/v1/surveys", headers=mine).json()["surveys"][0]["notes"] == NOTES
    known = {"If-Modified-Since": before.headers.get("last-modified", "Fri, 31 Dec 2100 23:59:59 GMT")}
    assert client.get(path, headers=mine | known).json()["notes"] == NOTES
    assert [event.id for event in front_of(client).database.events(survey_id, 0)] == events  # nothing happened to it
    assert client.patch(path, json={"notes": ""}, headers=mine).json()["notes"] == ""


def test_only_the_key_that_submitted_a_survey_names_it(client: TestClient) -> None:
    mine, yours = key(client), key(client)
    path = f"/v1/surveys/{submit(client, mine)}"
    assert_problem(client.patch(path, json={"name": "ours"}, headers=yours), 403, code="forbidden")
    assert client.get(path, headers=yours).json()["name"] == "small"
    assert_problem(client.patch("/v1/surveys/none", json={"name": "x"}, headers=mine), 404)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"name": "a\nb"}, "cannot be printed"),
        *(({"notes": f"a{each}b"}, "cannot be printed") for each in UNPRINTABLE + UNSEEN),
        *(({"name": f"a{each}b"}, f"U+{ord(each):04X}") for each in UNSEEN),
        ({"name": "x" * 201}, "200"), ({"notes": "x" * 10_001}, "10000"), ({"state": "failed"}, "state"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown_is_refused(client: TestClient, body: dict[str, str], words: str) -> None:
    mine = key(client)
    path = f"/v1/surveys/{submit(client, mine)}"
    assert_problem(client.patch(path, json=body, headers=mine), 422, words)


def test_the_same_survey_is_found_whatever_it_is_called(client: TestClient) -> None:
    mine = key(client)
    survey_id = submit(client, mine)
    client.patch(f"/v1/surveys/{survey_id}", json={"name": "another", "notes": NOTES}, headers=mine)
    again = client.post("/v1/surveys", json=BODY, headers=mine).json()
    assert (again["id"], again["name"]) == (survey_id, "another")


def test_the_client_and_the_command_describe_a_survey(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with front_end(tmp_path, explorer=False) as http:
        job = Client(http=http).submit(BODY)
        assert job.describe(notes=NOTES).document["notes"] == NOTES
        assert job.document["name"] == "small"
        with pytest.raises(ServiceError, match="cannot be printed"):
            job.describe("\t")
        monkeypatch.setattr("gear_rattle.service.client.Client.close", lambda _: None)
        monkeypatch.setattr("gear_rattle.service.client.httpx.Client", lambda **_: http)
        said = [
            CliRunner().invoke(cli.app, ["describe", job.id, *given]).output for given in (["--name", "Figure 7"], [])
        ]
        assert said == [f"Figure 7\n{NOTES}\n"] * 2
        stored = front_of(http).database.job(job.id)
        row = survey_row(JobStatus(stored, None, None), View(), is_owned=True)
        assert (row["name"], row["title"], row["notes"]) == ("Figure 7", "Figure 7", NOTES)
