"""The scheduler: API keys take turns on the cluster, and the surveys of a key share the key's turns."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gear_rattle.service.database.survey_rows import Active

TURN_SECONDS = 3.0  # duration of a turn; running tasks end within two seconds afterwards, unless one cell takes longer


@dataclass
class _Standing:
    """The turns of an API key. last: number of its last turn. smallest: True if its smallest survey is next."""

    last: int = 0
    smallest: bool = True


class Turns:
    """The scheduler of several surveys. It belongs to one thread, and its state is lost with the process.

    Keys take turns one after the other. A key alternates between its survey with the fewest remaining cells and its
    survey that has waited for the most turns. So its smallest survey waits for at most two turns of the key, and every
    survey gets a turn, whatever else is submitted. A survey without remaining cells counts as the largest, because the
    time for its bound or certificates does not follow from cells.

    Parameters
    ----------
    clock
        Function that returns the time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._count = 0  # number of turns so far
        self._keys: dict[str | None, _Standing] = {}
        # By id of a survey: the number of its last turn, or of the turn in which it was submitted.
        self._waits_since: dict[str, int] = {}
        self._began = 0.0

    def next(self, active: Sequence[Active]) -> Active | None:
        """Return the survey that gets the next turn. active: all active surveys, oldest first."""
        since = self._waits_since
        self._waits_since = {each.id: since.get(each.id, self._count) for each in active}
        if not active:
            return None
        owner = min(active, key=lambda each: self._key(each.owner).last).owner
        mine = [each for each in active if each.owner == owner]
        if self._key(owner).smallest:
            return min(mine, key=lambda each: each.left or math.inf)
        return min(mine, key=lambda each: self._waits_since[each.id])

    def begin(self, survey: Active) -> None:
        """Begin a turn of a survey."""
        self._count += 1
        key = self._key(survey.owner)
        key.last, key.smallest = self._count, not key.smallest
        self._waits_since[survey.id] = self._count
        self._began = self._clock()

    @property
    def is_used_up(self) -> bool:
        """True if the present turn has lasted for TURN_SECONDS."""
        return self._clock() - self._began >= TURN_SECONDS

    def _key(self, owner: str | None) -> _Standing:
        return self._keys.setdefault(owner, _Standing())
