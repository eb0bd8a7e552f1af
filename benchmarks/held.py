"""How long the event loop of a service is held: imported by the process of the service that is measured."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

LEAST = 0.05  # seconds; less is not noted


def note(path: Path) -> None:
    """Write each long step of the event loop to a file, a line of JSON: seconds of the thread, of the clock, whose."""
    run = asyncio.Handle._run  # the loop looks it up in the class
    lines = path.open("a", buffering=1)

    def timed(handle: asyncio.Handle) -> None:
        began, at_work = time.perf_counter(), time.thread_time()
        run(handle)
        if (took := time.perf_counter() - began) > LEAST:
            lines.write(json.dumps([time.thread_time() - at_work, took, repr(handle)[:300]]) + "\n")

    asyncio.Handle._run = timed  # type: ignore[method-assign]  # measured from outside
