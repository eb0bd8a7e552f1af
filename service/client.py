"""A Python client of the service: submit a survey, wait for it with progress, and open the results with xarray.

client = Client("http://127.0.0.1:8000")
job = client.submit(delta=(0.4, 1.0, 61), epsilon=(0.005, 0.3, 60))
job.wait(progress=print)
dataset = job.open()
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import urlsplit

import httpx
from httpx_sse import SSEError, connect_sse

from gear_rattle.service.errors import ResponseError, ServiceError, WaitTimeoutError
from gear_rattle.service.parameters import added_parameters
from gear_rattle.service.results import api_key_headers, open_family, open_results

if TYPE_CHECKING:
    import xarray as xr

    from gear_rattle.workers import AnyRequest, PopulationRequest, SurveyRequest

MACHINE_AXES = ("rpm", "eccentricity")  # the numbers of a machine that may be axes of a survey
AXIS_FIELDS = ("start", "stop", "num")
FINAL = ("successful", "failed", "dismissed")
RECONNECT_SECONDS = 1.0  # seconds until the next attempt to connect
LONGEST_QUOTE = 60  # a message quotes at most this many characters of another program's answer
READ_SECONDS = 60.0  # longest wait for data of an answer; the event stream has several heartbeats in this time

Document = dict[str, Any]
Progress = Callable[[Document], None]


class Client:
    """A connection to a service.

    Parameters
    ----------
    url
        Address of the service, for example ``http://127.0.0.1:8000``.
    http
        An httpx client to use instead of a new one, with its own base URL.
    key
        API key; by default the environment variable ``RATTLE_API_KEY``. The operator of the service at ``url`` sees the
        key, and so does anybody who can read the connection if it is not https.
    """

    def __init__(
        self, url: str = "http://127.0.0.1:8000", http: httpx.Client | None = None, key: str | None = None
    ) -> None:
        self._http = http or httpx.Client(base_url=url, timeout=httpx.Timeout(10.0, read=READ_SECONDS))
        self.headers = api_key_headers(key)

    def __enter__(self) -> Self:
        """Return this client, which the end of the `with` block closes."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the connection."""
        self.close()

    def close(self) -> None:
        """Close the connection. The end of a `with` block also closes it."""
        self._http.close()

    def submit(
        self,
        request: SurveyRequest | Mapping[str, Any] | None = None,
        *,
        idempotency_key: str | None = None,
        force: bool = False,
        **fields: Any,
    ) -> Job:
        """Submit a survey, given as a request or field by field; an axis may be a (start, stop, num) triple.

        The service returns an existing survey if anybody's identical survey is successful, or if your own identical
        survey waits or runs.

        Parameters
        ----------
        request : SurveyRequest | Mapping[str, Any] | None
            The request, or a mapping with its fields.
        idempotency_key : str | None
            A text of your choice. Sending the same request again with the same text creates no second survey.
        force : bool
            Compute the survey again although an identical one exists.
        fields
            Fields of the request, which replace those in `request`.

        Returns
        -------
        Job
            The survey in the service; `wait` for it, then `open` its results.

        Raises
        ------
        ServiceError
            The service refuses the survey, or cannot be reached.
        """
        return self._submit_to("/v1/surveys", _request_body(request, fields), idempotency_key, force)

    def submit_population(
        self,
        request: PopulationRequest | Mapping[str, Any] | None = None,
        *,
        idempotency_key: str | None = None,
        force: bool = False,
        **fields: Any,
    ) -> Job:
        """Submit a population of gears; arguments as in :meth:`submit`. :meth:`Job.answers` returns its answers."""
        return self._submit_to("/v1/populations", _request_body(request, fields), idempotency_key, force)

    def _submit_to(self, path: str, body: Document, idempotency_key: str | None, force: bool) -> Job:
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        params = {"force": "true"} if force else {}
        return Job(self, self.document("POST", path, json=body, headers=headers, params=params))

    def job(self, survey_id: str) -> Job:
        """Return a survey by its id."""
        return Job(self, self.document("GET", f"/v1/surveys/{survey_id}"))

    def population(self, population_id: str) -> Job:
        """Return a population by its id."""
        return Job(self, self.document("GET", f"/v1/populations/{population_id}"))

    def surveys(self) -> Iterator[Job]:
        """Yield every survey of the service, newest first."""
        return self._list_jobs("surveys")

    def populations(self) -> Iterator[Job]:
        """Yield every population of the service, newest first."""
        return self._list_jobs("populations")

    def _list_jobs(self, kind: str) -> Iterator[Job]:
        cursor: dict[str, str] = {}
        while True:
            page = self.document("GET", f"/v1/{kind}", params=cursor)
            yield from (Job(self, document) for document in page[kind])
            if page["next"] is None:
                return
            cursor = {"cursor": page["next"]}

    def call(self, method: str, path: str, **kwargs: Any) -> httpx.Response:
        """Send one request.

        Returns
        -------
        httpx.Response
            The answer of the service, with a status below 400.

        Raises
        ------
        ResponseError
            The service answered with an error; its problem document is attached.
        ServiceError
            The service cannot be reached, or the request cannot be encoded as JSON and headers.
        """
        headers = self.headers | kwargs.pop("headers", {})
        try:
            answer = self._http.request(method, path, headers=headers, **kwargs)
        except httpx.HTTPError as error:
            raise ServiceError(
                f"The service at {self._http.base_url} cannot be reached ({error}). "
                "Check the address, and that the service runs."
            ) from error
        except (TypeError, ValueError) as error:  # NaN and Python objects are no JSON, headers have ASCII only
            raise ServiceError(
                f"The request cannot be sent ({error}): give finite numbers, texts, lists and mappings; an API key and "
                "an idempotency key may have ASCII characters only."
            ) from error
        if answer.is_error:
            refusal = _response_error(answer)
            raise refusal
        return answer

    def document(self, method: str, path: str, **kwargs: Any) -> Document:
        """Send a request, and return the JSON object of its answer.

        Returns
        -------
        Document
            Names and values of the object.

        Raises
        ------
        ServiceError
            See `call`; or the answer is not a JSON object, so it comes from another program.
        """
        answer = self.call(method, path, **kwargs)
        try:
            found = answer.json()
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise ServiceError(
                f"{answer.url} answered {answer.text[:LONGEST_QUOTE]!r}, which is not a JSON object, so another "
                f"program may be at {self._http.base_url}. Give the address of a gear-rattle service."
            )
        return found

    def events(self, path: str, after: int) -> Iterator[tuple[int, Document]]:
        """Yield number and data of each event after number ``after``, until the event stream at ``path`` ends."""
        with connect_sse(self._http, "GET", path, headers=self.headers | {"Last-Event-ID": str(after)}) as source:
            if source.response.is_error:
                source.response.read()
                refusal = _response_error(source.response)
                raise refusal
            if source.response.status_code == httpx.codes.NO_CONTENT:
                return
            for event in source.iter_sse():
                if event.data:  # httpx-sse returns a heartbeat as an event without data
                    yield int(event.id), json.loads(event.data)

    @property
    def url(self) -> str:
        """Address of the service."""
        return str(self._http.base_url).rstrip("/")


