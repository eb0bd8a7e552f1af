"""Two unlike gears against their own equations of motion: both bodies in SI units, integrated by scipy."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rattle
from rattle.inelastic import InelasticGear

DRAWING = {"inertia": 0.003, "drag": 1.5e-4, "backlash": 100e-6, "eccentricity": 15e-6, "radius": 0.05, "rpm": 3000}
SECOND = {"driven_inertia": 0.02, "teeth": 20, "driven_teeth": 35, "driven_eccentricity": 10e-6, "mesh_error": 0.2e-6}
LOSSY = {"restitution": 0.85, "load_torque": 0.3}
ALIKE = {"driven_drag": 1.5e-4 * 0.02 / 0.003}  # γ₁ = γ₂
PHASE, SPEED = 0.3, 0.02  # of a departure from Σ⁺; m/s
TOLERANCE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-16, "max_step": 1e-4}


class Bodies:
    """Both base circles, y = (p₁, p₂, p₁', p₂') less the mean motion, in metres along the line of action."""

    def __init__(self, numbers: dict[str, Any]) -> None:
        g = self.numbers = {"driven_teeth": 1, "teeth": 1, "driven_eccentricity": 0.0, "mesh_error": 0.0, **numbers}
        ratio = g["driven_teeth"] / g["teeth"]
        radius2 = g["radius"] * ratio
        self.turn = g["rpm"] * 2 * math.pi / 60
        self.mean = g["radius"] * self.turn
        self.drag = np.array([g["drag"] / g["radius"] ** 2, g["driven_drag"] / radius2**2])
        self.mass = np.array([g["inertia"] / g["radius"] ** 2, g["driven_inertia"] / radius2**2])
        self.imposed = g["drive"] == "speed"
        if self.imposed:
            self.mass[0] = math.inf
        load = g.get("load_torque", 0.0) / radius2
        self.force = np.array([self.drag.sum() * self.mean + load, -load])

    def error(self, t: float) -> tuple[float, float]:
        """The transmission error and its rate: each part by the angle of its own gear."""
        g, angle = self.numbers, self.turn * t
        parts = [
            (1.0, g["eccentricity"]),
            (g["teeth"] / g["driven_teeth"], g["driven_eccentricity"]),
            (g["teeth"], g["mesh_error"]),
        ]
        e = sum(size * math.cos(order * angle) for order, size in parts)
        return e, -sum(size * order * self.turn * math.sin(order * angle) for order, size in parts)

    def gap(self, t: float, y: np.ndarray) -> tuple[float, float]:
        e, rate = self.error(t)
        return y[0] - y[1] + e, y[2] - y[3] + rate

    def rates(self, _t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], (self.force - self.drag * (self.mean + y[2:])) / self.mass])

    def struck(self, t: float, y: np.ndarray) -> np.ndarray:
        inverse = 1 / self.mass
        impulse = (1 + self.numbers.get("restitution", 1.0)) * self.gap(t, y)[1] / inverse.sum()
        return y + np.array([0.0, 0.0, -impulse * inverse[0], impulse * inverse[1]])

    def departure(self, t: float, speed: float = SPEED) -> np.ndarray:
        """Teeth that leave the driving side with this speed while the common motion is the mean one."""
        e, rate = self.error(t)
        apart, parting = self.numbers["backlash"] / 2 - e, -speed - rate
        first = 0.0 if self.imposed else self.mass[1] / self.mass.sum()
        return np.array([first * apart, (first - 1) * apart, first * parting, (first - 1) * parting])

    def impacts(self, t: float, end: float) -> list[tuple[float, int, float]]:
        half, y, found = self.numbers["backlash"] / 2, self.departure(t), []

        def meets(wall: int) -> Callable[[float, np.ndarray], float]:
            def event(t: float, y: np.ndarray) -> float:
                return wall * self.gap(t, y)[0] - half

            event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
            return event

        while True:
            away = solve_ivp(self.rates, (t, min(t + 1e-5, end)), y, **TOLERANCE)  # off the wall that it has left
            t, y = away.t[-1], away.y[:, -1]
            flight = solve_ivp(self.rates, (t, end), y, events=[meets(1), meets(-1)], **TOLERANCE)
            t, y = flight.t[-1], flight.y[:, -1]
            if flight.status != 1:
                return found
            found.append((t, 1 if flight.t_events[0].size else -1, abs(self.gap(t, y)[1])))
            y = self.struck(t, y)


@pytest.mark.parametrize(
    ("drive", "more"),
    [
        ("torque", {**SECOND, **ALIKE, **LOSSY}),
        ("torque", {**SECOND, **ALIKE}),
        ("speed", {**SECOND, "driven_drag": 4e-4, **LOSSY}),
        ("speed", {**SECOND, "driven_drag": 4e-4, "eccentricity": 0.0, "driven_eccentricity": 0.0, **LOSSY}),
    ],
)
def test_two_unlike_gears_impact_as_the_model_does(drive: str, more: dict[str, Any]) -> None:
    numbers = {**DRAWING, **more, "drive": drive}
    given, bodies = rattle.Machine(**numbers), Bodies(numbers)
    units = given.units
    start, span = PHASE * units.time, 0.12
    found = bodies.impacts(start, start + span)
    known = given.gear.trajectory(PHASE, SPEED / units.velocity, span / units.time, 2)
    count = min(len(found), 8)  # later ones are sensitive to the first
    time, wall, speed = (np.array(column)[:count] for column in zip(*found, strict=True))
    assert count >= 5
    np.testing.assert_array_equal(wall, known.impact_wall[:count])
    np.testing.assert_allclose(time - start, known.impact_time[:count] * units.time, atol=1e-8)
    np.testing.assert_allclose(speed, known.impact_speed[:count] * units.velocity, rtol=1e-5)
    assert given.rate_error < 1e-12


def test_unequal_rates_are_off_by_no_more_than_is_said() -> None:
    numbers = {**DRAWING, **SECOND, "drag": 0.15, "driven_drag": 0.02, "backlash": 2e-3, "drive": "torque"}
    given, bodies = rattle.Machine(**numbers), Bodies(numbers)
    units = given.units
    driving = given.delta * 4 * math.pi * units.length / units.time**2
    start = PHASE * units.time
    known = given.gear.trajectory(PHASE, 0.3 / units.velocity, 2.0, 4001)
    free = known.time[known.time < known.impact_time[0]]
    times = start + free * units.time
    moved = solve_ivp(bodies.rates, (start, times[-1]), bodies.departure(start, 0.3), t_eval=times, **TOLERANCE)
    gap = np.array([bodies.gap(*each)[0] for each in zip(times, moved.y.T, strict=True)])
    off = np.abs(gap - known.phi[: free.size] * units.length)
    allowed = given.rate_error * driving * (times - start) ** 2 / 2
    assert 1e-3 < given.rate_error < 0.03
    assert np.all(off <= allowed + 1e-13)
    assert off[-1] > 0.01 * allowed[-1]  # and the bound is of that size


def test_numbers_of_the_reduction() -> None:
    numbers: dict[str, Any] = {**DRAWING, **SECOND, **ALIKE, **LOSSY}
    given = rattle.Machine(**numbers)
    radius2 = 0.05 * 35 / 20
    assert given.effective_mass == pytest.approx(1 / (0.05**2 / 0.003 + radius2**2 / 0.02), rel=1e-14)
    omega = 100 * math.pi
    assert given.gear.load == pytest.approx(0.3 / (ALIKE["driven_drag"] * omega * 20 / 35), rel=1e-14)
    assert given.revolutions == 7  # of 20 teeth, after which the pair repeats itself
    assert [order for order, _, _ in given.harmonics] == [1, 4, 7, 140]
    assert given.delta == pytest.approx(0.05 * 7 * 0.02, rel=1e-13)  # rate × period
    imposed = rattle.Machine(**numbers, drive="speed")
    assert imposed.effective_mass == pytest.approx(0.02 / radius2**2, rel=1e-14)
    drift = 4 * math.pi * (1 + imposed.gear.load) * imposed.units.velocity
    assert drift == pytest.approx(0.05 * omega + radius2 * 0.3 / ALIKE["driven_drag"], rel=1e-13)
    alone = rattle.Machine(**(DRAWING | {"eccentricity": 0}), teeth=20, mesh_error=1e-7, restitution=0.9)
    assert alone.revolutions == pytest.approx(0.05)
    assert alone.harmonics == ()
    assert alone.units.frequency == pytest.approx(1000)


def test_a_second_gear_like_the_first_changes_not_a_bit() -> None:
    for drive in ("torque", "speed"):
        plain = rattle.Machine(**DRAWING, drive=drive)
        scale, speed = {"torque": 1.0, "speed": 2.0}[drive], plain.speed
        assert plain.delta == 2 * math.pi * 1.5e-4 / (0.003 * speed)
        assert plain.epsilon == scale * 15e-6 / 0.05
        assert plain.beta == scale * 100e-6 / (2 * 0.05)
        time = 2 * math.pi / speed
        force = 0.5 * 0.003 / (0.05 * time * time)
        assert plain.units.force == force
        assert plain.units.energy == force * (0.05 / scale)
        twin = rattle.Machine(
            **DRAWING, drive=drive, driven_inertia=0.003, driven_drag=1.5e-4, driven_radius=0.05, restitution=1.0
        )
        assert (twin.gear, twin.units) == (plain.gear, plain.units)
        assert "driven" not in repr(plain)


def test_the_harmonics_are_the_sum_of_all_parts() -> None:
    errors = [(1, 8e-6, 0.3), (2, 2e-6, 0.9), (20, 3e-7, 0.2)]
    given = rattle.Machine(
        **(DRAWING | {"eccentricity": 0}), **SECOND, driven_drag=1e-3, errors=errors, driven_errors=[(2, 1e-6, 0.4)]
    )
    t = np.random.default_rng(7).random(50)  # forcing periods, of seven revolutions
    parts = [
        *((7 * order, size, phase) for order, size, phase in errors),
        (4, 10e-6, 0.0), (140, 0.2e-6, 0.0), (8, 1e-6, 0.4),
    ]  # fmt: skip
    wanted = sum(size * np.cos(2 * np.pi * (order * t + phase)) for order, size, phase in parts)
    scale = given.epsilon * given.units.length
    found = scale * sum(size * np.cos(2 * np.pi * (order * t + phase)) for order, size, phase in given.harmonics)
    np.testing.assert_allclose(found, wanted, atol=1e-15)
    turned = rattle.Machine(**(DRAWING | {"eccentricity": 0}), errors=errors)  # time begins where order 1 has phase 0
    found = turned.epsilon * turned.units.length * (
        np.cos(2 * np.pi * t) + sum(a * np.cos(2 * np.pi * (k * t + p)) for k, a, p in turned.harmonics)
    )  # fmt: skip
    wanted = sum(size * np.cos(2 * np.pi * (order * (t - 0.3) + phase)) for order, size, phase in errors)
    np.testing.assert_allclose(found, wanted, atol=1e-15)


def test_a_forcing_without_a_first_harmonic_is_that_of_a_shorter_period() -> None:
    scaled = InelasticGear(0.6, 0.1, 0.6, 0.8, 5.0, [(1, 0, 0), (3, 1, 0)])
    plain = InelasticGear(0.2, 0.1, 0.6, 0.8, 1.0)
    assert scaled.quiet_limit == pytest.approx(plain.quiet_limit, rel=1e-12)
    one, other = scaled.trajectory(0.2 / 3, 9.0, 3.0, 2), plain.trajectory(0.2, 3.0, 9.0, 2)
    count = min(one.impact_time.size, other.impact_time.size, 20)
    assert count > 5
    np.testing.assert_array_equal(one.impact_wall[:count], other.impact_wall[:count])
    np.testing.assert_allclose(3 * one.impact_time[:count], other.impact_time[:count], atol=1e-8)
    np.testing.assert_allclose(one.impact_speed[:count], 3 * other.impact_speed[:count], rtol=1e-6)
    for wrong, said in (
        ([(1, 0, 0)], "no harmonic has an amplitude above 0"),
        ([(1, 0.5, 0)], "or 0 if there is none"),
    ):
        with pytest.raises(rattle.ParameterError, match=said):
            InelasticGear(0.6, 0.1, 0.6, 0.8, 0.0, wrong)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"mesh_error": 1e-7}, "mesh_error has an order of the tooth mesh"),
        ({"driven_teeth": 35}, "give teeth, that of the first gear, too"),
        ({"teeth": 20, "driven_teeth": 35}, "give driven_inertia and driven_drag too"),
        ({"teeth": 20, "driven_teeth": 20, "driven_radius": 0.06}, "must have the ratio of the tooth numbers, 20/20"),
        ({"teeth": 20.5}, "teeth must be an integer"),
        ({"teeth": 20, "mesh_error": 0.2}, "must be in metres: they add up to"),
        ({"restitution": 1.2}, "restitution must be at most 1"),
        ({"restitution": 0.0}, "restitution must be greater than 0"),
        ({"load_torque": -1.0}, "load_torque must not be negative"),
        ({"restitution": 0.9, "stiffness": 1e8}, "a machine with a stiffness must have elastic impacts"),
        ({"driven_radius": 87.5, "driven_inertia": 0.02, "driven_drag": 1e-3}, "driven_radius must be in metres"),
        ({"errors": [(1, 1e-6, 0.0)]}, "give eccentricity=0"),
        ({"errors": [(0, 1e-6, 0.0)]}, "must be an integer from 1 on"),
        ({"errors": [(2, 1e-6, 0.0), (2, 1e-6, 0.0)]}, "twice"),
        ({"errors": 3}, "errors must be a list of"),
        ({"errors": [(2000, 1e-7, 0.0)]}, "above the limit of 1000"),
        ({"driven_mass": 2.0}, "must be one of load_torque"),
    ],
)
def test_what_cannot_be_a_pair_is_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(rattle.ParameterError, match=said):
        rattle.Machine(**(DRAWING | wrong))
