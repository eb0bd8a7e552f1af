"""Commands about one parameter point, dimensionless or of a machine in SI units."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app

SI = {"inertia": 0.003, "drag": 5e-4, "backlash": 100e-6, "eccentricity": 15e-6, "radius": 0.05, "rpm": 3000.0}


def options(**changed: float | str | None) -> list[str]:
    """A machine's, some of them changed or left out."""
    given = {name: value for name, value in (SI | changed).items() if value is not None}
    return [text for name, value in given.items() for text in (f"--{name}", str(value))]


def said(*arguments: str) -> str:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return result.output


def rows(printed: str, first: str) -> list[list[str]]:
    """The rows of the table whose first heading this is, their cells apart by two blanks."""
    lines = printed.splitlines()
    begin = next(i for i, line in enumerate(lines) if line.split()[:1] == [first])
    return [re.split(r" {2,}", line.strip()) for line in lines[begin + 1 :]]


def test_a_machine_is_the_point_that_it_is() -> None:
    machine = rattle.Machine(**SI)
    point = [repr(machine.delta), repr(machine.epsilon), "--beta", repr(machine.beta)]
    plain, of_machine = said("orbits", *point), said("orbits", *options())
    assert plain.splitlines()[:2] == of_machine.splitlines()[:2]
    assert plain.startswith(f"delta = {machine.delta}, epsilon = {machine.epsilon}, beta = {machine.beta}: region")
    limit = machine.gear.quiet_limit * machine.units.length
    assert f"quiet limit at an eccentricity of {limit:.6g} m" in of_machine
    for one, other in zip(rows(plain, "orbit"), rows(of_machine, "orbit"), strict=True):
        assert float(other[3]) == pytest.approx(float(one[3]) * machine.units.velocity, abs=1e-9)
    stiff = said("orbits", *options(stiffness=3e8, drive="speed", eccentricity=5e-6))
    assert "epsilon = 0.0002, beta = 0.002, kappa = 50000.0" in stiff


@pytest.mark.parametrize(
    ("point", "lines"),
    [
        (
            ["0.6", "0.18"],
            [
                "SN1 at epsilon = 0.05964305819, quiet limit at epsilon = 0.1901210509",
                "flip: none at this damping: C ends in grazing G1 at epsilon = 0.144452777",
            ],
        ),
        (["0.5", "0.1"], ["SN1 at epsilon = 0.04149408254, flip at epsilon = 0.1676723452, quiet limit at epsilon = "]),
        (
            ["0.8", "0.1"],
            [
                "quiet limit at epsilon = 0.2526085729",
                "SN1: none at this damping: C does not exist, A begins in grazing G2 at epsilon = 0.1080528758",
                "flip: none at this damping: C does not exist",
            ],
        ),
        (
            ["0.05", "0.02", "--beta", "0.001"],
            [
                "quiet limit at epsilon = 0.0159149904",
                "SN1: none at this damping: A and C do not exist",
                "flip: none at this damping: C does not exist",
            ],
        ),
    ],
)
def test_a_limit_that_is_virtual_is_not_printed(point: list[str], lines: list[str]) -> None:
    printed = said("orbits", *point).splitlines()[1:]
    assert [line[: len(start)] for line, start in zip(printed, lines, strict=False)] == lines
    assert printed[len(lines)].split()[:2] == ["orbit", "P(m,"]


def test_the_end_of_c_in_a_machine_is_in_metres() -> None:
    machine = rattle.Machine(**SI | {"backlash": 300e-6})
    end = float(rattle.grazing("G1", machine.delta, machine.beta).epsilon)
    where = f"at epsilon = {end:.10g}, an eccentricity of {end * machine.units.length:.6g} m"
    assert f"flip: none at this damping: C ends in grazing G1 {where}" in said("orbits", *options(backlash=300e-6))


def test_attractors_are_printed_with_what_they_rattle() -> None:
    machine = rattle.Machine(**SI)
    known = machine.attractors(32)
    found = rows(said("attractors", *options(), "--count", "32"), "attractor")
    assert len(found) == len(known)
    for row, each in zip(found, known, strict=True):
        intensity = machine.intensity(each)
        numbers = [float(cell) for cell in row[1:]]
        assert numbers[0] == pytest.approx(each.fraction, abs=1e-4)
        assert sum(numbers[3:5]) == pytest.approx(intensity.impacts / 50, rel=1e-5)
        assert numbers[5:7] == pytest.approx([intensity.mean_velocity, intensity.largest_velocity], rel=1e-5)
        assert numbers[7:9] == pytest.approx([intensity.power, 0.0], rel=1e-5)
        assert numbers[9] == pytest.approx(intensity.level, abs=0.01)
    gear = rattle.Gear(0.6, 0.1)
    (chaotic,) = (
        row for row in rows(said("attractors", "0.6", "0.1", "--v-max", "7"), "attractor") if row[0] == "chaotic"
    )
    attractor = next(each for each in gear.attractors(64) if each.kind == "chaotic")
    expected = gear.intensity(attractor)
    assert [float(x) for x in chaotic[8:10]] == pytest.approx([expected.energy, expected.errors.energy], rel=1e-5)


