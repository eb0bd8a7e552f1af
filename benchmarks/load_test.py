"""Measure a service under load: submissions, readers and event streams during a survey; and a survey of 10⁶ cells.

    python benchmarks/load_test.py [--seconds 20] [--watchers 200] [--rate 50]

The program starts a service on loopback with two workers. It prints latencies in milliseconds, memory and processor
time of the service, and the load average of the computer, without which the figures mean little.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import tempfile
import time
from collections.abc import Awaitable, Callable, Coroutine
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import psutil
from server import server

BUSY = {  # a chaotic plane: the survey outlasts the test and writes several tiles a second
    "delta": {"start": 0.4, "stop": 1.0, "num": 400},
    "epsilon": {"start": 0.2, "stop": 0.3, "num": 400},
    "tile": {"delta": 8, "epsilon": 8},
}
MILLION = {  # 20,000 tiles of 50 cells
    "delta": {"start": 0.4, "stop": 1.0, "num": 1000},
    "epsilon": {"start": 0.005, "stop": 0.06, "num": 1000},
    "initial_conditions": {"count": 1},
    "tile": {"delta": 10, "epsilon": 5},
}
SMALL = {
    "delta": {"start": 0.5, "stop": 0.7, "num": 6},
    "epsilon": {"start": 0.05, "stop": 0.15, "num": 4},
    "initial_conditions": {"count": 4},
}


class Latencies(list[float]):
    """A list of latencies in milliseconds."""

    async def of(self, call: Awaitable[httpx.Response], *statuses: int) -> httpx.Response:
        """Wait for an answer, record its latency, and require that its status is one of `statuses`."""
        began = time.perf_counter()
        answer = await call
        self.append((time.perf_counter() - began) * 1000)
        assert answer.status_code in statuses, answer.text
        return answer

    def __str__(self) -> str:
        if not self:
            return "none"
        ordered = sorted(self)
        shares = (ordered[min(int(share * len(ordered)), len(ordered) - 1)] for share in (0.5, 0.95, 0.99, 1.0))
        return " | ".join(f"{value:.1f}" for value in shares) + f" | {len(self)}"


async def watch(url: str, path: str, delays: Latencies, counts: list[int]) -> None:
    """Follow the events of a survey, and record the milliseconds from an event's time stamp to its arrival.

    HTTP is written by hand here, because a client library would take longer for an event than the service.
    """
    host, port = url.removeprefix("http://").split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    try:
        writer.write(f"GET {path}/events HTTP/1.1\r\nHost: {host}:{port}\r\nLast-Event-ID: {2**50}\r\n\r\n".encode())
        while line := await reader.readline():
            if line.startswith(b"data:"):
                counts[0] += 1
                at = json.loads(line[5:]).get("at")
                if at:
                    delays.append((datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds() * 1000)
    finally:
        writer.close()


async def regularly(rate: float, stop: asyncio.Event, act: Callable[[int], Coroutine[Any, Any, None]]) -> None:
    """Call `act` at a fixed rate, even if earlier calls have not ended."""
    tasks, began, number = set[asyncio.Task[Any]](), time.perf_counter(), 0
    while not stop.is_set():
        tasks.add(asyncio.create_task(act(number)))
        number += 1
        await asyncio.sleep(max(0.0, began + number / rate - time.perf_counter()))
    await asyncio.gather(*tasks)


async def load(url: str, front: psutil.Process, seconds: float, watchers: int, rate: float) -> None:
    """Submit surveys, read documents and lists, and follow events, all at once while a survey runs."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=100)
    submitted, shown, listed, delays, counts = Latencies(), Latencies(), Latencies(), Latencies(), [0]
    async with httpx.AsyncClient(base_url=url, timeout=60, limits=limits) as client:
        path = (await client.post("/v1/surveys", json=BUSY)).headers["location"]
        while (await client.get(path)).json()["tiles_done"] < 2:
            await asyncio.sleep(0.5)
        stop = asyncio.Event()
        streams = [asyncio.create_task(watch(url, path, delays, counts)) for _ in range(watchers)]
        await asyncio.sleep(2)
        before, used, done = front.memory_info().rss, front.cpu_times(), (await client.get(path)).json()["tiles_done"]
        received = counts[0]

        async def submit(number: int) -> None:
            await submitted.of(client.post("/v1/surveys", json=SMALL | {"seed": number}), 202)

        async def read(number: int) -> None:
            await shown.of(client.get(path), 200)
            if number % 5 == 0:
                await listed.of(client.get("/v1/surveys"), 200)

        work = asyncio.gather(regularly(rate, stop, submit), regularly(20, stop, read))
        await asyncio.sleep(seconds)
        stop.set()
        await work
        after, spent = front.memory_info().rss, front.cpu_times()
        tiles = (await client.get(path)).json()["tiles_done"] - done
        for stream in streams:
            stream.cancel()
    cpu = spent.user + spent.system - used.user - used.system
    load_average = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"{watchers} watchers, {rate:g} submissions/s for {seconds:g} s; load average {load_average}")
    print("| ms | p50 | p95 | p99 | largest | number |\n|---|---|---|---|---|---|")
    for name, latencies in (("submit", submitted), ("document", shown), ("list", listed), ("event", delays)):
        print(f"| {name} | {latencies} |")
    print(f"{tiles} tiles done meanwhile, {counts[0] - received} events received")
    print(f"front end: {before >> 20} MiB before, {after >> 20} MiB after, {cpu / seconds:.0%} of a core")


async def million(url: str, front: psutil.Process, seconds: float) -> None:
    """Measure the memory of the service while a survey of 10⁶ cells is computed, listed, followed and read."""
    async with httpx.AsyncClient(base_url=url, timeout=120) as client:
        path = (await client.post("/v1/surveys", json=MILLION)).headers["location"]
        counts, memory = [0], []
        streams = [asyncio.create_task(watch(url, path, Latencies(), counts)) for _ in range(10)]
        began = time.perf_counter()
        while time.perf_counter() - began < seconds:
            document = (await client.get(path)).json()
            await client.get("/v1/surveys")
            await client.get(f"{path}/store/zarr.json")
            memory.append((document["tiles_done"], front.memory_info().rss >> 20))
            if document["state"] not in ("accepted", "running"):
                break
            await asyncio.sleep(seconds / 20)
        for stream in streams:
            stream.cancel()
    print(f"\n10^6 cells, 20,000 tiles, {document['state']} after {time.perf_counter() - began:.0f} s;", end=" ")
    print("tiles done: MiB of the front end")
    print(", ".join(f"{tiles}: {size}" for tiles, size in memory), f"; {counts[0]} events received by 10 watchers")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--watchers", type=int, default=200)
    parser.add_argument("--rate", type=float, default=50, help="submissions per second")
    parser.add_argument("--million", type=float, default=60, help="seconds for the survey of a million cells; 0: none")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as data, server(Path(data)) as (url, front):
        asyncio.run(load(url, front, given.seconds, given.watchers, given.rate))
    if given.million:
        with tempfile.TemporaryDirectory() as data, server(Path(data)) as (url, front):
            asyncio.run(million(url, front, given.million))


if __name__ == "__main__":
    main()
