"""``rattle run``: compute a survey without a server."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gear_rattle.service.commands import options
from gear_rattle.service.commands.filling import compute_store
from gear_rattle.service.commands.survey_options import add_survey_options

if TYPE_CHECKING:
    from gear_rattle.workers import SurveyRequest


@add_survey_options
def run(
    request: SurveyRequest,
    out: Annotated[
        str, typer.Option(metavar="PATH", help="Zarr store to write or to resume: a path, or s3://BUCKET/PREFIX.")
    ],
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the completed survey into this file.")
    ] = None,
) -> None:
    """Compute a survey and write it to PATH: in this process, with an embedded cluster or with an existing one.

    The same command resumes an interrupted survey (Ctrl-C, SIGTERM, a crash); the numbers are the same to the last bit.
    """
    from gear_rattle.service.commands.drawing import draw_survey, require_writable

    if figure is not None:
        if request.third_axis_name:
            raise typer.BadParameter(
                "a survey with a third axis has no single picture: leave --figure out. When the survey is complete, "
                f"draw a slice with rattle figure {out} --slice 0",
                param_hint="--figure",
            )
        require_writable(figure)
    compute_store(request, out, scheduler, workers)
    _print_summary(out)
    if figure is not None:
        draw_survey(out, figure)


def _percent_text(share: float) -> str:
    """Return a share in per cent with two significant digits, for example "0.22" or "100"."""
    return f"{float(f'{100 * share:.2g}'):g}"


def _print_summary(out: str) -> None:
    import numpy as np
    import zarr  # used instead of xarray, which takes half a second to load

    from gear_rattle.workers.storage.location import place_of
    from gear_rattle.workers.storage.store import read_variable_in_bands
    from gear_rattle.workers.survey.refined.audit import AUDIT_ATTRIBUTES
    from gear_rattle.workers.survey.values.evaluate import FAILED

    place = place_of(out)
    told = zarr.open_group(place.zarr(), mode="r")
    cells, n_failed = np.sum(
        [(band.size, (band == FAILED).sum()) for band in read_variable_in_bands(place, "status")], axis=0
    ).tolist()
    summary = f"{cells} cells, {n_failed} failed"
    if "undecided_fraction" in told and n_failed < cells:
        both = zip(
            read_variable_in_bands(place, "undecided_fraction"), read_variable_in_bands(place, "status"), strict=True
        )
        shares = (band[status != FAILED] for band, status in both)
        undecided = sum(float(np.sum(each, dtype=float)) for each in shares) / (cells - n_failed)
        summary += f", {100 * undecided:.3f} % of samples undecided"
    attributes: dict[str, Any] = dict(told.attrs)
    if "refined_cells_filled" in attributes:
        filled, audited, wrong, bound = (attributes[name] for name in AUDIT_ATTRIBUTES)
        summary += (
            f"; {cells - filled - n_failed} computed, {filled} filled: of {audited} audited ones {wrong} disagreed, at "
            f"most {_percent_text(bound)} % are wrong (95 %)"
        )
    typer.echo(summary)