def test_a_sound_is_that_of_the_library(tmp_path: Path) -> None:
    out = str(tmp_path / "out.wav")
    machine = rattle.Machine(**SI)
    printed = said("sound", out, *options(), "--seconds", "0.2", "--rate", "8000", "--count", "32", "--ring", "900")
    loudest = max(machine.attractors(32), key=lambda each: machine.intensity(each).power)
    assert f"P({loudest.m}, {loudest.n_plus}, {loudest.n_minus})" in printed
    rate, heard = wavfile.read(out)
    expected = machine.gear.sound(loudest, 3000.0, 0.2, 8000, 900.0)
    assert (rate, heard.dtype, heard.size) == (8000, np.int16, 1600)
    np.testing.assert_allclose(heard, expected / np.abs(expected).max() * 29490, atol=0.51)
    said("sound", out, *options(), "--seconds", "0.2", "--count", "32", "--full-scale", "1e-3")
    assert np.abs(wavfile.read(out)[1]).max() == 29490  # louder than that is cut
    assert "is silent" in said("sound", out, "0.6", "0.05", "--rpm", "3000", "--attractor", "1", "--seconds", "0.1")
    assert not wavfile.read(out)[1].any()


def test_a_table_is_compared(tmp_path: Path) -> None:
    gear = rattle.Gear(0.6, 0.089)
    attractor = next(each for each in gear.attractors(32) if each.m == 4)
    impacts = gear.impacts(attractor, 60.0)
    path = tmp_path / "impacts.csv"
    table = [
        f"{t},{v},{w}" for t, v, w in zip(impacts.time.tolist(), impacts.speed.tolist(), impacts.wall, strict=True)
    ]
    path.write_text("time,speed,wall\n" + "\n".join(table))
    plain = said("compare", str(path), "0.6", "0.089", "--offset", "0")
    assert "1.5 impacts per revolution, P(4, 4, 2)" in plain
    assert "phase 0 at 0 revolutions" in plain
    assert rows(plain, "nearest")[0][0] == "P(4, 4, 2)"
    path.write_text("time\n" + "\n".join(str(0.02 * t) for t in impacts.time.tolist()))
    timed = said("compare", str(path), "0.6", "0.089", "--rpm", "3000")
    assert "P(4, 4, 2)" in timed
    assert float(re.findall(r"phase 0 at (\S+) s;", timed)[0]) % 0.02 == pytest.approx(0.0, abs=2e-6)
    path.write_text("time\n" + "\n".join(map(str, np.cumsum(np.random.default_rng(2).exponential(0.7, 200)))))
    assert "The impacts do not fit this gear" in said("compare", str(path), "0.6", "0.089")


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["orbits"], "give DELTA and EPSILON, or a machine"),
        (["orbits", "0.6"], "give DELTA and EPSILON, or a machine"),
        (["orbits", "0.6", "0.1", *options()], "exclude each other"),
        (["attractors", *options(drag=None, radius=None)], "a machine needs --drag and --radius too"),
        (["attractors", *options(rpm=None)], "a machine needs --rpm too"),
        (["attractors", "0.6", "0.1", "--rpm", "100"], "exclude each other"),
        (["sound", "x.wav", "0.6", "0.1"], "--rpm"),
        (
            ["sound", "x.wav", "0.6", "0.1", "--rpm", "100", "--attractor", "9"],
            "no attractor 9: give a number from 1 to 3",
        ),
        (["orbits", *options(radius=50)], "for 50 mm give 0.05"),
        (["orbits", *options(drive="belt")], "drive must be one of torque, speed"),
        (["sound", "absent/x.wav", "0.6", "0.1", "--rpm", "100", "--seconds", "0.1"], "cannot be written"),
        (["sound", "x.wav", "0.6", "0.1", "--rpm", "-1"], "rpm must be greater than 0"),
        (["compare", "absent.csv", "0.6", "0.1"], "cannot be read"),
    ],
)
def test_what_does_not_fit_together_is_refused(
    arguments: list[str], what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code != 0
    told = f"{result.output} {result.exception}"
    assert what in re.sub(r"\s+", " ", told)
    assert isinstance(result.exception, rattle.RattleError | SystemExit)


def test_tables_say_what_their_columns_are() -> None:
    """The interval of a share is at 95 %, and a machine's options are those of two equal gears."""
    printed = said("attractors", "0.6", "0.089", "--count", "16")
    heading = next(line for line in printed.splitlines() if line.strip().startswith("attractor"))
    assert "95 % from" in heading
    (quiet,) = [row for row in rows(printed, "attractor") if row[0] == "quiet"]
    assert float(quiet[2]) < float(quiet[1]) < float(quiet[3])
    for command in ("attractors", "orbits", "run", "tolerance", "limit"):
        shown = " ".join(said(command, "--help").replace("│", " ").split())
        assert "equal gears" in shown, command
    for command in ("attractors", "sound", "compare"):
        assert "per cell" not in said(command, "--help")
