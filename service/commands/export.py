"""``rattle export``: write a survey to a file for other programs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import copyfileobj
from typing import IO, TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from gear_rattle.workers.survey.values.schema import RowForm

ENDINGS = (".nc", ".csv", ".parquet")


def export(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Path or s3:// URL of a survey's store.")],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="File to write: .nc, .csv or .parquet.")],
    form: Annotated[
        str,
        typer.Option(
            metavar="cells|attractors|orbits",
            help="Row of a table: a cell, an attractor or an orbit; .nc has everything.",
        ),
    ] = "cells",
) -> None:
    """Write a survey, finished or not, as NetCDF, CSV or Parquet, by the ending of FILE.

    NetCDF has everything in the store except its levels, with CF conventions; a table has a row for each cell, or for
    each attractor or orbit. A service offers the same files for download.
    """
    from gear_rattle.workers.survey.values.schema import RowForm

    if out.suffix not in ENDINGS:
        raise typer.BadParameter(f"{out} must end in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}", param_hint="FILE")
    forms = [str(each) for each in (RowForm.CELLS, RowForm.ATTRACTORS, RowForm.ORBITS)]
    if form not in forms:
        raise typer.BadParameter(f"{form!r} is not a kind of row: use one of {', '.join(forms)}", param_hint="--form")
    if "://" in store and not store.startswith("s3://"):
        raise typer.BadParameter(
            f"{store} is not a store on disk or in a bucket: to export a survey of a service, download the survey's "
            "address with /download.nc, /download.csv or /download.parquet added",
            param_hint="STORE",
        )
    _write_file(store, out, RowForm(form))
    typer.echo(f"{out} is complete: {out.stat().st_size:,} bytes.")


def _write_file(store: str, out: Path, form: RowForm) -> None:
    from gear_rattle.workers import open_survey, place_of
    from gear_rattle.workers.storage.export import (
        csv_lines,
        names_of_column_variables,
        require_readable_variables,
        write_netcdf,
        write_parquet,
    )
    from gear_rattle.workers.storage.store import open_groups

    place = place_of(store)
    with open_survey(place, as_stored=True) as dataset:
        require_readable_variables(dataset, None if out.suffix == ".nc" else names_of_column_variables(dataset, form))
        with _open_replacement_file(out) as file:
            if out.suffix == ".csv":
                file.writelines(line.encode() for line in csv_lines(dataset, form))
                return
            made = write_netcdf(dataset, open_groups(place)) if out.suffix == ".nc" else write_parquet(dataset, form)
            with made:
                copyfileobj(made, file)


@contextmanager
def _open_replacement_file(path: Path) -> Iterator[IO[bytes]]:
    """Yield a temporary file that replaces `path` at the end of the context. A failure leaves no temporary file."""
    from gear_rattle.service.errors import ServiceError

    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            yield file
        part.replace(path)
    except OSError as error:
        raise ServiceError(f"The file {path} cannot be written: {error}") from error
    finally:
        with suppress(OSError):
            part.unlink()
