"""``rattle serve``: the REST service."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.commands.options import Scheduler

if TYPE_CHECKING:
    from service.database import Database
    from service.settings import Settings

#: What a page of the explorer may say at once; it says little.
MAX_MESSAGE_BYTES = 1 << 20


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.", show_default="127.0.0.1")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0 takes a free one.", show_default="8000")] = None,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Directory of the job database and the stores.", show_default="data"),
    ] = None,
    store: Annotated[
        str | None, typer.Option(metavar="URL", help="s3://BUCKET/PREFIX of the stores.", show_default="in DIR")
    ] = None,
    scheduler: Scheduler = None,
    workers: Annotated[int | None, typer.Option(help="Processes of the embedded cluster.", show_default="2")] = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Ask nobody for an API key, whatever the address.")
    ] = False,
) -> None:
    """Serve surveys over HTTP, until SIGINT or SIGTERM.

    Surveys that an earlier server left unfinished in DIR are resumed. Environment variables set the limits, such as
    RATTLE_MAX_CELLS. On another address than those of this machine only, every request needs an API key (`rattle key
    add`). TLS is left to a proxy in front.
    """
    import uvicorn

    from service.app import create_app
    from service.commands.options import settings_of
    from service.commands.signals import stop_requested
    from service.jobs.opening import opened
    from service.observability.logs import log_config
    from service.web.protocol import protocol_of
    from service.web.server import Server

    settings = settings_of(
        host=host, port=port, data=data, store=store, scheduler=scheduler, workers=workers, insecure=insecure or None
    )
    # A plain sentence now, instead of uvicorn's traceback later.
    with opened(settings) as (_, database):
        require_keys(settings, database)
    if settings.insecure:
        typer.echo(f"Everybody who reaches {settings.host} may use this service: no keys are asked.", err=True)
    app = create_app(settings)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        http=protocol_of(settings),
        h11_max_incomplete_event_size=settings.max_header_bytes,
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_per_message_deflate=False,  # of maps, in the event loop, while everybody waits
        proxy_headers=False,  # who sends a request is who connects
        server_header=False,
        log_config=log_config(settings.log_format),
        access_log=False,  # RequestLogMiddleware says more
        timeout_graceful_shutdown=settings.shutdown_seconds,
    )
    with stop_requested() as asked_to_stop:  # uvicorn raises the signal again after a clean shutdown
        server = Server(config, app, asked_to_stop)
        server.run()
    if not server.started:
        raise typer.Exit(1)


def require_keys(settings: Settings, database: Database) -> None:
    """Raise AccessError where keys are asked and nobody has one."""
    from service.access.keys import has_live_key
    from service.access.middleware import asks_keys
    from service.errors import AccessError

    if not asks_keys(settings) or has_live_key(database):
        return
    where = "--database-url URL" if settings.database_url else f"--data {settings.data}"  # a URL may hold a password
    raise AccessError(
        f"On {settings.host} every request needs an API key, and there is none. Make one: rattle key add NAME --scope "
        f"submit {where}; or listen on 127.0.0.1; or, where everybody who reaches the service may use it, add "
        "--insecure."
    )
