"""The pictures of the stiff gear show what the library computes: its limit, and its diagrams."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rattle.errors import ParameterError
from rattle.plot import diagram, diagram_figure, stiff, stiff_figure
from rattle.stiff import StiffGear
from rattle.stiff import diagram as stiff_diagram
from service.cli import app


def test_the_figure_shows_convergence_and_the_graze(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stiff, "STIFFNESSES", np.array([1e3, 1e6, 1e8]))
    places, multipliers, curves, graze = stiff_figure(0.6, 0.08).figure.axes
    for axes in (places, multipliers):
        lines = {line.get_label(): np.asarray(line.get_xydata()) for line in axes.get_lines()}
        assert set("ABCD") < set(lines)
        for name in "ABCD":
            assert lines[name][1, 1] / lines[name][2, 1] == pytest.approx(10, rel=0.3)
    lines = {line.get_label(): np.asarray(line.get_xydata()) for line in curves.get_lines()}
    assert lines["quiet limit"][1, 1] / lines["quiet limit"][2, 1] == pytest.approx(100, rel=0.01)
    assert lines["SN1"][1, 1] / lines["SN1"][2, 1] == pytest.approx(10, rel=0.1)
    assert {"SN2", "PD1"} < set(lines)
    impacting = np.asarray(graze.get_lines()[-1].get_ydata())
    jumps = [np.abs(np.diff(np.asarray(line.get_ydata()))).max() for line in graze.get_lines()]
    assert len(impacting) == 801
    assert jumps == sorted(jumps)  # the stiffer, the steeper


def test_it_needs_all_four_motions() -> None:
    with pytest.raises(ParameterError, match="do not all exist"):
        stiff_figure(0.6, 0.05)


def test_a_diagram_is_drawn_as_that_of_the_impacting_model() -> None:
    found = stiff_diagram((0.6, 0.075), (0.6, 0.09), 0.6, 1e4, 4, 2, impacts=2)
    lower = diagram_figure(found, (3.0, 5.0)).axes[1]
    assert lower.get_xlabel() == "eccentricity $ε$ (δ = 0.6, β = 0.6, κ = 10000)"
    assert {text.get_text() for text in lower.texts} == {"(b)", "A", "B", "C", "D"}
    drawn = []
    for line in lower.lines:
        x, y = (np.asarray(part) for part in line.get_data())
        for k in np.flatnonzero((x[:-1] - 0.08) * (x[1:] - 0.08) <= 0):
            share = (0.08 - x[k]) / (x[k + 1] - x[k])
            drawn.append((y[k] + share * (y[k + 1] - y[k]), line.get_linestyle() == "-"))
    for orbit in StiffGear(0.6, 0.08, 0.6, 1e4).orbits():
        tau, stable = min(drawn, key=lambda each: abs(each[0] - orbit.tau))
        assert tau == pytest.approx(orbit.tau, abs=2e-3)
        assert stable == orbit.stable
    softer = diagram_figure(stiff_diagram((0.6, 0.07), (0.6, 0.07), 0.6, (1e3, 1e4), 2, 1, impacts=1)).axes[1]
    assert softer.get_xlabel() == "softness $κ^{-1/2}$ (δ = 0.6, ε = 0.07, β = 0.6, κ 1000 to 10000)"
    assert softer.get_xlim() == pytest.approx((1e-2, 1e-3**0.5))


def test_the_command_draws_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stiff, "STIFFNESSES", np.array([1e3, 1e6, 1e8]))
    monkeypatch.setattr(diagram, "STIFF_STEPS", 2)
    for arguments in (["stiff"], ["5", "--epsilon", "0.058:0.066", "--kappa", "1e4"]):
        result = CliRunner().invoke(app, ["figure", *arguments, "--out", str(tmp_path), "--format", "png"])
        assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.iterdir()} == {"stiff.png", "figure5.png"}
    assert min(path.stat().st_size for path in tmp_path.iterdir()) > 20_000
