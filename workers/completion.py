"""What follows from the tiles of a survey once all are there: its families, and then its levels."""

from __future__ import annotations

from pathlib import Path

from workers.families.join import join_survey, lacks_families
from workers.kinds import AnyRequest
from workers.overviews import lacks_levels, make_levels
from workers.storage.added import Each, here
from workers.storage.location import Place
from workers.survey.request import SurveyRequest


def is_incomplete(request: AnyRequest, where: str | Path | Place) -> bool:
    """Whether what follows from all tiles, which are there, is still to be made."""
    return isinstance(request, SurveyRequest) and (lacks_families(request, where) or lacks_levels(request, where))


def complete(request: AnyRequest, where: str | Path | Place, each: Each = here) -> None:
    """Make what is lacking of it. The caller holds the store.

    Raises:
        StorageError: it cannot be written now.
        SurveyError: there is no survey, or it is damaged.
    """
    if not isinstance(request, SurveyRequest):
        return
    if lacks_families(request, where):
        join_survey(request, where, each)
    if lacks_levels(request, where):  # of slots as they are after the join
        make_levels(request, where, each)
