"""`rattle diagram`, and what pictures of diagrams and branches say, against the library's own numbers."""

import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import rattle
from gear_rattle.service.cli import app
from rattle.errors import ParameterError
from rattle.plot import branch_figure
from rattle.plot.diagram import _note_on_omitted_branches
from rattle.stiff import StiffGear, stiff_branch


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["diagram", *arguments])
    return result.exit_code, result.output


def test_events_are_named_and_where_the_library_has_them(tmp_path: Path) -> None:
    out = tmp_path / "diagram.png"
    code, said = run("--delta", "0.6", "--epsilon", "0.055:0.062", "--steps", "4", "--count", "8", "--figure", str(out))
    assert code == 0, said
    rows = [re.split(r" {2,}", line.strip()) for line in said.splitlines() if "saddle-node" in line]
    (first,) = [row for row in rows if row[1] == "SN1"]
    assert first[2] == "P(1, 1, 0)"
    assert float(first[3]) == 0.6
    assert float(first[4]) == pytest.approx(float(rattle.sn1(0.6)), abs=1e-9)
    assert re.search(r"^\d+ branches, \d+ events$", said, re.MULTILINE)
    assert np.ptp(matplotlib.image.imread(out)[..., :3]) > 0.5


def test_a_line_along_delta_and_of_the_stiff_gear() -> None:
    code, said = run("--epsilon", "0.06", "--delta", "0.595:0.605", "--steps", "2", "--count", "4", "--kappa", "1e5")
    assert code == 0, said
    assert re.search(r"^\d+ branches", said, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--delta", "0.6", "--epsilon", "0.1"), "must be a range"),
        (("--delta", "0.6", "--epsilon", "a:b"), "neither a number nor"),
        (("--delta", "0.6:0.7:0.8", "--epsilon", "0.1"), "neither a number nor"),
        (("--delta", "0.6", "--epsilon", "0.1:0.11", "--figure", "x.txtt"), "The format of the picture"),
        (("--delta", "-0.6:0.5", "--epsilon", "0.1"), "must be"),
    ],
)
def test_what_is_no_line_is_refused(arguments: tuple[str, ...], message: str) -> None:
    result = CliRunner().invoke(app, ["diagram", *arguments])
    assert result.exit_code != 0
    assert message in (result.output + str(result.exception)).replace("\n", " ")


@pytest.fixture(scope="module")
def branch() -> rattle.Branch:
    return rattle.branch(rattle.Gear(0.6, 0.07).orbits()[-1], "epsilon", (0.06, 0.08), resolution=12)


def entries(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_branch_draws_itself(branch: rattle.Branch) -> None:
    figure = branch.plot()
    upper, lower = figure.axes
    texts = {text.get_text() for text in upper.texts}
    assert {"SN2", "PD1", "B", "D"} <= texts
    assert upper.get_title() == "δ = 0.6, β = 0.6"
    assert lower.get_xlabel().startswith("eccentricity")
    x, v = np.concatenate([np.column_stack(line.get_data()) for line in upper.lines]).T
    for k in np.flatnonzero(branch.admissible):
        assert np.hypot(x - branch.epsilon[k], v - branch.speeds[k, 0]).min() < 1e-9
    assert upper.get_xlim()[0] < branch.epsilon.min() < branch.epsilon.max() < upper.get_xlim()[1]
    assert not any("followed" in entry for entry in entries(figure))


def test_a_branch_of_the_stiff_gear_draws_itself_along_its_stiffness() -> None:
    orbit = StiffGear(0.6, 0.089).orbits()[-1]
    figure = stiff_branch(orbit, "kappa", (5e3, 2e4), resolution=6).plot()
    assert figure.axes[1].get_xlabel().startswith("softness")
    assert figure.axes[0].get_title() == "δ = 0.6, ε = 0.089, β = 0.6"
    assert figure.axes[0].lines


def test_what_is_no_branch_is_refused() -> None:
    with pytest.raises(ParameterError, match="must be a Branch"):
        branch_figure(3)


def test_a_diagram_draws_itself_and_its_legend_names_every_mark() -> None:
    found = rattle.diagram((0.6, 0.058), (0.6, 0.062), steps=2, count=8, impacts=2, most=3)
    names = entries(found.plot())
    for word in ("A to D, stable", "other motions, unstable", "saddle-node", "flip", "graze", "forward", "backward"):
        assert any(word in name for name in names), word


def test_branches_left_out_are_one_line() -> None:
    found = rattle.diagram((0.6, 0.08), (0.6, 0.09), steps=6, count=32, impacts=2, most=3)
    assert len(found.left_out) > 4
    (note,) = _note_on_omitted_branches(found)
    assert note.startswith(f"{len(found.left_out)} branches left out")
    assert note.endswith(f"and {len(found.left_out) - 4} more")
    assert len(note) < 120
