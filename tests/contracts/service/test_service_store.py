"""The store over HTTP gives what zarr asks for, and nothing else of the disk."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from service_support import BODY, assert_problem, front_end, front_of

from gear_rattle.service.database.tables import State

CHUNK = bytes(range(64))


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture(scope="module")
def store(client: TestClient) -> tuple[str, Path]:
    """URL and path of the store of a survey at work."""
    survey_id = client.post("/v1/surveys", json=BODY).json()["id"]
    front_of(client).database.set_state(survey_id, State.RUNNING)
    path = front_of(client).directory.store(survey_id)
    (path / "region" / "c" / "0").mkdir(parents=True)
    (path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group"}')
    (path / "region" / "c" / "0" / "0").write_bytes(CHUNK)
    (path / "region" / "c" / "0" / "1.partial").write_bytes(CHUNK)
    (path / ".hidden").write_text("secret")
    (path.parent.parent / "outside").write_text("secret")
    (path / "link").symlink_to(path.parent.parent / "outside")
    (path / "linked").symlink_to(path.parent.parent)
    return f"/v1/surveys/{survey_id}/store", path


def test_metadata_and_chunks_are_served(client: TestClient, store: tuple[str, Path]) -> None:
    url, path = store
    metadata = client.get(f"{url}/zarr.json")
    assert metadata.content == (path / "zarr.json").read_bytes()
    assert metadata.headers["content-type"] == "application/json"
    chunk = client.get(f"{url}/region/c/0/0")
    assert chunk.content == CHUNK
    assert chunk.headers["content-type"] == "application/octet-stream"
    head = client.head(f"{url}/region/c/0/0")
    assert (head.content, head.headers["content-length"]) == (b"", str(len(CHUNK)))


@pytest.mark.parametrize(
    ("wanted", "expected"), [("bytes=2-4", CHUNK[2:5]), ("bytes=60-", CHUNK[60:]), ("bytes=-3", CHUNK[-3:])]
)
def test_ranges_are_served(client: TestClient, store: tuple[str, Path], wanted: str, expected: bytes) -> None:
    part = client.get(f"{store[0]}/region/c/0/0", headers={"Range": wanted})
    assert (part.status_code, part.content) == (206, expected)


def test_a_range_beyond_the_end_is_a_problem(client: TestClient, store: tuple[str, Path]) -> None:
    refused = client.get(f"{store[0]}/region/c/0/0", headers={"Range": "bytes=64-70"})
    assert_problem(refused, 416)
    assert refused.headers["content-range"] == "bytes */64"


def test_a_running_survey_is_revalidated_and_a_finished_one_cached(client: TestClient, store: tuple[str, Path]) -> None:
    url, _ = store
    running = client.get(f"{url}/region/c/0/0")
    assert running.headers["cache-control"] == "no-cache"
    same = client.get(f"{url}/region/c/0/0", headers={"If-None-Match": running.headers["etag"]})
    assert (same.status_code, same.content) == (304, b"")


@pytest.mark.parametrize(
    "key",
    [
        "",
        "region",
        "region/",
        "region/c/0/9",
        "region/c/0/1.partial",
        "region//c/0/0",
        ".hidden",
        "link",
        "linked/outside",
        "%2e%2e/%2e%2e/outside",
        "region/%2e%2e/%2e%2e/%2e%2e/outside",
        "..%5c..%5coutside",
        "%2fetc/passwd",
        "zarr.json%00",
        "a" * 300,
        "a/" * 3000 + "a",
        "ü",
    ],
)
def test_other_keys_are_not_found(client: TestClient, store: tuple[str, Path], key: str) -> None:
    for answer in (client.get(f"{store[0]}/{key}"), client.head(f"{store[0]}/{key}")):
        assert answer.status_code == 404
        assert "secret" not in answer.text


@pytest.mark.parametrize("survey_id", ["x", "..", "%2e%2e", "..%2fsurveys", "*"])
def test_other_surveys_have_no_store(client: TestClient, store: tuple[str, Path], survey_id: str) -> None:
    assert store[1].exists()
    assert_problem(client.get(f"/v1/surveys/{survey_id}/store/zarr.json"), 404)


def test_a_survey_that_waits_has_no_store_and_no_picture(client: TestClient) -> None:
    survey_id = client.post("/v1/surveys?force=true", json=BODY).json()["id"]
    assert_problem(client.get(f"/v1/surveys/{survey_id}/store/zarr.json"), 404)
    assert_problem(client.get(f"/v1/surveys/{survey_id}/map.png"), 404, "accepted")
