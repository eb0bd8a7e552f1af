"""Two gears in SI units: their parameter point in the model, and the results of the model in SI units.

The first gear drives the second. Gear i has the inertia Iᵢ, the drag cᵢ, the base radius rᵢ and the angle θᵢ. Along the
line of action there are a backlash j, the transmission error e(t) and the mesh stiffness k. With x = r₁θ₁ − r₂θ₂, the
tooth force F, the driving torque T₁ and the load torque T₂

    I₁θ₁'' + c₁θ₁' = T₁ − F r₁,      I₂θ₂'' + c₂θ₂' = F r₂ − T₂

Drive "torque" has a constant T₁, which maintains the mean speed; drive "speed" imposes θ₁ = Ωt. For two equal gears
without a load, φ = θ₁ − θ₂ and Φ = φ + (e/r) cos Ωt give the paper's (2.1) to (2.4) in forcing periods 2π/Ω, with

    δ = 2πc/(IΩ),      ε = e/r,      β = j/2r

With drive "speed", Φ, ε and β of the model are twice these values, and the model's stiffness is half as large. The
derivation is in docs/decisions/0025-machine.md for two equal gears, and in docs/decisions/0065-two-gears.md for two
different gears, which `conversion.reduce_pair` reduces to one equation.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from rattle.attractors.speeds import NATURAL
from rattle.attractors.table import Attractor
from rattle.errors import require, require_number, require_one_of
from rattle.intensity.intensity import Intensity
from rattle.intensity.motions import Motion
from rattle.machine.conversion import DRIVES, Units
from rattle.machine.forcing import AMPLITUDES, check_components
from rattle.machine.given import (
    DRIVEN,
    RPM,
    WIDEST,
    check_tooth_number,
    convert_to_si_number,
    is_quantity,
    require_plausible_machine,
    require_plausible_speed,
)
from rattle.machine.point import MachinePoint, machine_point
from rattle.machine.verdict import MachineVerdict, machine_verdict
from rattle.parameters import Harmonic

if TYPE_CHECKING:
    from rattle.models import AnyGear

#: Reference of sound power levels in W (ISO 1683).
PICOWATT = 1e-12


class MachineIntensity(NamedTuple):
    """The intensity of a motion in SI units.

    Attributes
    ----------
    impacts
        Number of impacts per second, on both walls.
    mean_velocity, largest_velocity
        Mean and largest speed of the impacts along the line of action, m/s.
    energy
        Kinetic energy of the impacts in a forcing period, J.
    power, power_error
        Energy of the impacts per time, W, and the 95 % half-width of this power, 0 if it is exact.
    level
        Level of the power in dB relative to 1 pW; −inf if the motion is quiet.
    contact
        Share of time in contact.
    """

    impacts: float
    mean_velocity: float
    largest_velocity: float
    energy: float
    power: float
    power_error: float
    level: float
    contact: float


@dataclass(frozen=True, init=False, repr=False)
class Machine:
    """A pair of gears, the first of which drives the second.

    By default both gears have the same inertia, drag and base radius. Numbers are in SI units, or quantities of `pint`;
    lengths are along the line of action.

    Parameters
    ----------
    inertia, drag, radius : float
        Inertia (kg m²) and drag torque over speed (N m s/rad) of the first gear with all parts that turn with it, and
        its base radius (m).
    backlash : float
        The whole backlash, m.
    eccentricity : float
        Amplitude of the transmission error's component of order 1 of the first gear's revolution, m; 0 if `errors`
        contains this component.
    speed, rpm : float
        Mean speed of the first gear in rad/s, or in revolutions per minute.
    drive : str
        "torque": a constant torque on the first gear. "speed": an imposed speed, as for most loose gears.
    stiffness : float, optional
        Stiffness of the mesh, N/m; without it the teeth are rigid.
    restitution : float, optional
        Speed after an impact over the speed before it, above 0 and at most 1; by default 1, elastic impacts.
    load_torque : float, optional
        Torque that the second gear drives besides its drag, N m.
    driven_inertia, driven_drag, driven_radius : float, optional
        Inertia, drag and base radius of the second gear; by default those of the first.
    teeth, driven_teeth : int, optional
        Tooth numbers of both gears. They determine driven_radius if it is not given.
    driven_eccentricity : float, optional
        Amplitude of the component of order 1 of the second gear's revolution, m.
    mesh_error, mesh_error_2, mesh_error_3 : float, optional
        Amplitudes of the components of order 1, 2 and 3 of the tooth mesh, m.
    errors, driven_errors : sequence of (int, float, float)
        Other components: order in the revolution of the first or second gear, amplitude in m, phase in turns. A
        measured transmission error is `read_transmission_error(…).harmonics`.

    Raises
    ------
    ParameterError
        If a number is not above 0 (amplitudes and load may be 0), is so large that its unit must be wrong, or
        contradicts another number.
    """

    inertia: float
    drag: float
    backlash: float
    eccentricity: float
    radius: float
    speed: float
    drive: str = "torque"
    stiffness: float | None = None
    restitution: float | None = None
    load_torque: float | None = None
    driven_inertia: float | None = None
    driven_drag: float | None = None
    driven_radius: float | None = None
    teeth: int | None = None
    driven_teeth: int | None = None
    driven_eccentricity: float | None = None
    mesh_error: float | None = None
    mesh_error_2: float | None = None
    mesh_error_3: float | None = None
    errors: tuple[tuple[int, float, float], ...] = ()
    driven_errors: tuple[tuple[int, float, float], ...] = ()

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
        restitution: float | None = None,
        teeth: int | None = None,
        driven_teeth: int | None = None,
        errors: Iterable[Any] = (),
        driven_errors: Iterable[Any] = (),
        **second: Any,
    ) -> None:
        require_one_of("drive", drive, DRIVES)
        require((speed is None) != (rpm is None), "give the mean speed once: either speed in rad/s, or rpm")
        known = ("load_torque", *(f"driven_{name}" for name in DRIVEN), *AMPLITUDES)
        for name in second:
            require_one_of("a number of a machine", name, known)
        lengths = {"backlash": backlash, "eccentricity": eccentricity, "radius": radius}
        given = {"inertia": inertia, "drag": drag, **lengths}
        numbers = {name: convert_to_si_number(name, value) for name, value in given.items()}
        turning = speed if rpm is None else require_number("rpm", rpm, positive=True) * RPM
        numbers["speed"] = convert_to_si_number("speed", turning)
        optional = {"stiffness": stiffness, **{name: second.get(name) for name in known}}
        found: dict[str, Any] = {
            **numbers,
            **{name: None if value is None else convert_to_si_number(name, value) for name, value in optional.items()},
            "drive": drive,
            "restitution": _check_restitution(restitution),
            "teeth": check_tooth_number("teeth", teeth),
            "driven_teeth": check_tooth_number("driven_teeth", driven_teeth),
            "errors": check_components("errors", errors),
            "driven_errors": check_components("driven_errors", driven_errors),
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)
        require_plausible_machine(self.inertia, self.backlash, self.eccentricity, self.radius)
        require_plausible_speed(self.speed, self.radius, sure=rpm is not None or is_quantity(speed))
        self._require_consistent_pair()

    def _require_consistent_pair(self) -> None:
        """Raise ParameterError if a number is too large for its unit, or if two numbers exclude each other."""
        total = self._point.forcing.amplitude_sum
        require(
            total <= WIDEST * self.radius,
            f"the amplitudes of the transmission error must be in metres: they add up to {total:g} m, "
            f"{total / self.radius:.2g} times the base radius; for {total:g} µm give {1e-6 * total:g}",
        )
        require(
            not (self.eccentricity and any(order == 1 for order, _, _ in self.errors)),
            "eccentricity is the amplitude of order 1, which errors contains too: give eccentricity=0, or leave "
            "order 1 out of errors",
        )
        pair = self._point.pair
        own = float(pair.radius / pair.radius_ratio)
        require_plausible_machine(self.driven_inertia or self.inertia, 0.0, 0.0, own, "driven_")
        require(
            self.stiffness is None or set(self.added) == {"kappa"},
            "a machine with a stiffness must have elastic impacts, no load torque and one harmonic: leave out "
            "stiffness, or else restitution, load_torque and all errors but one",
        )

    def __repr__(self) -> str:
        """Return the call that makes this machine, as text. Fields after the first eight appear only if given."""
        shown = [(each.name, getattr(self, each.name)) for each in fields(self)]
        kept = shown[: len(shown) if self._has_optional_fields else 8]
        words = [f"{name}={value!r}" for i, (name, value) in enumerate(kept) if i < 8 or value not in (None, ())]
        return f"{type(self).__name__}({', '.join(words)})"

    @property
    def _has_optional_fields(self) -> bool:
        """True if a field after the first eight, which are inertia to stiffness, was given."""
        return any(getattr(self, each.name) not in (None, ()) for each in fields(self)[8:])

    @cached_property
    def _point(self) -> MachinePoint:
        """The machine's dimensionless parameters, the SI sizes of the model's units, its reduction and its forcing."""
        numbers = {each.name: getattr(self, each.name) for each in fields(self)}
        return machine_point(numbers, self.speed, self.errors, self.driven_errors)

    @property
    def rpm(self) -> float:
        """The mean speed in revolutions per minute."""
        return self.speed / RPM

    @property
    def delta(self) -> float:
        """Damping δ."""
        return float(self._point.delta)

    @property
    def epsilon(self) -> float:
        """Eccentricity ε, from the amplitude of the first harmonic, or of the largest one if there is no first."""
        return float(self._point.epsilon)

    @property
    def beta(self) -> float:
        """Half-backlash β."""
        return float(self._point.beta)

    @property
    def added(self) -> dict[str, float]:
        """The parameters of the machine's model besides δ, ε and β, by name."""
        return {name: float(value) for name, value in self._point.added.items()}

    @property
    def harmonics(self) -> tuple[Harmonic, ...]:
        """The harmonics of the forcing besides the first, in the form that `rattle.Gear` takes."""
        return self._point.forcing.harmonics()

    @property
    def revolutions(self) -> float:
        """Revolutions of the first gear in a forcing period; 1 if `eccentricity` is the only transmission error."""
        return 1.0 / self._point.forcing.periods_per_revolution

    @property
    def effective_mass(self) -> float:
        """The effective mass of an impact, 1/(r₁²/I₁ + r₂²/I₂) in kg, with I₁ = ∞ if the speed is imposed."""
        units = self.units
        return float(units.energy / units.velocity**2)

    @property
    def rate_error(self) -> float:
        """A bound of the force that the model neglects, as a share of the driving force.

        The model has one damping rate for both gears. It neglects nothing, and the bound is 0, if the speed is imposed
        or if c₁/I₁ = c₂/I₂.
        """
        return float(self._point.rate_error)

    def __getattr__(self, name: str) -> float | None:
        """Return a parameter that a model adds, by its name; None if this machine's model has no such parameter."""
        from rattle.models import ADDED

        if name not in ADDED:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return self.added.get(name)

    @property
    def gear(self) -> "AnyGear":
        """The gear at the machine's parameter point: a `Gear`, `StiffGear` or `InelasticGear`.

        Raises
        ------
        ParameterError
            If a parameter is outside the domain of the gear.
        """
        from rattle.models import model_of, with_harmonics  # imported here, because it loads all gears

        return with_harmonics(model_of(self.beta, **self.added), self.harmonics).gear(self.delta, self.epsilon)

    @property
    def units(self) -> Units:
        """The SI sizes of the model's units."""
        return self._point.units

    def attractors(self, count: int = 256, seed: int = 0) -> tuple[Attractor, ...]:
        """Return the attractors that random states with speeds up to the natural speed reach; see `Gear.attractors`."""
        return self.gear.attractors(count, NATURAL, seed)

    def verdict(self, count: int = 256, seed: int = 0) -> MachineVerdict:
        """Return whether the machine rattles: never, only after a knock, from some initial conditions, or always.

        Parameters
        ----------
        count, seed : int
            Number and seed of the random initial conditions, as in `attractors`.

        Returns
        -------
        MachineVerdict
            The verdict; `str` gives it in one line.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        return machine_verdict(self, count, seed)

    def intensity(self, motion: Motion, periods: float | None = None) -> MachineIntensity:
        """Return the intensity of a motion in SI units; `Gear.intensity` returns it in the model's units."""
        return self.intensity_in_si(self.gear.intensity(motion, periods))

    def intensity_in_si(self, found: Intensity) -> MachineIntensity:
        """Convert an intensity in the model's units, as `Gear.intensity` returns it, to SI units."""
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


def _check_restitution(value: float | None) -> float | None:
    """Return a checked coefficient of restitution, or None if `value` is None. Raises ParameterError."""
    if value is None:
        return None
    number = require_number("restitution", value, positive=True)
    require(number <= 1.0, f"restitution must be at most 1 (elastic impacts), got {number:g}")
    return number
