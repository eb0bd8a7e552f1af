"""Complete a survey once all its tiles are there.

The bound of one that is refined, then families, then levels, then certificates.
"""

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
    """Return whether what follows from all tiles, which are there, is still to be made."""
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
    """Make what is lacking of it. The caller holds the store.

    Parameters
    ----------
    each : Each
        Does the tasks.
    at_once : int
        Tiles that it is given at a time to go through a round or to be moved, and parts of the attractors to be proved.
    on_proved : Callable[[int, int], None]
        Told how many attractors are through, and how many there are.
    should_pause : Callable[[], bool]
        Asked after each time: whether the rest is left for another call.

    Raises
    ------
    MissingExtraError
        Attractors are to be proved, and python-flint is not installed.
    StorageError
        It cannot be written now.
    SurveyError
        There is no survey, or it is damaged.
    """
    if not isinstance(request, SurveyRequest):
        return
    if lacks_bound(request, where) and not meet_bound(request, where, each, at_once, should_pause):
        return
    if lacks_families(request, where):
        join_survey(request, where, each, at_once)
    if lacks_levels(request, where):  # of slots as they are after the join
        make_levels(request, where, each)
    if lacks_certificates(request, where):  # of attractors in their slots
        prove_survey(request, where, each, at_once, on_proved, should_pause)
