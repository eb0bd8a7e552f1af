"""The picture of a survey, as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def draw(store: str | Path, out: Path) -> None:
    """Write the three-panel picture of the survey in ``store`` to ``out``; the suffix is the format."""
    from service.errors import ServiceError
    from workers import open_survey, survey_figure

    picture = survey_figure(open_survey(store))
    try:
        picture.savefig(out)
    except (OSError, ValueError) as error:  # ValueError: a format that matplotlib does not know
        raise ServiceError(f"The picture {out} cannot be written: {error}") from error
    typer.echo(f"{out} shows it.")


def figure(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Path or URL of a survey's store.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The picture to write; .png, .pdf or .svg.")] = Path(
        "survey.png"
    ),
) -> None:
    """Draw a survey: regions with the bifurcation curves, quiet fraction, largest Lyapunov exponent."""
    draw(store, out)
