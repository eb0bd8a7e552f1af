"""The service below a path: who says which, and that nobody else can."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from pydantic import ValidationError
from service_support import BODY, front_end

from gear_rattle.service.settings import Settings

BELOW = {"X-Forwarded-Prefix": "/rattle"}


@pytest.fixture(scope="module")
def trusting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), behind_proxy=True, insecure=True, explorer=False) as client:
        yield client


def self_of(client: TestClient, headers: dict[str, str], path: str = "/v1/surveys") -> str:
    answer = client.post(f"{path}?force=true", json=BODY, headers=headers)
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == answer.json()["links"]["self"]
    return str(answer.json()["links"]["self"])


@pytest.mark.parametrize("path", ["/v1/surveys", "/rattle/v1/surveys"])  # removed by the proxy, or not
def test_a_trusted_proxy_says_the_path(trusting: TestClient, path: str) -> None:
    assert self_of(trusting, BELOW, path).startswith("/rattle/v1/surveys/")
    assert self_of(trusting, {}).startswith("/v1/surveys/")  # of each request its own


@pytest.mark.parametrize(
    "said", ["//evil.example", "https://evil.example", "/a/../b", "rattle", "/a b", "/a,/b", "/%2f"]
)
def test_what_is_no_path_counts_for_nothing(trusting: TestClient, said: str) -> None:
    assert self_of(trusting, {"X-Forwarded-Prefix": said}).startswith("/v1/surveys/")


def test_a_slash_at_the_end_is_the_same_path(trusting: TestClient) -> None:
    assert self_of(trusting, {"X-Forwarded-Prefix": "/apps/rattle/"}).startswith("/apps/rattle/v1/")
    found = trusting.get("/rattle?a=b", headers=BELOW, follow_redirects=False)
    assert found.headers["location"] == "/rattle/?a=b"


def test_without_a_proxy_nobody_says_a_path(tmp_path: Path) -> None:
    with front_end(tmp_path, insecure=True, explorer=False) as client:
        assert self_of(client, BELOW).startswith("/v1/surveys/")
        assert client.get("/rattle/v1/health", headers=BELOW).status_code == 404


def test_the_setting_wins(tmp_path: Path) -> None:
    with front_end(tmp_path, behind_proxy=True, insecure=True, explorer=False, root_path="/mine/") as client:
        assert self_of(client, BELOW).startswith("/mine/v1/surveys/")
        assert client.get("/mine/openapi.json").json()["servers"] == [{"url": "/mine"}]
        assert client.get("/mine/mine/v1/health").status_code == 404


def test_a_key_is_asked_below_a_path_too(tmp_path: Path) -> None:
    with front_end(tmp_path, require_keys=True, explorer=False, root_path="/rattle") as client:
        for path in ("/v1/surveys", "/rattle/v1/surveys"):
            assert client.get(path).status_code == 401
        for path in ("/v1/health", "/rattle/v1/health", "/rattle/openapi.json"):
            assert client.get(path).status_code == 200
        assert client.get("/rattle/rattle/v1/health").status_code == 401  # no path of ours, and not open


@pytest.mark.parametrize("given", ["rattle", "//host", "/a/../b", "/a?b", "https://host"])
def test_a_root_path_is_a_path(given: str) -> None:
    with pytest.raises(ValidationError, match="write the path like /rattle"):
        Settings(root_path=given)
