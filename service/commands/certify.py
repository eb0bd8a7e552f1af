"""``rattle certify``: prove periodic motions, bifurcations and chaos, and check certificates."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands import certify_bifurcations as bifurcations
from gear_rattle.service.commands.certify_areas import prove_areas
from gear_rattle.service.commands.filling import INTERRUPTED, cluster_context
from gear_rattle.service.commands.options import NO_NUMBERS, Scheduler, Slice, add_parameter_options

if TYPE_CHECKING:
    from rattle.proof.bifurcations.certificate import BifurcationCertificate
    from rattle.proof.chaos.certificate import HorseshoeCertificate

NOT_PROVED = 1  # exit status if something is not proved
COLUMNS = 320  # default number of columns of blocks; with 320, more than 99 % of the plane of Figure 7 is proved
SUFFIX = ".certificates.zarr"


@partial(add_parameter_options, kind=str, text="{}, for --point.")
def certify(
    store: Annotated[str | None, typer.Argument(metavar="STORE", help="Path or URL of a survey's store.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Store of certificates to write.", show_default=f"beside STORE, *{SUFFIX}"),
    ] = None,
    processes: Annotated[int, typer.Option("--processes", "--workers", min=1, help="Number of processes.")] = 1,
    scheduler: Scheduler = None,
    point: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="DELTA EPSILON", help="Prove the periodic motions of one point, taken as exact decimals."),
    ] = None,
    areas: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Prove blocks of a plane, and write them to this file, one a line."),
    ] = None,
    delta: Annotated[
        str, typer.Option(metavar="LOW:HIGH", help="Range of damping in exact decimals (with --areas).")
    ] = "0.4:1",
    epsilon: Annotated[str, typer.Option(metavar="LOW:HIGH", help="Range of eccentricity (with --areas).")] = "0:0.3",
    columns: Annotated[int, typer.Option(min=1, help="Number of columns of damping (with --areas).")] = COLUMNS,
    figure: Annotated[Path | None, typer.Option(metavar="PATH", help="Draw the proved blocks (with --areas).")] = None,
    beta: Annotated[str, typer.Option(help="Half-backlash (with --point or --areas).")] = "0.6",
    slice_: Slice = None,
    curves: Annotated[bool, typer.Option("--curves", help="Prove the points of the curves of STORE instead.")] = False,
    codimension_two: Annotated[
        bool, typer.Option("--codimension-two", help="Prove the points where curves meet, at --beta.")
    ] = False,
    chaos: Annotated[bool, typer.Option("--chaos", help="Prove that --point has chaotic motions instead.")] = False,
    check: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Check the certificates of this file, one a line, without any of the prover's code."
        ),
    ] = None,
    numbers: Mapping[str, str] = NO_NUMBERS,
) -> None:
    """Prove that periodic motions exist and are locally unique, with their labels, and whether they attract.

    For a survey, or a slice of it, all periodic attractors are proved, and their certificates are written to a store
    beside the survey; the same command resumes an interrupted run. For a point, for curves, for points where curves
    meet, and for chaos, the certificates are printed, one in a line. For a plane, blocks are proved: the region I to V,
    the motions of period one that exist and attract, and whether quiet running is possible. Each line of the file is a
    block; the blocks of a column are written together, when all of them are done. The exit status is 1 if something is
    not proved, which does not mean that it is false.
    """
    if [store, point, check, areas, codimension_two or None].count(None) != 4:
        raise typer.BadParameter(
            "give exactly one of these: the STORE of a survey, --point DELTA EPSILON, --areas FILE, --codimension-two, "
            "--check FILE"
        )
    if curves and store is None:
        raise typer.BadParameter("--curves needs a STORE: name a survey")
    if chaos and (point is None or numbers):
        raise typer.BadParameter(
            "--chaos proves chaos of the impacting gear at one point: give --point DELTA EPSILON, and leave "
            "out parameters of another model, such as --kappa"
        )
    if areas is not None:
        prove_areas(areas, delta, epsilon, beta, columns, processes, figure)
    elif check is not None:
        _check_certificates(check)
    elif point is not None and chaos:
        _print_certificates(_horseshoe_certificates(*point, beta))
    elif point is not None:
        _prove_point(*point, beta, numbers)
    elif codimension_two:
        _print_certificates(bifurcations.codimension_two_certificates(beta))
    elif store is not None and curves:
        _print_certificates(bifurcations.curve_point_certificates(store, slice_))
    elif store is not None:
        beside = store.rstrip("/").removesuffix(".zarr") + ("" if slice_ is None else f".slice{slice_}") + SUFFIX
        _prove_survey(store, out or Path(beside), processes, scheduler, slice_)


def _horseshoe_certificates(delta: str, epsilon: str, beta: str) -> Iterator[HorseshoeCertificate | str]:
    """Yield the certificate of a horseshoe (chaotic motions) at a point, or the reason why none is proved."""
    import rattle
    from rattle.proof.chaos.prove import certify_chaos

    try:
        yield certify_chaos(delta, epsilon, beta)
    except rattle.NotProvedError as why:
        yield str(why)


def _print_certificates(certificates: Iterable[BifurcationCertificate | HorseshoeCertificate | str]) -> None:
    """Print certificates, one in a line, and print unproved statements to stderr.

    If a statement is unproved, or if there is no certificate at all, exit with NOT_PROVED.
    """
    refused, found = False, False
    for each in certificates:
        found = True
        if isinstance(each, str):
            refused = True
            typer.echo(f"not proved: {each}", err=True)
        else:
            typer.echo(each.json())
    if not found:
        typer.echo("not proved: no point was found that could be proved", err=True)
    if refused or not found:
        raise typer.Exit(NOT_PROVED)


def _check_certificates(path: Path) -> None:
    from gear_rattle.workers.certificates import CERTIFICATES
    from rattle.proof import check
    from rattle.proof.areas.checker import check as areas
    from rattle.proof.bifurcations.check_points import check as check_bifurcation
    from rattle.proof.chaos.check import check as check_horseshoe

    file = path / CERTIFICATES if path.is_dir() else path
    if not file.is_file():
        raise typer.BadParameter(f"there is no file {file}: name a file of certificates")
    checkers: dict[object, Callable[[str], str]] = {
        "area": areas.check, "bifurcation": check_bifurcation, "horseshoe": check_horseshoe,
    }  # fmt: skip
    refused = False
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    if not any(line.strip() for line in lines):
        raise typer.BadParameter(f"{file} has no certificate to check: name a file of certificates")
    for number, line in enumerate(lines, 1):
        try:
            typer.echo(f"proved: {checkers.get(_theorem_of(line), check.check)(line)}")
        except (check.Refusal, areas.BlockRefusal) as why:
            refused = True
            typer.echo(f"NOT PROVED, line {number}: {why}")
    if refused:
        raise typer.Exit(NOT_PROVED)


def _theorem_of(line: str) -> object:
    """Return the entry `theorem` of a certificate: "area", "bifurcation" or "horseshoe".

    Return None for a certificate of a periodic motion, which has no such entry, and for a line without JSON.
    """
    try:
        return json.loads(line).get("theorem")
    except (ValueError, AttributeError, RecursionError):
        return None


def _prove_point(delta: str, epsilon: str, beta: str, added: Mapping[str, str]) -> None:
    import rattle
    from rattle.models import Capability, model_of, require_capability
    from rattle.proof.certificate import exact_number

    given = {"delta": delta, "epsilon": epsilon, "beta": beta, **added}
    numbers = {name: float(exact_number(name, text)) for name, text in given.items()}
    model = model_of(**{name: numbers[name] for name in ("beta", *added)})
    require_capability(Capability.PROOFS, model)
    gear = model.gear(numbers["delta"], numbers["epsilon"])
    starts = [(orbit.tau, orbit.v, orbit.n_plus) for orbit in gear.orbits()]
    starts += [(each.tau, each.v, each.n_plus) for each in gear.attractors() if each.m > 1 or each.n_plus > 1]
    refused = not starts
    if refused:
        typer.echo(f"not proved: no periodic motion was found at delta = {delta}, epsilon = {epsilon}", err=True)
    for start in starts:
        try:
            typer.echo(rattle.certify(gear.orbit(*start), **given).json())
        except rattle.NotProvedError as why:
            refused = True
            typer.echo(f"not proved: the motion at tau = {start[0]:.6f}, v = {start[1]:.6f}: {why}", err=True)
    if refused:
        raise typer.Exit(NOT_PROVED)


def _prove_survey(store: str, out: Path, processes: int, scheduler: str | None, slice_number: int | None) -> None:
    from gear_rattle.service.commands.progress import create_reporter
    from gear_rattle.service.commands.signals import catch_stop_signals
    from gear_rattle.service.results import open_results
    from gear_rattle.workers.certificates import CERTIFICATES, REFUSED, certify_survey, claims_of
    from gear_rattle.workers.errors import SurveyError
    from gear_rattle.workers.survey.slices import select_slice

    with open_results(store) as whole, catch_stop_signals() as stop:
        survey = select_slice(whole, slice_number)
        number = len(claims_of(survey))
        here = processes == 1 and scheduler is None
        cluster = nullcontext() if here else cluster_context({}, scheduler, processes, stop.is_set)
        try:
            with cluster as client, create_reporter(number, what="motions") as progress:

                def on_done(done: int, _: int) -> None:
                    progress.show_cells_done(done)

                if client is None:
                    found = certify_survey(survey, out, on_done=on_done, should_stop=stop.is_set)
                else:
                    from gear_rattle.workers.cluster.runner import certify_on_cluster  # loads dask

                    found = certify_on_cluster(client, survey, out, on_done, stop.is_set)
        except SurveyError:
            if not stop.is_set():  # an error after a stop only says that the cluster has ended
                raise
    if stop.is_set():
        typer.echo(f"Stopped. {out} keeps what is proved; the same command resumes it.", err=True)
        raise typer.Exit(INTERRUPTED)
    proved = int((found["attractor_certificate"] != 0).sum())
    typer.echo(f"{proved} of {number} periodic attractors are proved: {out / CERTIFICATES}")
    if proved < number:
        typer.echo(f"{number - proved} are not proved, which does not mean that they are false: {out / REFUSED}")
        raise typer.Exit(NOT_PROVED)
