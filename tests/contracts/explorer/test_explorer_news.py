"""News of the surveys for pages: nobody is told what was so before they came."""

from collections.abc import Sequence
from pathlib import Path

from fastapi.testclient import TestClient
from service_support import BODY, front_end
from waiting import wait_until

from gear_rattle.service.explorer.common.news import JobStatus, Listener, StatusPublisher


def submit(client: TestClient, name: str) -> None:
    assert client.post("/v1/surveys?force=true", json=BODY | {"name": name}).status_code == 202


def test_who_comes_after_the_others_have_left_is_told_of_what_came_meanwhile(tmp_path: Path) -> None:
    """A page keeps to the survey that it finds first, and the newest was missing if nobody had looked for a while."""
    told: dict[str, list[list[str]]] = {"first": [], "second": []}
    with front_end(tmp_path) as client:
        news: StatusPublisher = client.app.state.explorer.news

        def listener(name: str) -> Listener:
            def heard(standings: Sequence[JobStatus]) -> None:
                told[name].append([each.job.name for each in standings])

            return heard

        submit(client, "old")
        first = listener("first")
        client.portal.call(news.add_listener, first)
        wait_until(lambda: told["first"])
        client.portal.call(news.remove_listener, first)
        submit(client, "new")
        client.portal.call(news.add_listener, listener("second"))
        wait_until(lambda: told["second"])
    assert told["first"][0] == ["old"]
    assert told["second"][0] == ["new", "old"]
