"""The options that describe a survey, for `rattle run` and `rattle submit`, and the request that follows from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from gear_rattle.service.commands.options import (
    HARMONIC,
    MACHINE,
    NUMBERS,
    Budget,
    Command,
    Name,
    add_command_options,
    make_number_options,
)
from gear_rattle.service.parameters import added_parameters

if TYPE_CHECKING:
    from gear_rattle.workers import Axis, SurveyRequest

AXIS = "START:STOP:NUM"
EVENLY_SPACED = "evenly spaced values, both ends included."
SECOND_GEAR = ("driven_inertia", "driven_drag", "driven_radius", "teeth", "driven_teeth")
SURVEYED_MACHINE = ("inertia", "drag", "backlash", "radius", "drive", *SECOND_GEAR, "rpm", "eccentricity")


def _annotate_option(kind: Any, text: str, **more: Any) -> Any:
    return Annotated[kind | None, typer.Option(help=text, **more)]


def _annotate_axis_option(name: str) -> Any:
    return _annotate_option(str, f"{NUMBERS[name][0].rstrip('.')}: {EVENLY_SPACED}", metavar=AXIS, show_default=False)


_MACHINE_OPTIONS = make_number_options(float)
#: All options of a survey. An option that sets a field of `SurveyRequest` or of its initial conditions has the field's
#: name, except `harmonic`, which adds an entry to the field `harmonics`. The default values are repeated here, because
#: `SurveyRequest` is slow to import.
OPTIONS: dict[str, Any] = {
    "delta": _annotate_axis_option("delta"),
    "epsilon": _annotate_axis_option("epsilon"),
    "beta": _annotate_option(
        str, "Half-backlash: one value, or a third axis.", metavar=f"BETA|{AXIS}", show_default="0.6"
    ),
    **{
        name: _annotate_option(
            str,
            f"{each.full_label}: one value{' or a third axis' if each.is_axis else ''} (the {each.model} model).",
            metavar=f"{name.upper()}|{AXIS}" if each.is_axis else name.upper(),
            show_default=NUMBERS[name][1],
        )
        for name, each in added_parameters().items()
    },
    "harmonic": _annotate_option(list[str], HARMONIC, metavar="ORDER:AMPLITUDE:PHASE", show_default="none"),
    "count": _annotate_option(int, "Number of initial conditions per cell."),
    "v_max": _annotate_option(
        str,
        'Largest initial speed, or "natural": 1.5 √(16πδβ) + 2πε of each cell.',
        metavar="SPEED",
        show_default="7 in the paper's plane, natural elsewhere",
    ),
    "budget": Budget,
    "slots": _annotate_option(
        int, "Largest number of attractors to store per cell.", show_default="8; 24 where δ begins below 0.1"
    ),
    "slots_by": _annotate_option(
        str,
        "Order attractors by: fraction (the largest basin fraction first), or family (one slot for each family).",
        metavar="fraction|family",
        show_default="family if families are computed",
    ),
    "seed": _annotate_option(int, "Random seed of the initial conditions."),
    "name": Name,
    "tile": _annotate_option(
        str,
        "Number of cells of a tile, which is one task and one chunk.",
        metavar="DELTAxEPSILON",
        show_default="chosen by the size of the sample",
    ),
    "quantity": _annotate_option(
        list[str],
        "Quantity to compute, such as region or attractors; repeatable. These are computed only if named: basins "
        "(costly), intensity, families (which need attractors and lyapunov).",
        metavar="NAME",
        show_default="all others",
    ),
    "refine": Annotated[
        bool,
        typer.Option(
            "--refine",
            help="Adaptive refinement: compute few cells, and more where neighbours differ; fill the others.",
        ),
    ],
    "audit": _annotate_option(
        float,
        "Share of filled cells to recompute as a check (with --refine).",
        metavar="SHARE",
        show_default="0.02",
    ),
    "bound": _annotate_option(
        float,
        "Largest allowed share of wrong cells among the filled ones, with 95 % confidence; further cells are computed "
        "until it is met.",
        metavar="SHARE",
    ),
    "certify": Annotated[
        bool,
        typer.Option(
            "--certify", help="Prove the periodic attractors, and write certificates to a store beside the survey's."
        ),
    ],
    **{name: _MACHINE_OPTIONS[name] for name in SURVEYED_MACHINE},
    "rpm": _annotate_option(
        str,
        "Speed range in revolutions per minute, both ends included; values are evenly spaced in δ.",
        metavar=AXIS,
        rich_help_panel=MACHINE,
        show_default=False,
    ),
    "eccentricity": _annotate_option(
        str,
        f"Amplitude of the transmission error once a revolution, in m: {EVENLY_SPACED}",
        metavar=AXIS,
        rich_help_panel=MACHINE,
        show_default=False,
    ),
}
#: {option: default}. An option without an entry is None if it is not given.
DEFAULTS = {"count": 64, "seed": 0}


def add_survey_options(command: Command) -> Command:
    """Give a command the options of a survey. The command's first argument is then the `SurveyRequest`."""
    return add_command_options(command, OPTIONS, request_from_options, **DEFAULTS)


