"""The point of the model that two gears have, of one pair or of many, from their numbers in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rattle.errors import require
from rattle.machine import conversion
from rattle.machine.conversion import Reduced, Units
from rattle.machine.forcing import AMPLITUDES, PairForcing, assembled, components_of
from rattle.machine.given import DRIVEN, require_two


class MachinePoint(NamedTuple):
    """Two gears as the model has them, plain numbers or arrays.

    delta, epsilon, beta: dimensionless. pair: the reduction. forcing: the transmission error. added: what a model adds,
    by name. units: from the model back to SI.
    """

    delta: Any
    epsilon: Any
    beta: Any
    pair: Reduced
    forcing: PairForcing
    added: dict[str, Any]
    units: Units

    @property
    def rate_error(self) -> Any:
        """The largest share of the driving force that a single rate leaves out: 0 where the reduction is exact."""
        backlash = 2.0 * self.beta * self.units.length
        return conversion.rate_error(self.pair, backlash, self.forcing.total, self.added.get("load", 0.0))


@np.errstate(all="ignore")  # numbers at the ends of double precision are refused below, or by the gear
def machine_point(
    numbers: Mapping[str, Any],
    speed: Any,
    errors: Sequence[tuple[int, Any, Any]] = (),
    driven_errors: Sequence[tuple[int, Any, Any]] = (),
) -> MachinePoint:
    """Return the point of the model that two gears are.

    Parameters
    ----------
    numbers : mapping
        The numbers of a `Machine` by name, which broadcast; None for those that are not given.
    speed : float or ndarray
        Mean speed of the first gear, rad/s.
    errors, driven_errors : sequence of (int, float, float)
        See `components_of`.

    Returns
    -------
    MachinePoint
        The point, with restitution and load only where the impacts are not elastic or something beside the first
        harmonic and the drag acts.

    Raises
    ------
    ParameterError
        Numbers of the two gears disagree, or are too far apart for double precision.
    """
    from rattle.models import ADDED  # loads all gears: only for who asks

    given = {name: value for name, value in numbers.items() if value is not None}
    teeth, driven_teeth = (None if given.get(name) is None else int(given[name]) for name in ("teeth", "driven_teeth"))
    driven = {f"driven_{name}": given.get(f"driven_{name}", given[name]) for name in DRIVEN}
    driven["driven_radius"] = require_two(given, given["radius"], teeth, driven_teeth)
    amplitudes = {name: given[name] for name in ("eccentricity", *AMPLITUDES) if name in given}
    forcing = assembled(components_of(teeth, driven_teeth, amplitudes, errors, driven_errors))
    drive = given.get("drive", "torque")
    inertia, drag, radius = (given[name] for name in DRIVEN)
    pair = conversion.reduced(inertia, drag, radius, speed, drive, **driven, base=forcing.base)
    for number in (pair.inertia, pair.drag, pair.scale, pair.speed):
        require(
            bool(np.all(np.isfinite(number) & (np.asarray(number) > 0.0))),
            "the numbers of the two gears are too far apart to be computed with: check inertias, drags and base radii",
        )
    added = {
        name: each.of_machine(given[each.machine_number], pair)
        for name, each in ADDED.items()
        if each.machine_number is not None and each.of_machine is not None and each.machine_number in given
    }
    if not np.any(added.get("load", 0.0)):
        added.pop("load", None)
    restitution = given.get("restitution", 1.0)
    if np.any(np.not_equal(restitution, 1.0)) or "load" in added or len(forcing.orders) > 1:
        added = {"restitution": restitution, "load": 0.0, **added}
    return MachinePoint(
        conversion.damping(pair),
        conversion.over_radius(forcing.amplitude, pair),
        conversion.half_backlash(given["backlash"], pair),
        pair,
        forcing,
        added,
        conversion.units(pair),
    )
