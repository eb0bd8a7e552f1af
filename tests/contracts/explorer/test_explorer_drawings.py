"""Drawings of a part of a page: one at a time, the newest of what is wanted, none that nobody wants any more; and the
threads of a page, which are few however much is given up.
"""

import asyncio
import threading
from collections.abc import AsyncGenerator, Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest
from waiting import HANG, eventually

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common import drawings
from gear_rattle.service.explorer.common.drawings import DrawingRunner, Show
from gear_rattle.service.explorer.common.viewer import THREADS, PageSession
from rattle import RattleError


class Slow:
    """Drawings that last until they are let go, at most one at a time."""

    def __init__(self) -> None:
        viewer: Any = SimpleNamespace(
            start=lambda work: asyncio.get_running_loop().create_task(work),
            schedule_document_change=lambda what: what(),
        )
        self.refused: list[RattleError] = []
        self.drawings = DrawingRunner(viewer, self.refused.append)
        self.begun: list[tuple[str, int]] = []
        self.shown: list[tuple[str, int]] = []
        self.go_on = asyncio.Event()
        self.at_work = 0

    async def want(self, what: str, done: int, state: State = State.SUCCESSFUL) -> None:
        async def draw() -> AsyncGenerator[Show, None]:
            self.begun.append((what, done))
            self.at_work += 1
            assert self.at_work == 1
            await self.go_on.wait()
            self.at_work -= 1
            if what == "wrong":
                raise ValueError(what)
            if what == "refused":
                raise RattleError(what)
            yield lambda: self.shown.append((what, done))

        self.drawings.request(what, [JobRow(id="a", state=state, cells_done=done)], draw)
        await settled()

    async def end(self) -> None:
        self.go_on.set()
        await settled()


async def settled() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def in_loop(body: Callable[[Slow], Awaitable[None]]) -> None:
    async def main() -> None:
        await body(Slow())

    asyncio.run(main())


def test_what_is_wanted_meanwhile_is_drawn_next_and_only_the_newest() -> None:
    async def body(slow: Slow) -> None:
        for done in (1, 2, 3):
            await slow.want("region", done)
        assert slow.begun == [("region", 1)]
        await slow.end()
        assert slow.shown == slow.begun == [("region", 1), ("region", 3)]  # of fewer cells, it is the same map
        await slow.want("region", 3)
        assert len(slow.begun) == 2

    in_loop(body)


def test_what_is_no_longer_wanted_is_not_shown() -> None:
    async def body(slow: Slow) -> None:
        await slow.want("region", 1)
        await slow.want("orbits", 1)
        await slow.end()
        assert slow.shown == [("orbits", 1)]
        slow.go_on.clear()
        await slow.want("region", 1)
        slow.drawings.stop()
        await slow.end()
        assert slow.shown == [("orbits", 1)]
        slow.at_work = 0
        await slow.want("orbits", 1)
        assert slow.shown == [("orbits", 1)] * 2

    in_loop(body)


def test_what_fails_is_not_tried_again_until_there_is_more() -> None:
    async def body(slow: Slow) -> None:
        slow.go_on.set()
        for done in (1, 1, 2):
            await slow.want("wrong", done)
        assert slow.begun == [("wrong", 1), ("wrong", 2)]
        await slow.want("region", 2)
        assert slow.shown == [("region", 2)]

    in_loop(body)


def test_an_error_of_a_wanted_drawing_is_shown_in_its_place() -> None:
    async def body(slow: Slow) -> None:
        await slow.want("refused", 1)
        await slow.want("region", 1)
        await slow.end()
        assert (slow.shown, slow.refused) == ([("region", 1)], [])
        await slow.want("refused", 1)
        assert [str(each) for each in slow.refused] == ["refused"]

    in_loop(body)


def test_a_survey_that_runs_is_drawn_once_in_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(slow: Slow) -> None:
        slow.go_on.set()
        monkeypatch.setattr(drawings, "PAUSE", HANG)
        await slow.want("region", 1, State.RUNNING)
        await slow.want("region", 2, State.RUNNING)
        assert slow.shown == [("region", 1)]
        slow.drawings.stop()
        monkeypatch.setattr(drawings, "PAUSE", 0.0)
        await slow.want("region", 2, State.RUNNING)
        await slow.want("region", 3, State.RUNNING)
        await eventually(lambda: slow.shown[1:] == [("region", 2), ("region", 3)])

    in_loop(body)


def test_threads_whose_work_was_given_up_keep_their_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of windows that a viewer had left were traced in fifty threads, and the service answered nobody."""
    monkeypatch.setattr(PageSession, "require_scope", lambda *_: None)
    begun, go_on = list[int](), threading.Event()

    async def main() -> None:
        unused: Any = None
        viewer = PageSession(unused, None, unused)

        async def trace(number: int) -> None:
            def work() -> int:
                begun.append(number)
                assert go_on.wait(HANG)
                if number == 0:
                    raise ValueError("nobody asks")
                return number

            assert await viewer.run_in_thread(work) == number

        left = [viewer.start(trace(number)) for number in range(3 * THREADS)]
        await eventually(lambda: len(begun) == THREADS)
        for each in left:
            each.cancel()
        asked = viewer.start(trace(-1))
        await settled()
        assert sorted(begun) == list(range(THREADS))
        go_on.set()
        await asyncio.wait_for(asked, HANG)
        assert sorted(begun) == [-1, *range(THREADS)]  # those that waited have never begun
        assert all(each.cancelled() for each in left)

    asyncio.run(main())
