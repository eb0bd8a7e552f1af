"""Deep zoom through the service: windows of the plane on a real cluster, beside a survey that runs on it."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import aclosing, asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import dask
import httpx
import numpy as np
import pytest
import xarray as xr
from depth import deep
from distributed import Client, Worker
from faults import Faults
from intruders import certificates
from service_processes import assert_bit_identical, serial_run
from waiting import HANG, eventually

import gear_rattle.workers.cluster.refinement
from gear_rattle.service.app import create_app
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.operations import windows as service_windows
from gear_rattle.service.operations.windows import WindowCache, refine_window
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import (
    ClusterLostError,
    SurveyError,
    SurveyRequest,
    Window,
    WindowFrame,
    compute_window_part,
    connect,
    embedded_cluster,
    request_for_window,
)
from rattle import RattleError

REQUEST = SurveyRequest(
    delta={"start": 0.5, "stop": 0.8, "num": 12},
    epsilon={"start": 0.05, "stop": 0.2, "num": 12},
    initial_conditions={"count": 4},
    tile={"delta": 4, "epsilon": 4},
)
WINDOW = Window((0.55, 0.65), (0.08, 0.12))
PIXELS = (65, 33)
HERE = "http://127.0.0.1:8000"
THREADS = 2


@pytest.fixture(scope="module")
def faults(tmp_path_factory: pytest.TempPathFactory) -> Faults:
    return Faults(tmp_path_factory.mktemp("faults"))


@pytest.fixture(scope="module")
def cluster(faults: Faults) -> Iterator[Client]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", faults.environment["PYTHONPATH"])
        with embedded_cluster(THREADS) as client:
            yield client


@pytest.fixture(autouse=True)
def _nobody_is_kept(faults: Faults) -> Iterator[None]:
    """Release what a failed test has held, because other tests use the same workers."""
    yield
    faults.release()


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Create a file; while it exists, every part of WINDOW waits, except those of the coarsest level."""
    gate = tmp_path / "gate"
    gate.touch()
    survey = request_for_window(REQUEST, WINDOW, PIXELS)
    coarsest = {*survey.delta.values()[::32]}, {*survey.epsilon.values()[::32]}
    monkeypatch.setattr(gear_rattle.workers.cluster.refinement, "compute_window_part", partial(behind, gate, coarsest))
    yield gate
    gate.unlink(missing_ok=True)


def behind(
    gate: Path, coarsest: tuple[set[float], set[float]], survey: SurveyRequest, variable: str, index: int, *axes: Any
) -> Any:
    """Compute the coarsest part of a window at once, and further parts once the gate is open."""
    if not all(known.issuperset(values) for known, values in zip(coarsest, axes, strict=True)):
        wait_for(gate.exists)
    return compute_window_part(survey, variable, index, *axes)


def wait_for(blocked: Callable[[], bool]) -> None:
    """Keep a worker busy."""
    while blocked():
        time.sleep(0.01)


@asynccontextmanager
async def service(
    data: Path, open_cluster: Callable[[], Any], **settings: Any
) -> AsyncIterator[tuple[ApplicationState, Any]]:
    """Yield the state of the routes and a client of the application, once the cluster is ready."""
    app = create_app(Settings(data=data, **settings), open_cluster)
    async with app.router.lifespan_context(app):
        front: ApplicationState = app.state.front
        await eventually(lambda: front.manager.cluster_state == "ready")
        transport = httpx.ASGITransport(app, client=("127.0.0.1", 50000))
        async with httpx.AsyncClient(transport=transport, base_url=HERE) as http:
            yield front, http


def run(data: Path, cluster: Client, body: Callable[[ApplicationState, Any], Awaitable[None]], **settings: Any) -> None:
    """Run a test in an event loop, with a service that uses the cluster of the module."""

    @contextmanager
    def borrowed() -> Iterator[Client]:
        yield cluster

    async def main() -> None:
        async with service(data, borrowed, **settings) as (front, http):
            await body(front, http)

    asyncio.run(main())


def shown(front: ApplicationState, variable: str, index: int = 0) -> Any:
    """Return the frames of the window."""
    return refine_window(front, REQUEST, variable, index, WINDOW, PIXELS)


async def all_frames(front: ApplicationState, variable: str, index: int = 0) -> list[WindowFrame]:
    return [frame async for frame in shown(front, variable, index)]


def has_part(dask_worker: Worker) -> bool:
    """Return whether a part of a window has arrived at a worker; that may be later than the scheduler sends it."""
    return any(str(key).startswith("window") for key in dask_worker.state.tasks)


def parts(cluster: Client) -> int:
    """Return how many parts of windows the scheduler has sent to workers, arrived or not."""
    return sum(str(key).startswith("window") for keys in cluster.processing().values() for key in keys)


