"""A measured transmission error: its orders against those that it was made of, and sentences for what is none."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rattle

PARTS = [(1, 15e-6, 0.0), (2, 3e-6, 0.3), (20, 0.4e-6, 0.7), (40, 0.1e-6, 0.1)]


def curve(turn: np.ndarray) -> np.ndarray:
    return np.asarray(sum(a * np.cos(2 * np.pi * (k * turn + p)) for k, a, p in PARTS))


def table(path: Path, angle: np.ndarray, error: np.ndarray, header: str = "angle_deg,error_um") -> Path:
    path.write_text("\n".join([header, *(f"{a!r},{e!r}" for a, e in zip(angle.tolist(), error.tolist(), strict=True))]))
    return path


TURN = np.arange(720) / 720
EVEN = (360 * TURN, 1e6 * curve(TURN))


@pytest.mark.parametrize("closed", [False, True])
def test_orders_are_those_that_the_curve_is_made_of(tmp_path: Path, closed: bool) -> None:
    turn = np.arange(720 + closed) / 720
    found = rattle.read_transmission_error(table(tmp_path / "a.csv", 360 * turn, 1e6 * curve(turn) + 7.0))
    known = dict.fromkeys(range(1, 41), (0.0, 0.0)) | {k: (a, p) for k, a, p in PARTS}
    for order, size, phase in found.harmonics:
        wanted = known[order][0] * np.exp(2j * np.pi * known[order][1])
        assert abs(size * np.exp(2j * np.pi * phase) - wanted) < 1e-14
    assert found.left_out < 1e-14
    assert (found.points, found.revolutions) == (720, 1)


def test_what_is_left_out_is_what_the_other_orders_have(tmp_path: Path) -> None:
    found = rattle.read_transmission_error(table(tmp_path / "a.csv", *EVEN), orders=20)
    assert found.left_out == pytest.approx(0.1e-6 / np.sqrt(2), rel=1e-9)  # order 40
    assert "0.071 µm rms left out" in str(found)
    given = rattle.Machine(0.003, 5e-4, 100e-6, 0, 0.05, rpm=3000, restitution=0.9, errors=found.harmonics)
    assert given.epsilon * given.units.length == pytest.approx(15e-6, rel=1e-9)
    assert {k: a for k, a, _ in given.harmonics}[20] == pytest.approx(0.4 / 15, rel=1e-9)


def test_uneven_angles_and_several_revolutions(tmp_path: Path) -> None:
    turn = np.sort(np.random.default_rng(3).random(3000) * 3)
    turn[0], turn[-1] = 0.0, 3.0 - 1e-3
    for header, scale in (("angle_rad,error_mm", 2 * np.pi), ("angle_rev,error_mm", 1.0)):
        found = rattle.read_transmission_error(table(tmp_path / "b.csv", turn * scale, 1e3 * curve(turn), header))
        assert found.revolutions == 3
        assert {k: a for k, a, _ in found.harmonics}[20] == pytest.approx(0.4e-6, rel=1e-6)


GAP = np.delete(np.arange(720), slice(100, 140))


@pytest.mark.parametrize(
    ("angle", "error", "header", "more", "said"),
    [
        (*EVEN, "angle,error_um", {}, "does not say its unit: name it angle_deg, angle_rad or angle_rev"),
        (*EVEN, "angle_deg,error", {}, "does not say its unit: name it error_um, error_mm or error_m"),
        (*EVEN, "angle_rad,error_um", {}, "angles must span whole revolutions"),
        (2 * np.pi * TURN, EVEN[1], "angle_deg,error_um", {}, "angles must span whole revolutions"),
        (*EVEN, "angle_deg,error_mm", {}, "if the errors are in µm, name the column error_um"),
        (EVEN[0], EVEN[1] / 1000 / 10, "angle_deg,error_um", {}, "if the errors are in mm, name the column error_mm"),
        (EVEN[0][GAP], EVEN[1][GAP], "angle_deg,error_um", {}, "there is a gap of 0.0569 revolutions"),
        (EVEN[0], EVEN[1] + 30 * TURN, "angle_deg,error_um", {}, "does not close after a revolution"),
        (*EVEN, "angle_deg,error_um", {"orders": 360}, "720 points are too few for 360 orders"),
        (EVEN[0][::-1], EVEN[1], "angle_deg,error_um", {}, "angles must rise, but these fall"),
        (np.roll(EVEN[0], 9), EVEN[1], "angle_deg,error_um", {}, "sort the table by angle"),
        (EVEN[0], np.where(TURN == 0.5, np.nan, EVEN[1]), "angle_deg,error_um", {}, "not a finite number"),
        (EVEN[0][:500], EVEN[1][:500], "angle_deg,error_um", {}, "whole revolutions, but span 0.693"),
        (EVEN[0][:3], EVEN[1][:3], "angle_deg,error_um", {}, "3 points are too few"),
        (*EVEN, "angle_deg,error_um", {"orders": 0}, "orders must be an integer from 1"),
        (*EVEN, "angle_deg,other", {}, "must have exactly one of the columns error_um"),
    ],
)
def test_what_is_no_transmission_error_is_refused(
    tmp_path: Path, angle: np.ndarray, error: np.ndarray, header: str, more: dict[str, Any], said: str
) -> None:
    with pytest.raises(rattle.ParameterError, match=said):
        rattle.read_transmission_error(table(tmp_path / "c.csv", angle, error, header), **more)
