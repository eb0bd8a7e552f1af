"""Machines against their own equations of motion: two bodies in SI units, integrated by another's integrator."""

import math
from collections.abc import Callable

import numpy as np
import pint
import pytest
from scipy.integrate import solve_ivp

import rattle
from rattle.stiff import StiffGear

DRAWING = {"inertia": 0.003, "drag": 1.5e-4, "backlash": 100e-6, "eccentricity": 15e-6, "radius": 0.05}
PHASE, SPEED, PERIODS = 0.3, 0.012, 3.5  # of a departure from Σ⁺, of the model
TOLERANCE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-16, "max_step": 5e-4}


def machine(drive: str, **more: float) -> rattle.Machine:
    return rattle.Machine(**DRAWING, rpm=3000, drive=drive, **more)


class Bodies:
    """Angles θ − Ωt and rates of both gears, y (4,); the second is free, the first too unless its speed is imposed."""

    def __init__(self, given: rattle.Machine) -> None:
        self.given = given
        self.inverse = (1 / given.inertia if given.drive == "torque" else 0.0, 1 / given.inertia)
        self.torque = 2 * given.drag * given.speed

    def gap(self, t: float, y: np.ndarray) -> tuple[float, float]:
        """How far the teeth are from the middle of their clearance, along the line of action, and its rate."""
        g, turn = self.given, self.given.speed * t
        position = g.radius * (y[0] - y[1]) + g.eccentricity * math.cos(turn)
        return position, g.radius * (y[2] - y[3]) - g.eccentricity * g.speed * math.sin(turn)

    def rates(self, t: float, y: np.ndarray) -> list[float]:
        """Newton's law for either body, with the force of the teeth, if these give way."""
        g, (first, second) = self.given, self.inverse
        position, force = self.gap(t, y)[0], 0.0
        if g.stiffness is not None and abs(position) > g.backlash / 2:
            force = g.stiffness * (position - math.copysign(g.backlash / 2, position))
        driving = self.torque - g.drag * (g.speed + y[2]) - force * g.radius
        return [y[2], y[3], first * driving, second * (force * g.radius - g.drag * (g.speed + y[3]))]

    def struck(self, t: float, y: np.ndarray) -> np.ndarray:
        """The rates after an elastic impact: the impulse that turns the rate of the gap around."""
        first, second = self.inverse
        r, rate = self.given.radius, self.gap(t, y)[1]
        impulse = 2 * rate / (r * r * (first + second))
        return y + np.array([0.0, 0.0, -impulse * r * first, impulse * r * second])

    def at_wall(self, velocity: float) -> tuple[float, np.ndarray]:
        """Teeth that meet at the upper wall, with this velocity (m/s) into it."""
        g = self.given
        t, length = PHASE * g.units.time, g.backlash / 2
        apart = (length - g.eccentricity * math.cos(g.speed * t)) / g.radius
        rate = (velocity + g.eccentricity * g.speed * math.sin(g.speed * t)) / g.radius
        if g.drive == "speed":
            return t, np.array([0.0, -apart, 0.0, -rate])
        return t, 0.5 * np.array([apart, -apart, rate, -rate])


def impacts_in_si(bodies: Bodies) -> list[tuple[float, int, float]]:
    """Time (s), wall and speed (m/s) of the impacts on walls that do not give way."""
    t, y = bodies.at_wall(-SPEED * bodies.given.units.velocity)
    end, half = t + PERIODS * bodies.given.units.time, bodies.given.backlash / 2

    def meets(wall: int) -> Callable[[float, np.ndarray], float]:
        def event(t: float, y: np.ndarray) -> float:
            return wall * bodies.gap(t, y)[0] - half

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        return event

    walls, found = (1, -1), []
    while True:
        away = solve_ivp(bodies.rates, (t, min(t + 1e-4, end)), y, **TOLERANCE)  # off the wall that it has just left
        t, y = away.t[-1], away.y[:, -1]
        flight = solve_ivp(bodies.rates, (t, end), y, events=[meets(wall) for wall in walls], **TOLERANCE)
        t, y = flight.t[-1], flight.y[:, -1]
        if flight.status != 1:
            return found
        wall = walls[0 if flight.t_events[0].size else 1]
        found.append((t, wall, abs(bodies.gap(t, y)[1])))
        y = bodies.struck(t, y)


