"""Impacts that the models make themselves, given as if they were measured: with noise, without walls, at any phase."""

import math
from pathlib import Path

import numpy as np
import pytest
from depth import deep, either

import rattle
from rattle.comparison import compare, measured, read_csv
from rattle.flight.law import natural_speed
from rattle.models import AnyGear
from rattle.stiff import StiffGear

CELLS = {
    "the paper's": rattle.Gear(0.6, 0.089),
    "chaos": rattle.Gear(0.6, 0.1),
    "many impacts": rattle.Gear(0.45, 0.26, 0.3),
    "real gears": rattle.Gear(0.0021220659, 0.0003, 0.001),
    "stiff": StiffGear(0.6, 0.089, kappa=1e5),
}
EXACT = {"the paper's"}  # times without noise too
START, PERIODS = 0.377, 120.0


def rattling(gear: AnyGear) -> list[rattle.Attractor]:
    """Return the attractors of a sample, without quiet running and undecided samples."""
    speed = float(natural_speed(gear.delta, gear.epsilon, gear.beta))
    return [each for each in gear.attractors(64, speed) if each.kind in ("periodic", "chaotic")]


def same(a: rattle.Attractor, b: rattle.Attractor) -> bool:
    return (a.kind, a.m, a.n_plus, a.n_minus) == (b.kind, b.m, b.n_plus, b.n_minus)


def label_of(attractor: rattle.Attractor) -> tuple[int, int, int] | None:
    label = attractor.m, attractor.n_plus, attractor.n_minus
    return label if attractor.kind == "periodic" else None


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        *((name, 0.003) for name in CELLS),
        *(pytest.param(name, 0.0, marks=() if name in EXACT else deep) for name in CELLS),
    ],
)
def test_walls_phase_and_motion_are_found_from_times_alone(name: str, noise: float) -> None:
    gear, rng = CELLS[name], np.random.default_rng(3)
    for each in rattling(gear)[:3]:
        impacts = gear.impacts(each, PERIODS)
        late = noise * rng.standard_normal(impacts.time.size) * PERIODS / impacts.time.size
        found = compare(measured(impacts.time + START + late), gear)
        np.testing.assert_array_equal(found.wall, impacts.wall)
        turn = 0.5 if noise and label_of(each) == (1, 2, 0) else 1.0  # nearly the same half a revolution later
        off = (found.offset - START + 0.5 * turn) % turn - 0.5 * turn
        assert off == pytest.approx(0.0, abs=3e-3 if noise or name == "stiff" else 1e-4)
        assert found.misfit < (0.02 if noise else 2e-3)
        assert found.label == label_of(each)
        assert same(found.near[0].attractor, each)
        assert found.near[0].distance < 0.03
        assert found.impacts == pytest.approx(gear.intensity(each).impacts, rel=0.03)
        assert found.histogram.sum() == pytest.approx(found.impacts, rel=1e-12)
        np.testing.assert_allclose(
            found.histogram.sum(axis=1), found.near[0].histogram.sum(axis=1), rtol=0.1, atol=0.05
        )


def test_what_was_measured_besides_times_is_used() -> None:
    gear = CELLS["the paper's"]
    attractor = next(each for each in rattling(gear) if each.m == 4)
    impacts = gear.impacts(attractor, PERIODS)
    found = compare(measured(impacts.time, impacts.speed, impacts.wall), gear, 0.0)
    assert found.offset == 0.0
    assert found.energy == pytest.approx(gear.intensity(attractor).energy, rel=0.02)
    assert found.near[0].intensity == gear.intensity(attractor)
    wrong = compare(measured(impacts.time, None, -impacts.wall), gear, 0.0)
    assert set(wrong.wall * impacts.wall) <= {-1, 0}  # as measured, or none of the motion
    assert wrong.misfit > 0.3
    assert compare(measured(impacts.time), gear, 0.25).misfit > 0.05


def test_times_at_random_are_no_motion() -> None:
    rng = np.random.default_rng(5)
    for _ in range(4):
        found = compare(measured(np.cumsum(rng.exponential(0.6, 300))), CELLS["the paper's"])
        assert found.misfit == pytest.approx(0.5, abs=0.1)
        assert found.label is None


def test_a_cascade_is_told_from_the_motion_that_it_doubled() -> None:
    gear = CELLS["the paper's"]
    for each in rattling(gear):
        if each.m > 1:
            impacts = gear.impacts(each, 4.0 * each.m)
            assert compare(measured(impacts.time), gear).label == label_of(each)
            nearly = compare(measured(impacts.time), gear, tolerance=0.5).label
            assert nearly == label_of(each)


def test_a_distance_is_how_far_impacts_are_moved() -> None:
    gear = CELLS["the paper's"]
    c = next(each for each in rattling(gear) if each.m == 1)
    times = c.tau + np.arange(1, 41) + 0.1
    near = {each.attractor.kind: each for each in compare(measured(times, None, np.ones(40)), gear, 0.0).near[::-1]}
    closest = compare(measured(times, None, np.ones(40)), gear, 0.0).near
    own = next(each for each in closest if same(each.attractor, c))
    assert own.distance == pytest.approx(0.1, abs=2e-3)
    assert near["quiet"].distance == pytest.approx(0.5, rel=1e-12)


