"""``rattle tolerance``: compute how the tolerances of a gear affect how it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gear_rattle.service.commands import options
from gear_rattle.service.commands.filling import compute_store
from gear_rattle.service.commands.population_tables import print_population
from gear_rattle.service.commands.remote import Force, Key, Watch, follow_job

if TYPE_CHECKING:
    from gear_rattle.workers import PopulationRequest


@options.add_number_options
def tolerance(
    numbers: dict[str, str],
    out: Annotated[
        str | None,
        typer.Option(
            metavar="PATH", help="Zarr store to write or to resume: a path, or s3://BUCKET/PREFIX.", show_default=False
        ),
    ] = None,
    submit: Annotated[bool, typer.Option("--submit", help="Submit the population to a service instead.")] = False,
    measured: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV", help="Table of measured gears: a column for each number that varies, a row for each gear."
        ),
    ] = None,
    correlation: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME:NAME:NUMBER", help="Correlation of two numbers; repeatable.", show_default="none"),
    ] = None,
    gears: Annotated[int, typer.Option(help="Number of gears of the population.")] = 4096,
    count: Annotated[int, typer.Option(help="Number of initial conditions of each gear.")] = 16,
    share: Annotated[
        float | None, typer.Option(help="Least probability of quiet running of a gear that passes.")
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(help="Impact speed up to which a gear that passes keeps running quietly; m/s of a machine."),
    ] = None,
    judged: Annotated[int, typer.Option(help="Number of gears to judge.")] = 256,
    shock_speed: Annotated[
        str | None, typer.Option(metavar="NUMBER|DISTRIBUTION", help="Speed of a shock that the gears begin with.")
    ] = None,
    shock_phase: Annotated[
        str | None, typer.Option(metavar="NUMBER|DISTRIBUTION", help="Phase of the shock.", show_default="any")
    ] = None,
    pairs: Annotated[int, typer.Option(help="Number of pairs of gears that share numbers, for Sobol indices.")] = 1024,
    seed: options.Seed = 0,
    budget: options.Budget = None,
    name: options.Name = "",
    tile: Annotated[
        int | None, typer.Option(help="Number of gears of a tile, which is one task and one chunk.")
    ] = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    url: options.Url = options.DEFAULT_URL,
    key: Key = None,
    force: Force = False,
    watch: Watch = False,
) -> None:
    """Compute a population of gears, write it to PATH, and print the answers about it.

    With --submit a service computes the population instead, and the command prints its id; if the service has an
    identical population, that one is used. Write a number that varies as normal:MEAN:DEVIATION[:LOW[:HIGH]],
    uniform:LOW:HIGH, triangular:LOW:MODE:HIGH or lognormal:MEDIAN:DEVIATION. The same command resumes an interrupted
    population; the numbers are the same to the last bit.
    """
    if (out is None) != submit:
        raise typer.BadParameter(
            "give --out PATH to compute the population here, or --submit to have a service compute it"
        )
    shock = {"speed": shock_speed, "phase": shock_phase}
    asked: dict[str, Any] = {"gears": gears, "count": count, "share": share, "margin": margin, "judged": judged}
    asked |= {"pairs": pairs, "seed": seed, "name": name, "tile": tile}
    asked |= {} if budget is None else {"budget": budget}
    request = _build_population_request(numbers, measured, correlation or [], shock, asked)
    if out is None:
        _submit_population(request, url, key, force, watch)
        return
    compute_store(request, out, scheduler, workers)

    from gear_rattle.workers.answers import read_finished_population

    print_population(read_finished_population(out))


def _submit_population(request: PopulationRequest, url: str, key: str | None, force: bool, watch: bool) -> None:
    from gear_rattle.service.client import Client

    with Client(url) as client:
        job = client.submit_population(request, idempotency_key=key, force=force)
        typer.echo(job.id)
        if watch:
            follow_job(job)


def _build_population_request(
    numbers: dict[str, str],
    measured: Path | None,
    pairs: list[str],
    shock: dict[str, str | None],
    other_fields: dict[str, Any],
) -> PopulationRequest:
    """Return the request that the given options describe. Raises typer.BadParameter if an option is wrong."""
    from pydantic import ValidationError

    import rattle
    from gear_rattle.workers import PopulationRequest
    from gear_rattle.workers.populations.numbers import convert_to_request_field
    from gear_rattle.workers.survey.axes import message_with_field
    from rattle.populations import Tolerances, parse_distribution

    def read_number_or_distribution(text: str) -> Any:
        try:
            return float(text)
        except ValueError:
            return convert_to_request_field(parse_distribution(text))

    try:
        gear: dict[str, Any] = {
            name: text if name == "drive" else read_number_or_distribution(text) for name, text in numbers.items()
        }
        matrix = None
        if measured is not None:
            found, matrix = rattle.read_gears(measured)
            if both := sorted(found.keys() & gear.keys()):
                raise typer.BadParameter(
                    f"{measured} and the command line both have {' and '.join(both)}: give each number "
                    "in one place only"
                )
            varying = [name for name, value in gear.items() if isinstance(value, dict)]
            if varying or pairs:
                raise typer.BadParameter(
                    f"with --measured only the numbers in {measured} vary: give every other number one value, and "
                    "leave --correlation out"
                )
            gear |= {name: convert_to_request_field(each) for name, each in found.items()}
        elif pairs:
            matrix = _correlation_matrix(Tolerances({**numbers}).names, pairs)
        given = {name: read_number_or_distribution(text) for name, text in shock.items() if text is not None}
        if given and "speed" not in given:
            raise typer.BadParameter("a shock needs a speed: give --shock-speed too")
        rows = None if matrix is None else tuple(map(tuple, matrix.tolist()))
        fields = {"gear": gear, "correlation": rows, "shock": given or None, **other_fields}
        return PopulationRequest.model_validate(fields)
    except ValidationError as error:
        raise typer.BadParameter(message_with_field(error)) from error
    except rattle.RattleError as error:
        raise typer.BadParameter(str(error)) from error


def _correlation_matrix(names: tuple[str, ...], pairs: list[str]) -> Any:
    """Return the correlation matrix of the varying numbers `names`. pairs: correlations as text NAME:NAME:NUMBER."""
    import numpy as np

    matrix, given = np.eye(len(names)), list[set[int]]()
    for text in pairs:
        try:
            first, second, number = text.split(":")
            i, j = names.index(first), names.index(second)
            value = float(number)
            if i == j:
                raise ValueError("both names are the same")
        except ValueError:
            known = ", ".join(names)
            raise typer.BadParameter(
                f"correlation {text!r}: write NAME:NAME:NUMBER, with two of the varying numbers ({known})"
            ) from None
        if {i, j} in given:
            raise typer.BadParameter(
                f"correlation {text!r}: the correlation of {first} and {second} is given twice: leave one out"
            )
        given.append({i, j})
        matrix[i, j] = matrix[j, i] = value
    return matrix
