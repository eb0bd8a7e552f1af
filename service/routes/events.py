"""What happens to a survey, as server-sent events."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Coroutine
from typing import Annotated

import anyio
from fastapi import APIRouter, Header, Response
from sse_starlette import EventSourceResponse, ServerSentEvent
from starlette.concurrency import run_in_threadpool

from service.errors import UnknownSurveyError
from service.problems import declared
from service.state import Front, FrontState
from service.tables import State

router = APIRouter(prefix="/v1/surveys", tags=["surveys"])

LARGEST_ID = 2**53
SEND_SECONDS = 30
GRACE_SECONDS = 2.0


@router.get(
    "/{survey_id}/events",
    summary="Follow a survey",
    response_class=EventSourceResponse,
    responses={
        200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}},
        204: {"description": "the survey has ended and every event was seen: no need to connect again"},
        **declared(404, 422, 503),
    },
)
async def follow(
    front: FrontState,
    survey_id: str,
    last_event_id: Annotated[int, Header(ge=0, le=LARGEST_ID, description="id of the last event seen")] = 0,
) -> Response:
    """Events `state` and `tile`, numbered from 1; the stream closes after the event of the final state."""
    job = await run_in_threadpool(front.database.job, survey_id)
    if State(job.state).final and last_event_id >= job.last_event:
        return Response(status_code=204)
    closing = anyio.Event()
    return EventSourceResponse(
        _events(front, survey_id, min(last_event_id, job.last_event), closing),
        shutdown_event=closing,
        shutdown_grace_period=GRACE_SECONDS,
        ping=front.settings.heartbeat_seconds,
        send_timeout=SEND_SECONDS,
    )


async def _events(front: Front, survey_id: str, seen: int, closing: anyio.Event) -> AsyncIterator[ServerSentEvent]:
    # Listening starts before the first look into the database, so that no change falls between them.
    with front.broadcast.listen(survey_id) as changed:
        while not closing.is_set():
            changed.clear()
            try:
                later = await run_in_threadpool(front.database.events, survey_id, seen)
            except UnknownSurveyError:
                return  # deleted
            for event in later:
                seen = event.id
                yield ServerSentEvent(json.dumps(event.data), event=event.kind, id=str(event.id))
                if event.kind == "state" and State(event.data["state"]).final:
                    return
            if not later:
                await _first(changed.wait(), closing.wait())


async def _first(*waits: Coroutine[object, object, object]) -> None:
    tasks = [asyncio.ensure_future(wait) for wait in waits]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
