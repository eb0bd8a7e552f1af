"""``rattle compare``: compare measured impacts with the motions of the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.at_point import GivenPoint, add_point_options
from gear_rattle.service.commands.attractors import attractor_name
from gear_rattle.service.commands.options import Sample, Seed

if TYPE_CHECKING:
    from rich.table import Table

    from rattle.comparison import Comparison

WIDTH = 140  # characters in a line, enough for all numbers, however wide the terminal is
LONGEST_BAR = 20  # length of the longest bar in characters


@add_point_options(allows_rpm=True)
def compare(
    point: GivenPoint,
    table: Annotated[
        Path,
        typer.Argument(
            metavar="CSV", help="Table of impacts: a column time, and optional columns speed and wall (1 or -1)."
        ),
    ],
    offset: Annotated[
        float | None,
        typer.Option(
            help="Time at which the transmission error closes the driving side's gap most, in the table's unit.",
            show_default="as fits best",
        ),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Tolerance for a repetition, as a share of the mean time between impacts.")
    ] = 0.05,
    bins: Annotated[int, typer.Option(min=1, help="Number of bars of the histogram.")] = 24,
    count: Sample = 64,
    seed: Seed = 0,
) -> None:
    """Compare measured impacts with the motions of a gear: label, phases, nearest attractors.

    For a machine, times are in seconds, and speeds in m/s along the line of action. With DELTA and EPSILON, speeds are
    those of the model, and times are in revolutions, or in seconds if --rpm is given.
    """
    from rattle import comparison

    revolution = 1.0 if point.rpm is None else 60.0 / point.rpm
    velocity = 1.0 if point.machine is None else point.machine.units.velocity
    measured = comparison.read_csv(table, revolution, velocity)
    when = None if offset is None else offset / revolution
    found = comparison.compare(measured, point.gear, when, bins=bins, tolerance=tolerance, count=count, seed=seed)
    unit = "revolutions" if point.rpm is None else "s"
    typer.echo(f"{point.parameters_text}\n{measured.time.size} impacts in {measured.span:.6g} revolutions")
    _print_comparison(found, revolution, unit)


def _print_comparison(found: Comparison, revolution: float, unit: str) -> None:
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from rattle.comparison import POOR

    console = Console(highlight=False, width=WIDTH)
    label = "not periodic" if found.label is None else f"P({', '.join(map(str, found.label))})"
    console.print(f"{found.impacts:.4g} impacts per revolution, {label}")
    if found.energy is not None:
        console.print(f"energy of the impacts of a revolution (sum of v^2/2 of the model): {found.energy:.6g}")
    low, high = (end * revolution for end in found.offset_interval)
    width = "as given" if low == high else f"95 %: {low:.6g} to {high:.6g}"
    console.print(f"phase 0 at {found.offset * revolution:.6g} {unit}; {width}")
    for other, ends in found.other_offsets:
        low, high = (end * revolution for end in ends)
        console.print(f"or at {other * revolution:.6g} {unit}, which fits about as well ({low:.6g} to {high:.6g})")
    false, unsure = np.count_nonzero(found.wall == 0), np.count_nonzero(~found.is_sure)
    console.print(
        f"{false} false impacts, which the motion does not have; {unsure - false} others whose wall is not sure"
    )
    console.print(f"misfit {found.misfit:.2g} (0: a motion of this gear, 0.5: at random)")
    if found.misfit > POOR:
        console.print("The impacts do not fit this gear: walls, label and phase mean little.")
    nearest = Table("nearest", "share", "impacts+", "impacts-", "energy, model's", "distance, revolutions", box=None)
    for near in found.near:
        rates = near.intensity.impacts_plus, near.intensity.impacts_minus, near.intensity.energy
        columns = f"{near.attractor.fraction:.4f}", *(f"{x:.6g}" for x in rates), f"{near.distance:.4g}"
        nearest.add_row(attractor_name(near.attractor), *columns)
    console.print(nearest)
    console.print(_histogram_table(found))


def _histogram_table(found: Comparison) -> Table:
    """Return a table of impacts per revolution by phase, for the measured impacts and for the nearest attractor."""
    from rich.table import Table

    columns = [("driving side", found.histogram[0]), ("other side", found.histogram[1])]
    if found.near:
        nearest = found.near[0]
        columns[1:1] = [(attractor_name(nearest.attractor), nearest.histogram[0])]
        columns.append((attractor_name(nearest.attractor), nearest.histogram[1]))
    title = "impacts per revolution in each part of the phase"
    table = Table("phase", *(name for name, _ in columns), box=None, title=title, title_justify="left")
    most = max(float(values.max()) for _, values in columns)
    bins = found.histogram.shape[1]
    for i in range(bins):
        table.add_row(f"{i / bins:.3f}", *(_bar_text(float(values[i]), most) for _, values in columns))
    return table


def _bar_text(value: float, largest: float) -> str:
    return f"{value:.3f} {'#' * round(LONGEST_BAR * value / largest)}" if value > 0.0 else ""
