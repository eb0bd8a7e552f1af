"""Run the tasks that complete a survey after its tiles. A task handles one item, such as a block of cells."""

from collections.abc import Callable, Sequence
from typing import Any

from gear_rattle.workers.survey.request import SurveyRequest

#: The type of functions that run `task(request, path, *item)` for each item, in this process or on a cluster, and
#: return the results in the order of the items.
RunForEach = Callable[[Callable[..., Any], SurveyRequest, str, Sequence[tuple[Any, ...]]], list[Any]]


def run_in_this_process(
    task: Callable[..., Any], request: SurveyRequest, path: str, items: Sequence[tuple[Any, ...]]
) -> list[Any]:
    """Run a task in this process for each item, one after the other."""
    return [task(request, path, *item) for item in items]
