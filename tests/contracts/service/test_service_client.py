"""What the Python client does by itself, against a service that never ends a survey."""

from collections.abc import Iterator

import httpx
import pytest

import service.client
from service.client import Client, Document, Job
from service.errors import ServiceError, WaitTimeoutError
from service.web.examples import DETAIL, SURVEY

DOCUMENT = {**DETAIL, "state": "running", "progress": 40}


class Clock:
    """Time that passes by sleep alone."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def job() -> Iterator[Job]:
    http = httpx.Client(
        transport=httpx.MockTransport(lambda _: httpx.Response(200, json=DOCUMENT)), base_url="http://service"
    )
    with Client(http=http) as client:
        yield Job(client, DOCUMENT)


@pytest.mark.parametrize("timeout", [0.0, 0.5, 30.0])
def test_who_waits_can_say_for_how_long(job: Job, timeout: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service.client, "time", clock := Clock())
    told: list[Document] = []
    with pytest.raises(WaitTimeoutError, match=f"is running after {timeout:g} s") as raised:
        job.wait(told.append, timeout=timeout)
    assert isinstance(raised.value, TimeoutError)
    assert isinstance(raised.value, ServiceError)
    assert clock.now == timeout
    assert [each["progress"] for each in told] == [40] * len(told)
    assert bool(told) == (timeout > 0)


def test_a_job_shows_itself(job: Job) -> None:
    assert repr(job) == f"<survey {DOCUMENT['id']}: running, 40 %>"
    assert "<th>progress</th><td>40</td>" in job._repr_html_()
    assert "<th>cells</th><td>3660</td>" in Job(job._client, SURVEY)._repr_html_()
    assert "<script>" not in Job(job._client, {**DOCUMENT, "id": "<script>"})._repr_html_()
