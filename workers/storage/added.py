"""Run tasks, each for a part of a survey, which may run anywhere: the interface of what follows after all tiles."""

from collections.abc import Callable, Sequence
from typing import Any

from gear_rattle.workers.survey.request import SurveyRequest

#: Runs a task, a function of a request, a path and one item, for each item; results are in their order.
Each = Callable[[Callable[..., Any], SurveyRequest, str, Sequence[tuple[Any, ...]]], list[Any]]


def here(task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]) -> list[Any]:
    """Run a task in this process, for one item after the other."""
    return [task(request, path, *item) for item in items]
