"""What `rattle bench` measures. Every figure is a best of several runs: the machine can only make it slower."""

from __future__ import annotations

import resource
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

REPEATS = 5
CELLS = {
    "quiet only (0.6, 0.056)": (0.6, 0.056),
    "five attractors (0.6, 0.089)": (0.6, 0.089),
    "chaos beside quiet (0.6, 0.1)": (0.6, 0.1),
    "chaos alone (0.6, 0.25)": (0.6, 0.25),
    "near the quiet limit (0.6, 0.1885)": (0.6, 0.1885),
}
KIBIBYTE = 1024


def workloads() -> dict[str, tuple[NDArray[np.float64], ...]]:
    """(τ, v, δ, ε) of A: δ = 0.6, ε = 0.1, v in (0.5, 7); B: there, v in (0.01, 0.2); C: 64 × 64 cells of the plane."""
    sets: dict[str, tuple[NDArray[np.float64], ...]] = {}
    for name, low, high in (("A", 0.5, 7.0), ("B", 0.01, 0.2)):
        rng, n = np.random.default_rng(7), 4096
        sets[name] = (rng.random(n), rng.uniform(low, high, n), np.full(n, 0.6), np.full(n, 0.1))
    delta, epsilon = np.meshgrid(np.linspace(0.4, 1, 64), np.linspace(0.02, 0.3, 64), indexing="ij")
    rng, n = np.random.default_rng(7), delta.size
    sets["C"] = (rng.random(n), rng.uniform(0.5, 7, n), delta.ravel(), epsilon.ravel())
    return sets


def best(run: Callable[[], Any]) -> float:
    """Seconds of the fastest of several runs, after one that is not counted."""
    run()
    seconds = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def kernel() -> Iterator[tuple[str, float]]:
    """(workload, nanoseconds per impact on either wall), one core."""
    from rattle.impact_map import iterate_many

    for name, (tau, v, delta, epsilon) in workloads().items():
        arguments = (tau, v, np.full(tau.size, 100), delta, epsilon, np.full(tau.size, 0.6))
        _, _, _, n_plus, n_minus = iterate_many(*arguments)
        impacts = int(n_plus.sum() + n_minus.sum())
        yield name, best(partial(iterate_many, *arguments)) / impacts * 1e9


def cell(count: int) -> Iterator[tuple[str, float, dict[str, tuple[int, float]]]]:
    """(cell, milliseconds, per outcome: samples and mean impacts on Σ⁺ of one), one core."""
    from rattle.attractors import KINDS
    from rattle.classify import Budget, Point, classify_many
    from rattle.quiet import capture_invariant
    from rattle.sampling import initial_conditions

    for name, (delta, epsilon) in CELLS.items():
        tau, v = initial_conditions(count, 7.0, 0, (delta, epsilon, 0.6))
        point = Point(delta, epsilon, 0.6, capture_invariant(delta, epsilon, 0.6))
        outcomes, _, _ = classify_many(tau, v, point, Budget())
        spent = defaultdict(list)
        for outcome in outcomes:
            spent[KINDS[outcome.kind]].append(outcome.impacts)
        seconds = best(partial(classify_many, tau, v, point, Budget()))
        yield name, seconds * 1e3, {kind: (len(n), float(np.mean(n))) for kind, n in spent.items()}


def survey(cells_per_side: int, count: int, n_workers: int) -> dict[str, float]:
    """A survey of the plane of Figure 7 on an embedded cluster: cells, seconds, and peak resident memory in MiB.

    Seconds are those from the first tile submitted to the last written; compiling and starting processes come before.
    """
    import workers as w

    request = w.SurveyRequest(
        delta=w.Axis(start=0.4, stop=1.0, num=cells_per_side),
        epsilon=w.Axis(start=0.005, stop=0.3, num=cells_per_side),
        initial_conditions=w.InitialConditions(count=count),
    )
    records: list[w.TileRecord] = []
    with tempfile.TemporaryDirectory() as directory, w.embedded_cluster(n_workers) as client:
        store = Path(directory) / "survey.zarr"
        w.create_store(request, store)
        began = time.perf_counter()
        w.run_tiles(request, store, w.tiles_of(request), client, records.append, lambda: False)
        seconds = time.perf_counter() - began
        w.finish_store(store)
        peaks = client.run(_peak_memory)
    return {
        "cells": request.n_cells,
        "seconds": seconds,
        "cells_per_second": request.n_cells / seconds,
        "computing_share": sum(record.seconds for record in records) / (seconds * n_workers),
        "front_mebibytes": _peak_memory(),
        "workers_mebibytes": sum(peaks.values()),
    }


def _peak_memory() -> float:
    """Peak resident memory of this process in MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KIBIBYTE
