"""Treat SIGINT and SIGTERM as requests to stop."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def catch_stop_signals() -> Iterator[threading.Event]:
    """Yield an event that the first SIGINT or SIGTERM sets; later signals have their previous effect again."""
    event = threading.Event()
    previous = {number: signal.getsignal(number) for number in STOP_SIGNALS}

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - Python passes both arguments
        event.set()
        for each in STOP_SIGNALS:
            signal.signal(each, previous[each])

    for number in STOP_SIGNALS:
        signal.signal(number, stop)
    try:
        yield event
    finally:
        for number in STOP_SIGNALS:
            signal.signal(number, previous[number])
