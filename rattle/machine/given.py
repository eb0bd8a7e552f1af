"""Check the numbers of a machine: convert quantities to SI, and refuse numbers that are probably in wrong units."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rattle.errors import ParameterError, require, require_number
from rattle.flight.forcing import TWO_PI
from rattle.machine.forcing import AMPLITUDES

UNITS = {
    "inertia": "kg*m**2",
    "drag": "N*m*s",  # N m per rad/s, without the radian, which has no dimension
    "backlash": "m",
    "eccentricity": "m",
    "radius": "m",
    "speed": "rad/s",
    "stiffness": "N/m",
    "load_torque": "N*m",
    "driven_inertia": "kg*m**2",
    "driven_drag": "N*m*s",
    "driven_radius": "m",
    **dict.fromkeys(AMPLITUDES, "m"),
}
#: Numbers that may be 0: all amplitudes, and the load.
MAY_BE_ZERO = ("eccentricity", "load_torque", *AMPLITUDES)
#: Numbers for which the second gear may have other values; these are named driven_inertia and so on.
DRIVEN = ("inertia", "drag", "radius")
ANGLES = ("rad", "rev", "turn", "deg", "cycle")
#: One revolution per minute in rad/s.
RPM = TWO_PI / 60.0

#: Largest plausible base radius, m.
LARGEST_RADIUS = 5.0
#: Largest plausible ratio of backlash or eccentricity to the base radius.
WIDEST = 0.1
#: Largest relative difference between the ratio of the radii and the ratio of the tooth numbers. It is not 0, because
#: drawings give rounded radii.
RADIUS_ROUNDING = 0.01
MOST_TEETH = 1000
#: Density of steel in kg/m³. The largest plausible inertia of a gear is LARGEST_INERTIA_RATIO times the inertia of a
#: steel disc with the gear's base radius and a width equal to this radius.
STEEL, LARGEST_INERTIA_RATIO = 7850.0, 1e4
#: If the base circle is faster than this, in m/s, a speed that was given in rad/s was probably meant in rpm. Only gears
#: of turbines are faster, up to 200 m/s.
FASTEST_PLAUSIBLE = 100.0
#: Largest possible speed of the base circle, m/s.
IMPOSSIBLE = 1000.0


def convert_to_si_number(name: str, value: Any) -> float:
    """Return a number of a machine in SI, from a number in SI or from a quantity of `pint`.

    Returns
    -------
    float
        The number in the unit that UNITS has for this name.

    Raises
    ------
    ParameterError
        If the number is not above 0 (for names in `MAY_BE_ZERO`: if it is below 0), the quantity has another
        dimension, or a quantity for `speed` is not an angle over time.
    """
    if is_quantity(value):
        if name == "speed" and not any(angle in str(value.units) for angle in ANGLES):
            raise ParameterError(f"speed must be an angle over time, such as 3000 rpm or 314 rad/s, got {value}")
        try:
            value = value.to(UNITS[name]).magnitude
        except TypeError as error:  # pint's DimensionalityError is a TypeError
            raise ParameterError(f"{name} must be in {UNITS[name]} or a unit of that dimension: {error}") from None
    return require_number(name, value, positive=name not in MAY_BE_ZERO)


def is_quantity(value: Any) -> bool:
    """Return whether a value is a quantity of `pint`."""
    return hasattr(value, "magnitude") and hasattr(value, "to")


def require_plausible_machine(
    inertia: float, backlash: float, eccentricity: float, radius: float, prefix: str = ""
) -> None:
    """Raise ParameterError if a number is so large that its unit must be wrong, or if the radius is 0.

    prefix: "driven_" if the names in messages are those of the second gear.
    """
    require(radius > 0.0, f"{prefix}radius is 0 in double precision: give larger radii in metres")
    require(
        radius <= LARGEST_RADIUS,
        f"{prefix}radius must be in metres: {radius:g} m is no gear; for {radius:g} mm give {1e-3 * radius:g}",
    )
    for name, length in (("backlash", backlash), ("eccentricity", eccentricity)):
        require(
            length <= WIDEST * radius,
            f"{name} must be in metres along the line of action: {length:g} m is {length / radius:.2g} times the base "
            f"radius of {radius:g} m; for {length:g} mm give {1e-3 * length:g}, for {length:g} µm {1e-6 * length:g}",
        )
    disc = 0.25 * TWO_PI * STEEL * radius**5
    require(
        inertia <= LARGEST_INERTIA_RATIO * disc,
        f"{prefix}inertia must be in kg m²: {inertia:g} is over {LARGEST_INERTIA_RATIO:g} times the {disc:.2g} "
        f"of a steel disc of radius {radius:g} m; "
        f"for {inertia:g} kg mm² give {1e-6 * inertia:g}, for {inertia:g} kg cm² {1e-4 * inertia:g}",
    )


def check_tooth_number(name: str, value: Any) -> int | None:
    """Return a number of teeth after a check, or None if `value` is None. Raises ParameterError."""
    if value is None:
        return None
    number = require_number(name, value, positive=True)
    require(
        number == int(number) and number <= MOST_TEETH,
        f"{name} must be an integer from 1 to {MOST_TEETH}, got {number:g}",
    )
    return int(number)


def require_matching_gears(given: Mapping[str, Any], radius: Any, teeth: int | None, driven_teeth: int | None) -> Any:
    """Check that the numbers of both gears agree, and return the base radius of the second gear.

    Returns
    -------
    float or ndarray
        The radius in m: driven_radius, or else the radius that the tooth numbers imply, or else that of the first gear.

    Raises
    ------
    ParameterError
        If radii and tooth numbers disagree, a second gear of another size lacks its inertia or drag, or the second
        tooth number is given without the first.
    """
    driven = given.get("driven_radius")
    require(
        driven_teeth is None or teeth is not None,
        "driven_teeth is the tooth number of the second gear: give teeth, that of the first gear, too",
    )
    if driven is None:
        driven = radius if driven_teeth is None or teeth is None else radius * (driven_teeth / teeth)
    elif teeth is not None and driven_teeth is not None:
        off = float(np.max(np.abs(np.divide(driven, radius) * (teeth / driven_teeth) - 1.0)))
        require(
            off <= RADIUS_ROUNDING,
            f"base radii must have the ratio of the tooth numbers, {driven_teeth}/{teeth}, but their ratio is "
            f"{100 * off:.3g} % off: check the radii, or leave out driven_radius",
        )
    if np.any(np.not_equal(driven, radius)):
        lacking = [f"driven_{name}" for name in DRIVEN[:2] if given.get(f"driven_{name}") is None]
        require(
            not lacking, f"the second gear has another base radius than the first: give {' and '.join(lacking)} too"
        )
    return driven


def require_plausible_speed(speed: float, radius: float, sure: bool) -> None:
    """Raise ParameterError if a speed in rad/s is impossible, or so high that it was probably given in rpm.

    sure: whether the unit of the speed is known for certain; then only an impossible speed is refused.
    """
    rpm, velocity = speed / RPM, speed * radius
    require(velocity <= IMPOSSIBLE, f"no gear turns at {rpm:.6g} rpm with a base radius of {radius:g} m: check both")
    require(
        sure or velocity <= FASTEST_PLAUSIBLE,
        f"speed is in rad/s: {speed:g} rad/s are {rpm:.6g} rpm, {velocity:.3g} m/s at the base circle; for "
        f"{speed:g} rpm give rpm={speed:g}, and if the speed is right give rpm={rpm:.6g}",
    )
