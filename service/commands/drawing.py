"""Draw a survey, and write its picture or another figure to a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_survey(store: str | Path, out: Path, slice_number: int | None = None) -> None:
    """Draw a survey with `survey_figure`, and write the picture to the file `out`, whose suffix is the format.

    Parameters
    ----------
    slice_number : int | None
        Number of the slice of a survey with a third axis, from 0; None without a third axis.
    """
    from gear_rattle.service.results import open_results
    from gear_rattle.workers.pictures.figure import survey_figure
    from gear_rattle.workers.survey.slices import select_slice

    with open_results(store) as dataset:
        picture = survey_figure(select_slice(dataset, slice_number))
    write_figure(picture, out)


def write_figure(picture: Figure, out: Path) -> None:
    """Write a figure to the file `out`, whose suffix is the format. Raises ServiceError if writing fails."""
    from gear_rattle.service.errors import ServiceError

    try:
        picture.savefig(out)
    except (OSError, ValueError) as error:  # ValueError: a format that matplotlib does not know
        raise ServiceError(f"The picture {out} cannot be written: {error}") from error
    typer.echo(f"{out} is written.")


def require_writable(out: Path) -> None:
    """Raise ServiceError if a picture cannot be written to `out`, before a command computes for hours in vain."""
    from matplotlib.backend_bases import FigureCanvasBase

    from gear_rattle.service.errors import ServiceError

    known = FigureCanvasBase.get_supported_filetypes().keys() - {"pgf"}  # pgf needs TeX
    if out.suffix.removeprefix(".").lower() not in known:
        raise ServiceError(
            f"The format of the picture {out} is not known: end its name in one of .{', .'.join(sorted(known))}"
        )
    if not out.parent.is_dir():
        raise ServiceError(f"The picture {out} cannot be written: {out.parent} is not a directory. Create it first.")
