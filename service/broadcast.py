"""Wakes event streams: from the thread that runs the surveys to any number of coroutines."""

from __future__ import annotations

import asyncio
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Broadcast:
    """Tells listeners that a survey changed, not how: they read the database, so a slow one holds nothing back."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: defaultdict[str, set[tuple[asyncio.AbstractEventLoop, asyncio.Event]]] = defaultdict(set)

    def changed(self, survey_id: str) -> None:
        """Wake everybody who listens to this survey. Called from any thread."""
        with self._lock:
            for loop, event in self._listeners.get(survey_id, ()):
                if not loop.is_closed():
                    loop.call_soon_threadsafe(event.set)

    @contextmanager
    def listen(self, survey_id: str) -> Iterator[asyncio.Event]:
        """An event of the running loop that each change sets; the listener clears it."""
        listener = (asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            self._listeners[survey_id].add(listener)
        try:
            yield listener[1]
        finally:
            with self._lock:
                self._listeners[survey_id].discard(listener)
                if not self._listeners[survey_id]:
                    del self._listeners[survey_id]
