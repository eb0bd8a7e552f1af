"""``rattle run``: a survey without a server."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.commands import options

if TYPE_CHECKING:
    from distributed import Client

    from workers import SurveyRequest, Tile, TileRecord

INTERRUPTED = 130
PROCESSES = 2
MAX_MESSAGES = 10


def run(
    out: Annotated[
        str, typer.Option(metavar="PATH", help="The zarr store to write, or to resume; or s3://BUCKET/PREFIX.")
    ],
    delta: options.Delta = None,
    epsilon: options.Epsilon = None,
    beta: options.BetaUnlessMachine = None,
    kappa: options.Kappa = None,
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
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes of the embedded cluster.",
            show_default="2; for a few seconds of work none but this one",
        ),
    ] = None,
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
    import workers as survey
    from service.commands.drawing import draw, require_writable
    from service.commands.progress import compiling_told
    from service.commands.signals import stop_requested

    if figure is not None:
        require_writable(figure)
    survey.create_store(request, out)
    done = survey.tiles_done(request, out)
    missing = [tile for tile in survey.tiles_of(request) if tile.index not in done]
    if missing or survey.lacks_families(request, out):
        with stop_requested() as stop, compiling_told():
            try:
                short = survey.is_short(request, sum(tile.n_cells for tile in missing) or request.n_cells)
                here = short and not (scheduler or workers)
                cluster = nullcontext() if here else _started(request, scheduler, workers or PROCESSES, stop.is_set)
                _compute(request, out, missing, cluster, stop.is_set)
            except survey.SurveyError:
                if not stop.is_set():  # otherwise the stop is what ended the cluster
                    raise
            if stop.is_set():
                typer.echo(f"Stopped. {out} keeps every finished tile; the same command resumes it.", err=True)
                raise typer.Exit(INTERRUPTED)
    else:
        typer.echo(f"{out} is complete.")
    survey.finish_store(out)
    _summarise(out)
    if figure is not None:
        draw(out, figure)


def _started(
    request: SurveyRequest, scheduler: str | None, workers: int, should_stop: Callable[[], bool]
) -> AbstractContextManager[Client]:
    """The cluster, and a word to whoever waits for it."""
    import rattle
    from workers import connect, embedded_cluster

    if scheduler:
        return connect(scheduler)
    typer.echo(f"Starting {workers} process{'es' if workers > 1 else ''} …", err=True)
    # Kernels that are not there yet are compiled once for all: here too, where it is told.
    threading.Thread(target=rattle.warm_up, args=(request.kappa,), name="kernels", daemon=True).start()
    return embedded_cluster(workers, should_stop=should_stop)


def _compute(
    request: SurveyRequest,
    out: str,
    missing: list[Tile],
    cluster: AbstractContextManager[Client | None],
    should_stop: Callable[[], bool],
) -> None:
    import workers as survey
    from service.commands.progress import reporter

    todo = sum(tile.n_cells for tile in missing)
    done = before = request.n_cells - todo
    failed: list[tuple[int, int, str]] = []
    with cluster as client, reporter(request.n_cells, before) as progress:

        def on_tile(record: TileRecord) -> None:
            nonlocal done
            done += record.cells
            failed.extend(record.failed_cells)
            progress.show(done)

        began = time.monotonic()
        if client is None:
            survey.run_tiles_here(request, out, missing, on_tile, should_stop)
        else:
            survey.run_tiles(request, out, missing, client, on_tile, should_stop)
        seconds = time.monotonic() - began
        if not should_stop() and survey.lacks_families(request, out):
            _join(request, out, client, should_stop)
    if missing:
        typer.echo(f"{done - before} cells in {seconds:.1f} s: {(done - before) / seconds:.1f} cells/s")
    for i, j, message in failed[:MAX_MESSAGES]:
        typer.echo(f"failed: epsilon[{i}], delta[{j}]: {message}", err=True)


def _join(request: SurveyRequest, out: str, client: Client | None, should_stop: Callable[[], bool]) -> None:
    import workers as survey

    typer.echo("Joining the attractors to families …", err=True)
    if client is None:
        with survey.place_of(out).writing():
            survey.join_survey(request, out)
    else:
        survey.join_on(client, request, out, should_stop)


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
