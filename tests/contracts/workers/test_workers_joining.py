"""Which tasks of a join are done again, and which are given up, without a cluster."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from distributed import KilledWorker

import workers.cluster.joining
from workers import Axis, StoppedError, SurveyError, SurveyRequest
from workers.cluster.joining import ATTEMPTS, Joining

REQUEST = SurveyRequest(delta=Axis(start=0.5, stop=0.6, num=4), epsilon=Axis(start=0.05, stop=0.1, num=2))


class Future:
    """A task that has ended, or does not."""

    def __init__(self, key: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.key, self.status, self._error, self._result = key, "finished", None, None
        try:
            self._result = function(*arguments)
        except Exception as error:
            self.status, self._error = "error", error

    def add_done_callback(self, function: Callable[..., None]) -> None:
        if self._result is not ENDLESS:
            function(self)

    def result(self) -> Any:
        if self._error:
            raise self._error
        return self._result

    def exception(self) -> Any:
        return self._error

    def release(self) -> None:
        pass


ENDLESS = object()


class Client:
    """Enough of dask's for tasks that end as they begin."""

    def __init__(self) -> None:
        self.submitted: list[Any] = []

    def nthreads(self) -> dict[str, int]:
        return {"one": 1, "other": 2}

    @property
    def loop(self) -> "Client":
        return self

    def add_callback(self, function: Callable[..., Coroutine[Any, Any, None]], *arguments: Any) -> None:
        asyncio.run(function(*arguments))

    async def gather(self, future: Future, **_: Any) -> Any:
        return future.result()

    def submit(self, function: Callable[..., Any], *arguments: Any, key: str, **_: Any) -> Future:
        self.submitted.append(arguments[-1])
        return Future(key, function, arguments)


def killed() -> KilledWorker:
    return KilledWorker("task", None, 3)


def each(task: Callable[[Any], Any], stop: Callable[[], bool] = lambda: False) -> list[Any]:
    joining = Joining(Client(), stop)  # type: ignore[arg-type]
    found = joining.each(lambda _, __, item: task(item), REQUEST, "nowhere", [(i,) for i in range(7)])
    assert not joining.in_flight
    return found


@pytest.fixture
def given_up(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many tasks are given up, each time."""
    found: list[int] = []
    monkeypatch.setattr(workers.cluster.joining, "end_tasks_and_wait", lambda _, futures: found.append(len(futures)))
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

    with pytest.raises(SurveyError, match="the survey killed the process that completed it"):
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
    with pytest.raises(StoppedError, match="stopped while the survey was completed"):
        each(lambda _: ENDLESS, lambda: next(asked))
    assert given_up == [3]
