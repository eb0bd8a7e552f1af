"""A pair of equal gears in SI units: which parameter point it is, and its motions back in SI units.

Both gears have the inertia I, the viscous drag c and the base radius r, and turn at the mean speed Ω. Along the line of
action lies a backlash j, the transmission error has the amplitude e once a revolution, and teeth press on each other
with k times their depth. With φ = θ₁ − θ₂ and Φ = φ + (e/r) cos Ωt the teeth meet at Φ = ±j/2r, and

    I θ₁'' + c θ₁' = 2cΩ − F r,      I θ₂'' + c θ₂' = F r      (drive "torque": a constant one keeps the mean speed)

give I φ'' + c φ' = 2cΩ − 2F r: in forcing periods 2π/Ω the paper's (2.1) to (2.4), with

    δ = 2πc/(IΩ),      ε = e/r,      β = j/2r.

Drive "speed" imposes θ₁ = Ωt, so I φ'' + c φ' = cΩ − F r, with half the drift: Φ, ε and β of the model are then twice
those above, and a stiffness counts half. docs/decisions/0025-machine.md has every step.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from rattle.attractors.speeds import NATURAL
from rattle.attractors.table import Attractor
from rattle.errors import require, require_number, require_one_of
from rattle.intensity.intensity import Intensity
from rattle.intensity.motions import Motion
from rattle.machine import conversion
from rattle.machine.conversion import DRIVES, Units
from rattle.machine.given import RPM, in_si, is_quantity, require_plausible, require_slow

if TYPE_CHECKING:
    from rattle.models import AnyGear

PICOWATT = 1e-12  # W, reference of sound power levels (ISO 1683)


class MachineIntensity(NamedTuple):
    """How hard a motion rattles, in SI units.

    impacts: per second, on both walls. mean_velocity, largest_velocity: of impacts, m/s along the line of action.
    energy: kinetic energy of the impacts of a revolution, J. power: what they hand over, W, power_error its 95 %
    half-width (0: exact). level: of that power, dB relative to 1 pW; −inf if quiet. contact: share of time in contact.
    """

    impacts: float
    mean_velocity: float
    largest_velocity: float
    energy: float
    power: float
    power_error: float
    level: float
    contact: float


@dataclass(frozen=True, init=False)
class Machine:
    """A pair of equal gears: both have this inertia, this drag and this base radius, so the ratio is 1.

    A pair of unlike gears is another model, which this is not. Numbers are in SI units, or quantities of `pint`.

    inertia: kg m², of each gear with what turns with it. drag: N m s/rad, the drag torque of each over its speed.
    backlash, eccentricity: m along the line of action, the whole backlash, and the amplitude of the transmission error
    once a revolution. radius: m, of the base circle. speed: the mean one in rad/s; or rpm=, revolutions per minute.
    drive: "torque", a constant one on one gear, or "speed", that of one imposed (inertia and drag are the other's).
    stiffness: N/m of the mesh along the line of action; without it teeth do not give way. Raises ParameterError on
    what is not above 0 (the eccentricity may be 0), and on what can only be in other units.
    """

    inertia: float
    drag: float
    backlash: float
    eccentricity: float
    radius: float
    speed: float
    drive: str = "torque"
    stiffness: float | None = None

    def __init__(
        self,
        inertia: Any,
        drag: Any,
        backlash: Any,
        eccentricity: Any,
        radius: Any,
        speed: Any = None,
        drive: str = "torque",
        stiffness: Any = None,
        *,
        rpm: float | None = None,
    ) -> None:
        require_one_of("drive", drive, DRIVES)
        require((speed is None) != (rpm is None), "give the mean speed once: speed in rad/s, or rpm")
        lengths = {"backlash": backlash, "eccentricity": eccentricity, "radius": radius}
        given = {"inertia": inertia, "drag": drag, **lengths}
        numbers = {name: in_si(name, value) for name, value in given.items()}
        turning = speed if rpm is None else require_number("rpm", rpm, positive=True) * RPM
        numbers["speed"] = in_si("speed", turning)
        for name, value in numbers.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "drive", drive)
        object.__setattr__(self, "stiffness", None if stiffness is None else in_si("stiffness", stiffness))
        require_plausible(self.inertia, self.backlash, self.eccentricity, self.radius)
        require_slow(self.speed, self.radius, sure=rpm is not None or is_quantity(speed))

    @property
    def rpm(self) -> float:
        """The mean speed in revolutions per minute."""
        return self.speed / RPM

    @property
    def delta(self) -> float:
        """Damping δ."""
        return float(conversion.damping(self.inertia, self.drag, self.speed))

    @property
    def epsilon(self) -> float:
        """Eccentricity ε."""
        return float(conversion.over_radius(self.eccentricity, self.radius, self.drive))

    @property
    def beta(self) -> float:
        """Half-backlash β."""
        return float(conversion.half_backlash(self.backlash, self.radius, self.drive))

    @property
    def added(self) -> dict[str, float]:
        """Parameters that its model has beside δ, ε and β, by name."""
        from rattle.models import ADDED  # loads all gears: only for who asks

        given = {
            name: (each.of_machine, getattr(self, each.machine_number))
            for name, each in ADDED.items()
            if each.machine_number is not None and each.of_machine is not None
        }
        scale = conversion.DRIVES[self.drive]
        return {
            name: float(make(number, self.inertia, self.radius, self.speed, scale))
            for name, (make, number) in given.items()
            if number is not None
        }

    def __getattr__(self, name: str) -> float | None:
        """Return a parameter that a model adds, None where this machine's model does not have it."""
        from rattle.models import ADDED

        if name not in ADDED:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self.added.get(name)

    @property
    def gear(self) -> "AnyGear":
        """The parameter point: a `Gear`, or with a stiffness a `StiffGear`. Raises ParameterError."""
        from rattle.models import model_of  # loads all gears: only for who asks

        return model_of(self.beta, **self.added).gear(self.delta, self.epsilon)

    @property
    def units(self) -> Units:
        """From the model back to SI units."""
        return conversion.units(self.inertia, self.radius, self.speed, self.drive)

    def attractors(self, count: int = 256, seed: int = 0) -> tuple[Attractor, ...]:
        """`Gear.attractors` of its gear, from speeds on the scale of its motions."""
        return self.gear.attractors(count, NATURAL, seed)

    def intensity(self, motion: Motion, periods: float | None = None) -> MachineIntensity:
        """Return how hard a motion of its gear rattles: `Gear.intensity` in SI units. Raises as that."""
        return self.in_si(self.gear.intensity(motion, periods))

    def in_si(self, found: Intensity) -> MachineIntensity:
        """Return an intensity of its gear in SI units."""
        units = self.units
        power = found.energy * units.power
        return MachineIntensity(
            impacts=found.impacts * units.frequency,
            mean_velocity=found.mean_speed * units.velocity,
            largest_velocity=found.largest_speed * units.velocity,
            energy=found.energy * units.energy,
            power=power,
            power_error=found.errors.energy * units.power,
            level=-math.inf if power == 0.0 else 10.0 * math.log10(power / PICOWATT),
            contact=found.contact,
        )