@pytest.mark.parametrize("drive", ["torque", "speed"])
def test_two_bodies_impact_as_the_model_does(drive: str) -> None:
    given = machine(drive)
    found, units = impacts_in_si(Bodies(given)), given.units
    known = given.gear.trajectory(PHASE, SPEED, PERIODS, 2)
    time, wall, speed = (np.array(column) for column in zip(*found, strict=True))
    assert len(found) >= 5
    assert set(wall) == {1, -1}
    np.testing.assert_array_equal(wall, known.impact_wall)
    np.testing.assert_allclose(time / units.time - PHASE, known.impact_time, atol=1e-7)
    np.testing.assert_allclose(speed, known.impact_speed * units.velocity, rtol=1e-6)


@pytest.mark.parametrize("drive", ["torque", "speed"])
def test_two_bodies_whose_teeth_give_way_move_as_the_stiff_gear(drive: str) -> None:
    given = machine(drive, stiffness=2e6)
    bodies, units = Bodies(given), given.units
    t, y = bodies.at_wall(-SPEED * units.velocity)
    times = t + np.linspace(0, PERIODS, 71) * units.time
    moved = solve_ivp(bodies.rates, (t, times[-1]), y, t_eval=times, **(TOLERANCE | {"max_step": 2e-5}))
    assert isinstance(given.gear, StiffGear)
    known = given.gear.trajectory(PHASE, SPEED, PERIODS, 71)
    gap, rate = np.array([bodies.gap(*each) for each in zip(moved.t, moved.y.T, strict=True)]).T
    assert known.impact_time.size >= 5
    np.testing.assert_allclose(gap, known.phi * units.length, atol=1e-6 * given.backlash)
    np.testing.assert_allclose(rate, known.velocity * units.velocity, atol=1e-5 * SPEED * units.velocity)


@pytest.mark.parametrize("drive", ["torque", "speed"])
def test_the_energy_of_an_impact_is_what_stiff_teeth_store(drive: str) -> None:
    given = machine(drive, stiffness=1e12)
    bodies = Bodies(given)
    t, y = bodies.at_wall(SPEED * given.units.velocity)

    def turns(t: float, y: np.ndarray) -> float:
        return bodies.gap(t, y)[1]

    turns.terminal = True  # type: ignore[attr-defined]
    deepest = solve_ivp(bodies.rates, (t, t + 1e-4), y, events=turns, **(TOLERANCE | {"max_step": 1e-7}))
    depth = bodies.gap(deepest.t[-1], deepest.y[:, -1])[0] - given.backlash / 2
    assert given.stiffness is not None
    assert given.stiffness * depth**2 / 2 == pytest.approx(given.units.energy * SPEED**2 / 2, rel=1e-3)


def test_parameters_are_those_of_the_formulas() -> None:
    given = rattle.Machine(0.003, 1.5e-4, 100e-6, 15e-6, 0.05, 314.0, stiffness=3e8)
    turn = 2 * math.pi / 314.0
    assert given.delta == pytest.approx(1.5e-4 * turn / 0.003, rel=1e-14)
    assert (given.epsilon, given.beta) == pytest.approx((3e-4, 1e-3), rel=1e-14)
    assert given.kappa == pytest.approx(3e8 * 0.05**2 * turn**2 / 0.003, rel=1e-14)
    assert given.gear == StiffGear(given.delta, given.epsilon, given.beta, given.kappa)
    imposed = rattle.Machine(0.003, 1.5e-4, 100e-6, 15e-6, 0.05, 314.0, "speed", 3e8)
    assert (imposed.delta, imposed.epsilon, imposed.beta) == (given.delta, 2 * given.epsilon, 2 * given.beta)
    assert imposed.kappa == given.kappa / 2
    assert machine("torque").gear == rattle.Gear(*(getattr(machine("torque"), n) for n in ("delta", "epsilon", "beta")))


@pytest.mark.parametrize("drive", ["torque", "speed"])
def test_the_mean_force_of_the_teeth_carries_the_drag(drive: str) -> None:
    given = machine(drive)
    for orbit in given.gear.orbits():
        lines = given.gear.spectrum(orbit, 1.0)
        assert abs(lines.amplitude[0]) * given.units.force == pytest.approx(given.drag * given.speed / given.radius)


