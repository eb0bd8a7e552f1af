"""Read the numbers of a machine as plain SI numbers, and decide whether these can be meant."""

from typing import Any

from rattle.errors import ParameterError, require, require_number
from rattle.flight.forcing import TWO_PI

UNITS = {
    "inertia": "kg*m**2",
    "drag": "N*m*s",  # radians have no dimension
    "backlash": "m",
    "eccentricity": "m",
    "radius": "m",
    "speed": "rad/s",
    "stiffness": "N/m",
}
ANGLES = ("rad", "rev", "turn", "deg", "cycle")
RPM = TWO_PI / 60.0  # rad/s

LARGEST_RADIUS = 5.0  # m
WIDEST = 0.1  # of the base radius: backlash and eccentricity
STEEL, HEAVIEST = 7850.0, 1e4  # kg/m³; inertia over that of a steel disc as wide as its radius
FASTEST = 100.0  # m/s at the base circle, from which on a number in rad/s is doubted: turbines' gears reach 200
IMPOSSIBLE = 1000.0


def in_si(name: str, value: Any) -> float:
    """Return a number in the unit of UNITS, from one or from a quantity of `pint`.

    Returns
    -------
    float
        The number.

    Raises
    ------
    ParameterError
        Unless it is above 0, or of the eccentricity at least 0.
    """
    if is_quantity(value):
        if name == "speed" and not any(angle in str(value.units) for angle in ANGLES):
            raise ParameterError(f"speed must be an angle over time, such as 3000 rpm or 314 rad/s, got {value}")
        try:
            value = value.to(UNITS[name]).magnitude
        except TypeError as error:  # pint's DimensionalityError is one
            raise ParameterError(f"{name} must be in {UNITS[name]} or another unit of that kind: {error}") from None
    return require_number(name, value, positive=name != "eccentricity")


def is_quantity(value: Any) -> bool:
    """Return whether this is a quantity of `pint`."""
    return hasattr(value, "magnitude") and hasattr(value, "to")


def require_plausible(inertia: float, backlash: float, eccentricity: float, radius: float) -> None:
    """Raise ParameterError on numbers that can only be in other units than SI's."""
    require(
        radius <= LARGEST_RADIUS,
        f"radius must be in metres: {radius:g} m is no gear; for {radius:g} mm give {1e-3 * radius:g}",
    )
    for name, length in (("backlash", backlash), ("eccentricity", eccentricity)):
        require(
            length <= WIDEST * radius,
            f"{name} must be in metres along the line of action: {length:g} m is {length / radius:.2g} times the base "
            f"radius of {radius:g} m; for {length:g} mm give {1e-3 * length:g}, for {length:g} µm {1e-6 * length:g}",
        )
    disc = 0.25 * TWO_PI * STEEL * radius**5
    require(
        inertia <= HEAVIEST * disc,
        f"inertia must be in kg m²: {inertia:g} is over {HEAVIEST:g} times the {disc:.2g} of a steel disc of radius "
        f"{radius:g} m; for {inertia:g} kg mm² give {1e-6 * inertia:g}, for {inertia:g} kg cm² {1e-4 * inertia:g}",
    )


def require_slow(speed: float, radius: float, sure: bool) -> None:
    """Raise ParameterError on a speed in rad/s at which nothing turns.

    Or, unless sure of the unit, on one that seems to be in rpm.
    """
    rpm, velocity = speed / RPM, speed * radius
    require(velocity <= IMPOSSIBLE, f"nothing turns at {rpm:.6g} rpm with a base radius of {radius:g} m: check both")
    require(
        sure or velocity <= FASTEST,
        f"speed is in rad/s: {speed:g} rad/s are {rpm:.6g} rpm, {velocity:.3g} m/s at the base circle; for "
        f"{speed:g} rpm give rpm={speed:g}, and if it is meant rpm={rpm:.6g}",
    )
