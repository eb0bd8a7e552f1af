"""``rattle submit``, ``list`` and ``watch``: surveys of a service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from service.commands import options
from service.commands.options import DEFAULT_URL, Url

if TYPE_CHECKING:
    from service.client import Job


def submit(
    delta: options.Delta = None,
    epsilon: options.Epsilon = None,
    beta: options.SurveyedBeta = None,
    kappa: options.SurveyedKappa = None,
    count: options.Count = 64,
    v_max: options.VMax = None,
    budget: options.Budget = None,
    slots: options.Slots = None,
    slots_by: options.SlotsBy = None,
    seed: options.Seed = 0,
    name: options.Name = "",
    tile: options.Tile = None,
    quantity: options.Quantity = None,
    inertia: options.Inertia = None,
    drag: options.Drag = None,
    backlash: options.Backlash = None,
    radius: options.Radius = None,
    drive: options.Drive = None,
    rpm: options.Rpm = None,
    eccentricity: options.MetresOfEccentricity = None,
    url: Url = DEFAULT_URL,
    key: Annotated[str | None, typer.Option(help="Idempotency key: submitting twice accepts the survey once.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Compute it although an identical survey is there.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Wait until it ends.")] = False,
) -> None:
    """Submit a survey to a service and print its id: that of an identical survey, if the service has one."""
    from service.client import Client

    request = options.survey_request(
        delta=delta,
        epsilon=epsilon,
        beta=beta,
        kappa=kappa,
        count=count,
        v_max=v_max,
        budget=budget,
        slots=slots,
        slots_by=slots_by,
        seed=seed,
        name=name,
        tile=tile,
        quantity=quantity,
        machine={
            "inertia": inertia,
            "drag": drag,
            "backlash": backlash,
            "radius": radius,
            "drive": drive,
            "rpm": rpm,
            "eccentricity": eccentricity,
        },
    )
    with Client(url) as client:
        job = client.submit(request, idempotency_key=key, force=force)
        typer.echo(job.id)
        if watch:
            _follow(job)


def list_(
    url: Url = DEFAULT_URL,
    limit: Annotated[int, typer.Option(min=1, help="Surveys to print, newest first.")] = 50,
) -> None:
    """List the surveys of a service."""
    from itertools import islice

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from service.client import Client

    table = Table("id", "state", "progress", "cells", "created", "name", box=None)
    with Client(url) as client:
        for job in islice(client.surveys(), limit):
            shown = job.document
            cells = f"{shown['cells_done']}/{shown['cells']}"
            table.add_row(
                job.id, job.state, f"{shown['progress']} %", cells, shown["created"][:19], Text(shown["name"])
            )
    Console(width=140).print(table)  # ids are never cut


def watch(
    survey_id: Annotated[str, typer.Argument(metavar="ID", help="The survey's id.")],
    url: Url = DEFAULT_URL,
) -> None:
    """Follow a survey until it ends, and print where its results are."""
    from service.client import Client

    with Client(url) as client:
        _follow(client.job(survey_id))


def _follow(job: Job) -> None:
    from service.commands.progress import reporter

    cells, done = job.document["cells"], job.document["cells_done"]
    with reporter(cells, done) as progress:
        job.wait(progress=lambda event: progress.show(event["cells_done"]))
    typer.echo(f"{job.state}: {job.store_url}")
