"""The scheduler: API keys take turns on the cluster, and the surveys of a key share the key's turns."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gear_rattle.service.database.survey_rows import ActiveSurvey

TURN_SECONDS = 3.0  # duration of a turn; running tasks end within two seconds afterwards, unless one cell takes longer


@dataclass
class _KeyTurns:
    """The turns of an API key.

    last_turn: number of its last turn among the turns of all keys; 0 before its first turn. is_smallest_next: True if
    its next turn goes to its survey with the fewest remaining cells, False if to the survey that has waited longest.
    """

    last_turn: int = 0
    is_smallest_next: bool = True


class TurnScheduler:
    """The scheduler of several surveys. It belongs to one thread, and its state is lost with the process.

    Keys take turns one after the other. A key alternates between its survey with the fewest remaining cells and its
    survey that has waited for the most turns. So its smallest survey waits for at most two turns of the key, and every
    survey gets a turn, whatever else is submitted. A survey without remaining cells counts as the largest, because the
    time for its last steps, such as its certificates, does not follow from a number of cells.

    Parameters
    ----------
    clock
        Function that returns the time in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._count = 0  # number of turns so far, of all keys
        self._keys: dict[str | None, _KeyTurns] = {}
        # {id of an active survey: number of its last turn. Before its first turn: number of the last turn, of any
        # survey, before it became active}
        self._waits_since: dict[str, int] = {}
        self._began = 0.0

    def next_survey(self, active: Sequence[ActiveSurvey]) -> ActiveSurvey | None:
        """Return the survey that gets the next turn; None if none is active. active: active surveys, oldest first."""
        since = self._waits_since
        self._waits_since = {each.id: since.get(each.id, self._count) for each in active}
        if not active:
            return None
        owner = min(active, key=lambda each: self._turns_of_key(each.owner).last_turn).owner
        mine = [each for each in active if each.owner == owner]
        if self._turns_of_key(owner).is_smallest_next:
            return min(mine, key=lambda each: each.remaining_cells or math.inf)
        return min(mine, key=lambda each: self._waits_since[each.id])

    def begin_turn(self, survey: ActiveSurvey) -> None:
        """Record that a turn of a survey begins now."""
        self._count += 1
        key = self._turns_of_key(survey.owner)
        key.last_turn, key.is_smallest_next = self._count, not key.is_smallest_next
        self._waits_since[survey.id] = self._count
        self._began = self._clock()

    @property
    def is_turn_over(self) -> bool:
        """True if the present turn has lasted for TURN_SECONDS."""
        return self._clock() - self._began >= TURN_SECONDS

    def _turns_of_key(self, owner: str | None) -> _KeyTurns:
        return self._keys.setdefault(owner, _KeyTurns())
