"""``rattle key``: add, list and revoke API keys. A running service notices changes at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from gear_rattle.service.database import Database

LARGEST_INTEGER = 2**31 - 1  # largest number that an integer column of the database can hold
LONGEST_NAME = 100  # largest number of characters of a key's name

app = typer.Typer(help="Add, list and revoke the API keys of a service.", no_args_is_help=True)

Data = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Data directory of the service; RATTLE_DATA.", show_default="data"),
]
DatabaseUrl = Annotated[
    str | None,
    typer.Option(
        metavar="URL", help="Job database of the service; RATTLE_DATABASE_URL.", show_default="in the data directory"
    ),
]


@app.command(epilog="Example: rattle key add alice --scope submit")
def add(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Owner of the key, for people.")],
    scope: Annotated[
        Literal["read", "submit"],
        typer.Option(help="Scope of the key: read results, or also submit and remove surveys."),
    ] = "read",
    max_cells: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=LARGEST_INTEGER,
            help="Quota of cells of all its surveys, kept ones too.",
            show_default="no quota",
        ),
    ] = None,
    max_running: Annotated[
        int | None,
        typer.Option(
            min=1, max=LARGEST_INTEGER, help="Quota of its queued and running surveys.", show_default="no quota"
        ),
    ] = None,
    data: Data = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Make a key and print it. It cannot be shown again, because the service keeps only a hash of it."""
    from gear_rattle.service.access.keys import add_key
    from gear_rattle.service.database.tables import Scope

    if not (name.isprintable() and 0 < len(name) <= LONGEST_NAME):
        raise typer.BadParameter(f"NAME must have 1 to {LONGEST_NAME} printable characters")
    with _open_job_database(data, database_url, create=True) as database:
        key, token = add_key(database, name, Scope(scope), max_cells, max_running)
    typer.echo(f"Key {key.id} for {name}. Keep it in RATTLE_API_KEY; it cannot be shown again:", err=True)
    typer.echo(token)


@app.command("list", epilog="Example: rattle key list")
def list_keys(data: Data = None, database_url: DatabaseUrl = None) -> None:
    """List the keys, including revoked ones, without their secrets."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    with _open_job_database(data, database_url) as database:
        keys = database.keys()
    table = Table("id", "scope", "max cells", "max running", "created", "revoked", "name", box=None)
    for key in keys:
        quotas = ("" if quota is None else str(quota) for quota in (key.max_cells, key.max_running))
        table.add_row(
            key.id, ", ".join(key.scopes), *quotas, key.created[:19], (key.revoked or "")[:19], Text(key.name)
        )
    Console(width=140).print(table)


@app.command(epilog="Example: rattle key revoke ID")
def revoke(
    key_id: Annotated[str, typer.Argument(metavar="ID", help="Id of the key, as `rattle key list` shows it.")],
    data: Data = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Revoke a key permanently. Its surveys stay and continue."""
    with _open_job_database(data, database_url) as database:
        key = database.revoke_key(key_id)
    typer.echo(f"Key {key.id} for {key.name} is revoked.")


@contextmanager
def _open_job_database(data: Path | None, database_url: str | None, create: bool = False) -> Iterator[Database]:
    """Yield the job database of a service. create: True to make a missing data directory."""
    from gear_rattle.service.commands.options import settings_from_options
    from gear_rattle.service.database import Database
    from gear_rattle.service.errors import DataDirectoryError
    from gear_rattle.service.jobs.directory import DataDirectory

    settings = settings_from_options(data=data, database_url=database_url)
    directory = DataDirectory(settings.data)
    if settings.database_url is None:
        if create:
            directory.path.mkdir(parents=True, exist_ok=True)
        elif not directory.has_database:
            raise DataDirectoryError(
                f"{directory.path} has no job database, so it is not the data directory of a service: name the data "
                "directory of the service (--data)."
            )
    # A service may be running, so the database is not opened exclusively, and the directory is not locked.
    with closing(Database(settings.database_url or directory.database_url, exclusive=False)) as database:
        yield database
