"""The picture of a bifurcation diagram shows what the diagram has, and nothing that does not happen."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from depth import deep
from matplotlib.collections import PathCollection

import rattle
from rattle.plot import diagram_figure


@cache
def pictured():
    found = rattle.diagram((0.6, 0.055), (0.6, 0.08), steps=25)
    return found, diagram_figure(found, (3.7, 4.7), (0.4, 1.0))


def test_both_panels_name_branches_and_events():
    found, figure = pictured()
    upper, lower = figure.axes
    assert upper.get_ylim() == (3.7, 4.7)
    assert lower.get_ylim() == (0.4, 1.0)
    assert upper.get_xlim() == lower.get_xlim() == (0.055, 0.08)
    texts = [{text.get_text() for text in panel.texts} for panel in (upper, lower)]
    assert texts[0] == {"(a)", "A, C", "B", "D", "SN1", "SN2", "PD1"}
    assert texts[1] == {"(b)", "A", "B", "C", "D", "SN1", "SN2", "PD1"}
    assert len(found.events) >= 3


def test_solid_is_stable_and_dashed_is_not():
    """In phase at ε = 0.07, A–D by their closed forms; nothing is drawn before SN1."""
    _, figure = pictured()
    orbits = rattle.Gear(0.6, 0.07).orbits()
    assert len(orbits) == 4
    drawn = []
    for line in figure.axes[1].lines:
        x, y = (np.asarray(part) for part in line.get_data())
        assert x.min() >= rattle.sn1(0.6) - 1e-12
        for k in np.flatnonzero((x[:-1] - 0.07) * (x[1:] - 0.07) <= 0):
            share = (0.07 - x[k]) / (x[k + 1] - x[k])
            drawn.append((y[k] + share * (y[k + 1] - y[k]), line.get_linestyle() == "-"))
    for orbit in orbits:
        tau, stable = min(drawn, key=lambda each: abs(each[0] - orbit.tau))
        assert abs(tau - orbit.tau) < 2e-3
        assert stable == orbit.stable


def test_both_directions_are_drawn_rasterized():
    found, figure = pictured()
    for panel in figure.axes:
        sweeps = [each for each in panel.collections if isinstance(each, PathCollection) and each.get_rasterized()]
        assert len({tuple(each.get_facecolor()[0]) for each in sweeps if len(each.get_offsets())}) == 2
        assert sum(len(each.get_offsets()) for each in sweeps) == found.points.tau.size


@pytest.mark.parametrize("end", [(0.62, 0.075), pytest.param((0.62, 0.06), marks=deep)], ids=["slanted", "along delta"])
def test_other_segments_and_limits_found(end, tmp_path):
    found = rattle.diagram((0.6, 0.06), end, steps=10, impacts=2)
    figure = diagram_figure(found)
    assert figure.axes[0].get_ylim()[1] > found.points.v.max(initial=0.0)
    figure.savefig(tmp_path / "diagram.png")
    assert (tmp_path / "diagram.png").stat().st_size > 10_000


def test_a_quiet_diagram_is_an_empty_picture():
    figure = diagram_figure(rattle.diagram((0.6, 0.0), (0.6, 0.04), steps=2))
    assert not figure.axes[0].lines


def test_without_limits_the_phase_panel_shows_all_phases():
    figure = diagram_figure(rattle.diagram((0.6, 0.0), (0.6, 0.04), steps=2), tau=None)
    assert figure.axes[1].get_ylim() == (0.0, 1.0)


def test_what_is_no_diagram_is_refused():
    with pytest.raises(rattle.ParameterError, match="must be a Diagram"):
        diagram_figure(3)


def test_a_diagram_needs_no_matplotlib():
    code = "import sys, rattle; rattle.diagram; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
