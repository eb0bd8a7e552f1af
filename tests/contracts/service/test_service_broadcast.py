"""Whoever watches a survey gets every event once and in order, and many who watch cost one read."""

import asyncio
from collections import Counter
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from waiting import eventually

from gear_rattle.service.errors import UnknownSurveyError
from gear_rattle.service.jobs import broadcast
from gear_rattle.service.jobs.broadcast import SurveyEventBroadcaster, encode_events

PAGE = 7
KEPT = 10


class Survey:
    """Events as the database gives them, a page at a time."""

    def __init__(self) -> None:
        self.rows: list[Any] = []
        self.reads = 0
        self.deleted = False

    def happen(self, number: int) -> None:
        for _ in range(number):
            data = {"tile": len(self.rows)}
            self.rows.append(SimpleNamespace(id=len(self.rows) + 1, kind="tile", data=data, at="now"))

    def has(self, number: int) -> bool:
        return len(self.rows) >= number

    def read(self, _: str, after: int) -> list[Any]:
        self.reads += 1
        if self.deleted:
            raise UnknownSurveyError("x")
        return self.rows[after : after + PAGE]


async def follow(feeds: SurveyEventBroadcaster, survey: Survey, seen: int, until: int, lag: int = 0) -> list[int]:
    """Ids of the events from `seen` to `until`, by a stream that looks again when `lag` more have happened."""
    found: list[int] = []
    with feeds.listen("x", survey.read, len(survey.rows)) as (feed, grown):
        while not feed.is_deleted and (not found or found[-1] < until):
            grown.clear()
            later = feed.events_after(found[-1] if found else seen)
            if later is None:
                later = encode_events(survey.read("x", found[-1] if found else seen))
            found += [event.id for event in later]
            if not later:
                await grown.wait()
            elif lag:
                await eventually(partial(survey.has, min(found[-1] + lag, until)))
    return found


async def watched(feeds: SurveyEventBroadcaster, number: int) -> None:
    """Open so many listeners of the survey."""
    await eventually(lambda: "x" in feeds._feeds and len(feeds._feeds["x"].listeners) == number)


def test_every_stream_gets_every_event_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broadcast, "KEPT_EVENTS", KEPT)
    monkeypatch.setattr(broadcast, "READ_PAUSE", 0)

    async def run() -> None:
        feeds, survey = SurveyEventBroadcaster(), Survey()
        survey.happen(25)
        streams = [follow(feeds, survey, seen, 100, lag) for seen in (0, 3, 24, 25) for lag in (0, KEPT + 5)]
        running = [asyncio.create_task(stream) for stream in streams]
        await watched(feeds, len(streams))
        for _ in range(15):
            await asyncio.sleep(0)
            survey.happen(5)
            feeds.notify("x")
        found = await asyncio.gather(*running)
        assert [ids[0] for ids in found] == [1, 1, 4, 4, 25, 25, 26, 26]
        assert all(ids == list(range(ids[0], ids[-1] + 1)) for ids in found)
        assert feeds._feeds == {}  # nothing is kept of a survey that nobody watches

    asyncio.run(run())


def test_many_who_watch_cost_one_read() -> None:
    async def run() -> None:
        feeds, survey = SurveyEventBroadcaster(), Survey()
        running = [asyncio.create_task(follow(feeds, survey, 0, 5)) for _ in range(200)]
        await watched(feeds, 200)
        survey.happen(5)
        feeds.notify("x")
        assert await asyncio.gather(*running) == [[1, 2, 3, 4, 5]] * 200
        assert survey.reads <= 4

    asyncio.run(run())


def test_a_deleted_survey_ends_its_streams() -> None:
    async def run() -> None:
        feeds, survey = SurveyEventBroadcaster(), Survey()
        running = asyncio.create_task(follow(feeds, survey, 0, 5))
        await watched(feeds, 1)
        survey.deleted = True
        feeds.notify("x")
        assert await running == []

    asyncio.run(run())


def test_a_crowd_that_watches_does_not_hold_up_others() -> None:
    """Two hundred answers at once would: between them, the loop is seen to turn."""

    async def run() -> None:
        feeds, survey, turns = SurveyEventBroadcaster(), Survey(), [0]
        woken: list[int] = []

        async def watch() -> None:
            await follow(feeds, survey, 0, 1)
            woken.append(turns[0])

        async def turn() -> None:
            while True:
                await asyncio.sleep(0)
                turns[0] += 1

        running = [asyncio.create_task(watch()) for _ in range(200)]
        await watched(feeds, 200)
        turning = asyncio.create_task(turn())
        survey.happen(1)
        feeds.notify("x")
        await asyncio.gather(*running)
        turning.cancel()
        assert max(Counter(woken).values()) <= broadcast.LISTENERS_AT_ONCE

    asyncio.run(run())
