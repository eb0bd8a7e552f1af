"""Record long steps of a service's event loop. The process of the measured service imports this module."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

LEAST = 0.05  # steps that take less than this many seconds are not recorded


def note(path: Path) -> None:
    """Write each long step of the event loop to a file, as a JSON line: seconds of the thread, seconds in all, name."""
    run = asyncio.Handle._run  # the event loop calls this method of the class for each step
    lines = path.open("a", buffering=1)

    def timed(handle: asyncio.Handle) -> None:
        began, at_work = time.perf_counter(), time.thread_time()
        run(handle)
        if (took := time.perf_counter() - began) > LEAST:
            lines.write(json.dumps([time.thread_time() - at_work, took, repr(handle)[:300]]) + "\n")

    asyncio.Handle._run = timed  # type: ignore[method-assign]  # measured from outside
