"""Measure how fast this computer does the work of surveys: ``PYTHONPATH=benchmarks python -m bench``."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.table import Table

    from bench.cells import ClassCost, Reference
    from bench.measure import Outcome


class Part(StrEnum):
    """A group of measurements that can be run alone."""

    KERNEL = "kernel"
    CELL = "cell"
    SURVEY = "survey"
    CURVES = "curves"
    GLOBAL = "global"
    PEERS = "peers"
    START = "start"


app = typer.Typer(add_completion=False)


@app.command()
def bench(
    parts: Annotated[list[Part] | None, typer.Argument(help="What to measure.", show_default="all")] = None,
    count: Annotated[int, typer.Option(min=1, help="Initial conditions per cell, of cell and survey.")] = 64,
    side: Annotated[int, typer.Option(min=8, help="Cells along each axis of the survey.")] = 64,
    workers: Annotated[int, typer.Option(min=1, help="Processes of the survey's cluster.")] = 2,
    tile: Annotated[int | None, typer.Option(min=1, help="Cells along a tile.", show_default="few")] = None,
    thin: Annotated[int, typer.Option(min=1, max=1024, hidden=True, help="One in so many trajectories.")] = 1,
    row: Annotated[int, typer.Option(min=1, hidden=True, help="Cells of a row of neighbours.")] = 64,
    sample: Annotated[
        int, typer.Option(min=1, hidden=True, help="Cells of a random sample of the plane, at most.")
    ] = 512,
) -> None:
    """Measure how fast this computer does the work of surveys. Other running programs make the figures worse.

    kernel: nanoseconds per impact, the scaling over two threads and processes, and the cost of x86-64-v3.

    cell: milliseconds per cell, and the mean number of impacts of a sample by its outcome.

    survey: cells per second, where the processes' time goes, and peak memory. The processor time of a
    cell by its ε divided by the quiet limit is compared with that of an older version.

    curves: seconds to trace the curves of Figures 7 and 8, branches of motions, and a period-doubling cascade.

    global: basins and their boundaries, manifolds, a boundary crisis, the diagram of Figure 5.

    peers: other people's integrators on the same trajectories.

    start: seconds to the first result of a new process.
    """
    from rich.console import Console

    console, wanted = Console(), parts or list(Part)
    tables = {
        Part.KERNEL: lambda: _kernel(thin),
        Part.CELL: lambda: _cell(count, row, sample),
        Part.SURVEY: lambda: _survey(side, count, workers, tile, sample),
        Part.CURVES: _curves,
        Part.GLOBAL: _global,
        Part.PEERS: _peers,
        Part.START: _start,
    }
    for part in (part for part in Part if part in wanted):
        with console.status(f"{part} …"):
            for table in tables[part]():
                console.print(table)


def _kernel(thin: int) -> Iterable[Table]:
    from rich.table import Table

    from bench import measure

    table = Table("workload", "plain", "with tangent", "scanned", "searched", title="kernel: ns per impact, one thread")
    for rate in measure.rates(thin):
        shares = (f"{100 * share:.3f} %" for share in (rate.scanned, rate.searched))
        table.add_row(rate.workload, f"{rate.plain:.1f}", f"{rate.tangent:.1f}", *shares)
    yield table
    table = Table("runners", "work done, of one runner's", title="kernel: halves of workload A side by side")
    for name, scaling in measure.scaling(thin):
        table.add_row(name, f"{scaling:.2f}")
    yield table
    table = Table("compiled for", "plain", "with tangent", title="kernel: workload A, ns per impact")
    for name, nanoseconds in measure.portable(thin).items():
        table.add_row(name, *(f"{each:.1f}" for each in nanoseconds))
    yield table


def _cell(count: int, row: int, sample: int) -> Iterable[Table]:
    from rich.table import Table

    from bench import measure

    table = Table("cell (δ, ε)", "ms", "outcome: share × impacts on Σ⁺", title=f"cell: {count} initial conditions")
    for name, milliseconds, outcomes in measure.cells(count, row):
        table.add_row(name, f"{milliseconds:.2f}", _described(outcomes))
    yield table
    milliseconds, outcomes = measure.plane(count, sample)
    title = f"cell: {sample} random cells of the plane of Figure 7, {milliseconds:.2f} ms per cell"
    table = Table("outcome", "impacts on Σ⁺ per sample", "share of samples", "share of impacts", title=title)
    samples, impacts = sum(each.samples for each in outcomes), sum(each.impacts for each in outcomes)
    for each in outcomes:
        shares = (f"{100 * each.samples / samples:.2f} %", f"{100 * each.impacts / impacts:.2f} %")
        table.add_row(each.kind, f"{each.mean:.0f}", *shares)
    table.add_row("all", f"{impacts / samples:.0f}", "100 %", "100 %", end_section=True)
    yield table


def _described(outcomes: list[Outcome]) -> str:
    samples = sum(each.samples for each in outcomes)
    return ", ".join(f"{each.kind} {100 * each.samples / samples:.1f} % × {each.mean:.0f}" for each in outcomes)


def _survey(side: int, count: int, workers: int, tile: int | None, sample: int) -> Iterable[Table]:
    from bench import cells

    yield from _processes(side, count, workers, tile)
    per_class = min(sample, cells.PER_CLASS)
    sampled, comparable = cells.classes(per_class), (count, per_class) == (cells.COUNT, cells.PER_CLASS)
    yield _classes(cells.costs(sampled, count), cells.F2F9D81 if comparable else None)


def _classes(costs: list[ClassCost], reference: Reference | None) -> Table:
    from rich.table import Table

    columns = ("ε / quiet limit", "cells", "impacts", "time", "impacts per cell", "ms per cell")
    beside = () if reference is None else (f"impacts / {reference.version}'s", f"time / {reference.version}'s")
    note = "" if reference is None else f"; {reference.version}'s times are of {reference.processor}"
    table = Table(*columns, *beside, title=f"survey: processor time of a cell by its class{note}")
    for each in costs:
        shares = (f"{100 * share:.1f} %" for share in each.shares)
        ratios = () if reference is None else reference.ratios(each.name, each.cost)
        taken = (f"{each.cost.impacts:.0f}", f"{each.cost.milliseconds:.3f}")
        table.add_row(each.name, *shares, *taken, *(f"{ratio:.2f}" for ratio in ratios))
    return table


def _processes(side: int, count: int, workers: int, tile: int | None) -> Iterable[Table]:
    from rich.table import Table

    from bench import measure

    cost = measure.survey(side, count, workers, tile)
    title = f"survey: plane of Figure 7, {side} × {side} cells, {count} initial conditions, {workers} processes"
    table = Table("", "", "share", title=title)
    table.add_row("from the first tile to the last", f"{cost.seconds:.1f} s", "")
    shares = {
        "processes computing": cost.computing,
        "processes writing": cost.writing,
        "before and between tiles (dask)": cost.dask,
        "idle at the end, no tile left": cost.idle_end,
    }
    for name, seconds in shares.items():
        table.add_row(name, f"{seconds:.2f} s", f"{100 * seconds / (cost.seconds * workers):.2f} %")
    table.add_row("cells per second", f"{cost.cells_per_second:.1f}", "")
    table.add_row("1000 × 1000 cells would take, without the idle end", f"{cost.large_hours:.2f} h", "")
    table.add_row("peak memory, this process", f"{cost.front_mebibytes:.0f} MiB", "")
    table.add_row("peak memory, all workers", f"{cost.workers_mebibytes:.0f} MiB", "")
    yield table


def _curves() -> Iterable[Table]:
    from rich.table import Table

    from bench.curves import bifurcations

    table = Table("what", "seconds", "points", title="curves: one core, kernels compiled")
    for name, seconds, points in bifurcations():
        table.add_row(name, f"{seconds:.2f}", str(points))
    yield table


def _global() -> Iterable[Table]:
    from rich.table import Table

    from bench import global_dynamics

    table = Table("what", "seconds", "", title="global: δ = 0.6, ε = 0.1; one core, kernels compiled")
    for name, seconds, makes in global_dynamics.times():
        table.add_row(name, f"{seconds:.3f}", makes)
    yield table


def _peers() -> Iterable[Table]:
    from rich.markup import escape
    from rich.table import Table

    from bench import peers

    columns = ("peer", "ns per impact", "rattle", "ratio", "largest error: phase", "speed", "compared", "lost")
    table = Table(*columns, title="peers: one thread, δ = 0.6, ε = 0.1")
    for peer in peers.peers():
        nanoseconds = (f"{peer.nanoseconds:.0f}", f"{peer.rattle_nanoseconds:.1f}", f"{peer.ratio:.0f}")
        errors = (f"{peer.phase_error:.1e}", f"{peer.speed_error:.1e}", str(peer.compared), str(peer.lost))
        table.add_row(f"{peer.name} {peer.version}", *nanoseconds, *errors)
    for name, command in peers.missing().items():
        table.add_row(name, escape(f"not installed: {command}"), *[""] * (len(columns) - 2))
    yield table


def _start() -> Iterable[Table]:
    from rich.table import Table

    from bench import measure

    table = Table("process", "seconds", title="start: a new process")
    for name, seconds in measure.start():
        table.add_row(name, f"{seconds:.2f}")
    yield table


if __name__ == "__main__":
    app(prog_name="bench")
