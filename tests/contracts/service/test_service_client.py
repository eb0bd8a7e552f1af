"""The Python client by itself, against a service that never ends a survey."""

import json
from collections.abc import Iterator

import httpx
import numpy as np
import pytest

import gear_rattle.service.client
from gear_rattle.service.client import Client, Document, Job
from gear_rattle.service.errors import ServiceError, WaitTimeoutError
from gear_rattle.service.web.examples import DETAIL, SURVEY

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
    monkeypatch.setattr(gear_rattle.service.client, "time", clock := Clock())
    told: list[Document] = []
    with pytest.raises(WaitTimeoutError, match=f"is running after {timeout:g} s") as raised:
        job.wait(told.append, timeout=timeout)
    assert isinstance(raised.value, TimeoutError)
    assert isinstance(raised.value, ServiceError)
    assert clock.now == timeout
    assert [each["progress"] for each in told] == [40] * len(told)
    assert bool(told) == (timeout > 0)


@pytest.mark.parametrize(("away", "is_lost"), [(60.0, False), (62.0, True)])
def test_a_service_may_be_away_for_so_long_however_long_it_was_silent_before(
    away: float, is_lost: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gear_rattle.service.client, "time", clock := Clock())
    silence = 1000.0  # of the stream, in which nothing happened to the survey

    def answer(request: httpx.Request) -> httpx.Response:
        if silence <= clock.now < silence + away:
            raise httpx.ConnectError("nobody listens")
        if clock.now >= silence + away:
            return httpx.Response(200, json={**DOCUMENT, "state": "successful"})
        if request.url.path.endswith("/events"):
            clock.now = silence
            raise httpx.RemoteProtocolError("peer closed connection")
        return httpx.Response(200, json=DOCUMENT)

    with Client(http=httpx.Client(transport=httpx.MockTransport(answer), base_url="http://service")) as client:
        job = Job(client, DOCUMENT)
        if is_lost:
            with pytest.raises(ServiceError, match="cannot be reached"):
                job.wait(patience=60.0)
        else:
            assert job.wait(patience=60.0).state == "successful"


def test_who_waits_for_a_service_that_is_away_waits_no_longer_than_was_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gear_rattle.service.client, "time", clock := Clock())

    def answer(_: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("nobody listens")

    with Client(http=httpx.Client(transport=httpx.MockTransport(answer), base_url="http://service")) as client:
        with pytest.raises(WaitTimeoutError, match=r"is running after 2\.5 s"):
            Job(client, DOCUMENT).wait(patience=60.0, timeout=2.5)
        assert clock.now == 2.5


MACHINE = {"inertia": 0.003, "drag": 0.0005, "backlash": 1e-4, "radius": 0.05}
AXIS = {"start": 1.0, "stop": 5.0, "num": 4}


@pytest.mark.parametrize(
    ("fields", "sent"),
    [
        ({"delta": (np.float64(1.0), np.float32(5.0), np.int64(4))}, {"delta": AXIS}),
        ({"delta": [1.0, 5.0, 4], "seed": np.int64(3)}, {"delta": AXIS, "seed": 3}),
        ({"machine": MACHINE | {"rpm": (1.0, 5.0, 4)}}, {"machine": MACHINE | {"rpm": AXIS}}),
        ({"delta": (1.0, 5.0)}, {"delta": [1.0, 5.0]}),  # which the service refuses, and says why
    ],
)
def test_what_is_submitted_is_sent_as_json_has_it(fields: Document, sent: Document) -> None:
    got: list[Document] = []

    def answer(request: httpx.Request) -> httpx.Response:
        got.append(json.loads(request.content))
        return httpx.Response(200, json=DOCUMENT)

    with Client(http=httpx.Client(transport=httpx.MockTransport(answer), base_url="http://service")) as client:
        client.submit(**fields)
    assert got == [sent]


@pytest.mark.parametrize("wrong", [{"delta": np.ones(3)}, {"delta": float("nan")}, {"idempotency_key": "é"}])
def test_what_cannot_be_sent_is_an_error_of_the_client(wrong: Document) -> None:
    with Client("http://service.invalid") as client, pytest.raises(ServiceError, match="cannot be sent"):
        client.submit(**wrong)


def test_a_job_shows_itself(job: Job) -> None:
    assert repr(job) == f"<survey {DOCUMENT['id']}: running, 40 %>"
    assert "<th>progress</th><td>40</td>" in job._repr_html_()
    assert "<th>cells</th><td>3660</td>" in Job(job._client, SURVEY)._repr_html_()
    assert "<script>" not in Job(job._client, {**DOCUMENT, "id": "<script>"})._repr_html_()
