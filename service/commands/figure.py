"""``rattle figure``: draw figures of the paper from computed data, or draw the picture of a survey."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.drawing import draw_survey
from gear_rattle.service.commands.options import NO_NUMBERS, Slice, add_parameter_options

if TYPE_CHECKING:
    from rattle.plot import FigureRequest, StiffFigureRequest

ALL, STIFF = "all", "stiff"
SURVEY_PICTURE = "survey.png"


@partial(add_parameter_options, kind=float, text="{}, for the stiff gear in Figures 5 and 9.", model="stiff")
def figure(
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="NUMBER...|all|stiff | STORE [OUT]", help="Figures of the paper, or a survey and its picture."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Directory of the figures; created if it does not exist.", show_default="."),
    ] = None,
    delta: Annotated[
        list[str] | None,
        typer.Option(metavar="VALUE", help="Damping: a number, or LOW:HIGH.", show_default="the paper's"),
    ] = None,
    epsilon: Annotated[
        list[str] | None,
        typer.Option(
            metavar="VALUE",
            help="Eccentricity: a number, several times for Figure 4, or LOW:HIGH.",
            show_default="the paper's",
        ),
    ] = None,
    beta: Annotated[float | None, typer.Option(help="Half-backlash.", show_default="0.6")] = None,
    format_: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="pdf|svg|png",
            help="Format of the files; repeatable, one file each.",
            show_default="pdf",
        ),
    ] = None,
    slice_: Slice = None,
    numbers: Mapping[str, float] = NO_NUMBERS,
) -> None:
    """Draw figures of the paper from computed data, or draw the picture of a survey.

    rattle figure 4 7 --out DIR writes DIR/figure4.pdf and DIR/figure7.pdf.
    The figures have the paper's parameters, or those of --delta, --epsilon and --beta:

    Figure 4, basins: one --delta, and an --epsilon for each panel.

    Figure 6, basins and manifolds: one --delta, one --epsilon.

    Figures 5 and 9, diagrams along ε: --delta NUMBER, --epsilon LOW:HIGH.

    Figures 7 and 8, bifurcation curves: --delta LOW:HIGH, --epsilon LOW:HIGH.

    With a stiffness, Figures 5 and 9 show the gear with stiff contact. The figure
    stiff shows how that gear converges to the impacting one: one --delta, one
    --epsilon.

    rattle figure STORE [OUT] draws a survey: regions with the bifurcation
    curves, quiet fraction, largest Lyapunov exponent. OUT ends in .png, .pdf or
    .svg. For a survey with a third axis, --slice names the slice to draw. Write
    ./4 or ./stiff for a store whose name is a number or stiff.
    """
    options = {
        "--out": out, "--delta": delta, "--epsilon": epsilon, "--beta": beta,
        **{f"--{name}": value for name, value in numbers.items()}, "--format": format_,
    }  # fmt: skip
    if what[0] in (ALL, STIFF) or what[0].isdecimal():
        if slice_ is not None:
            raise typer.BadParameter("a figure of the paper has no slices: leave --slice out", param_hint="--slice")
        requests = _figure_requests(what, delta or [], epsilon or [], beta, numbers)
        _draw_figures(requests, out or Path(), format_ or ["pdf"])
        return
    for option, given in options.items():
        if given is not None:
            raise typer.BadParameter(
                f"{option} is for figures of the paper, and {what[0]!r} is not the number of a figure: leave "
                f"{option} out",
                param_hint="STORE",
            )
    if len(what) > 2:
        raise typer.BadParameter(
            "give one survey and one file for its picture, or only numbers of figures", param_hint="STORE"
        )
    draw_survey(what[0], Path(what[1] if len(what) == 2 else SURVEY_PICTURE), slice_)


def _figure_requests(
    what: list[str], delta: list[str], epsilon: list[str], beta: float | None, added: Mapping[str, float]
) -> list[FigureRequest | StiffFigureRequest]:
    """Return the requested figures. All requests are checked before the first figure is computed."""
    from rattle.plot import BETA, FIGURES, parse_option, request, stiff_request

    numbers: list[int] = []
    for each in what:
        if each not in (ALL, STIFF) and not each.isdecimal():
            raise typer.BadParameter(
                f"{each!r} is not a figure of the paper: give numbers of figures, all, or stiff", param_hint="NUMBER"
            )
        numbers += sorted(FIGURES) if each == ALL else [] if each == STIFF else [int(each)]
    for name in added:
        if STIFF in what:
            raise typer.BadParameter(
                f"the figure stiff takes only delta, epsilon and beta: leave --{name} out", param_hint=f"--{name}"
            )
    values = parse_option("--delta", delta), parse_option("--epsilon", epsilon)
    beta = BETA if beta is None else beta
    requests: list[FigureRequest | StiffFigureRequest] = [
        request(each, *values, beta, **added) for each in dict.fromkeys(numbers)
    ]
    return [*requests, stiff_request(*values, beta)] if STIFF in what else requests


def _draw_figures(requests: list[FigureRequest | StiffFigureRequest], directory: Path, formats: list[str]) -> None:
    from gear_rattle.service.errors import ServiceError
    from rattle.plot import FORMATS, save

    for each in formats:
        if each not in FORMATS:
            raise typer.BadParameter(
                f"{each!r} is not a format: use one of {', '.join(FORMATS)}", param_hint="--format"
            )
    _create_writable_directory(directory)
    for request in requests:
        start = perf_counter()
        typer.echo(f"{request.title} …")
        picture = request.draw()
        for suffix in dict.fromkeys(formats):
            path = directory / f"{request.name}.{suffix}"
            try:
                save(picture.figure, path)
            except OSError as error:
                raise ServiceError(f"The figure {path} cannot be written: {error}") from error
            typer.echo(f"{path} ({perf_counter() - start:.1f} s)")
        for note in picture.notes:
            typer.echo(f"  {note}")


def _create_writable_directory(directory: Path) -> None:
    """Create a directory if necessary. Raise ServiceError if files cannot be written to it."""
    from gear_rattle.service.errors import ServiceError

    try:
        directory.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise ServiceError(f"The directory {directory} cannot be written to: {error}") from error
