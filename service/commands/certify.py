"""``rattle certify``: periodic motions as theorems, and the check of what others proved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.commands.options import Slice

if TYPE_CHECKING:
    from rattle.proof.certificate import Ends

NOT_PROVED, INTERRUPTED = 1, 130
COLUMNS = 320  # of the plane of Figure 7, with which its regions are proved on more than 99 %
SUFFIX = ".certificates.zarr"


def certify(
    store: Annotated[str | None, typer.Argument(metavar="STORE", help="Path or URL of a survey's store.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="The store of certificates.", show_default=f"beside STORE, *{SUFFIX}"),
    ] = None,
    processes: Annotated[int, typer.Option(min=1, help="Processes that prove.")] = 1,
    point: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="DELTA EPSILON", help="Prove the periodic motions of one point, taken as these very numbers."
        ),
    ] = None,
    areas: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Prove blocks of a plane, and write them here, one a line.")
    ] = None,
    delta: Annotated[str, typer.Option(metavar="LOW:HIGH", help="Damping, for --areas: exact decimals.")] = "0.4:1",
    epsilon: Annotated[str, typer.Option(metavar="LOW:HIGH", help="Eccentricity, for --areas.")] = "0:0.3",
    columns: Annotated[int, typer.Option(min=1, help="Columns of damping, for --areas.")] = COLUMNS,
    figure: Annotated[Path | None, typer.Option(metavar="PATH", help="Draw what --areas proved.")] = None,
    beta: Annotated[str, typer.Option(help="Half-backlash, for --point and --areas.")] = "0.6",
    kappa: Annotated[
        str | None, typer.Option(help="Stiffness, for --point.", show_default="none: the impacting model")
    ] = None,
    slice_: Slice = None,
    check: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Check certificates, one a line, with none of the prover's code."),
    ] = None,
) -> None:
    """Prove that periodic motions exist, alone near by, with their labels, and whether they attract.

    Of a survey, or of a slice of it: all periodic attractors, into a store beside it; the same command resumes. Of a
    point: one certificate a line. Of a plane: its regions I to V, where C and D attract, and where quiet is possible, a
    block a line, of whole columns. Exit status 1 if something is not proved; that does not mean that it is false.
    """
    if [store, point, check, areas].count(None) != 3:
        raise typer.BadParameter("name the STORE of a survey, or --point DELTA EPSILON, --areas FILE or --check FILE")
    if areas is not None:
        _prove_areas(areas, delta, epsilon, beta, columns, processes, figure)
    elif check is not None:
        _check(check)
    elif point is not None:
        _prove_point(*point, beta, kappa)
    elif store is not None:
        beside = store.rstrip("/").removesuffix(".zarr") + ("" if slice_ is None else f".slice{slice_}") + SUFFIX
        _prove_survey(store, out or Path(beside), processes, slice_)


def _check(path: Path) -> None:
    from rattle.proof import check
    from rattle.proof.areas.checker import check as check_areas
    from workers.certificates import CERTIFICATES

    file = path / CERTIFICATES if path.is_dir() else path
    if not file.is_file():
        raise typer.BadParameter(f"there is no file {file}")
    with file.open() as lines:
        of_areas = '"claim"' in lines.readline()
    if (check_areas.main if of_areas else check.main)(str(file)):
        raise typer.Exit(NOT_PROVED)


def _prove_areas(
    out: Path, delta: str, epsilon: str, beta: str, columns: int, processes: int, figure: Path | None
) -> None:
    from rattle.errors import require
    from rattle.proof.areas.shares import shares
    from rattle.proof.certificate import exact
    from service.commands.progress import reporter
    from service.commands.signals import stop_requested
    from workers.areas import certify_areas

    half_backlash, across, along = exact("beta", beta), _ends("delta", delta), _ends("epsilon", epsilon)
    require(half_backlash > 0 and across[0] > 0, "beta and delta must be greater than 0")
    with stop_requested() as stop, reporter(columns, what="columns") as progress:
        found = certify_areas(out, across, along, half_backlash, columns, processes, progress.show, stop.is_set)
    for share in shares(found, (across[1] - across[0]) * (along[1] - along[0])):
        typer.echo(share)
    if figure is not None:
        from rattle.plot.areas import areas_figure
        from rattle.plot.drawing import save

        save(areas_figure(found, across, along).figure, figure)
    if stop.is_set():
        typer.echo("Stopped: the other columns are not proved.", err=True)
        raise typer.Exit(INTERRUPTED)


def _ends(name: str, text: str) -> Ends:
    from rattle.proof.certificate import exact

    low, colon, high = text.partition(":")
    ends = exact(name, low), exact(name, high)
    if not (colon and 0 <= ends[0] < ends[1]):
        raise typer.BadParameter(f"write LOW:HIGH, such as 0.4:1, not {text!r}", param_hint=f"--{name}")
    return ends


def _prove_point(delta: str, epsilon: str, beta: str, kappa: str | None) -> None:
    import rattle
    from rattle.models import model_of
    from rattle.proof.certificate import exact

    given = {"delta": delta, "epsilon": epsilon, "beta": beta, **({} if kappa is None else {"kappa": kappa})}
    numbers = {name: float(exact(name, text)) for name, text in given.items()}
    gear = model_of(numbers["beta"], numbers.get("kappa")).gear(numbers["delta"], numbers["epsilon"])
    starts = [(orbit.tau, orbit.v, orbit.n_plus) for orbit in gear.orbits()]
    starts += [(each.tau, each.v, each.n_plus) for each in gear.attractors() if each.m > 1 or each.n_plus > 1]
    refused = False
    for start in starts:
        try:
            typer.echo(rattle.certify(gear.orbit(*start), **given).json())
        except rattle.NotProvedError as why:
            refused = True
            typer.echo(f"not proved: the motion at tau = {start[0]:.6f}, v = {start[1]:.6f}: {why}", err=True)
    if refused:
        raise typer.Exit(NOT_PROVED)


def _prove_survey(store: str, out: Path, processes: int, slice_number: int | None) -> None:
    from service.commands.progress import reporter
    from service.commands.signals import stop_requested
    from service.results import open_results
    from workers.certificates import CERTIFICATES, REFUSED, certify_survey, claims_of
    from workers.survey.slices import slice_of

    with open_results(store) as whole, stop_requested() as stop:
        survey = slice_of(whole, slice_number)
        number = len(claims_of(survey))
        with reporter(number, what="motions") as progress:
            found = certify_survey(survey, out, processes, progress.show, stop.is_set)
    proved = int((found["attractor_certificate"] != 0).sum())
    typer.echo(f"{proved} of {number} periodic attractors are proved: {out / CERTIFICATES}")
    if stop.is_set():
        typer.echo("Stopped. The same command resumes it.", err=True)
        raise typer.Exit(INTERRUPTED)
    if proved < number:
        typer.echo(f"{number - proved} are not proved, which does not mean that they are false: {out / REFUSED}")
        raise typer.Exit(NOT_PROVED)
