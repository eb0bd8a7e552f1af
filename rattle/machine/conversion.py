"""The numbers of machines as parameters of the model, and what a unit of it is there: plain numbers, or arrays of them.

docs/decisions/0025-machine.md has every step.
"""

from typing import Any, NamedTuple

import numpy as np

from rattle.flight.forcing import TWO_PI

DRIVES = {"torque": 1.0, "speed": 2.0}  # Φ of the model over φ + (e/r) cos Ωt


class Units(NamedTuple):
    """SI units of the model's units; multiply by them.

    length (m): of Φ along the line of action. time (s): a forcing period. velocity (m/s): of speeds, along the line of
    action. energy (J): of v²/2, for the kinetic energy of an impact. power (W): of v²/2 per forcing period. force (N):
    between the teeth. frequency (Hz): of orders.
    """

    length: Any
    time: Any
    velocity: Any
    energy: Any
    power: Any
    force: Any
    frequency: Any


def damping(inertia: Any, drag: Any, speed: Any) -> Any:
    """Return δ = 2πc/(IΩ), of a speed in rad/s."""
    with np.errstate(divide="ignore", over="ignore"):  # what turns so slowly has no finite damping
        return np.divide(TWO_PI * drag, inertia * speed)


def over_radius(length: Any, radius: Any, drive: str) -> Any:
    """Return ε of an eccentricity, along the line of action."""
    return DRIVES[drive] * length / radius


def half_backlash(backlash: Any, radius: Any, drive: str) -> Any:
    """Return β."""
    return DRIVES[drive] * backlash / (2.0 * radius)


def units(inertia: Any, radius: Any, speed: Any, drive: str) -> Units:
    """From the model back to SI units."""
    length, time = radius / DRIVES[drive], TWO_PI / speed
    force = 0.5 * inertia / (radius * time * time)
    energy = force * length
    return Units(length, time, length / time, energy, energy / time, force, 1.0 / time)
