"""Foreground requests come first, and background ones give way to them and begin anew."""

import asyncio
from collections.abc import Callable, Coroutine

from anyio import Event, sleep_forever
from waiting import HANG

from gear_rattle.service.limiter import PriorityLimiter


def run(body: Callable[[], Coroutine[None, None, None]]) -> None:
    asyncio.run(asyncio.wait_for(body(), HANG))


def test_the_background_gives_way_and_begins_anew() -> None:
    async def body() -> None:
        limiter, entered = PriorityLimiter(1), Event()
        begun: list[None] = []

        async def background() -> str:
            begun.append(None)
            entered.set()
            if len(begun) == 1:
                await sleep_forever()
            return "found"

        first = asyncio.create_task(limiter.run_in_background(background))
        await entered.wait()
        async with limiter.foreground_slot():  # else it would wait for ever
            second = asyncio.create_task(limiter.run_in_background(background))
            await asyncio.sleep(0)
            assert len(begun) == 1
        assert await asyncio.gather(first, second) == ["found", "found"]
        assert len(begun) == 3

    run(body)


def test_those_who_wait_come_before_the_background_however_late() -> None:
    async def body() -> None:
        limiter = PriorityLimiter(1)
        order: list[str] = []

        async def one(name: str) -> None:
            async with limiter.foreground_slot():
                order.append(name)
                await asyncio.sleep(0)

        async def background() -> None:
            order.append("background")

        async with limiter.foreground_slot():
            later = asyncio.create_task(limiter.run_in_background(background))
            await asyncio.sleep(0)
            others = [asyncio.create_task(one(name)) for name in "abc"]
            await asyncio.sleep(0)
        await asyncio.gather(later, *others)
        assert order == ["a", "b", "c", "background"]

    run(body)


def test_who_is_given_up_while_waiting_holds_nothing_back() -> None:
    async def body() -> None:
        limiter = PriorityLimiter(1)

        async def one() -> None:
            async with limiter.foreground_slot():
                raise AssertionError

        async def background() -> int:
            return 7

        async with limiter.foreground_slot():
            waiting = asyncio.create_task(one())
            await asyncio.sleep(0)
            waiting.cancel()
            await asyncio.wait([waiting])
        assert await limiter.run_in_background(background) == 7
        async with limiter.foreground_slot():
            pass

    run(body)
