"""``rattle curves``: print the bifurcation curves for one half-backlash."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.options import Beta

if TYPE_CHECKING:
    from rattle.curves import Curve

WIDTH = 160  # characters in a line, enough for all numbers, however wide the terminal is
COLUMNS = ("curve", "piece", "delta", "epsilon", "tau", "v", "re1", "im1", "re2", "im2")


def curves(
    beta: Beta = 0.6,
    delta: Annotated[str, typer.Option(metavar="LOW:HIGH", help="Range of damping of the window.")] = "0.3:1.2",
    epsilon: Annotated[str, typer.Option(metavar="LOW:HIGH", help="Range of eccentricity of the window.")] = "0:1",
    table: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write every point of the curves to this file.")
    ] = None,
) -> None:
    """Print the codimension-two points for a half-backlash, and where and why each bifurcation curve ends."""
    from rich.console import Console
    from rich.table import Table

    from rattle.curves import NAMES, codimension_two, trace

    window = _window_range("--delta", delta), _window_range("--epsilon", epsilon)
    traced = [trace(name, beta, *window) for name in NAMES]
    console = Console(highlight=False, width=WIDTH)
    points = Table("point", "delta", "epsilon", "curves", "what happens", box=None)
    for point in codimension_two(beta):
        where = f"{point.delta:.12f}", f"{point.epsilon:.12f}"
        points.add_row(point.name, *where, " ".join(point.curves), point.meaning)
    console.print(points)
    ends = Table("curve", "piece", "delta", "epsilon", "why it ends there", box=None)
    for curve in traced:
        for end in curve.ends:
            i = end.index
            where = f"{curve.delta[i]:.10f}", f"{curve.epsilon[i]:.10f}"
            ends.add_row(curve.name, str(curve.piece[i]), *where, end.reason)
        if not curve.ends:
            ends.add_row(curve.name, "", "", "", "not in the window")
    console.print()
    console.print(ends)
    if table is not None:
        _write_csv(table, traced)
        typer.echo(f"{table} holds {sum(map(len, traced))} points.")


def _window_range(option: str, text: str) -> tuple[float, float]:
    """Return both ends of a range LOW:HIGH. Raises BadParameter, which names the option."""
    try:
        low, high = map(float, text.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"write LOW:HIGH, such as 0.3:1.2, not {text!r}", param_hint=option) from error
    return low, high


def _write_csv(path: Path, traced: list[Curve]) -> None:
    from gear_rattle.service.errors import ServiceError

    try:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for curve in traced:
                one, other = curve.multipliers
                parts = one.real, one.imag, other.real, other.imag
                columns = curve.piece, curve.delta, curve.epsilon, curve.tau, curve.v, *parts
                writer.writerows((curve.name, *row) for row in zip(*(c.tolist() for c in columns), strict=True))
    except OSError as error:
        raise ServiceError(f"The table {path} cannot be written: {error}") from error
