"""Stream the events of a survey as server-sent events."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Header, Response
from sse_starlette import EventSourceResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from gear_rattle.service.access.keys import Caller
from gear_rattle.service.access.middleware import CallerState
from gear_rattle.service.access.revocation import RevocationWatcher
from gear_rattle.service.database.tables import JobKind, State
from gear_rattle.service.errors import UnknownSurveyError
from gear_rattle.service.jobs.broadcast import encode_events
from gear_rattle.service.operations.surveys import find_job
from gear_rattle.service.routes.documents import SurveyId
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web import examples
from gear_rattle.service.web.problems import declare_problems

router = APIRouter(prefix="/v1/surveys", tags=["surveys"])

LARGEST_ID = 2**53  # largest accepted id of an event
SEND_SECONDS = 30  # longest time for a client to accept an event; then the stream ends
GRACE_SECONDS = 2.0  # seconds within which a stream can end by itself when the service stops
#: Schema of an event of the stream.
EVENT_SCHEMA = {
    "type": "object",
    "properties": {
        "id": {"type": "string", "pattern": "^[1-9][0-9]*$"},
        "event": {"enum": ["state", "tile"]},
        "data": {"type": "string", "contentMediaType": "application/json"},
    },
    "required": ["id", "event", "data"],
}


@router.get(
    "/{survey_id}/events",
    summary="Follow a survey",
    response_class=EventSourceResponse,
    responses={
        200: {"content": {"text/event-stream": {"schema": EVENT_SCHEMA, "example": examples.EVENTS[0]}}},
        204: {"description": "the survey has ended and every event was seen: no need to connect again"},
        **declare_problems(404, 422),
    },
)
async def follow(
    front: FrontState,
    caller: CallerState,
    survey_id: SurveyId,
    last_event_id: Annotated[
        int, Header(ge=0, le=LARGEST_ID, description="id of the last event seen", examples=[0])
    ] = 0,
) -> Response:
    """Stream the events `state` and `tile`, numbered from 1, until the event of the final state."""
    return await event_stream(front, caller, survey_id, JobKind.SURVEY, last_event_id)


async def event_stream(
    front: ApplicationState, caller: Caller, survey_id: str, kind: JobKind, last_event_id: int
) -> Response:
    """Return the stream of a job's events after `last_event_id`.

    If the job has ended and has no event after `last_event_id`, return status 204.
    """
    job = await run_in_threadpool(find_job, front, survey_id, kind)
    if State(job.state).is_final and last_event_id >= job.last_event:
        return Response(status_code=204)
    closing = anyio.Event()
    return _RevocableStream(
        front.revocations,
        caller,
        _stream_encoded_events(front, survey_id, min(last_event_id, job.last_event), job.last_event, closing),
        shutdown_event=closing,
        shutdown_grace_period=GRACE_SECONDS,
        ping=front.settings.heartbeat_seconds,
        send_timeout=SEND_SECONDS,
    )


class _RevocableStream(EventSourceResponse):
    """A stream that ends when its caller is no longer authorised, even while the client reads nothing."""

    def __init__(self, revocations: RevocationWatcher, caller: Caller, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._revocations, self._caller = revocations, caller

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._revocations.cancel_when_revoked(self._caller) as reading:
            await super().__call__(scope, receive, send)
        if reading.cancelled_caught:
            await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _stream_encoded_events(
    front: ApplicationState, survey_id: str, seen: int, last: int, closing: anyio.Event
) -> AsyncIterator[bytes]:
    read = front.database.events
    with front.broadcast.listen(survey_id, read, last) as (feed, wake_event):
        waker = asyncio.create_task(_wake_on_closing(closing, wake_event))
        try:
            while not closing.is_set():
                wake_event.clear()
                later = feed.events_after(seen)
                if later is None:
                    later = encode_events(await run_in_threadpool(read, survey_id, seen))
                if later:
                    seen = later[-1].id
                    yield b"".join(event.text for event in later)
                    if later[-1].is_last:
                        return
                elif feed.is_deleted:
                    return
                else:
                    await wake_event.wait()
        except UnknownSurveyError:
            return  # the survey has been deleted
        finally:
            waker.cancel()


async def _wake_on_closing(closing: anyio.Event, wake_event: asyncio.Event) -> None:
    await closing.wait()
    wake_event.set()