@pytest.mark.parametrize(
    ("variable", "index"),
    [("region", 0), pytest.param("orbit_velocity", 2, marks=deep), ("quiet_fraction", 0), ("attractor_kind", 1)],
)
def test_frames_become_the_survey_of_the_window(
    tmp_path: Path, cluster: Client, gate: Path, monkeypatch: pytest.MonkeyPatch, variable: str, index: int
) -> None:
    monkeypatch.setattr(gear_rattle.workers.cluster.refinement, "FRAME_SECONDS", 0.0)  # a frame after every part

    async def body(front: ApplicationState, _: Any) -> None:
        survey = request_for_window(REQUEST, WINDOW, PIXELS)
        delta, epsilon = survey.delta.values(), survey.epsilon.values()
        expected = compute_window_part(survey, variable, index, delta, epsilon).values
        at_once = variable in ("region", "orbit_velocity")
        if at_once:
            gate.unlink()
        frames = []
        async for frame in shown(front, variable, index):
            frames.append(frame)
            gate.unlink(missing_ok=True)  # the first frame, of the coarsest level, has been seen
        last = frames[-1]
        np.testing.assert_array_equal(last.values, expected)
        np.testing.assert_array_equal(last.delta, delta)
        np.testing.assert_array_equal(last.epsilon, epsilon)
        assert last.done == 1
        assert last.failed == 0
        assert len(frames) == 1 if at_once else len(frames) > 1
        sizes, done = [frame.values.size for frame in frames], [frame.done for frame in frames]
        assert sizes == sorted(sizes)
        assert done == sorted(set(done))
        for frame in frames[:1]:  # the first frame shows everything that has been computed
            step = (len(delta) - 1) // (len(frame.delta) - 1)
            np.testing.assert_array_equal(frame.values, expected[::step, ::step])

    run(tmp_path, cluster, body)


def test_a_window_goes_before_what_waits_for_the_workers(tmp_path: Path, cluster: Client) -> None:
    first, others = tmp_path / "first", tmp_path / "others"
    first.touch()
    others.touch()

    async def body(front: ApplicationState, _: Any) -> None:
        submit = partial(cluster.submit, wait_for, pure=False)
        begun = [submit(first.exists, workers=[worker]) for worker in cluster.nthreads()]
        await eventually(lambda: sum(map(len, cluster.processing().values())) == THREADS)
        waiting = [submit(others.exists, workers=[worker]) for worker in cluster.nthreads() for _ in range(10)]
        window = asyncio.create_task(all_frames(front, "region"))
        await eventually(lambda: any(cluster.run(has_part).values()))
        first.unlink()  # each worker takes its next task: the window, or one that never ends
        assert len(await asyncio.wait_for(window, HANG)) == 1
        await eventually(lambda: all(future.status == "finished" for future in begun))  # one of them may end later
        assert not any(future.done() for future in waiting)
        others.unlink()
        await asyncio.to_thread(cluster.cancel, waiting)

    try:
        run(tmp_path, cluster, body)
    finally:  # otherwise the tasks would occupy the workers of the other tests for ever
        first.unlink(missing_ok=True)
        others.unlink(missing_ok=True)


def test_a_survey_stays_as_it_is_beside_a_window(tmp_path: Path, cluster: Client, faults: Faults) -> None:
    async def body(front: ApplicationState, http: Any) -> None:
        faults.hold(REQUEST.n_tiles - 1)
        answer = await http.post("/v1/surveys", json=REQUEST.model_dump(mode="json"))
        survey_id = answer.json()["id"]
        await eventually(lambda: front.database.job(survey_id).tiles_done > 0)
        window = asyncio.ensure_future(all_frames(front, "lyapunov_max"))
        await asyncio.wait([window], timeout=20)  # one of its parts may wait behind the tile that is held
        assert front.database.job(survey_id).state == "running"
        faults.release()
        assert (await window)[-1].done == 1
        await eventually(lambda: front.database.job(survey_id).state == "successful")
        with xr.open_zarr(front.directory.store(survey_id)) as dataset:
            assert_bit_identical(dataset, serial_run(REQUEST))

    run(tmp_path, cluster, body)


def test_closing_gives_up_what_is_not_begun_and_the_loop_runs_on(
    tmp_path: Path, cluster: Client, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        gear_rattle.workers.cluster.refinement, "PART_SECONDS", 0
    )  # parts of one cell each, so many that some must wait

    async def body(front: ApplicationState, _: Any) -> None:
        async with aclosing(shown(front, "lyapunov_max")) as frames:
            assert (await anext(frames)).done < 0.5
            second = asyncio.ensure_future(anext(frames))
            await eventually(lambda: parts(cluster) > THREADS)  # some run for ever, and others wait behind them
            assert not second.done()
            second.cancel()
            await asyncio.wait([second])
        await eventually(lambda: parts(cluster) == 0)  # although the running parts do not end by themselves
        # A task that is cancelled gives up as well, and keeps no place among the waiting.
        for _ in range(3):
            task = asyncio.create_task(all_frames(front, "lyapunov_max"))
            await eventually(lambda: parts(cluster) > 0)
            task.cancel()
            await asyncio.wait([task])
            await eventually(lambda: parts(cluster) == 0)
        assert front.window_limiter.borrowed_tokens == 0
        gate.unlink()
        assert len(await all_frames(front, "region")) == 1

    run(tmp_path, cluster, body)


