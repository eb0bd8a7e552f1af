"""The pictures of the stiff gear show what the library computes: its limit, and its diagrams."""

from pathlib import Path

import numpy as np
import pytest
from depth import deep
from typer.testing import CliRunner

from gear_rattle.service.cli import app
from rattle.errors import ParameterError
from rattle.plot import diagram, stiff, stiff_figure
from rattle.plot.diagram import admissible_curve_parts, impact_curves_along_branch, parameter_axis
from rattle.stiff import StiffGear
from rattle.stiff import diagram as stiff_diagram


@deep
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
    axis, scale, offset = parameter_axis(found)
    assert axis == "eccentricity $ε$ (δ = 0.6, β = 0.6, κ = 10000)"
    drawn, names = [], set()
    for curve in (
        curve for branch in found.branches for curve in impact_curves_along_branch(found, branch, scale, offset)
    ):
        names |= set(curve.name)
        for stable, part in admissible_curve_parts(curve):
            x, tau = curve.x[part], curve.tau[part]
            for k in np.flatnonzero((x[:-1] - 0.08) * (x[1:] - 0.08) <= 0):
                drawn.append((tau[k] + (0.08 - x[k]) / (x[k + 1] - x[k]) * (tau[k + 1] - tau[k]), stable))
    assert names >= set("ABCD")
    for orbit in StiffGear(0.6, 0.08, 0.6, 1e4).orbits():
        tau, stable = min(drawn, key=lambda each: abs(each[0] - orbit.tau))
        assert tau == pytest.approx(orbit.tau, abs=2e-3)
        assert stable == orbit.stable
    axis, scale, offset = parameter_axis(stiff_diagram((0.6, 0.07), (0.6, 0.07), 0.6, (1e3, 1e4), 2, 1, impacts=1))
    assert axis == "softness $κ^{-1/2}$ (δ = 0.6, ε = 0.07, β = 0.6, κ 1000 to 10000)"
    assert (offset, offset + scale) == pytest.approx((1e3**-0.5, 1e-2))


def test_the_command_draws_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stiff, "STIFFNESSES", np.array([1e3, 1e8]))
    monkeypatch.setattr(diagram, "STIFF_STEPS", 2)
    for arguments in (["stiff"], ["5", "--epsilon", "0.056:0.058", "--kappa", "1e4"]):
        result = CliRunner().invoke(app, ["figure", *arguments, "--out", str(tmp_path), "--format", "png"])
        assert result.exit_code == 0, result.output
    assert {path.name for path in tmp_path.iterdir()} == {"stiff.png", "figure5.png"}
    assert min(path.stat().st_size for path in tmp_path.iterdir()) > 20_000
