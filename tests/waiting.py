"""Waiting in tests: for a condition, with a limit that only a hang meets. No verdict depends on speed."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

#: Seconds after which something hangs: a hundred times what the slowest wait takes on an idle machine. Less than the
#: limit of a whole test (pyproject.toml), so that a wait says what it was for.
HANG = 900.0
POLL = 0.02
#: A long wait is asked about more and more seldom, up to this: who asks often takes the time of what is waited for.
SELDOM = 0.5
PATIENCE = 0.1  # of the time waited so far


def wait_until(condition: Callable[[], Any], poll: float = POLL) -> Any:
    """Poll until the condition is true, after so many seconds at least; its value."""
    began = time.monotonic()
    while not (value := condition()):
        waited = time.monotonic() - began
        assert waited < HANG, f"{condition} has not become true in {HANG:g} s"
        time.sleep(max(poll, min(SELDOM, PATIENCE * waited)))
    return value


async def eventually(condition: Callable[[], Any]) -> Any:
    """Poll in the event loop until the condition is true; its value."""
    deadline = time.monotonic() + HANG
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{condition} has not become true in {HANG:g} s"
        await asyncio.sleep(POLL)
    return value
