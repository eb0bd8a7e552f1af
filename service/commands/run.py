"""``rattle run``: a survey without a server."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.commands import options
from service.commands.filling import fill


def run(
    out: Annotated[
        str, typer.Option(metavar="PATH", help="The zarr store to write, or to resume; or s3://BUCKET/PREFIX.")
    ],
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
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    figure: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the survey when it is complete.")] = None,
) -> None:
    """Compute a survey and write it to PATH: in this process, with an embedded cluster or with an existing one.

    The same command resumes an interrupted survey (Ctrl-C, SIGTERM, a crash); the numbers are the same to the last bit.
    """
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
    from service.commands.drawing import draw, require_writable

    if figure is not None:
        if request.third:
            raise typer.BadParameter(
                f"draw a slice when the survey is complete, with rattle figure {out} --slice 0", param_hint="--figure"
            )
        require_writable(figure)
    fill(request, out, scheduler, workers)
    _summarise(out)
    if figure is not None:
        draw(out, figure)


def _summarise(out: str) -> None:
    import numpy as np
    import zarr  # xarray takes half a second to load

    from workers.storage.location import place_of
    from workers.survey.values.evaluate import FAILED

    arrays = zarr.open_group(place_of(out).zarr(), mode="r")
    status = np.asarray(arrays["status"])
    summary = f"{status.size} cells, {int((status == FAILED).sum())} failed"
    if "undecided_fraction" in arrays and (status != FAILED).any():
        undecided = np.asarray(arrays["undecided_fraction"], float)[status != FAILED]
        summary += f", {100 * undecided.mean():.3f} % of samples undecided"
    typer.echo(summary)
