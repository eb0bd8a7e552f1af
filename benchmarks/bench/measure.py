"""Measure the figures of `make bench`. A figure is the best of several runs, because load can only slow a run down.

Runs that are compared alternate, so that a temporary load slows all of them.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arguments = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]

TURNS, TURNS_IN_STEP = 5, 15
PATIENCE = 300.0  # longest wait of one runner for the other, which may have to compile first
IMPACTS = {"A": 300, "B": 300, "C": 200}  # by workload: impacts on Σ⁺ of each trajectory
PER_CELL = 16  # trajectories for each cell of workload C
NANO = 1e9
CELLS = {
    "quiet only (0.6, 0.056)": (0.6, 0.056),
    "five attractors (0.6, 0.089)": (0.6, 0.089),
    "chaos beside quiet (0.6, 0.1)": (0.6, 0.1),
    "chaos alone (0.6, 0.25)": (0.6, 0.25),
    "near the quiet limit (0.6, 0.1885)": (0.6, 0.1885),
}
NEIGHBOURS = 1e-4  # half the width in δ of the row of cells around each of CELLS
PLANE = (0.4, 1.0), (0.005, 0.3)  # (δ, ε) of Figure 7
LARGE = 1_000_000  # cells of the survey whose time is extrapolated
#: Variables that make numba compile for x86-64-v3: a Haswell has just these instructions, and the empty second variable
#: keeps numba from adding further instructions of this processor.
X86_64_V3 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""}
FIRST_RESULT = "import rattle; rattle.Gear(0.6, 0.1).attractors(count=64)"
KIBIBYTE = 1024


def workloads() -> dict[str, tuple[NDArray[np.float64], ...]]:
    """Return (τ, v, δ, ε) of the trajectories of each workload.

    A: δ = 0.6, ε = 0.1, v from 0.5 to 7. B: the same point, v from 0.01 to 0.2. C: 64 × 64 cells of the plane.

    Returns
    -------
    dict[str, tuple[NDArray[np.float64], ...]]
        Four arrays of one length, by workload.
    """
    sets: dict[str, tuple[NDArray[np.float64], ...]] = {}
    for name, low, high in (("A", 0.5, 7.0), ("B", 0.01, 0.2)):
        rng, n = np.random.default_rng(7), 4096
        sets[name] = (rng.random(n), rng.uniform(low, high, n), np.full(n, 0.6), np.full(n, 0.1))
    grid = np.meshgrid(np.linspace(0.4, 1, 64), np.linspace(0.02, 0.3, 64), indexing="ij")
    delta, epsilon = (np.repeat(x.ravel(), PER_CELL) for x in grid)
    rng, n = np.random.default_rng(7), delta.size
    sets["C"] = (rng.random(n), rng.uniform(0.5, 7, n), delta, epsilon)
    return sets


def _arguments(name: str, thin: int) -> Arguments:
    """Return the arguments of `rattle.iterate` for a workload, with every thin-th trajectory."""
    tau, v, delta, epsilon = (np.ascontiguousarray(x[::thin]) for x in workloads()[name])
    return delta, epsilon, tau, v, IMPACTS[name]


def _seconds(run: Callable[[], Any]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def best(runs: Sequence[Callable[[], Any]]) -> list[float]:
    """Return the least seconds of each function in TURNS alternating runs, after a first run that does not count."""
    for run in runs:
        run()
    return np.min([[_seconds(run) for run in runs] for _ in range(TURNS)], axis=0).tolist()


def best_of_two(run: Callable[[], Any]) -> float:
    """Return the seconds of the faster of two runs, after a first run that does not count; for slow functions."""
    run()
    return min(_seconds(run) for _ in range(2))


@dataclass(frozen=True)
class Rate:
    """The speed of a workload in one thread.

    plain, tangent: nanoseconds per impact on either wall, without and with the tangent map. scanned, searched: shares
    of flights that take the slower paths of the kernel.
    """

    workload: str
    plain: float
    tangent: float
    scanned: float
    searched: float


def rates(thin: int = 1) -> list[Rate]:
    """Measure each workload without and with the tangent map, with every thin-th trajectory."""
    import rattle
    from rattle.impacting.map.iterate import count_flights

    flown = {name: _arguments(name, thin) for name in IMPACTS}
    runs = [partial(run, *each) for each in flown.values() for run in (rattle.iterate, rattle.iterate_tangent)]
    seconds = np.reshape(best(runs), (-1, 2)).tolist()
    counted = [count_flights(*each) for each in flown.values()]
    return [
        Rate(name, plain / flights * NANO, tangent / flights * NANO, scanned / flights, searched / flights)
        for name, (plain, tangent), (flights, scanned, searched) in zip(flown, seconds, counted, strict=True)
    ]


def scaling(thin: int = 1) -> Iterator[tuple[str, float]]:
    """Yield (kind of runners, work of two runners divided by that of one); each runner has half of workload A."""
    with ThreadPoolExecutor(2) as threads:
        barrier = threading.Barrier(2)
        yield "2 threads", _scaling(threads, partial(_in_step, thin, barrier))
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, spawn, _meet_at, (spawn.Barrier(2),)) as processes:
        yield "2 processes", _scaling(processes, partial(_in_step, thin, None))


def _scaling(pool: Executor, run: Callable[[int], tuple[list[float], NDArray[np.float64]]]) -> float:
    first, second = pool.map(run, range(2))
    together = np.stack([first[1], second[1]])
    return float(2.0 * min(first[0]) / np.min(together[:, :, 1].max(axis=0) - together[:, :, 0].min(axis=0)))


_barriers: list[Any] = []  # the barrier of a spawned process, which can only be inherited, not sent with a task


def _meet_at(barrier: Any) -> None:
    _barriers.append(barrier)


def _in_step(thin: int, barrier: Any, index: int) -> tuple[list[float], NDArray[np.float64]]:
    """Run one half of workload A repeatedly, in step with another runner.

    Returns
    -------
    tuple[list[float], NDArray[np.float64]]
        Seconds of each run while the other runner waits (first runner only), and begin and end of each run while both
        run.
    """
    import rattle

    delta, epsilon, tau, v, n = _arguments("A", thin)
    half = slice(index, None, 2)
    run = partial(rattle.iterate, delta[half], epsilon[half], tau[half], v[half], n)
    barrier = barrier or _barriers[0]
    run()
    alone, together = [], []
    for _ in range(TURNS_IN_STEP):
        barrier.wait(PATIENCE)
        if index == 0:
            alone.append(_seconds(run))
        barrier.wait(PATIENCE)
        began = time.perf_counter()
        run()
        together.append((began, time.perf_counter()))
    return alone, np.array(together)


def portable(thin: int = 1) -> dict[str, tuple[float, float]]:
    """Measure workload A for this processor and for x86-64-v3: ns per impact without and with the tangent map."""
    native, other = list[list[float]](), list[list[float]]()
    measured = _workload_a(thin)
    with _elsewhere(thin) as ask:
        ask()
        measured()
        for _ in range(TURNS):
            native.append(measured())
            other.append(ask())
    found = {"this processor": native, "x86-64-v3": other}
    return {name: (min(x[0] for x in turns), min(x[1] for x in turns)) for name, turns in found.items()}


def _workload_a(thin: int) -> Callable[[], list[float]]:
    """Return a function that measures workload A once: nanoseconds per impact without and with the tangent map."""
    import rattle
    from rattle.impacting.map.iterate import count_flights

    arguments = _arguments("A", thin)
    flights = count_flights(*arguments)[0]
    runs = [partial(run, *arguments) for run in (rattle.iterate, rattle.iterate_tangent)]
    return lambda: [_seconds(run) / flights * NANO for run in runs]


@contextmanager
def _elsewhere(thin: int) -> Iterator[Callable[[], list[float]]]:
    """Yield a function that lets another process, compiled for x86-64-v3, measure workload A."""
    command = [sys.executable, "-c", f"from bench.measure import answer; answer({thin})"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=os.environ | X86_64_V3) as child:
        asked, answered = child.stdin, child.stdout
        assert asked is not None
        assert answered is not None

        def ask() -> list[float]:
            asked.write("\n")
            asked.flush()
            return [float(word) for word in answered.readline().split()]

        yield ask
        asked.close()


def answer(thin: int) -> None:
    """Measure workload A for each line of stdin, and print the result."""
    measured = _workload_a(thin)
    for _ in sys.stdin:
        print(*measured(), flush=True)


@dataclass(frozen=True)
class Outcome:
    """The samples that end on one kind of attractor: their number, and their impacts on Σ⁺ in total."""

    kind: str
    samples: int
    impacts: int

    @property
    def mean(self) -> float:
        """The mean number of impacts of a sample."""
        return self.impacts / self.samples


def _attractors(delta: NDArray[np.float64], epsilon: Any, count: int) -> tuple[list[Outcome], Callable[[], Any]]:
    """Return the outcomes of some cells, and a function without arguments that computes these cells again."""
    import rattle

    run = partial(rattle.attractors_of, delta, epsilon, 0.6, count, 7.0, 0)
    found = run()
    kinds = [(name, found.kind == kind) for kind, name in enumerate(rattle.KINDS)]
    outcomes = [Outcome(name, int(found.samples[on].sum()), int(found.impacts[on].sum())) for name, on in kinds]
    return [each for each in outcomes if each.samples], run


def cells(count: int, row: int = 64) -> Iterator[tuple[str, float, list[Outcome]]]:
    """Yield (name, milliseconds per cell, outcomes) for each of CELLS, on one core.

    Each measurement computes a row of `row` neighbouring cells, because the cells of a tile share lanes.

    Yields
    ------
    tuple[str, float, list[Outcome]]
        The measurement of a cell.
    """
    for name, (delta, epsilon) in CELLS.items():
        outcomes, run = _attractors(delta + np.linspace(-NEIGHBOURS, NEIGHBOURS, row), epsilon, count)
        yield name, best([run])[0] / row * 1e3, outcomes


def plane(count: int, size: int = 512) -> tuple[float, list[Outcome]]:
    """Return the milliseconds per cell on one core, and the outcomes, for random cells of the plane of Figure 7."""
    rng = np.random.default_rng(7)
    delta, epsilon = (rng.uniform(*bounds, size) for bounds in PLANE)
    outcomes, run = _attractors(delta, epsilon, count)
    return _seconds(run) / size * 1e3, outcomes


@dataclass(frozen=True)
class SurveyCost:
    """The cost of a survey on an embedded cluster: times in seconds, memory in MiB.

    seconds: from the submission of the first tile to the end of the last, without starting and compiling. computing,
    writing, dask, idle_end: these are summed over all processes, and add up to n_workers × seconds. computing: the
    computation of tiles. writing: the remaining time of tasks. dask: the time before a process' first task and between
    its tasks. idle_end: the time after a process' last task. front_mebibytes, workers_mebibytes: peak memory of this
    process, and of all workers together.
    """

    cells: int
    n_workers: int
    seconds: float
    computing: float
    writing: float
    dask: float
    idle_end: float
    front_mebibytes: float
    workers_mebibytes: float

    @property
    def cells_per_second(self) -> float:
        """The number of cells per second, for all processes together."""
        return self.cells / self.seconds

    @property
    def large_hours(self) -> float:
        """The hours that a million such cells would take, without the idle time at the end, which does not grow."""
        busy = self.computing + self.writing + self.dask
        return busy / self.n_workers / self.cells * LARGE / 3600


def survey(cells_per_side: int, count: int, n_workers: int, tile: int | None = None) -> SurveyCost:
    """Measure a survey of the plane of Figure 7 on an embedded cluster. tile: cells along a tile; None: few cells."""
    from distributed import get_task_stream

    from gear_rattle import workers as w

    delta, epsilon = (w.Axis(start=low, stop=high, num=cells_per_side) for low, high in PLANE)
    sample = w.InitialConditions(count=count)
    shape = w.TileShape(delta=tile, epsilon=tile)
    request = w.SurveyRequest(delta=delta, epsilon=epsilon, initial_conditions=sample, tile=shape)
    records: list[w.TileRecord] = []
    with tempfile.TemporaryDirectory() as directory, w.embedded_cluster(n_workers) as client:
        store = Path(directory) / "survey.zarr"
        w.create_store(request, store)
        with get_task_stream(client) as stream:
            began = time.time()  # dask's task stream has times of this clock
            w.run_tiles(request, store, w.tiles_of(request), client, records.append, lambda: False)
            ended = time.time()
        w.finish_store(store)
        peaks = client.run(_peak_memory)
    computing = sum(record.seconds for record in records)
    tasks, last = _tasks(stream.data)
    idle_end = sum(max(ended - each, 0.0) for each in last) + (n_workers - len(last)) * (ended - began)
    return SurveyCost(
        cells=request.n_cells,
        n_workers=n_workers,
        seconds=ended - began,
        computing=computing,
        writing=tasks - computing,
        dask=(ended - began) * n_workers - tasks - idle_end,
        idle_end=idle_end,
        front_mebibytes=_peak_memory(),
        workers_mebibytes=sum(peaks.values()),
    )


def _tasks(stream: list[dict[str, Any]]) -> tuple[float, list[float]]:
    """Return the total seconds of all tasks, and the time at which each worker ended its last task."""
    seconds, last = 0.0, dict[str, float]()
    for task in stream:
        for span in task["startstops"]:
            if span["action"] == "compute":
                seconds += span["stop"] - span["start"]
                last[task["worker"]] = max(last.get(task["worker"], 0.0), span["stop"])
    return seconds, list(last.values())


def _peak_memory() -> float:
    """Return the peak resident memory of this process in MiB."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / KIBIBYTE
    except (OSError, StopIteration):  # on systems other than Linux; on Linux ru_maxrss may include the parent's peak
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KIBIBYTE


def start() -> Iterator[tuple[str, float]]:
    """Yield (name, seconds from the start of a new process to its end) for several programs."""
    yield "first result", best([partial(_process, FIRST_RESULT)])[0]
    yield "of which import rattle", best([partial(_process, "import rattle")])[0]
    with tempfile.TemporaryDirectory() as directory:
        yield (
            "first result, kernels compiled first",
            _seconds(partial(_process, FIRST_RESULT, RATTLE_CACHE_DIR=directory)),
        )


def _process(code: str, **environment: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | environment)