class Job:
    """A survey or a population of a service.

    Attributes
    ----------
    document
        The JSON object that describes the job, as the service last sent it.
    """

    def __init__(self, client: Client, document: Document) -> None:
        self._client = client
        self.document = document

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"<{self.kind} {self.id}: {self.state}, {self.document['progress']} %>"

    @property
    def kind(self) -> str:
        """The kind of the job: "survey" or "population"."""
        return "population" if "answers" in self.document["links"] else "survey"

    @property
    def id(self) -> str:
        """Identifier of the job in the service."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """The state of the job at the last request: accepted, running, successful, failed or dismissed."""
        return str(self.document["state"])

    def _path_of_link(self, name: str) -> str:
        """Return the path of a link of the job, such as "events", relative to the address of the service."""
        return str(self.document["links"][name]).removeprefix(urlsplit(self._client.url).path)

    @property
    def store_url(self) -> str:
        """The address of the results, for ``xr.open_zarr``."""
        return self._client.url + self._path_of_link("store")

    def refresh(self) -> Self:
        """Read the present state of the job from the service."""
        self.document = self._client.document("GET", self._path_of_link("self"))
        return self

    def _repr_html_(self) -> str:
        names = ("id", "name", "state", "progress", "cells_done", "cells", "cells_failed", "message")
        rows = (f"<tr><th>{name}</th><td>{escape(str(self.document.get(name, '')))}</td></tr>" for name in names)
        return f"<table>{''.join(rows)}</table>"

    def wait(self, progress: Progress | None = None, patience: float = 60.0, timeout: float | None = None) -> Self:
        """Wait until the job is successful, even if connections are lost or the service restarts.

        Parameters
        ----------
        progress : Progress | None
            Called with the data of each event (``progress``, ``cells_done``, ``cells``, …).
        patience : float
            Seconds for which the service may be unreachable.
        timeout : float | None
            Longest wait in seconds. The job continues afterwards, and `wait` can be called again.

        Returns
        -------
        Self
            This job, now successful.

        Raises
        ------
        ServiceError
            The job failed, was dismissed or deleted, or the service refused a request or stayed unreachable.
        WaitTimeoutError
            The job has not ended within `timeout`.
        """
        seen = 0
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        unreachable_since = math.inf  # time of the first error in a row; infinity if the last request succeeded
        while True:
            try:
                if self.refresh().state in FINAL:
                    break
                unreachable_since = math.inf
                if time.monotonic() >= deadline:
                    raise self._timeout_error(timeout)
                for number, data in self._new_events(seen, deadline):
                    seen = number
                    if progress:
                        progress(data)
            except WaitTimeoutError:
                raise
            except (httpx.HTTPError, SSEError, ServiceError) as error:
                unreachable_since = min(unreachable_since, time.monotonic())
                lost = time.monotonic() - unreachable_since > patience
                refused = isinstance(error, ResponseError) and error.status < httpx.codes.INTERNAL_SERVER_ERROR
                if lost or refused:
                    refusal = _convert_to_service_error(error)
                    raise refusal from error
                if time.monotonic() >= deadline:
                    raise self._timeout_error(timeout) from error
                time.sleep(max(0.0, min(RECONNECT_SECONDS, deadline - time.monotonic())))
        if self.state != "successful":
            raise ServiceError(f"{self.kind.capitalize()} {self.id} is {self.state}: {self.document['message']}")
        return self

    def _timeout_error(self, timeout: float | None) -> WaitTimeoutError:
        what = f"{self.kind.capitalize()} {self.id}"
        return WaitTimeoutError(f"{what} is {self.state} after {timeout:g} s. Wait for it again.")

    def _new_events(self, seen: int, deadline: float) -> Iterator[tuple[int, Document]]:
        """Yield the number and the data of each event after number `seen`.

        If the deadline is finite, the event stream is not read, because it may stay open beyond the deadline. Instead,
        wait for at most a second, and then yield `seen` and the document of the job, once.

        Yields
        ------
        tuple[int, Document]
            Number and data of an event, or `seen` and the job's document.
        """
        if deadline == math.inf:
            yield from self._client.events(self._path_of_link("events"), after=seen)
        else:
            time.sleep(max(0.0, min(RECONNECT_SECONDS, deadline - time.monotonic())))
            yield seen, self.document

    def open(self) -> xr.Dataset:
        """Open the results as a dataset whose values are read over HTTP when they are needed."""
        return open_results(self.store_url, self._client.headers)

    def open_family(self, number: int, slice_number: int | None = None) -> xr.Dataset:
        """Open one family of a survey as a map. The survey must have been computed with families.

        See `gear_rattle.workers.open_family` for the variables.

        Returns
        -------
        xr.Dataset
            Variables over (epsilon, delta).
        """
        return open_family(self.store_url, number, self._client.headers, slice_number)

    def answers(self) -> Document:
        """Return the answers about a successful population.

        Returns
        -------
        Document
            The object of `GET /v1/populations/{population_id}/answers`.

        Raises
        ------
        ServiceError
            The population is not successful, or the service cannot be reached.
        """
        return self._client.document("GET", f"{self._path_of_link('self')}/answers")

    def verify(self) -> Self:
        """Let the service check every tile, and compute damaged or missing tiles again; `wait` waits for the end."""
        self.document = self._client.document("POST", f"{self._path_of_link('self')}/verify")
        return self

    def describe(self, name: str | None = None, notes: str | None = None) -> Self:
        """Give the survey another name or other notes. None leaves the present text unchanged.

        Returns
        -------
        Self
            This job, with the new text.

        Raises
        ------
        ServiceError
            The survey was submitted with another key.
        """
        given = {field: text for field, text in (("name", name), ("notes", notes)) if text is not None}
        self.document = self._client.document("PATCH", self._path_of_link("self"), json=given)
        return self

    def delete(self) -> None:
        """Dismiss a waiting or running job, or delete a job that has ended, together with its store."""
        self._client.call("DELETE", self._path_of_link("self"))


def _request_body(request: AnyRequest | Mapping[str, Any] | None, fields: Mapping[str, Any]) -> Document:
    given = request if isinstance(request, Mapping) else request.model_dump(mode="json") if request else {}
    body = _expand_axes({**given, **fields}, ("delta", "epsilon", "beta", *added_parameters()))
    if isinstance(machine := body.get("machine"), Mapping):
        body["machine"] = _expand_axes(machine, MACHINE_AXES)
    return {name: _to_plain_numbers(value) for name, value in body.items()}


def _expand_axes(fields: Mapping[str, Any], names: Sequence[str]) -> Document:
    return {name: _expand_axis(value) if name in names else value for name, value in fields.items()}


def _expand_axis(value: Any) -> Any:
    # A value that is no (start, stop, num) is sent unchanged, and the service explains what is wrong with it.
    is_triple = isinstance(value, (list, tuple)) and len(value) == len(AXIS_FIELDS)
    return dict(zip(AXIS_FIELDS, value, strict=True)) if is_triple else value


def _to_plain_numbers(value: Any) -> Any:
    """Replace numpy's numbers by Python's, because the JSON encoder does not know numpy's."""
    if isinstance(value, Mapping):
        return {name: _to_plain_numbers(each) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_to_plain_numbers(each) for each in value]
    return value.item() if getattr(value, "shape", None) == () else value


def _convert_to_service_error(error: Exception) -> ServiceError:
    return error if isinstance(error, ServiceError) else ServiceError(f"The service cannot be reached: {error}")


def _response_error(answer: httpx.Response) -> ResponseError:
    try:
        problem = answer.json()
    except ValueError:
        problem = {}
    if not isinstance(problem, dict):
        problem = {}
    detail = problem.get("detail") or answer.reason_phrase
    return ResponseError(answer.status_code, f"{detail} (HTTP {answer.status_code})", problem)
