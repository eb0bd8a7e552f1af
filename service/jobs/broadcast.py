"""Send the events of surveys to any number of streams. Each event is read from the database once."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from sqlalchemy.exc import SQLAlchemyError
from sse_starlette import ServerSentEvent
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.database.tables import EventRow, State
from gear_rattle.service.errors import UnavailableError, UnknownSurveyError

KEPT_EVENTS = 512  # at most this many events of a survey are kept in memory; older events are read from the database
READ_PAUSE = 0.05  # seconds between two reads of the database; events that are added in between are sent together
RETRY_SECONDS = 1.0  # seconds until the next read after an error
LISTENERS_AT_ONCE = 50  # at most this many listeners are notified before the event loop can do other work

Read = Callable[[str, int], Sequence[EventRow]]

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class EncodedEvent:
    """An event as the bytes of an event stream. is_last: True if the event says that the job has ended."""

    id: int
    text: bytes
    is_last: bool


def encode_events(rows: Sequence[EventRow]) -> list[EncodedEvent]:
    """Encode events of the database for an event stream."""
    return [
        EncodedEvent(
            row.id,
            ServerSentEvent(json.dumps(row.data | {"at": row.at}), event=row.kind, id=str(row.id)).encode(),
            row.kind == "state" and State(row.data["state"]).is_final,
        )
        for row in rows
    ]


class SurveyEventFeed:
    """The latest events of a survey that has listeners (open event streams). A feed belongs to one event loop."""

    def __init__(self, survey_id: str, read: Read, last: int) -> None:
        self._survey_id, self._read, self._last = survey_id, read, last
        self._recent: list[EncodedEvent] = []
        self._stale = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self.listeners: set[asyncio.Event] = set()
        self.is_deleted = False
        self._task = self._loop.create_task(self._read_new_events())
        self._stale.set()  # there may be events after `last`

    def notify(self) -> None:
        """Let the feed read new events from the database. This method may be called from any thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._stale.set)

    def events_after(self, seen: int) -> list[EncodedEvent] | None:
        """Return the events that the feed has read and whose numbers are above `seen`.

        Returns
        -------
        list[EncodedEvent] | None
            The events; None if the feed no longer keeps all of them, so the caller must read them from the database.
        """
        if seen >= self._last:
            return []
        first = self._recent[0].id if self._recent else self._last + 1
        return self._recent[seen + 1 - first :] if seen + 1 >= first else None

    def close(self) -> None:
        """Stop reading events."""
        self._task.cancel()

    async def _read_new_events(self) -> None:
        while not self.is_deleted:
            await self._stale.wait()
            self._stale.clear()
            try:
                rows = await run_in_threadpool(self._read, self._survey_id, self._last)
            except UnknownSurveyError:
                self.is_deleted = True
            except (SQLAlchemyError, UnavailableError) as error:
                log.warning("the events of survey %s cannot be read: %s", self._survey_id, error)
                self._stale.set()
                await asyncio.sleep(RETRY_SECONDS)
                continue
            else:
                if rows:
                    self._stale.set()  # there may be more events, because one read returns a limited number of them
                    self._last = rows[-1].id
                    self._recent = (self._recent + encode_events(rows))[-KEPT_EVENTS:]
            if self.is_deleted or rows:
                # Listeners are notified in groups, so that the event loop can answer requests in between.
                listeners = tuple(self.listeners)
                for first in range(0, len(listeners), LISTENERS_AT_ONCE):
                    for listener in listeners[first : first + LISTENERS_AT_ONCE]:
                        listener.set()
                    await asyncio.sleep(0)
                await asyncio.sleep(READ_PAUSE)


class SurveyEventBroadcaster:
    """The feeds of all surveys that have listeners."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._feeds: dict[str, SurveyEventFeed] = {}
        self._watchers: set[Callable[[str], None]] = set()

    def notify(self, survey_id: str) -> None:
        """Report a changed survey to its feed and to the functions given to `watch`. Any thread may call `notify`."""
        with self._lock:
            feed, watchers = self._feeds.get(survey_id), tuple(self._watchers)
        if feed is not None:
            feed.notify()
        for watcher in watchers:
            watcher(survey_id)

    @contextmanager
    def watch(self, on_change: Callable[[str], None]) -> Iterator[None]:
        """Call `on_change`, in any thread, with the id of each survey that changes during this context."""
        with self._lock:
            self._watchers.add(on_change)
        try:
            yield
        finally:
            with self._lock:
                self._watchers.discard(on_change)

    @contextmanager
    def listen(self, survey_id: str, read: Read, last: int) -> Iterator[tuple[SurveyEventFeed, asyncio.Event]]:
        """Yield the feed of a survey, and an asyncio event that is set when the feed has new events.

        Parameters
        ----------
        survey_id : str
            Id of the survey.
        read : Read
            Function that returns the events of a survey after a given number from the database.
        last : int
            Number of the job's latest event. If the survey has no feed yet, a new feed reads only later events.

        Yields
        ------
        tuple[SurveyEventFeed, asyncio.Event]
            The feed, and the asyncio event, which the listener must clear.
        """
        listener = asyncio.Event()
        with self._lock:
            feed = self._feeds.get(survey_id)
            if feed is None:
                feed = self._feeds[survey_id] = SurveyEventFeed(survey_id, read, last)
        feed.listeners.add(listener)
        try:
            yield feed, listener
        finally:
            feed.listeners.discard(listener)
            with self._lock:
                if not feed.listeners and self._feeds.get(survey_id) is feed:
                    del self._feeds[survey_id]
                    feed.close()
