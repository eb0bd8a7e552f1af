"""``rattle verify``: whether a survey's store still holds what was computed."""

from __future__ import annotations

from typing import Annotated

import typer

DAMAGED = 1
MAX_LINES = 20


def verify(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Path or s3:// URL of a survey's store.")],
) -> None:
    """Read every chunk of a survey and compare it with its checksum. Exit status 1 if any is damaged or lost.

    The command that computed the survey, or POST /v1/surveys/ID/verify, computes again what is damaged, and only that.
    """
    from workers import examine

    found = examine(store)
    typer.echo(f"{found.tiles} tiles: {len(found.done)} whole, {len(found.damaged)} damaged")
    if missing := found.tiles - len(found.done) - len(found.damaged):
        typer.echo(f"{missing} tiles are not computed yet")
    lines = [f"damaged: tile {tile}: {', '.join(names)}" for tile, names in found.damaged.items()]
    lines += [f"damaged: {name}" for name in found.template]
    for line in lines[:MAX_LINES]:
        typer.echo(line)
    if len(lines) > MAX_LINES:
        typer.echo(f"and {len(lines) - MAX_LINES} more")
    if not found.whole:
        raise typer.Exit(DAMAGED)