def test_an_intensity_in_si_units() -> None:
    given = machine("torque")
    a = given.gear.orbits()[0]
    found = given.intensity(a)
    velocity = given.delta * given.radius * given.speed  # of v = 2πδ
    energy = 0.5 * (given.inertia / 2) * (velocity / given.radius) ** 2
    assert (found.mean_velocity, found.largest_velocity) == pytest.approx((velocity, velocity), rel=1e-9)
    assert (found.impacts, found.energy, found.power) == pytest.approx((50.0, energy, 50 * energy), rel=1e-9)
    assert found.level == pytest.approx(10 * math.log10(50 * energy / 1e-12), abs=1e-6)
    assert (found.power_error, found.contact) == (0.0, 0.0)
    quiet = given.intensity(rattle.Attractor("quiet", 0, 0, 0, 1.0, (0, 1), (0, 0), 0.0, 0.0, 0.0))
    assert (quiet.power, quiet.level, quiet.contact) == (0.0, -math.inf, 1.0)


def test_quantities_with_units() -> None:
    q = pint.UnitRegistry().Quantity
    given = rattle.Machine(
        q(3000, "kg*mm**2"), q(0.15, "N*mm*s/rad"), q(100, "um"), q(15, "um"), q(5, "cm"), q(3000, "rpm"),
        stiffness=q(300, "N/um"),
    )  # fmt: skip
    plain = rattle.Machine(**DRAWING, rpm=3000, stiffness=3e8)
    for name in (*DRAWING, "speed", "stiffness", "delta", "epsilon", "beta", "kappa"):
        assert getattr(given, name) == pytest.approx(getattr(plain, name), rel=1e-12)
    for name, wrong in (
        ("radius", q(50, "s")),
        ("speed", q(50, "Hz")),
        ("inertia", q(3, "kg")),
        ("drag", q(0, "N*m*s")),
    ):
        with pytest.raises(rattle.ParameterError, match=f"^{name} must be"):
            rattle.Machine(**({**DRAWING, "speed": 314.0} | {name: wrong}))
    assert rattle.Machine(**DRAWING, speed=q(40_000, "rpm")).rpm == pytest.approx(40_000)  # is not doubted


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"radius": 50}, "for 50 mm give 0.05"),
        ({"backlash": 0.1}, "for 0.1 mm give 0.0001"),
        ({"backlash": 100}, "for 100 µm 0.0001"),
        ({"eccentricity": 0.015}, "for 0.015 mm give 1.5e-05"),
        ({"inertia": 3000}, "for 3000 kg mm² give 0.003"),
        ({"inertia": 1e-40, "backlash": 1e-74, "eccentricity": 0, "radius": 1e-70}, "inertia must be in kg m²"),
        ({"rpm": None, "speed": 3000.0}, "give rpm=3000"),
        ({"rpm": 1e308}, "no gear turns at"),
        ({"speed": 314.0}, "give the mean speed once"),
        ({"rpm": None}, "give the mean speed once"),
        ({"rpm": 0}, "rpm must be greater than 0"),
        ({"inertia": 0.0}, "inertia must be greater than 0"),
        ({"drag": -1e-4}, "drag must be greater than 0"),
        ({"backlash": math.nan}, "backlash must be finite"),
        ({"eccentricity": -1e-6}, "eccentricity must not be negative"),
        ({"stiffness": 0.0}, "stiffness must be greater than 0"),
        ({"radius": "50 mm"}, "radius must be real numbers"),
        ({"drive": "belt"}, "drive must be one of torque, speed"),
    ],
)
def test_what_cannot_be_meant_is_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(rattle.ParameterError, match=said):
        rattle.Machine(**(DRAWING | {"rpm": 3000} | wrong))


def test_a_machine_that_hardly_turns_hands_over_hardly_anything() -> None:
    given = rattle.Machine(**(DRAWING | {"drag": 1e-150}), rpm=1e-150)
    assert given.intensity_in_si(rattle.Intensity(1.0, 0.0, 1.0, 1.0, 0.5, 0.0, 1.0)).level == -math.inf


def test_a_gear_without_eccentricity_is_one() -> None:
    given = rattle.Machine(**(DRAWING | {"eccentricity": 0}), rpm=3000)
    assert given.gear.epsilon == 0.0
    assert given.rpm == pytest.approx(3000, rel=1e-15)
