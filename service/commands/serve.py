"""``rattle serve``: run the REST service and the explorer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.options import Scheduler

if TYPE_CHECKING:
    from gear_rattle.service.database import Database
    from gear_rattle.service.settings import Settings


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.", show_default="127.0.0.1")] = None,
    port: Annotated[
        int | None, typer.Option(help="Port to listen on; 0 takes a free one.", show_default="8000")
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Directory of the job database and the stores.", show_default="data"),
    ] = None,
    store: Annotated[
        str | None, typer.Option(metavar="URL", help="Bucket of the stores: s3://BUCKET/PREFIX.", show_default="in DIR")
    ] = None,
    root_path: Annotated[
        str | None,
        typer.Option(
            metavar="PATH", help="Path at which a proxy publishes the service, such as /rattle.", show_default="none"
        ),
    ] = None,
    scheduler: Scheduler = None,
    workers: Annotated[
        int | None, typer.Option(help="Number of processes of the embedded cluster.", show_default="2")
    ] = None,
    insecure: Annotated[bool, typer.Option("--insecure", help="Require no API key, whatever the address.")] = False,
) -> None:
    """Serve surveys over HTTP, until SIGINT or SIGTERM.

    Surveys that an earlier server left unfinished in DIR are resumed. Environment variables set the limits, such as
    RATTLE_MAX_CELLS. On any address but loopback every request needs an API key (`rattle key add`). A proxy in front
    provides TLS.
    """
    from gear_rattle.service.access.origins import is_loopback
    from gear_rattle.service.app import create_app
    from gear_rattle.service.commands.options import settings_from_options
    from gear_rattle.service.commands.signals import catch_stop_signals
    from gear_rattle.service.jobs.opening import open_service_data
    from gear_rattle.service.observability.logs import log_config
    from gear_rattle.service.web.server import run_server

    settings = settings_from_options(
        host=host,
        port=port,
        data=data,
        store=store,
        root_path=root_path,
        scheduler=scheduler,
        workers=workers,
        insecure=insecure or None,
    )
    # Errors are found here and printed as one sentence; uvicorn would print a traceback.
    with open_service_data(settings) as (_, database):
        require_keys(settings, database)
    if settings.insecure:
        typer.echo(f"Everybody who reaches {settings.host} may use this service: no key is needed.", err=True)
    if not (is_loopback(settings.host) or settings.behind_proxy):
        typer.echo(
            f"Other machines reach this service at {settings.host} without a proxy: there is no TLS, and slow clients "
            "are not cut off. Put Caddy or nginx in front (docs/operations.md) and set RATTLE_BEHIND_PROXY=true.",
            err=True,
        )
    # uvicorn raises the signal that ended it once more. In this context the repeated signal only sets `asked_to_stop`;
    # otherwise it would kill the process.
    with catch_stop_signals() as asked_to_stop:
        started = run_server(create_app(settings), settings, log_config(settings.log_format), asked_to_stop)
    if not started:
        raise typer.Exit(1)


def require_keys(settings: Settings, database: Database) -> None:
    """Raise NoKeysError if the service requires API keys and no valid key exists."""
    from gear_rattle.service.access.keys import has_live_key
    from gear_rattle.service.access.middleware import requires_keys
    from gear_rattle.service.errors import NoKeysError

    if not requires_keys(settings) or has_live_key(database):
        return
    # The message does not show the URL of a database, because the URL may have a password.
    where = "--database-url URL" if settings.database_url else f"--data {settings.data}"
    raise NoKeysError(
        f"On {settings.host} every request needs an API key, and there is none. Make one: rattle key add NAME --scope "
        f"submit {where}; or listen on 127.0.0.1; or, if everybody who can reach the service may use it, add "
        "--insecure."
    )
