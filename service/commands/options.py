"""Options that several commands share, and the survey request that they describe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from service.settings import Settings
    from workers import SurveyRequest

AXIS = "START:STOP:NUM"
DEFAULT_URL = "http://127.0.0.1:8000"

Delta = Annotated[str, typer.Option(metavar=AXIS, help="Damping: evenly spaced values, both ends included.")]
Epsilon = Annotated[str, typer.Option(metavar=AXIS, help="Eccentricity: evenly spaced values, both ends included.")]
Beta = Annotated[float, typer.Option(help="Half-backlash.")]
Kappa = Annotated[
    float | None,
    typer.Option(help="Stiffness of the walls: the stiff model.", show_default="none: the impacting model"),
]
Count = Annotated[int, typer.Option(help="Initial conditions per cell.")]
VMax = Annotated[
    str | None,
    typer.Option(
        metavar="SPEED",
        help='Largest initial speed, or "natural": 1.5 √(16πδβ) + 2πε of each cell.',
        show_default="7 in the paper's plane, natural elsewhere",
    ),
]
Budget = Annotated[
    int | None,
    typer.Option(help="Impacts after which a sample is undecided.", show_default="1000000"),
]
Slots = Annotated[
    int | None, typer.Option(help="Attractors that a cell lists.", show_default="8; 24 where δ begins below 0.1")
]
Seed = Annotated[int, typer.Option(help="Seed of the samples.")]
Name = Annotated[str, typer.Option(help="A name for people.")]
Tile = Annotated[
    str | None,
    typer.Option(metavar="DELTAxEPSILON", help="Cells of one tile, a task and a chunk.", show_default="by the sample"),
]
Quantity = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="What to compute, such as region or attractors; repeatable. Costly and only by name: basins.",
        show_default="all others",
    ),
]
Url = Annotated[str, typer.Option(envvar="RATTLE_URL", help="Where the service is.")]
Scheduler = Annotated[
    str | None,
    typer.Option(envvar="RATTLE_SCHEDULER", metavar="URL", help="An existing dask scheduler, such as tcp://host:8786."),
]


def settings_of(**given: Any) -> Settings:
    """Settings of a service, where None leaves them to the environment; typer.BadParameter names what is wrong."""
    from pydantic import ValidationError

    from service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        message = first["msg"].removeprefix("Value error, ")
        raise typer.BadParameter(f"{where}: {message}" if where else message) from error


def survey_request(
    *,
    delta: str,
    epsilon: str,
    beta: float,
    kappa: float | None,
    count: int,
    v_max: str | None,
    budget: int | None,
    slots: int | None,
    seed: int,
    name: str,
    tile: str | None,
    quantity: list[str] | None,
) -> SurveyRequest:
    """The request that these options describe; typer.BadParameter names the option that is wrong."""
    from pydantic import ValidationError

    from rattle import RattleError
    from rattle.attractors.speeds import read_speed
    from workers import Axis, SurveyRequest

    try:
        fields: dict[str, Any] = {
            "delta": Axis.parse(delta),
            "epsilon": Axis.parse(epsilon),
            "beta": beta,
            "initial_conditions": {
                "count": count,
                "v_max": read_speed(v_max),
                **({} if budget is None else {"budget": budget}),
            },
            "slots": slots,
            "seed": seed,
            "name": name,
        }
        if kappa is not None:
            fields |= {"model": "stiff", "kappa": kappa}
        if tile is not None:
            fields["tile"] = _tile(tile)
        if quantity:
            fields["quantities"] = tuple(quantity)
        return SurveyRequest(**fields)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise typer.BadParameter(f"{where}: {first['msg']}" if where else first["msg"]) from error
    except RattleError as error:
        raise typer.BadParameter(str(error)) from error


def _tile(text: str) -> dict[str, int]:
    try:
        delta, epsilon = (int(size) for size in text.lower().split("x"))
    except ValueError as error:
        raise typer.BadParameter(f"tile {text!r}: write DELTAxEPSILON, such as 16x16") from error
    return {"delta": delta, "epsilon": epsilon}
