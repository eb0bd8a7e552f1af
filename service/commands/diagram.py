"""``rattle diagram``: what happens along a line of the (δ, ε) plane."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from gear_rattle.service.commands.options import Beta

WIDTH = 140  # numbers are never cut, whatever the terminal
MEANINGS = {"SN": "saddle-node", "PD": "flip", "GR": "graze"}


def diagram(
    delta: Annotated[
        str, typer.Option(metavar="VALUE|LOW:HIGH", help="Damping: a number, or a range.", show_default=False)
    ],
    epsilon: Annotated[
        str, typer.Option(metavar="VALUE|LOW:HIGH", help="Eccentricity: a number, or a range.", show_default=False)
    ],
    beta: Beta = 0.6,
    kappa: Annotated[
        float | None,
        typer.Option(help="Stiffness of the walls: the stiff model.", show_default="none: the impacting model"),
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="Steps in which attractors are followed, either way.")] = 400,
    count: Annotated[int, typer.Option(min=1, help="Initial conditions at each step.")] = 64,
    picture: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Draw it: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """Print every bifurcation along a line of the plane: of which motion, on which named curve, and where.

    One of --delta and --epsilon is a range LOW:HIGH, the other a number; with two ranges the line goes from both low
    ends to both high ends. --figure draws speed and phase of the impacts, as Figures 5 and 9 of the paper.
    """
    from rich.console import Console
    from rich.table import Table

    import rattle
    from gear_rattle.service.commands.drawing import require_writable, write
    from gear_rattle.service.commands.progress import compiling_told

    lows, highs = zip(_ends("--delta", delta), _ends("--epsilon", epsilon), strict=True)
    if lows == highs:
        raise typer.BadParameter(
            "one of --delta and --epsilon must be a range, such as 0.4:1.0; `rattle orbits` is for a point"
        )
    if picture is not None:
        require_writable(picture)
    with compiling_told():
        found: Any
        if kappa is None:
            found = rattle.diagram(lows, highs, beta, steps, count)
        else:
            found = rattle.stiff.diagram(lows, highs, beta, kappa, steps, count)
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
        write(found.plot(), picture)


def _ends(option: str, text: str) -> tuple[float, float]:
    """Both ends of LOW:HIGH, or twice a number."""
    try:
        low, high = (float(part) for part in (text.split(":") if ":" in text else (text, text)))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is neither a number nor LOW:HIGH, such as 0.1 or 0.05:0.15", param_hint=option
        ) from None
    return low, high
