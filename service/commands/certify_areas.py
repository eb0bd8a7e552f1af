"""``rattle certify --areas``: prove blocks of a plane as a whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from gear_rattle.service.commands.filling import INTERRUPTED

if TYPE_CHECKING:
    from rattle.proof.certificate import Ends


def prove_areas(
    out: Path, delta: str, epsilon: str, beta: str, columns: int, processes: int, figure: Path | None
) -> None:
    """Prove statements about blocks of a plane, write the proved blocks to `out`, and draw them into `figure`.

    Print for each statement the share of the plane's area for which it is proved.
    """
    from gear_rattle.service.commands.progress import create_reporter
    from gear_rattle.service.commands.signals import catch_stop_signals
    from gear_rattle.workers.areas import certify_areas
    from rattle.errors import require
    from rattle.proof.areas.shares import shares_of_claims
    from rattle.proof.certificate import exact_number

    half_backlash, across, along = (
        exact_number("beta", beta),
        _exact_range("delta", delta),
        _exact_range("epsilon", epsilon),
    )
    require(
        half_backlash > 0 and across[0] > 0, f"--beta ({beta}) and the lower end of --delta {delta} must be above 0"
    )
    with catch_stop_signals() as stop, create_reporter(columns, what="columns") as progress:
        found = certify_areas(
            out, across, along, half_backlash, columns, processes, progress.show_cells_done, stop.is_set
        )
    for share in shares_of_claims(found, (across[1] - across[0]) * (along[1] - along[0])):
        typer.echo(share)
    if figure is not None:
        from rattle.plot import areas_figure, save

        save(areas_figure(found, across, along).figure, figure)
    if stop.is_set():
        typer.echo("Stopped: the remaining columns are not proved.", err=True)
        raise typer.Exit(INTERRUPTED)


def _exact_range(name: str, text: str) -> Ends:
    """Return both ends of a range LOW:HIGH as exact numbers. Raises BadParameter or ParameterError for other text."""
    from rattle.proof.certificate import exact_number

    low, colon, high = text.partition(":")
    ends = exact_number(name, low), exact_number(name, high)
    if not (colon and 0 <= ends[0] < ends[1]):
        raise typer.BadParameter(f"write LOW:HIGH, such as 0.4:1, not {text!r}", param_hint=f"--{name}")
    return ends
