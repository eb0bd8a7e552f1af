"""Compute a store in this process or on a cluster: the common part of commands for surveys and populations."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from distributed import Client

    from gear_rattle.workers import AnyRequest, SurveyRequest, TileRecord
    from gear_rattle.workers.kinds import AnyTile

INTERRUPTED = 130  # exit status after SIGINT or SIGTERM
PROCESSES = 2  # number of processes that a command starts by default
MAX_MESSAGES = 10  # largest number of failed cells whose messages are printed
CHECK_SECONDS = 0.1  # seconds between two checks whether the command must stop


def compute_store(request: AnyRequest, out: str, scheduler: str | None, workers: int | None) -> None:
    """Create or resume the store of a request, compute all missing parts, and mark the store as complete.

    out: the location of the store. scheduler: the address of a dask scheduler, or None. workers: the number of
    processes to start; None: PROCESSES, or no process if the work takes only a few seconds.
    """
    from gear_rattle.service.commands.progress import print_compilation_messages
    from gear_rattle.workers.certificates import require_certifiable

    require_certifiable(request, out)
    with print_compilation_messages():
        _compute_missing_parts(request, out, scheduler, workers)


def _compute_missing_parts(request: AnyRequest, out: str, scheduler: str | None, workers: int | None) -> None:
    from gear_rattle import workers as survey

    alone = not (scheduler or workers)
    if alone and survey.takes_few_seconds(request, request.n_cells):
        with _watch_stop_signals(out) as stop:
            _compile_kernels(request, stop)
    survey.create_store(request, out)
    done = survey.tiles_done(request, out)
    missing = [tile for tile in survey.tiles_of(request) if tile.index not in done]
    if missing or survey.is_incomplete(request, out):
        with _watch_stop_signals(out) as stop:
            try:
                short = survey.takes_few_seconds(request, sum(tile.n_cells for tile in missing) or request.n_cells)
                here = short and alone
                processes = workers or PROCESSES
                cluster = (
                    nullcontext()
                    if here
                    else cluster_context(request.added_parameter_values, scheduler, processes, stop.is_set)
                )
                _compute_tiles(request, out, missing, cluster, stop.is_set)
            except survey.SurveyError:
                if not stop.is_set():  # an error after a stop only says that the cluster has ended
                    raise
    else:
        typer.echo(f"{out} is complete.")
    survey.finish_store(out)


@contextmanager
def _watch_stop_signals(out: str) -> Iterator[threading.Event]:
    """Yield an event that SIGINT or SIGTERM sets. If the event is set when the context ends, end the command."""
    from gear_rattle.service.commands.signals import catch_stop_signals

    with catch_stop_signals() as stop:
        yield stop
        if stop.is_set():
            typer.echo(f"Stopped. {out} keeps every finished tile; the same command resumes it.", err=True)
            raise typer.Exit(INTERRUPTED)


def _compile_kernels(request: AnyRequest, stop: threading.Event) -> None:
    """Compile the kernels that a request needs. Return when they are compiled, or when `stop` is set."""
    from gear_rattle.workers import compile_kernels_for_request

    compiling = threading.Thread(target=compile_kernels_for_request, args=(request,), name="kernels", daemon=True)
    compiling.start()
    while compiling.is_alive() and not stop.is_set():
        compiling.join(CHECK_SECONDS)


def cluster_context(
    numbers: dict[str, float], scheduler: str | None, workers: int, should_stop: Callable[[], bool]
) -> AbstractContextManager[Client]:
    """Return the context of a cluster: an existing one, or processes that start on this machine.

    numbers: the values, by name, of the parameters that a model has besides δ, ε and β. Their names select the model
    whose kernels a thread compiles while processes start; with a scheduler they are not used. scheduler: the address of
    a dask scheduler; None starts processes, and prints a message.

    Returns
    -------
    AbstractContextManager[Client]
        A context manager that yields the client of the cluster.
    """
    import rattle
    from gear_rattle.workers import connect, embedded_cluster

    if scheduler:
        return connect(scheduler)
    typer.echo(f"Starting {workers} process{'es' if workers > 1 else ''} …", err=True)
    # The workers compile missing kernels too, but print no messages about it. This thread starts the same
    # compilation, which happens once for all processes, in order to print its messages.
    threading.Thread(target=rattle.precompile, kwargs=numbers, name="kernels", daemon=True).start()
    return embedded_cluster(workers, should_stop=should_stop)


def _compute_tiles(
    request: AnyRequest,
    out: str,
    missing: list[AnyTile],
    cluster: AbstractContextManager[Client | None],
    should_stop: Callable[[], bool],
) -> None:
    from gear_rattle import workers as survey
    from gear_rattle.service.commands.progress import create_reporter
    from gear_rattle.workers.kinds import position_of_failed_cell
    from gear_rattle.workers.storage.manifest import read_root_attributes
    from gear_rattle.workers.survey.refined.audit import AUDIT_ATTRIBUTES

    todo = sum(tile.n_cells for tile in missing)
    done = before = request.n_cells - todo
    filled = 0
    failed: list[tuple[int, int, str]] = []
    what = "gears" if isinstance(request, survey.PopulationRequest) else "cells"
    with cluster as client, create_reporter(request.n_cells, before, what) as progress:

        def on_tile(record: TileRecord) -> None:
            nonlocal done, filled
            done += record.cells
            filled += record.filled_cells
            failed.extend(record.failed_cells)
            progress.show_cells_done(done)

        began = time.monotonic()
        if client is None:
            survey.run_tiles_in_this_process(request, out, missing, on_tile, should_stop)
        else:
            survey.run_tiles(request, out, missing, client, on_tile, should_stop, on_left=progress.show_time_left)
        seconds = time.monotonic() - began
        if not should_stop() and survey.is_incomplete(request, out):
            _complete_survey(request, out, client, should_stop)
    if isinstance(request, survey.SurveyRequest) and request.has_wrong_share_bound:
        # The number of filled cells is read from the store, because audits after the tiles compute some filled cells.
        filled = 0 if before else read_root_attributes(survey.place_of(out)).get(AUDIT_ATTRIBUTES[0], 0)
    if missing:
        some = f", {filled} of them filled" if filled else ""
        typer.echo(f"{done - before} {what} in {seconds:.1f} s{some}: {(done - before) / seconds:.1f} {what}/s")
    for i, j, message in failed[:MAX_MESSAGES]:
        where = ", ".join(f"{axis}[{number}]" for axis, number in position_of_failed_cell(request, i, j).items())
        typer.echo(f"failed: {where}: {message}", err=True)


def _complete_survey(request: AnyRequest, out: str, client: Client | None, should_stop: Callable[[], bool]) -> None:
    from gear_rattle import workers as survey

    if isinstance(request, survey.SurveyRequest):
        for words in _messages_after_tiles(request):
            typer.echo(f"{words} …", err=True)
    if client is None:
        with survey.place_of(out).lock_for_writing():
            survey.complete(request, out)
    else:
        survey.complete_on_cluster(client, request, out, should_stop)


def _messages_after_tiles(request: SurveyRequest) -> Iterator[str]:
    """Yield a message for each step after a survey's tiles.

    The pyramid levels have a message of their own only if no families are joined before.
    """
    from gear_rattle.workers import Group
    from gear_rattle.workers.survey.levels.grid import stored_levels_of_shape

    if request.has_wrong_share_bound:
        yield "Auditing filled cells until the bound is met"
    if Group.FAMILIES in request.quantities:
        yield "Joining the attractors to families"
    elif stored_levels_of_shape(request.shape):
        yield "Building the pyramid levels"
    if request.certify:
        yield "Proving the periodic attractors"
