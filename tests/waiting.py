"""Waiting in tests: for a condition, with a limit that only a hang meets. No verdict depends on speed."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

#: Seconds after which something hangs: a hundred times what the slowest wait takes on an idle machine. Less than the
#: limit of a whole test (pyproject.toml), so that a wait says what it was for.
HANG = 900.0
POLL = 0.02
SELDOM = 0.5  # where it takes a process to ask


def wait_until(condition: Callable[[], Any], poll: float = POLL) -> Any:
    """Poll until the condition is true, after so many seconds each; its value."""
    deadline = time.monotonic() + HANG
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{condition} has not become true in {HANG:g} s"
        time.sleep(poll)
    return value


async def eventually(condition: Callable[[], Any]) -> Any:
    """Poll in the event loop until the condition is true; its value."""
    deadline = time.monotonic() + HANG
    while not (value := condition()):
        assert time.monotonic() < deadline, f"{condition} has not become true in {HANG:g} s"
        await asyncio.sleep(POLL)
    return value
