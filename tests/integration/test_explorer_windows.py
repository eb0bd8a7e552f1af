"""Deep zoom through the service: windows of the plane on a real cluster, beside a survey that runs on it."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import aclosing, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import xarray as xr
from distributed import Client
from service_processes import assert_bit_identical, serial_run

from rattle import RattleError
from service.app import create_app
from service.errors import UnavailableError
from service.explorer.windows import refine
from service.settings import Settings
from service.state import Front
from workers import (
    ClusterLostError,
    Frame,
    SurveyError,
    SurveyRequest,
    Window,
    compute_part,
    connect,
    embedded_cluster,
    window_survey,
)

REQUEST = SurveyRequest(
    delta={"start": 0.5, "stop": 0.8, "num": 24},
    epsilon={"start": 0.05, "stop": 0.2, "num": 24},
    initial_conditions={"count": 8},
    tile={"delta": 4, "epsilon": 4},
)
WINDOW = Window((0.55, 0.65), (0.08, 0.12))
LARGE = (800, 800)  # pixels: minutes of work
HERE = "http://127.0.0.1:8000"


@pytest.fixture(scope="module")
def cluster() -> Iterator[Client]:
    with embedded_cluster(2) as client:
        yield client


@asynccontextmanager
async def service(data: Path, open_cluster: Callable[[], Any], **settings: Any) -> AsyncIterator[tuple[Front, Any]]:
    """What the routes share, once the cluster is there, and a client of the application."""
    app = create_app(Settings(data=data, **settings), open_cluster)
    async with app.router.lifespan_context(app):
        front: Front = app.state.front
        await eventually(lambda: front.manager.cluster_state == "ready")
        transport = httpx.ASGITransport(app, client=("127.0.0.1", 50000))
        async with httpx.AsyncClient(transport=transport, base_url=HERE) as http:
            yield front, http


async def eventually(holds: Callable[[], bool], seconds: float = 30) -> None:
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline
        await asyncio.sleep(0.02)


def run(data: Path, cluster: Client, body: Callable[[Front, Any], Awaitable[None]], **settings: Any) -> None:
    """Run a test in an event loop, with a service that borrows the cluster."""

    @contextmanager
    def borrowed() -> Iterator[Client]:
        yield cluster

    async def main() -> None:
        async with service(data, borrowed, **settings) as (front, http):
            await body(front, http)

    asyncio.run(main())


async def all_frames(front: Front, variable: str, index: int, pixels: tuple[int, int] = (65, 33)) -> list[Frame]:
    return [frame async for frame in refine(front, REQUEST, variable, index, WINDOW, pixels)]


def has_no_windows(cluster: Client) -> bool:
    return not any(str(key).startswith("window") for keys in cluster.processing().values() for key in keys)


@pytest.mark.parametrize(
    ("variable", "index"), [("region", 0), ("orbit_velocity", 2), ("quiet_fraction", 0), ("attractor_kind", 1)]
)
def test_frames_become_the_survey_of_the_window(tmp_path: Path, cluster: Client, variable: str, index: int) -> None:
    async def body(front: Front, _: Any) -> None:
        survey = window_survey(REQUEST, WINDOW, (65, 33))
        delta, epsilon = survey.delta.values(), survey.epsilon.values()
        expected = compute_part(survey, variable, index, delta, epsilon).values
        frames = await all_frames(front, variable, index)
        last = frames[-1]
        np.testing.assert_array_equal(last.values, expected)
        np.testing.assert_array_equal(last.delta, delta)
        np.testing.assert_array_equal(last.epsilon, epsilon)
        assert last.done == 1
        assert last.failed == 0
        assert len(frames) == 1 if variable in ("region", "orbit_velocity") else len(frames) > 1
        sizes, done = [frame.values.size for frame in frames], [frame.done for frame in frames]
        assert sizes == sorted(sizes)
        assert done == sorted(set(done))
        for frame in frames[:1]:  # all that it shows has been computed
            step = (len(delta) - 1) // (len(frame.delta) - 1)
            np.testing.assert_array_equal(frame.values, expected[::step, ::step])

    run(tmp_path, cluster, body)


def test_a_window_goes_before_what_waits_for_the_workers(tmp_path: Path, cluster: Client) -> None:
    async def body(front: Front, _: Any) -> None:
        each = list(cluster.nthreads()) * 30  # named, they wait at their worker, not at the scheduler: 4.5 s
        waiting = [cluster.submit(time.sleep, 0.15, pure=False, workers=[worker]) for worker in each]
        assert len(await all_frames(front, "region", 0)) == 1
        assert sum(future.done() for future in waiting) < 30
        await asyncio.to_thread(cluster.cancel, waiting)

    run(tmp_path, cluster, body)


def test_a_survey_stays_as_it_is_beside_a_window(tmp_path: Path, cluster: Client) -> None:
    async def body(front: Front, http: Any) -> None:
        answer = await http.post("/v1/surveys", json=REQUEST.model_dump(mode="json"))
        survey_id = answer.json()["id"]
        await eventually(lambda: front.database.job(survey_id).tiles_done > 0)
        frames = await all_frames(front, "lyapunov_max", 0, (33, 33))
        assert frames[-1].done == 1
        assert front.database.job(survey_id).tiles_done < 36
        await eventually(lambda: front.database.job(survey_id).state == "successful", 60)
        with xr.open_zarr(front.directory.store(survey_id)) as dataset:
            assert_bit_identical(dataset, serial_run(REQUEST))

    run(tmp_path, cluster, body)


def test_closing_gives_up_what_is_not_begun_and_the_loop_runs_on(tmp_path: Path, cluster: Client) -> None:
    async def body(front: Front, _: Any) -> None:
        ticks = 0

        async def tick() -> None:
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0.01)

        ticking = asyncio.create_task(tick())
        async with aclosing(refine(front, REQUEST, "lyapunov_max", 0, WINDOW, LARGE)) as frames:
            async for frame in frames:
                before = frame.done
                if before > 0.01:
                    break
        assert before < 0.5
        assert ticks > 20
        await eventually(lambda: has_no_windows(cluster), 5)
        ticking.cancel()
        # A task that is cancelled gives up, too, and neither keeps its turn.
        for _ in range(3):
            task = asyncio.create_task(all_frames(front, "lyapunov_max", 0, LARGE))
            await asyncio.sleep(0.3)
            task.cancel()
            await asyncio.wait([task])
        await eventually(lambda: has_no_windows(cluster), 5)
        assert front.windows.borrowed_tokens == 0
        assert len(await all_frames(front, "region", 0)) == 1

    run(tmp_path, cluster, body)


def test_so_many_at_once_and_so_many_wait(tmp_path: Path, cluster: Client) -> None:
    async def body(front: Front, _: Any) -> None:
        async with aclosing(refine(front, REQUEST, "lyapunov_max", 0, WINDOW, LARGE)) as first:
            await anext(first)
            second = asyncio.create_task(all_frames(front, "region", 0))
            await asyncio.sleep(0.5)
            assert not second.done()
            with pytest.raises(UnavailableError, match="Too many"):
                await all_frames(front, "region", 0)
        assert len(await second) == 1

    run(tmp_path, cluster, body, max_windows=1, max_points_waiting=1)


def test_what_cannot_be_computed(tmp_path: Path, cluster: Client) -> None:
    async def body(front: Front, _: Any) -> None:
        with pytest.raises(SurveyError, match="weather"):
            await all_frames(front, "weather", 0)
        with pytest.raises(SurveyError, match="zoom out"):
            await anext(refine(front, REQUEST, "region", 0, Window((0.6, 0.6 + 3e-16), (0.1, 0.2)), LARGE))
        assert front.windows.borrowed_tokens == 0

    run(tmp_path, cluster, body)


def test_a_cluster_that_is_lost_is_told_and_found_again(tmp_path: Path) -> None:
    """The scheduler goes away under a window, with no survey that would notice; the next window has a new one."""
    opened: list[Client] = []

    @contextmanager
    def existing() -> Iterator[Client]:
        with connect(scheduler.scheduler.address) as client:
            opened.append(client)
            yield client

    async def main() -> None:
        nonlocal scheduler
        async with service(tmp_path, existing) as (front, _):
            async with aclosing(refine(front, REQUEST, "lyapunov_max", 0, WINDOW, LARGE)) as frames:
                await anext(frames)
                await asyncio.to_thread(scheduler.cluster.close)
                with pytest.raises(ClusterLostError, match="workers are gone"):
                    async for _ in frames:
                        pass
            assert front.windows.borrowed_tokens == 0
            await eventually(lambda: front.manager.cluster_state != "ready")
            with pytest.raises(RattleError, match="workers"):
                await all_frames(front, "region", 0)
            with embedded_cluster(1) as scheduler:
                await eventually(lambda: front.manager.cluster_state == "ready")
                assert (await all_frames(front, "region", 0))[-1].done == 1
            assert len(opened) == 2

    with embedded_cluster(1) as scheduler:
        asyncio.run(main())
