"""Complete a survey whose tiles are all computed: bound its wrong cells, add families and levels, prove attractors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gear_rattle.workers.bound import audit_until_bound_is_met, lacks_wrong_cell_bound
from gear_rattle.workers.certificates import lacks_certificates, write_certificates_of_survey
from gear_rattle.workers.families.join import join_attractors_of_survey, lacks_families
from gear_rattle.workers.kinds import AnyRequest
from gear_rattle.workers.overviews import build_pyramid_levels, lacks_levels
from gear_rattle.workers.storage.added import RunForEach, run_in_this_process
from gear_rattle.workers.storage.location import Place
from gear_rattle.workers.survey.request import SurveyRequest


def is_incomplete(request: AnyRequest, where: str | Path | Place) -> bool:
    """Return whether a survey whose tiles are all computed needs further steps, which `complete` takes.

    Returns
    -------
    bool
        True if one of these is missing: a requested bound, requested families, levels (in a large survey), requested
        certificates. False for a population.
    """
    return isinstance(request, SurveyRequest) and any(
        lacks(request, where) for lacks in (lacks_wrong_cell_bound, lacks_families, lacks_levels, lacks_certificates)
    )


def complete(
    request: AnyRequest,
    where: str | Path | Place,
    each: RunForEach = run_in_this_process,
    at_once: int = 1,
    on_proved: Callable[[int, int], None] = lambda _done, _number: None,
    should_pause: Callable[[], bool] = lambda: False,
) -> None:
    """Take the missing steps to complete a survey whose tiles are all computed.

    The steps meet the requested bound, join families, build levels and prove attractors. The caller holds the lock of
    the store.

    Parameters
    ----------
    each : RunForEach
        Function that runs a task for each of several items, such as `run_in_this_process`.
    at_once : int
        Number of tasks in a group; the results of a group are stored together.
    on_proved : Callable[[int, int], None]
        Called with the number of attractors whose proof was attempted, and the number of all attractors.
    should_pause : Callable[[], bool]
        Called after each group. If it returns true, the remaining work is left to another call.

    Raises
    ------
    MissingExtraError
        The request asks for certificates, and python-flint is not installed.
    SurveyError
        There is no survey, or it is damaged.
    StorageError
        The store cannot be written now.
    """
    if not isinstance(request, SurveyRequest):
        return
    if lacks_wrong_cell_bound(request, where) and not audit_until_bound_is_met(
        request, where, each, at_once, should_pause
    ):
        return
    if lacks_families(request, where):
        join_attractors_of_survey(request, where, each, at_once)
    if lacks_levels(request, where):  # levels are built after families are joined, because the join changes slots
        build_pyramid_levels(request, where, each)
    if lacks_certificates(request, where):  # last, because certificates name slots, and joining families changes slots
        write_certificates_of_survey(request, where, each, at_once, on_proved, should_pause)
