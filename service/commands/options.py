"""Options that several commands share, and the survey request that they describe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from gear_rattle.service.settings import Settings
    from gear_rattle.workers import Axis, SurveyRequest

AXIS = "START:STOP:NUM"
DEFAULT_URL = "http://127.0.0.1:8000"

MACHINE = "A machine, two equal gears, in SI units, instead of delta, epsilon and beta"


def _axis(what: str, panel: str | None = None) -> Any:
    text = f"{what}: evenly spaced values, both ends included."
    return Annotated[str | None, typer.Option(metavar=AXIS, help=text, rich_help_panel=panel, show_default=False)]


def _number(what: str) -> Any:
    return Annotated[float | None, typer.Option(help=what, rich_help_panel=MACHINE, show_default=False)]


Delta = _axis("Damping")
Epsilon = _axis("Eccentricity")
Beta = Annotated[float, typer.Option(help="Half-backlash.")]
SurveyedBeta = Annotated[
    str | None,
    typer.Option(metavar=f"BETA|{AXIS}", help="Half-backlash: one, or a third axis.", show_default="0.6"),
]
Inertia = _number("kg m², of each gear with what turns with it.")
Drag = _number("N m s/rad: the drag torque of each gear over its speed.")
Backlash = _number("m along the line of action.")
Radius = _number("m, of the base circle.")
Drive = Annotated[
    str | None,
    typer.Option(
        metavar="torque|speed",
        help="A constant torque on one gear, or its speed imposed.",
        rich_help_panel=MACHINE,
        show_default="torque",
    ),
]
Rpm = Annotated[
    str | None,
    typer.Option(
        metavar=AXIS,
        help="Revolutions per minute, both ends included: evenly spaced in δ, so in the time of a revolution.",
        rich_help_panel=MACHINE,
        show_default=False,
    ),
]
MetresOfEccentricity = _axis("m: the amplitude of the transmission error once a revolution", MACHINE)
SurveyedKappa = Annotated[
    str | None,
    typer.Option(
        metavar=f"KAPPA|{AXIS}",
        help="Stiffness of the walls, one or a third axis: the stiff model.",
        show_default="none: the impacting model",
    ),
]
Slice = Annotated[
    int | None,
    typer.Option("--slice", metavar="NUMBER", help="Of a survey with a third axis: which value of it, from 0."),
]
Count = Annotated[int, typer.Option(help="Initial conditions per cell.")]
Sample = Annotated[int, typer.Option(help="Initial conditions of the sample.")]
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
SlotsBy = Annotated[
    str | None,
    typer.Option(
        metavar="fraction|family",
        help="Which slot an attractor is in: the first of the largest share, or each family in one.",
        show_default="family where families are asked for",
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the samples.")]
Name = Annotated[str, typer.Option(help="A name for people.")]
Tile = Annotated[
    str | None,
    typer.Option(metavar="DELTAxEPSILON", help="Cells of one tile, a task and a chunk.", show_default="by the sample"),
]
Refine = Annotated[
    bool,
    typer.Option(
        "--refine",
        help="Compute few cells first, and more where what exists differs between them; fill the others.",
    ),
]
Audit = Annotated[
    float | None,
    typer.Option(
        metavar="SHARE", help="With --refine: of the filled cells that are computed all the same.", show_default="0.02"
    ),
]
Bound = Annotated[
    float | None,
    typer.Option(
        metavar="SHARE",
        help="With --refine: how many of the filled cells may be wrong (95 %); more are computed until no more are.",
    ),
]
Certify = Annotated[
    bool,
    typer.Option("--certify", help="Prove the periodic attractors, into a store of certificates beside the survey's."),
]
Quantity = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="What to compute, such as region or attractors; repeatable. Only by name: basins (costly), intensity, "
        "families (with attractors and lyapunov, of which they are made).",
        show_default="all others",
    ),
]
Url = Annotated[str, typer.Option(envvar="RATTLE_URL", help="Where the service is.")]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Processes of the embedded cluster.",
        show_default="2; for a few seconds of work none but this one",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(envvar="RATTLE_SCHEDULER", metavar="URL", help="An existing dask scheduler, such as tcp://host:8786."),
]


def settings_of(**given: Any) -> Settings:
    """Settings of a service, where None leaves them to the environment; typer.BadParameter names what is wrong."""
    from pydantic import ValidationError

    from gear_rattle.service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        from gear_rattle.workers.survey.axes import place_and_reason

        raise typer.BadParameter(place_and_reason(error)) from error


def survey_request(
    *,
    delta: str | None,
    epsilon: str | None,
    beta: str | None,
    kappa: str | None,
    count: int,
    v_max: str | None,
    budget: int | None,
    slots: int | None,
    slots_by: str | None,
    seed: int,
    name: str,
    tile: str | None,
    quantity: list[str] | None,
    machine: dict[str, Any],
    refine: bool,
    audit: float | None,
    bound: float | None,
    certify: bool,
) -> SurveyRequest:
    """The request that these options describe; typer.BadParameter names the option that is wrong."""
    from pydantic import ValidationError

    from gear_rattle.workers import Axis, SurveyRequest
    from gear_rattle.workers.survey.axes import place_and_reason
    from rattle import RattleError
    from rattle.attractors import read_speed

    given = {name: value for name, value in machine.items() if value is not None}
    asked = {name: value for name, value in (("audit", audit), ("bound", bound)) if value is not None}
    if asked and not refine:
        raise typer.BadParameter(f"--{next(iter(asked))} is a share of filled cells: give --refine too")
    for axis, other, value in (("delta", "rpm", delta), ("epsilon", "eccentricity", epsilon)):
        if (value is None) == (given.get(other) is None):
            raise typer.BadParameter(f"give either --{axis} or a machine's --{other}")
    try:
        axes = {name: Axis.parse(value) for name, value in (("delta", delta), ("epsilon", epsilon)) if value}
        given |= {name: Axis.parse(given[name]).model_dump() for name in ("rpm", "eccentricity") if name in given}
        fields: dict[str, Any] = {
            **axes,
            **({} if beta is None else {"beta": _number_or_axis("--beta", beta)}),
            **({"machine": given} if given else {}),
            "initial_conditions": {
                "count": count,
                "v_max": read_speed(v_max),
                **({} if budget is None else {"budget": budget}),
            },
            "slots": slots,
            "slots_by": slots_by,
            "seed": seed,
            "name": name,
            "certify": certify,
        }
        if kappa is not None:
            fields |= {"model": "stiff", "kappa": _number_or_axis("--kappa", kappa)}
        if tile is not None:
            fields["tile"] = _tile(tile)
        if refine:
            fields["refine"] = asked or True
        if quantity:
            fields["quantities"] = tuple(quantity)
        return SurveyRequest(**fields)
    except ValidationError as error:
        raise typer.BadParameter(place_and_reason(error)) from error
    except RattleError as error:
        raise typer.BadParameter(str(error)) from error


def _number_or_axis(option: str, text: str) -> float | Axis:
    from gear_rattle.workers import Axis

    if ":" in text:
        return Axis.parse(text)
    try:
        return float(text)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r}: write a number, or {AXIS}", param_hint=option) from error


def _tile(text: str) -> dict[str, int]:
    try:
        delta, epsilon = (int(size) for size in text.lower().split("x"))
    except ValueError as error:
        raise typer.BadParameter(f"tile {text!r}: write DELTAxEPSILON, such as 16x16") from error
    return {"delta": delta, "epsilon": epsilon}
