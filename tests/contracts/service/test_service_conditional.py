"""Nothing is sent twice to who has it, and nothing old is ever taken for new."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from depth import either
from fastapi.testclient import TestClient
from httpx import Headers
from service_support import BODY, IN_A_THREAD, front_end, front_of
from written import write_tile

from gear_rattle.service.database import DoneTile
from gear_rattle.service.database.tables import State
from gear_rattle.service.routes.model import points
from gear_rattle.service.web import conditional
from gear_rattle.workers import SurveyRequest, compute_tile, create_store, finish_store, tiles_of

HOUR = "max-age=3600"
POINT = "/v1/orbits?delta=0.6&epsilon=0.1"
FIELDS = BODY | {"quantities": ["region"]}  # with all of them a file for download takes a second


pytestmark = pytest.mark.usefixtures("templates_once")


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), points=IN_A_THREAD, max_jobs=100) as client:
        yield client


@pytest.fixture
def running(client: TestClient) -> str:
    """Path of a survey at work, one of whose four tiles is done."""
    request = SurveyRequest(**FIELDS)
    survey_id = client.post("/v1/surveys?force=true", json=FIELDS).json()["id"]
    create_store(request, front_of(client).directory.store(survey_id))
    front_of(client).database.set_state(survey_id, State.RUNNING)
    add_tile(client, survey_id, 0)
    return f"/v1/surveys/{survey_id}"


def add_tile(client: TestClient, survey_id: str, index: int) -> None:
    request, front = SurveyRequest(**FIELDS), front_of(client)
    tile = tiles_of(request)[index]
    write_tile(request, str(front.directory.store(survey_id)), tile, compute_tile(request, tile)[0])
    front.database.add_tile(survey_id, DoneTile(index, tile.n_cells, 0.1, 0, []))


def finish(client: TestClient, path: str) -> None:
    survey_id = path.rsplit("/", 1)[1]
    for index in range(1, 4):
        add_tile(client, survey_id, index)
    finish_store(front_of(client).directory.store(survey_id))
    front_of(client).database.set_state(survey_id, State.SUCCESSFUL)


def fresh(client: TestClient, url: str) -> Headers:
    """The headers of an answer; with its ETag, and with HEAD, the answer has no body and the same header."""
    full = client.get(url)
    assert full.status_code == 200, full.text
    head = client.head(url)
    assert (head.status_code, head.content) == (200, b"")
    tag = full.headers["etag"]
    every = (f'"other", {tag}', tag, tag.removeprefix("W/"), f"W/{tag.removeprefix('W/')}")
    for known in every if ".png" not in url else either(every[:1], every):  # a picture is drawn each time
        same = client.get(url, headers={"If-None-Match": known})
        assert (same.status_code, same.content) == (304, b""), known
        assert "content-type" not in same.headers
        for answer in (same, head):
            for name in ("etag", "cache-control"):
                assert answer.headers[name] == full.headers[name]
    others = (tag[:-2] + '"', '"other"', "")
    # A picture to who has another one: in the test of what was damaged.
    for other in others if ".png" not in url else either((), others):
        assert client.get(url, headers={"If-None-Match": other}).content == full.content
    assert head.headers["content-length"] == str(len(full.content))
    return full.headers


def test_documents_change_their_tag_with_every_tile(client: TestClient, running: str) -> None:
    urls = [running, "/v1/surveys", "/v1/surveys?limit=1", f"{running}/map.png", f"{running}/map.png?variable=status"]
    before = [fresh(client, url)["etag"] for url in urls]
    assert len(set(before)) >= 4
    add_tile(client, running.rsplit("/", 1)[1], 1)
    after = [fresh(client, url) for url in urls]
    assert all(old != new["etag"] for old, new in zip(before, after, strict=True))
    assert {each["cache-control"] for each in after} == {"no-cache"}


def test_a_finished_survey_is_cached_for_an_hour_a_running_one_never(client: TestClient, running: str) -> None:
    fixed = [f"{running}/store/zarr.json", f"{running}/store/status/c/0/0", f"{running}/map.png"]
    before = [fresh(client, url) for url in fixed]
    assert {each["cache-control"] for each in before} == {"no-cache"}
    finish(client, running)
    assert fresh(client, fixed[0])["etag"] != before[0]["etag"]  # dated when it was finished
    assert [client.get(url).headers["cache-control"] for url in fixed] == [HOUR, HOUR, "no-cache"]
    assert client.get(running).headers["cache-control"] == "no-cache"  # it may be deleted
    missing = client.get(f"{running}/store/status/c/9/9")
    assert missing.status_code == 404
    assert "cache-control" not in missing.headers


def test_what_was_damaged_is_not_kept_after_its_repair(client: TestClient, running: str) -> None:
    finish(client, running)
    chunk, picture = f"{running}/store/region/c/0/0", f"{running}/map.png"
    survey_id = running.rsplit("/", 1)[1]
    file = front_of(client).directory.store(survey_id) / "region" / "c" / "0" / "0"
    content = file.read_bytes()
    whole = client.get(picture).content
    file.write_bytes(content[::-1])
    damaged = client.get(chunk)
    file.unlink()  # a picture shows nothing there
    lost = client.get(picture)
    assert lost.content != whole
    assert "immutable" not in damaged.headers["cache-control"]
    assert lost.headers["cache-control"] == "no-cache"
    assert client.post(f"{running}/verify").status_code == 202
    file.write_bytes(content)
    again = client.get(chunk, headers={"If-None-Match": damaged.headers["etag"]})
    assert (again.status_code, again.content) == (200, content)
    assert client.get(picture, headers={"If-None-Match": lost.headers["etag"]}).content == whole


def test_dates_count_only_once_nothing_changes(client: TestClient, running: str) -> None:
    later = {"If-Modified-Since": "Fri, 31 Dec 2100 23:59:59 GMT"}
    urls = [running, f"{running}/store/zarr.json"]
    assert [client.get(url, headers=later).status_code for url in urls] == [200, 200]
    finish(client, running)
    for url in urls:
        date = client.get(url).headers["last-modified"]
        assert client.get(url, headers={"If-Modified-Since": date}).status_code == 304
        assert client.get(url, headers={"If-Modified-Since": "Fri, 01 Jan 2021 00:00:00 GMT"}).status_code == 200
        assert client.get(url, headers={"If-Modified-Since": date, "If-None-Match": '"other"'}).status_code == 200
    for nonsense in ("yesterday", "Fri, 31 Dec 2100 23:59:59", "\x00"):
        assert client.get(running, headers={"If-Modified-Since": nonsense}).status_code == 200


def test_ranges_of_what_has_changed_are_sent_whole(client: TestClient, running: str) -> None:
    url = f"{running}/store/zarr.json"
    whole = client.get(url)
    part = {"Range": "bytes=0-3"}
    assert client.get(url, headers=part | {"If-Range": whole.headers["etag"]}).content == whole.content[:4]
    finish(client, running)
    changed = client.get(url, headers=part | {"If-Range": whole.headers["etag"]})
    assert changed.status_code == 200
    assert changed.content != whole.content


def test_a_point_is_not_computed_for_who_has_it(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    urls = [POINT, "/v1/attractors?delta=0.6&epsilon=0.1&count=4", "/v1/curves?delta_min=0.6&delta_max=0.61"]
    urls.append("/v1/basins.png?delta=0.6&epsilon=0.1&resolution=10")
    tags = [fresh(client, url)["etag"] for url in urls]
    assert len(set(tags)) == 4
    assert not any(tag.startswith("W/") for tag in tags)
    assert fresh(client, f"{POINT}&beta=0.5")["etag"] != tags[0]

    def compute(*_: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(points, "orbits_document", compute)
    assert client.get(POINT, headers={"If-None-Match": tags[0]}).status_code == 304
    assert client.get(POINT).status_code == 500
    conditional._hash_of_all_code.cache_clear()
    monkeypatch.setattr(conditional, "code_version", lambda: "of tomorrow")
    assert client.get(POINT, headers={"If-None-Match": tags[0]}).status_code == 500
    conditional._hash_of_all_code.cache_clear()


def test_an_answer_is_sent_again_after_a_change_of_any_part_of_the_service(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert {"routes/model/verdict.py", "operations/points.py"} <= {
        str(each.relative_to(conditional.SERVICE)) for each in conditional.SERVICE.rglob("*.py")
    }
    tag = fresh(client, POINT)["etag"]
    for folder in ("routes", "operations"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "changed.py").write_text("CHANGED = True")
        monkeypatch.setattr(conditional, "SERVICE", tmp_path)
        conditional._hash_of_all_code.cache_clear()
        answer = client.get(POINT, headers={"If-None-Match": tag})
        assert answer.status_code == 200
        tag, before = answer.headers["etag"], tag
        assert tag != before
    conditional._hash_of_all_code.cache_clear()


def test_any_tag_is_that_of_whatever_is_there(client: TestClient, running: str) -> None:
    names = ("", "/map.png", *either((), ("/download.nc",)), "/download.csv", "/store/zarr.json", "/store/status/c/0/0")
    urls = [*(f"{running}{name}" for name in names), "/v1/surveys", POINT, "/v1/notebook?delta=0.6&epsilon=0.1"]
    urls.append("/v1/basins.png?delta=0.6&epsilon=0.1&resolution=10")
    for url in urls:
        whole = client.get(url)
        for answer in (
            client.get(url, headers={"If-None-Match": "*"}),
            client.head(url, headers={"If-None-Match": " * "}),
            client.get(url, headers={"If-None-Match": "*", "Range": "bytes=0-3"}),
        ):
            assert (answer.status_code, answer.content) == (304, b""), url
            assert {name: answer.headers.get(name) for name in ("etag", "cache-control")} == {
                name: whole.headers[name] for name in ("etag", "cache-control")
            }
            assert "content-type" not in answer.headers
    refused = {f"{running}/map.png?variable=x": 422, "/v1/orbits?delta=-1&epsilon=0.1": 422, "/v1/surveys/x": 404}
    for url, status in (refused | {f"{running}/store/x": 404, "/v1/health": 200}).items():
        assert client.get(url, headers={"If-None-Match": "*"}).status_code == status, url


def test_refusals_carry_no_tag(client: TestClient) -> None:
    for url in ("/v1/orbits?delta=-1&epsilon=0.1", "/v1/surveys/x", "/v1/attractors?delta=1&epsilon=1&count=999999"):
        refused = client.get(url)
        assert refused.status_code in (404, 422)
        assert "etag" not in refused.headers


def test_head_of_an_event_stream_ends(client: TestClient, running: str) -> None:
    head = client.head(f"{running}/events")
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"].startswith("text/event-stream")
