"""Complete a survey once all its tiles are computed: its bound if it is refined, families, levels, certificates."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gear_rattle.workers.bound import lacks_bound, meet_bound
from gear_rattle.workers.certificates import lacks_certificates, prove_survey
from gear_rattle.workers.families.join import join_survey, lacks_families
from gear_rattle.workers.kinds import AnyRequest
from gear_rattle.workers.overviews import lacks_levels, make_levels
from gear_rattle.workers.storage.added import Each, here
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.request import SurveyRequest


def is_incomplete(request: AnyRequest, where: str | Path | Place) -> bool:
    """Return whether a survey with all its tiles still lacks its bound, families, levels or certificates."""
    return isinstance(request, SurveyRequest) and any(
        lacks(request, where) for lacks in (lacks_bound, lacks_families, lacks_levels, lacks_certificates)
    )


def complete(
    request: AnyRequest,
    where: str | Path | Place,
    each: Each = here,
    at_once: int = 1,
    on_proved: Callable[[int, int], None] = lambda _done, _number: None,
    should_pause: Callable[[], bool] = lambda: False,
) -> None:
    """Compute the missing parts of a survey with all its tiles. The caller holds the lock of the store.

    Parameters
    ----------
    each : Each
        Runs the tasks.
    at_once : int
        Number of tiles that it gets at a time for a round or for the join, and of parts of the attractors.
    on_proved : Callable[[int, int], None]
        Called with the number of finished attractors, and of all.
    should_pause : Callable[[], bool]
        Called after each group; if true, the rest is left for another call.

    Raises
    ------
    MissingExtraError
        Attractors are to be proved, and python-flint is not installed.
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The store cannot be written now.
    """
    if not isinstance(request, SurveyRequest):
        return
    if lacks_bound(request, where) and not meet_bound(request, where, each, at_once, should_pause):
        return
    if lacks_families(request, where):
        join_survey(request, where, each, at_once)
    if lacks_levels(request, where):  # after the join, which changes slots
        make_levels(request, where, each)
    if lacks_certificates(request, where):  # after the join, too: certificates name slots
        prove_survey(request, where, each, at_once, on_proved, should_pause)