def request_from_options(given: dict[str, Any]) -> SurveyRequest:
    """Return the request that the given options describe. given: {option: value}.

    Raises
    ------
    BadParameter
        An option is wrong. The message names the option.
    """
    from pydantic import ValidationError

    from gear_rattle.workers import Axis, SurveyRequest
    from gear_rattle.workers.survey.axes import message_with_field
    from rattle import RattleError
    from rattle.attractors import parse_speed_limit

    def take_fields(*names: str) -> dict[str, Any]:
        return {name: fields.pop(name) for name in names if name in fields}

    fields = dict(given)
    machine, refined, sample = (
        take_fields(*SURVEYED_MACHINE),
        take_fields("audit", "bound"),
        take_fields("count", "v_max", "budget"),
    )
    refine = fields.pop("refine", False)
    if refined and not refine:
        raise typer.BadParameter(f"--{next(iter(refined))} is for refined surveys only: give --refine too")
    for axis, other in (("delta", "rpm"), ("epsilon", "eccentricity")):
        if (axis in fields) == (other in machine):
            raise typer.BadParameter(f"give either --{axis}, or a machine with --{other}")
    try:
        fields |= {name: Axis.parse(text) for name, text in take_fields("delta", "epsilon").items()}
        machine |= {name: Axis.parse(machine[name]).model_dump() for name in ("rpm", "eccentricity") if name in machine}
        machine |= {name: int(machine[name]) for name in ("teeth", "driven_teeth") if name in machine}
        texts = take_fields("beta", *added_parameters())
        fields |= {name: _parse_number_or_axis(f"--{name}", text) for name, text in texts.items()}
        if "v_max" in sample:
            sample["v_max"] = parse_speed_limit(sample["v_max"])
        for each in added_parameters().values():
            if each.name in fields:
                fields["model"] = each.model
        if "tile" in fields:
            fields["tile"] = _parse_tile_sides(fields["tile"])
        if harmonics := fields.pop("harmonic", None):
            from gear_rattle.service.harmonics import read_harmonics

            fields["harmonics"] = read_harmonics(harmonics)
        if quantities := fields.pop("quantity", None):
            fields["quantities"] = tuple(quantities)
        if machine:
            fields["machine"] = machine
        if refine:
            fields["refine"] = refined or True
        return SurveyRequest(**fields | {"initial_conditions": sample})
    except ValidationError as error:
        raise typer.BadParameter(message_with_field(error)) from error
    except RattleError as error:
        raise typer.BadParameter(str(error)) from error


def _parse_number_or_axis(option: str, text: str) -> float | Axis:
    from gear_rattle.workers import Axis

    if ":" in text:
        return Axis.parse(text)
    try:
        return float(text)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is no number: write a number, or {AXIS}", param_hint=option) from error


def _parse_tile_sides(text: str) -> dict[str, int]:
    try:
        delta, epsilon = (int(size) for size in text.lower().split("x"))
    except ValueError as error:
        raise typer.BadParameter(f"--tile {text!r}: write DELTAxEPSILON, such as 16x16") from error
    return {"delta": delta, "epsilon": epsilon}
