"""Tasks of a join that are repeated, and those that are given up, without a cluster."""

from collections.abc import Callable
from typing import Any

import pytest
from distributed import KilledWorker
from ended_tasks import ENDLESS, Client

import gear_rattle.workers.cluster.joining
from gear_rattle.workers import Axis, StoppedError, SurveyError, SurveyRequest
from gear_rattle.workers.cluster.joining import ATTEMPTS, CompletionTasks

REQUEST = SurveyRequest(delta=Axis(start=0.5, stop=0.6, num=4), epsilon=Axis(start=0.05, stop=0.1, num=2))


def killed() -> KilledWorker:
    return KilledWorker("task", None, 3)


def each(task: Callable[[Any], Any], stop: Callable[[], bool] = lambda: False) -> list[Any]:
    joining = CompletionTasks(Client(3), stop)  # type: ignore[arg-type]
    found = joining.run_for_each(lambda _, __, item: task(item), REQUEST, "nowhere", [(i,) for i in range(7)])
    assert not joining.in_flight
    return found


@pytest.fixture
def given_up(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many tasks are given up, each time."""
    found: list[int] = []
    monkeypatch.setattr(
        gear_rattle.workers.cluster.joining, "end_tasks_and_wait", lambda _, futures: found.append(len(futures))
    )
    return found


def test_results_are_in_their_order_whatever_is_killed(given_up: list[int]) -> None:
    deaths: dict[int, int] = {}

    def task(item: int) -> int:
        deaths[item] = deaths.get(item, 0) + 1
        if item in (2, 5) and deaths[item] < ATTEMPTS:
            raise killed()
        return 10 * item

    assert each(task) == [0, 10, 20, 30, 40, 50, 60]
    assert deaths[2] == deaths[5] == ATTEMPTS
    assert given_up == []


def test_what_kills_again_and_again_is_told(given_up: list[int]) -> None:
    def task(item: int) -> Any:
        if item:
            raise killed()
        return ENDLESS

    with pytest.raises(SurveyError, match="a task that completes the survey killed its worker"):
        each(task)
    assert given_up[0] >= 1


def test_what_fails_is_raised_and_the_others_are_given_up(given_up: list[int]) -> None:
    def task(item: int) -> Any:
        if item == 2:
            raise SurveyError("as it is")
        return ENDLESS

    with pytest.raises(SurveyError, match="as it is"):
        each(task)
    assert given_up == [2]


def test_a_stop_leaves_nothing_at_work(given_up: list[int]) -> None:
    asked = iter([False, False, True])
    with pytest.raises(StoppedError):
        each(lambda _: ENDLESS, lambda: next(asked))
    assert given_up == [3]
