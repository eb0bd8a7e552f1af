"""``rattle open``: show the contents of a survey."""

from __future__ import annotations

from typing import Annotated

import typer


def open_(store: Annotated[str, typer.Argument(metavar="STORE", help="Path or URL of a survey's store.")]) -> None:
    """Print the dataset of a survey, as xarray shows it."""
    from gear_rattle.service.results import open_results

    typer.echo(repr(open_results(store)))
