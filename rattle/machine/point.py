"""Compute the model's parameter point of a pair of gears, or of many pairs, from their SI numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rattle.errors import require
from rattle.machine import conversion
from rattle.machine.conversion import ReducedPair, Units
from rattle.machine.forcing import AMPLITUDES, PairForcing, assemble_forcing, components_of_transmission_error
from rattle.machine.given import DRIVEN, require_matching_gears


class MachinePoint(NamedTuple):
    """The parameter point of a pair of gears, as plain numbers, or of many pairs, as arrays.

    Attributes
    ----------
    delta, epsilon, beta
        The dimensionless parameters.
    pair
        The reduction of the two gears to one coordinate.
    forcing
        The transmission error.
    added
        The parameters that a model adds, by name.
    units
        The SI sizes of the model's units.
    """

    delta: Any
    epsilon: Any
    beta: Any
    pair: ReducedPair
    forcing: PairForcing
    added: dict[str, Any]
    units: Units

    @property
    def rate_error(self) -> Any:
        """A bound of the force that the model neglects, as a share of the driving force.

        The model has one damping rate for both gears, so it neglects a force if the rates of the two gears differ,
        unless the speed is imposed.
        """
        backlash = 2.0 * self.beta * self.units.length
        return conversion.neglected_force_bound(
            self.pair, backlash, self.forcing.amplitude_sum, self.added.get("load", 0.0)
        )


@np.errstate(all="ignore")  # no warning of overflow: numbers that are not finite are refused below, or by the gear
def machine_point(
    numbers: Mapping[str, Any],
    speed: Any,
    errors: Sequence[tuple[int, Any, Any]] = (),
    driven_errors: Sequence[tuple[int, Any, Any]] = (),
) -> MachinePoint:
    """Return the parameter point of a pair of gears.

    Parameters
    ----------
    numbers : mapping
        The numbers of a `Machine` by name, which broadcast; None means that a number is not given.
    speed : float or ndarray
        Mean speed of the first gear, rad/s.
    errors, driven_errors : sequence of (int, float, float)
        Components of the transmission error, as in `components_of_transmission_error`.

    Returns
    -------
    MachinePoint
        The parameter point. `added` contains restitution and load only if impacts are inelastic, or if there is a load
        or a harmonic besides the first.

    Raises
    ------
    ParameterError
        If numbers of the two gears disagree, or exceed the range of double precision; if a mesh error lacks `teeth`, or
        the transmission error has too high or too many orders.
    """
    from rattle.models import ADDED  # imported here, because it loads all gears

    given = {name: value for name, value in numbers.items() if value is not None}
    teeth, driven_teeth = (None if given.get(name) is None else int(given[name]) for name in ("teeth", "driven_teeth"))
    driven = {f"driven_{name}": given.get(f"driven_{name}", given[name]) for name in DRIVEN}
    driven["driven_radius"] = require_matching_gears(given, given["radius"], teeth, driven_teeth)
    amplitudes = {name: given[name] for name in ("eccentricity", *AMPLITUDES) if name in given}
    forcing = assemble_forcing(components_of_transmission_error(teeth, driven_teeth, amplitudes, errors, driven_errors))
    drive = given.get("drive", "torque")
    inertia, drag, radius = (given[name] for name in DRIVEN)
    pair = conversion.reduce_pair(inertia, drag, radius, speed, drive, **driven, base=forcing.periods_per_revolution)
    for number in (pair.inertia, pair.drag, pair.phi_per_angle, pair.speed):
        require(
            bool(np.all(np.isfinite(number) & (np.asarray(number) > 0.0))),
            "the numbers of the two gears are too large, too small or too different for double precision: check "
            "inertias, drags, base radii and the speed",
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
        conversion.delta_of_pair(pair),
        conversion.epsilon_of_amplitude(forcing.amplitude, pair),
        conversion.beta_of_backlash(given["backlash"], pair),
        pair,
        forcing,
        added,
        conversion.si_units_of_model(pair),
    )
