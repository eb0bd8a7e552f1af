"""``rattle sound``: write the impacts of a motion to a sound file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.at_point import GivenPoint, add_point_options
from gear_rattle.service.commands.attractors import SpeedLimit, attractor_name, attractors_of_point
from gear_rattle.service.commands.options import Sample, Seed

if TYPE_CHECKING:
    import numpy as np

    from rattle import Attractor


@add_point_options(allows_rpm=True)
def sound(
    point: GivenPoint,
    out: Annotated[Path, typer.Argument(metavar="OUT.wav", help="Sound file to write.")],
    attractor: Annotated[
        int | None,
        typer.Option(
            help="Number of the attractor in `rattle attractors`, from 1.", show_default="the one of most power"
        ),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Length in seconds.")] = 5.0,
    ring: Annotated[float, typer.Option(help="Frequency of the ring of an impact, in Hz.")] = 2000.0,
    decay: Annotated[float, typer.Option(help="Decay time of the ring (to 1/e), in seconds.")] = 0.005,
    rate: Annotated[int, typer.Option(help="Sample rate, in Hz.")] = 44100,
    full_scale: Annotated[
        float | None,
        typer.Option(
            help="Impulse of the model that has full volume, so that sounds can be compared.",
            show_default="the loudest sample",
        ),
    ] = None,
    count: Sample = 64,
    v_max: SpeedLimit = None,
    seed: Seed = 0,
) -> None:
    """Write the impacts of a motion to a sound file. The amplitude of an impact is proportional to its impulse.

    --rpm is the speed of rotation.
    """
    if point.rpm is None:
        raise typer.BadParameter("a sound needs the speed of rotation: give --rpm", param_hint="--rpm")
    chosen = _choose_attractor(point, attractors_of_point(point, count, v_max, seed), attractor)
    samples = point.gear.sound(chosen, point.rpm, seconds, rate, ring, decay)
    _write_wav(out, samples, rate, full_scale)
    share = f"{100 * chosen.fraction:.3g} % of the initial conditions"
    typer.echo(f"{out}: {attractor_name(chosen)}, {share}" + ("" if samples.any() else ", is silent"))


def _choose_attractor(point: GivenPoint, found: tuple[Attractor, ...], number: int | None) -> Attractor:
    """Return the attractor `number`, counted from 1; for None the attractor with the most energy.

    The entry of undecided samples is chosen for None only if `found` has no other entry.
    """
    if number is not None:
        if not 1 <= number <= len(found):
            raise typer.BadParameter(
                f"there is no attractor {number}: give a number from 1 to {len(found)}", param_hint="--attractor"
            )
        return found[number - 1]
    told = [each for each in found if each.kind != "undecided"]
    return max(told or found, key=lambda each: point.gear.intensity(each).energy)


def _write_wav(out: Path, samples: np.ndarray, rate: int, full_scale: float | None) -> None:
    from gear_rattle.service.errors import ServiceError
    from rattle.intensity import wav

    file = wav(samples, rate, full_scale)
    try:
        out.write_bytes(file)
    except OSError as error:
        raise ServiceError(f"The sound {out} cannot be written: {error}") from error
