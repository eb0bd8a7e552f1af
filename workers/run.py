"""Compute a survey from Python in one call."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from gear_rattle.workers.certificates import require_certifiable
from gear_rattle.workers.completion import complete, is_incomplete
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.in_process import run_tiles_in_this_process, takes_few_seconds
from gear_rattle.workers.storage.location import Place, place_of
from gear_rattle.workers.storage.store import create_store, finish_store, open_survey, tiles_done
from gear_rattle.workers.survey.axes import message_with_field
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.tiles import Tile, TileRecord, tiles_of

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

PROCESSES = 2  # number of processes that a survey starts by default

Progress = Callable[[int, int], None]  # called with the number of computed cells and the number of all cells


def run_survey(
    request: SurveyRequest | Mapping[str, Any] | None = None,
    *,
    out: str | Path | Place | None = None,
    cluster: str | Client | int | None = None,
    progress: Progress | None = None,
    **fields: Any,
) -> xr.Dataset:
    """Compute a survey and open it: `run_survey(delta=(0.4, 1.0, 61), epsilon=(0.005, 0.3, 60), out="survey.zarr")`.

    The same call with the same `out` resumes an interrupted survey, bit for bit, and opens a completed one.

    Parameters
    ----------
    request : SurveyRequest | Mapping[str, Any] | None
        The request, or a mapping with its fields.
    out : str | Path | Place | None
        Location of the store, a path or "s3://BUCKET/PREFIX". By default the values are kept in memory only, and an
        interrupted survey is lost.
    cluster : str | Client | int | None
        The URL of a dask scheduler or a client of it, whose workers can write to `out`; or the number of processes to
        start on this machine. By default a survey of a few seconds runs in this process, a longer one in two others.
    progress : Progress | None
        Called repeatedly with the number of computed cells and of all cells.
    fields
        Fields of the request; they replace fields of `request`. An axis may be a (start, stop, num) triple.

    Returns
    -------
    xr.Dataset
        The open survey. With `out`, its variables are read from the store when they are needed.

    Raises
    ------
    SurveyError
        The request is invalid, `out` has other contents or cannot be written, or there is no cluster.
    """
    wanted = _validate_request(request, fields)
    if out is not None:
        require_certifiable(wanted, out)
        return _run_and_open(wanted, place_of(out), cluster, progress)
    if wanted.certify:
        raise SurveyError("certificates are stored beside a survey's store: give `out`, or leave out `certify`")
    with (
        tempfile.TemporaryDirectory(prefix="rattle-") as directory,
        _run_and_open(wanted, place_of(Path(directory) / "survey.zarr"), cluster, progress) as survey,
    ):
        return survey.load()


def _validate_request(request: SurveyRequest | Mapping[str, Any] | None, fields: Mapping[str, Any]) -> SurveyRequest:
    given = request.model_dump(exclude_unset=True) if isinstance(request, SurveyRequest) else request or {}
    try:
        return SurveyRequest.model_validate({**given, **fields})
    except ValidationError as error:
        raise SurveyError(message_with_field(error)) from None


def _run_and_open(
    request: SurveyRequest, place: Place, cluster: str | Client | int | None, progress: Progress | None
) -> xr.Dataset:
    create_store(request, place)
    done = tiles_done(request, place)
    missing = [tile for tile in tiles_of(request) if tile.index not in done]
    if missing or is_incomplete(request, place):
        _compute_and_complete_survey(request, place, missing, cluster, progress)
    finish_store(place)
    return open_survey(place)


def _compute_and_complete_survey(
    request: SurveyRequest,
    place: Place,
    missing: list[Tile],
    cluster: str | Client | int | None,
    progress: Progress | None,
) -> None:
    done = request.n_cells - sum(tile.n_cells for tile in missing)

    def on_tile(record: TileRecord) -> None:
        nonlocal done
        done += record.cells
        if progress:
            progress(done, request.n_cells)

    if cluster is None and takes_few_seconds(request, request.n_cells):
        run_tiles_in_this_process(request, place, missing, on_tile, _never_stop)
        with place.lock_for_writing():
            complete(request, place)
        return
    from gear_rattle.workers.cluster.runner import complete_on_cluster, run_tiles

    with _open_client(cluster) as client:
        run_tiles(request, place, missing, client, on_tile, _never_stop)
        complete_on_cluster(client, request, place, _never_stop)


def _open_client(cluster: str | Client | int | None) -> AbstractContextManager[Client]:
    from gear_rattle.workers.cluster.cluster import connect, embedded_cluster

    if isinstance(cluster, str):
        return connect(cluster)
    if cluster is None or isinstance(cluster, int):
        return embedded_cluster(PROCESSES if cluster is None else cluster)
    return nullcontext(cluster)


def _never_stop() -> bool:
    return False
