"""The interface of tasks that complete a survey: a task handles one item, in this process or on a cluster."""

from collections.abc import Callable, Sequence
from typing import Any

from gear_rattle.workers.survey.request import SurveyRequest

#: A function that runs `task(request, path, *item)` for each item, and returns the results in the order of the items.
Each = Callable[[Callable[..., Any], SurveyRequest, str, Sequence[tuple[Any, ...]]], list[Any]]


def run_in_process(
    task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]
) -> list[Any]:
    """Run a task in this process for each item, one after the other."""
    return [task(request, path, *item) for item in items]