def test_a_table_in_seconds_and_metres(tmp_path: Path) -> None:
    machine = rattle.Machine(0.003, 3e-4, 100e-6, 15e-6, 0.05, rpm=3000)
    attractor = next(each for each in rattling(machine.gear) if each.n_minus == 0)
    impacts, units = machine.gear.impacts(attractor, 40.0), machine.units
    lines = ["\ufeffSpeed, Time ,note", ""]
    for time, speed in zip(impacts.time, impacts.speed, strict=True):
        lines.append(f"{speed * units.velocity!r},{time * units.time!r},x")
    path = tmp_path / "impacts.csv"
    path.write_text("\n".join(lines).replace("np.float64(", "").replace(")", "") + "\n", encoding="utf-8")
    found = read_csv(path, units.time, units.velocity)
    np.testing.assert_allclose(found.time, impacts.time, rtol=1e-14)
    assert found.speed is not None
    np.testing.assert_allclose(found.speed, impacts.speed, rtol=1e-14)
    assert found.wall is None
    assert same(compare(found, machine.gear).near[0].attractor, attractor)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "must name its columns"),
        ("1\n2\n", "must name its columns"),
        ("time\n1\n2\n", "2 impacts are too few: give at least 8"),
        ("time\n" + "\n".join("12345678") + "\n7\n", "time must be finite and rise"),
        (
            "time\n" + "\n".join(f"{i}e-20" for i in range(9)),
            "within 8e-20 forcing periods: give time in forcing",
        ),
        ("time,speed,Time\n" + "\n".join(f"{i},1,{i}" for i in range(9)), "2 columns named 'time': keep one"),
        ("time\n" + "\n".join("1234567") + "\nlate\n", "line 9 of .*'late' in column 1 is not a number"),
        ("time,speed\n" + "\n".join("12345678") + "\n", "line 2 of .*'' in column 2 is not a number"),
        ("time,wall\n" + "\n".join(f"{i},0" for i in range(9)), "wall must be 1 "),
        ("time,speed\n" + "\n".join(f"{i},-1" for i in range(9)), "speed must be finite and at least 0"),
    ],
)
def test_a_table_that_cannot_be_used_says_why(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "impacts.csv"
    path.write_text(text)
    with pytest.raises(rattle.ParameterError, match=said):
        read_csv(path)


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    with pytest.raises(rattle.RattleError, match="cannot be read"):
        read_csv(tmp_path / "absent.csv")
    times = np.arange(9.0)
    for arguments, said in (
        ((times, times[:3]), "a speed for each of the 9 impacts"),
        ((times, None, times[:3]), "a wall for each of the 9 impacts"),
        ((times[:, None],), "shape"),
    ):
        with pytest.raises(rattle.ParameterError, match=said):
            measured(*arguments)
    for options, said in (({"bins": 0}, "bins"), ({"tolerance": 0.0}, "tolerance"), ({"offset": math.nan}, "offset")):
        with pytest.raises(rattle.ParameterError, match=said):
            compare(measured(times), rattle.Gear(0.6, 0.05), **options)


FALSE = 0.1  # of the impacts
STATED = ((0.6, 0.0615), (0.6, 0.089))


def with_false_impacts(gear: AnyGear, each: rattle.Attractor, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times from START on, late by noise, with false impacts at random among them, and walls, 0 of these."""
    impacts, rng = gear.impacts(each, PERIODS), np.random.default_rng(seed)
    late = noise * rng.standard_normal(impacts.time.size) * PERIODS / impacts.time.size
    times = np.sort(impacts.time + START + late)
    false = rng.uniform(times[0], times[-1], round(FALSE * times.size))
    order = np.argsort(np.append(times, false))
    return np.append(times, false)[order], np.append(impacts.wall, np.zeros(false.size, np.int64))[order]


def off_by(offset: float) -> float:
    return (offset - START + 0.5) % 1.0 - 0.5


@pytest.mark.parametrize(("delta", "epsilon"), STATED)
def test_false_impacts_are_found_and_do_not_move_the_phase(delta: float, epsilon: float) -> None:
    gear = rattle.Gear(delta, epsilon)
    for seed in range(either(2, 20)):
        for each in rattling(gear)[:2]:
            times, wall = with_false_impacts(gear, each, 0.0, seed)
            found = compare(measured(times), gear)
            assert abs(off_by(found.offset)) < 1e-4
            assert np.mean(found.wall == wall) > 0.98
            assert found.misfit < 0.1
            low, high = found.offset_interval
            assert low < found.offset < high < low + 1e-3


@pytest.mark.parametrize(("delta", "epsilon"), STATED)
def test_the_phase_lies_in_its_interval_or_in_one_that_is_stated_beside_it(delta: float, epsilon: float) -> None:
    """Times that are noisy, too, over many seeds: 95 % of the intervals, but for their own sampling error."""
    gear, inside = rattle.Gear(delta, epsilon), []
    motions = rattling(gear)[:2]
    for seed in range(either(10, 100)):
        each = motions[seed % len(motions)]
        times, wall = with_false_impacts(gear, each, 0.003, seed)
        found = compare(measured(times), gear)
        ends = [found.offset_interval, *(interval for _, interval in found.other_offsets)]
        inside.append(any((START - low) % 1.0 <= high - low for low, high in ends))
        assert np.mean(found.wall[found.is_sure] == wall[found.is_sure]) > 0.97
    assert np.mean(inside) >= 0.95 - 2.0 * math.sqrt(0.95 * 0.05 / len(inside))


def test_a_phase_that_is_given_is_not_doubted() -> None:
    gear = CELLS["the paper's"]
    impacts = gear.impacts(rattling(gear)[0], PERIODS)
    found = compare(measured(impacts.time), gear, 0.0)
    assert found.offset_interval == (0.0, 0.0)
    assert found.other_offsets == ()
