"""How what follows from all tiles is made: tasks, each for one part of a survey, that may run anywhere."""

from collections.abc import Callable, Sequence
from typing import Any

from gear_rattle.workers.survey.request import SurveyRequest

#: Does a task, a function of a request, a path and what follows, for each of these; results in their order.
Each = Callable[[Callable[..., Any], SurveyRequest, str, Sequence[tuple[Any, ...]]], list[Any]]


def here(task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]) -> list[Any]:
    """Do a task in this process, for one after the other."""
    return [task(request, path, *item) for item in items]
