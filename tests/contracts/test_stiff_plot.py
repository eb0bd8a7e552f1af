"""The picture of the stiff gear's limit shows what the library computes."""

import numpy as np
import pytest

from rattle.errors import ParameterError
from rattle.plot import stiff, stiff_figure


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