def test_a_picture_of_a_window_has_its_finer_cells_computed_once(
    tmp_path: Path, cluster: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(front: ApplicationState, http: Any) -> None:
        here = (await http.post("/v1/surveys", json=REQUEST.model_dump(mode="json"))).json()["links"]["self"]
        await eventually(lambda: front.database.job(here.rpartition("/")[2]).state == "successful")
        (left, right), (bottom, top) = WINDOW
        window = {"delta_min": left, "delta_max": right, "epsilon_min": bottom, "epsilon_max": top}
        asked = window | {"variable": "quiet_fraction"}
        fine = asked | dict(zip(("pixels_delta", "pixels_epsilon"), PIXELS, strict=True))
        coarse, first = [(await http.get(f"{here}/map.png", params=each)).content for each in (asked, fine)]
        expected = (await all_frames(front, "quiet_fraction"))[-1]
        windows = http._transport.app.state.overlaid.windows
        beyond = fine | {"delta_min": -0.3, "delta_max": -0.1}  # outside of the survey: the page shows no cells there
        assert (await http.get(f"{here}/map.png", params=beyond)).status_code == 200
        monkeypatch.setattr(service_windows, "refine_window", None)  # a window that is kept is not computed again
        again = await http.get(f"{here}/map.png", params=fine)
        kept = await windows.last_frame(REQUEST, "quiet_fraction", 0, WINDOW, PIXELS)
        np.testing.assert_array_equal(kept.values, expected.values)
        assert coarse != first == again.content
        for variable in ("attractor_phase", "region"):  # no window has it; the cells are fine enough
            few = fine if variable != "region" else {"pixels_delta": 20, "pixels_epsilon": 20}
            answer = await http.get(f"{here}/map.png", params=few | {"variable": variable})
            assert answer.status_code == 200

    run(tmp_path, cluster, body)


def test_so_many_windows_are_kept_and_so_many_cells() -> None:
    windows = WindowCache(None)  # type: ignore[arg-type]  # which is asked for nothing

    def keep(number: int, cells: int) -> None:
        frame = WindowFrame(np.zeros(1), np.zeros(1), np.zeros((1, cells)), 1.0, 0)
        windows._keep_frame(("", "region", number, WINDOW, PIXELS), frame)

    for number in range(2 * service_windows.KEPT_WINDOWS):
        keep(number, 1)
    assert [key[2] for key in windows._kept] == [*range(service_windows.KEPT_WINDOWS, 2 * service_windows.KEPT_WINDOWS)]
    keep(99, service_windows.KEPT_CELLS)
    assert [key[2] for key in windows._kept] == [99]


def test_so_many_at_once_and_so_many_wait(tmp_path: Path, cluster: Client) -> None:
    async def body(front: ApplicationState, _: Any) -> None:
        async with aclosing(shown(front, "lyapunov_max")) as first:
            await anext(first)
            second = asyncio.create_task(all_frames(front, "region"))
            await eventually(lambda: front.window_limiter.statistics().tasks_waiting == 1)
            with pytest.raises(UnavailableError, match="Too many"):
                await all_frames(front, "region")
            assert not second.done()
        assert len(await second) == 1

    run(tmp_path, cluster, body, max_windows=1, max_points_waiting=1)


def test_what_cannot_be_computed(tmp_path: Path, cluster: Client) -> None:
    async def body(front: ApplicationState, _: Any) -> None:
        with pytest.raises(SurveyError, match="weather"):
            await all_frames(front, "weather")
        with pytest.raises(SurveyError, match="zoom out"):
            await anext(refine_window(front, REQUEST, "region", 0, Window((0.6, 0.6 + 3e-16), (0.1, 0.2)), PIXELS))
        assert front.window_limiter.borrowed_tokens == 0

    run(tmp_path, cluster, body)


@deep
def test_a_cluster_that_is_lost_is_told_and_found_again(tmp_path: Path, gate: Path) -> None:
    """The scheduler ends under a window while no survey runs that would notice; the next window has a new scheduler."""
    opened: list[Client] = []

    @contextmanager
    def existing() -> Iterator[Client]:
        with dask.config.set(certificates(scheduler)), connect(scheduler.scheduler.address) as client:
            opened.append(client)
            yield client

    async def main() -> None:
        nonlocal scheduler
        async with service(tmp_path, existing) as (front, _):
            async with aclosing(shown(front, "lyapunov_max")) as frames:
                await anext(frames)
                await asyncio.to_thread(scheduler.cluster.close)
                with pytest.raises(ClusterLostError):
                    async for _ in frames:
                        pass
            gate.unlink()
            assert front.window_limiter.borrowed_tokens == 0
            await eventually(lambda: front.manager.cluster_state != "ready")
            with pytest.raises(RattleError, match="workers"):
                await all_frames(front, "region")
            with embedded_cluster(1) as scheduler:
                await eventually(lambda: front.manager.cluster_state == "ready")
                assert (await all_frames(front, "region"))[-1].done == 1
            assert len(opened) == 2

    with embedded_cluster(1) as scheduler:
        asyncio.run(main())
