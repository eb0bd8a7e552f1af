"""``rattle diagram``: print the bifurcations along a line of the (δ, ε) plane."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from gear_rattle.service.commands.options import NO_NUMBERS, Beta, add_parameter_options

WIDTH = 140  # characters in a line, enough for all numbers, however wide the terminal is
MEANINGS = {"SN": "saddle-node", "PD": "flip", "GR": "graze"}


@partial(add_parameter_options, kind=float)
def diagram(
    delta: Annotated[
        str, typer.Option(metavar="VALUE|LOW:HIGH", help="Damping: a number, or a range.", show_default=False)
    ],
    epsilon: Annotated[
        str, typer.Option(metavar="VALUE|LOW:HIGH", help="Eccentricity: a number, or a range.", show_default=False)
    ],
    beta: Beta = 0.6,
    steps: Annotated[
        int, typer.Option(min=1, help="Number of steps in which attractors are followed, in each direction.")
    ] = 400,
    count: Annotated[int, typer.Option(min=1, help="Number of initial conditions at each step.")] = 64,
    picture: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", help="Draw the diagram into this file: .png, .pdf or .svg."),
    ] = None,
    numbers: Mapping[str, float] = NO_NUMBERS,
) -> None:
    """Print every bifurcation along a line of the (δ, ε) plane: the motion, the named curve and the position.

    One of --delta and --epsilon is a range LOW:HIGH, the other a number; with two ranges the line goes from both low
    ends to both high ends. --figure draws speed and phase of the impacts, like Figures 5 and 9 of the paper.
    """
    from rich.console import Console
    from rich.table import Table

    from gear_rattle.service.commands.drawing import require_writable, write_figure
    from gear_rattle.service.commands.progress import print_compilation_messages
    from rattle.models import model_of

    lows, highs = zip(
        _parse_range_or_number("--delta", delta), _parse_range_or_number("--epsilon", epsilon), strict=True
    )
    if lows == highs:
        raise typer.BadParameter(
            "--delta or --epsilon must be a range, such as 0.4:1.0: give a range, or use `rattle orbits` for a point"
        )
    if picture is not None:
        require_writable(picture)
    with print_compilation_messages():
        found = model_of(beta, **numbers).diagram(lows, highs, steps, count)
    console = Console(highlight=False, markup=False, width=WIDTH)
    table = Table("event", "named", "motion", "delta", "epsilon", box=None)
    for event, named, motion, at_delta, at_epsilon in found.to_dataframe()[
        ["event", "curve", "motion", "delta", "epsilon"]
    ].itertuples(index=False):
        table.add_row(MEANINGS[event], named, motion, f"{at_delta:.10f}", f"{at_epsilon:.10f}")
    console.print(table)
    console.print(f"{len(found.branches)} branches, {len(found.events)} events")
    if found.left_out:
        console.print(
            f"{len(found.left_out)} branches left out, as they have more than 8 impacts per period or are too many"
        )
    if picture is not None:
        write_figure(found.plot(), picture)


def _parse_range_or_number(option: str, text: str) -> tuple[float, float]:
    """Return both ends of a range LOW:HIGH, or a single number twice."""
    try:
        low, high = (float(part) for part in (text.split(":") if ":" in text else (text, text)))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is neither a number nor LOW:HIGH, such as 0.1 or 0.05:0.15", param_hint=option
        ) from None
    return low, high
