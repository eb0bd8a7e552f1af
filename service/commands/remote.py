"""``rattle submit``, ``list``, ``watch`` and ``describe``: surveys and populations of a service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.options import DEFAULT_URL, Url
from gear_rattle.service.commands.survey_options import add_survey_options

if TYPE_CHECKING:
    from gear_rattle.service.client import Client, Job
    from gear_rattle.workers import SurveyRequest

NOT_FOUND = 404  # HTTP status of the answer to an unknown id

Key = Annotated[
    str | None, typer.Option(help="Idempotency key: submitting again with the same key computes nothing again.")
]
Force = Annotated[bool, typer.Option("--force", help="Compute it although an identical survey or population exists.")]
Watch = Annotated[bool, typer.Option("--watch", help="Wait until the survey or population ends.")]


@add_survey_options
def submit(
    request: SurveyRequest,
    url: Url = DEFAULT_URL,
    key: Key = None,
    force: Force = False,
    watch: Watch = False,
) -> None:
    """Submit a survey to a service and print its id. If the service has an identical survey, that survey is used.

    `rattle tolerance --submit` submits a population of gears.
    """
    from gear_rattle.service.client import Client

    with Client(url) as client:
        job = client.submit(request, idempotency_key=key, force=force)
        typer.echo(job.id)
        if watch:
            follow_job(job)


def list_(
    url: Url = DEFAULT_URL,
    limit: Annotated[int, typer.Option(min=1, help="Number of surveys to print, newest first.")] = 50,
    populations: Annotated[
        bool, typer.Option("--populations", help="List populations of gears instead of surveys.")
    ] = False,
) -> None:
    """List the surveys of a service, or its populations."""
    from itertools import islice

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from gear_rattle.service.client import Client

    table = Table("id", "state", "progress", "gears" if populations else "cells", "created", "name", box=None)
    with Client(url) as client:
        for job in islice(client.populations() if populations else client.surveys(), limit):
            shown = job.document
            cells = f"{shown['cells_done']}/{shown['cells']}"
            table.add_row(
                job.id, job.state, f"{shown['progress']} %", cells, shown["created"][:19], Text(shown["name"])
            )
    Console(width=140).print(table)  # wide enough that no id is cut off


def watch(
    job_id: Annotated[str, typer.Argument(metavar="ID", help="Id of a survey or of a population.")],
    url: Url = DEFAULT_URL,
) -> None:
    """Follow a survey or a population until it ends; print the location of its results, and a population's answers."""
    from gear_rattle.service.client import Client

    with Client(url) as client:
        follow_job(_find_survey_or_population(client, job_id))


def describe(
    survey_id: Annotated[str, typer.Argument(metavar="ID", help="Id of a survey.")],
    name: Annotated[str | None, typer.Option(help="New name.")] = None,
    notes: Annotated[str | None, typer.Option(help="New notes, in place of the present ones.")] = None,
    url: Url = DEFAULT_URL,
) -> None:
    """Change the name or the notes of a survey of a service, and print both; without an option only print them."""
    from gear_rattle.service.client import Client

    with Client(url) as client:
        job = client.job(survey_id)
        shown = (job if name is None and notes is None else job.describe(name, notes)).document
    typer.echo(f"{shown['name']}\n{shown['notes']}".rstrip("\n"))


def _find_survey_or_population(client: Client, job_id: str) -> Job:
    """Return the survey or population with an id. Raises BadParameter if the service has neither."""
    from gear_rattle.service.errors import ResponseError

    try:
        return client.job(job_id)
    except ResponseError as error:
        if error.status != NOT_FOUND:
            raise
    try:
        return client.population(job_id)
    except ResponseError as error:
        if error.status != NOT_FOUND:
            raise
        raise typer.BadParameter(
            f"the service has no survey and no population {job_id}: rattle list shows the ids of all"
        ) from error


def follow_job(job: Job) -> None:
    """Show the progress of a job until it ends, then its state, its address and, for a population, its results."""
    from gear_rattle.service.commands.progress import create_reporter

    of_gears = job.kind == "population"
    cells, done = job.document["cells"], job.document["cells_done"]
    with create_reporter(cells, done, "gears" if of_gears else "cells") as progress:
        job.wait(progress=lambda event: progress.show_cells_done(event["cells_done"]))
    typer.echo(f"{job.state}: {job.store_url}")
    if of_gears:
        from gear_rattle.service.commands.population_tables import print_population
        from gear_rattle.workers.answers import read_population_in_dataset

        print_population(read_population_in_dataset(job.open(), job.store_url))
