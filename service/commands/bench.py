"""``rattle bench``: how fast this machine is at what a survey costs."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Part(StrEnum):
    """What can be measured."""

    KERNEL = "kernel"
    CELL = "cell"
    SURVEY = "survey"


def bench(
    parts: Annotated[list[Part] | None, typer.Argument(help="What to measure.", show_default="all")] = None,
    count: Annotated[int, typer.Option(min=1, help="Initial conditions per cell.")] = 64,
    side: Annotated[int, typer.Option(min=8, help="Cells along each axis of the survey.")] = 32,
    workers: Annotated[int, typer.Option(min=1, help="Processes of the survey's cluster.")] = 2,
) -> None:
    """Measure nanoseconds per impact, milliseconds per cell, and cells per second of a survey with its peak memory."""
    from rich.console import Console
    from rich.table import Table

    import rattle
    from service import measure

    rattle.warm_up()
    console, wanted = Console(), parts or list(Part)
    if Part.KERNEL in wanted:
        table = Table("workload", "ns per impact", title="kernel: one core")
        for name, nanoseconds in measure.kernel():
            table.add_row(name, f"{nanoseconds:.0f}")
        console.print(table)
    if Part.CELL in wanted:
        table = Table("cell (δ, ε)", "ms", "outcome: samples × mean impacts", title=f"cell: {count} initial conditions")
        for name, milliseconds, spent in measure.cell(count):
            table.add_row(
                name, f"{milliseconds:.1f}", ", ".join(f"{k}: {n} × {mean:.0f}" for k, (n, mean) in spent.items())
            )
        console.print(table)
    if Part.SURVEY in wanted:
        result = measure.survey(side, count, workers)
        table = Table("survey", "", title=f"survey: plane of Figure 7, {count} initial conditions, {workers} processes")
        table.add_row("cells", f"{result['cells']:.0f}")
        table.add_row("seconds", f"{result['seconds']:.1f}")
        table.add_row("cells per second", f"{result['cells_per_second']:.1f}")
        table.add_row("share of time spent computing tiles", f"{100 * result['computing_share']:.1f} %")
        table.add_row("peak memory, this process", f"{result['front_mebibytes']:.0f} MiB")
        table.add_row("peak memory, all workers", f"{result['workers_mebibytes']:.0f} MiB")
        console.print(table)
