"""Declare the options that several commands share."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gear_rattle.service.parameters import added_parameters

if TYPE_CHECKING:
    from gear_rattle.service.settings import Settings

DEFAULT_URL = "http://127.0.0.1:8000"

Command = Callable[..., None]
NO_NUMBERS: Mapping[str, Any] = MappingProxyType({})
MACHINE = "A machine in SI units (two equal gears, or with --driven-… unlike ones), instead of delta, epsilon and beta"
NONE = "none: the impacting model"
METRES = "in m along the line of action"
#: The numbers of a gear, each with its help text and the default to show. A machine's numbers come after a model's.
NUMBERS: dict[str, tuple[str, str | bool]] = {
    "delta": ("Damping.", False),
    "epsilon": ("Eccentricity.", False),
    "beta": ("Half-backlash.", "0.6"),
    **{
        each.name: (f"{each.full_label} (selects the {each.model} model).", NONE)
        for each in added_parameters().values()
    },
    "inertia": (
        "Moment of inertia of each gear and its shaft, in kg m²; of the first one if --driven-inertia is given.",
        False,
    ),
    "drag": (
        "Drag torque of each gear over its speed, in N m s/rad; of the first one if --driven-drag is given.",
        False,
    ),
    "backlash": (f"Backlash, {METRES}.", False),
    "eccentricity": (f"Amplitude of the transmission error once a revolution, {METRES}.", False),
    "radius": ("Radius of the base circle, in m.", False),
    "rpm": ("Speed in revolutions per minute.", False),
    "drive": ("Drive: a constant torque on one gear, or an imposed speed.", "torque"),
    **{
        each.machine_number: (f"{each.machine_text} (selects the {each.model} model).", each.machine_absent)
        for each in added_parameters().values()
        if each.machine_number is not None
    },
    "driven_inertia": ("Moment of inertia of the second gear, in kg m².", "that of the first"),
    "driven_drag": ("Drag torque of the second gear over its speed, in N m s/rad.", "that of the first"),
    "driven_radius": ("Radius of the second gear's base circle, in m.", "by the tooth numbers"),
    "teeth": ("Number of teeth of the first gear.", False),
    "driven_teeth": ("Number of teeth of the second gear.", "that of the first"),
    "driven_eccentricity": (f"Transmission error once a revolution of the second gear, {METRES}.", "0"),
    "mesh_error": (f"Transmission error once a tooth, {METRES}.", "0"),
    "mesh_error_2": (f"Transmission error twice a tooth, {METRES}.", "0"),
    "mesh_error_3": (f"Transmission error three times a tooth, {METRES}.", "0"),
}
HARMONIC = (
    "A harmonic of the forcing beside the first: its order, amplitude over that of the first, and phase in turns. "
    "Repeatable. Needs --restitution, 1 of which is an elastic impact."
)
DIMENSIONLESS = ("delta", "epsilon", "beta", *added_parameters())


def make_number_options(kind: Any, metavar: str | None = None, panel: str = MACHINE) -> dict[str, Any]:
    """Return {name: option} for the numbers of a gear: of a model and of a machine.

    kind: the type of the options; only the option `drive` is always text.
    """
    found = {}
    for name, (text, default) in NUMBERS.items():
        taken, shown = (str, "torque|speed") if name == "drive" else (kind, metavar)
        of = None if name in DIMENSIONLESS else panel
        found[name] = Annotated[
            taken | None, typer.Option(metavar=shown, help=text, rich_help_panel=of, show_default=default)
        ]
    return found


def add_command_options(
    command: Command, options: dict[str, Any], argument_of: Callable[[dict[str, Any]], Any], **defaults: Any
) -> Command:
    """Give a command further options, from which the function `argument_of` makes the command's first argument.

    options: {option: annotated type}. argument_of: called with {option: value} for all values that are not None.
    defaults: {option: default}; the default of an option without an entry is None.

    Returns
    -------
    Command
        The command with a new signature, which typer reads.
    """
    keyword = inspect.Parameter.KEYWORD_ONLY
    # The type of the first argument may be from a module that imports slowly, so the annotation is not evaluated.
    command.__annotations__.pop(next(iter(command.__annotations__)))
    own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]
    shared = [
        inspect.Parameter(name, keyword, default=defaults.get(name), annotation=kind) for name, kind in options.items()
    ]
    # Required parameters, such as a file, come before the added options.
    required = [each for each in own if each.default is inspect.Parameter.empty]
    taken = [*required, *shared, *(each for each in own if each not in required)]

    @functools.wraps(command)
    def command_with_options(**given: Any) -> None:
        found = {name: given.pop(name) for name in options}
        command(argument_of({name: value for name, value in found.items() if value is not None}), **given)

    del command_with_options.__wrapped__  # typer would read the annotations of the original command
    command_with_options.__signature__ = inspect.Signature([each.replace(kind=keyword) for each in taken])  # type: ignore[attr-defined]
    command_with_options.__annotations__ = {each.name: each.annotation for each in taken}
    return command_with_options


def add_parameter_options(
    command: Command, kind: Any, text: str | None = None, after: str = "beta", model: str | None = None
) -> Command:
    """Give a command an option for each parameter that a model adds. These options follow the option named `after`.

    The command's last argument is then a mapping {name: value} of the given parameters.

    Parameters
    ----------
    text : str | None
        Help text of each option, with `{}` for the parameter's label; by default the text in the table NUMBERS.
    model : str | None
        The only model whose parameters become options; by default the parameters of all models do.

    Returns
    -------
    Command
        The command with a new signature, which typer reads.
    """
    own = list(inspect.signature(command, eval_str=True).parameters.values())[:-1]
    options = [
        inspect.Parameter(
            each.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[
                kind | None,
                typer.Option(
                    help=NUMBERS[each.name][0] if text is None else text.format(each.label.capitalize()),
                    show_default=NONE,
                ),
            ],
        )
        for each in added_parameters().values()
        if model in (None, each.model)
    ]
    place = 1 + [each.name for each in own].index(after)

    @functools.wraps(command)
    def command_with_options(**given: Any) -> None:
        found = {each.name: given.pop(each.name) for each in options}
        command(**given, numbers={name: value for name, value in found.items() if value is not None})

    del command_with_options.__wrapped__  # typer would read the annotations of the original command
    taken = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own]
    taken[place:place] = options
    command_with_options.__signature__ = inspect.Signature(taken)  # type: ignore[attr-defined]
    command_with_options.__annotations__ = {each.name: each.annotation for each in taken}
    return command_with_options


def add_number_options(command: Command) -> Command:
    """Give a command an option for each number of a gear; its value is a number or a distribution, as text.

    The command's first argument is then a mapping {name: text} of the options in the command line.

    Returns
    -------
    Command
        The command with a new signature, which typer reads.
    """
    return add_command_options(command, make_number_options(str, "NUMBER|DISTRIBUTION"), lambda given: given)


Beta = Annotated[float, typer.Option(help=NUMBERS["beta"][0])]
Slice = Annotated[
    int | None,
    typer.Option("--slice", metavar="NUMBER", help="Number of the slice of a survey with a third axis, from 0."),
]
Sample = Annotated[int, typer.Option(help="Number of initial conditions.")]
Budget = Annotated[
    int | None,
    typer.Option(help="Number of impacts after which a sample is undecided.", show_default="1000000"),
]
Seed = Annotated[int, typer.Option(help="Random seed of the initial conditions.")]
Name = Annotated[str, typer.Option(help="Name of the survey or population, shown in lists.")]
Url = Annotated[str, typer.Option(envvar="RATTLE_URL", help="Address of the service.")]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Number of processes of the embedded cluster.",
        show_default="2; this process only for a few seconds of work",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        envvar="RATTLE_SCHEDULER",
        metavar="URL",
        help="Address of an existing dask scheduler, such as tcp://host:8786, or its scheduler file (….json).",
    ),
]


def settings_from_options(**given: Any) -> Settings:
    """Return the settings of a service. A setting with the argument None comes from the environment or is the default.

    Raises
    ------
    BadParameter
        A setting is wrong; the message names its option.
    """
    from pydantic import ValidationError

    from gear_rattle.service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        from gear_rattle.workers.survey.axes import message_with_field

        raise typer.BadParameter(message_with_field(error)) from error
