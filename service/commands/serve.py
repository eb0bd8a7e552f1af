"""``rattle serve``: the REST service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from service.commands.options import Scheduler


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.", show_default="127.0.0.1")] = None,
    port: Annotated[int | None, typer.Option(help="Port; 0 takes a free one.", show_default="8000")] = None,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Directory of the job database and the stores.", show_default="data"),
    ] = None,
    scheduler: Scheduler = None,
    workers: Annotated[int | None, typer.Option(help="Processes of the embedded cluster.", show_default="2")] = None,
) -> None:
    """Serve surveys over HTTP, until SIGINT or SIGTERM.

    Surveys that an earlier server left unfinished in DIR are resumed. Environment variables set the limits, such as
    RATTLE_MAX_CELLS. Nobody is asked for a password: use other addresses than 127.0.0.1 on trusted networks only.
    """
    import uvicorn
    from pydantic import ValidationError

    from service.app import create_app
    from service.commands.signals import stop_requested
    from service.database import Database
    from service.datadir import DataDirectory
    from service.settings import Settings

    given: dict[str, Any] = {"host": host, "port": port, "data": data, "scheduler": scheduler, "workers": workers}
    try:
        settings = Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        raise typer.BadParameter(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    # A plain sentence now, instead of uvicorn's traceback later.
    directory = DataDirectory(settings.data)
    with directory.locked():
        Database(settings.database_url or directory.database_url).close()
    server = uvicorn.Server(
        uvicorn.Config(
            create_app(settings),
            host=settings.host,
            port=settings.port,
            log_level="info",
            timeout_graceful_shutdown=settings.shutdown_seconds,
        )
    )
    with stop_requested():  # uvicorn raises the signal again after a clean shutdown
        server.run()
    if not server.started:
        raise typer.Exit(1)
