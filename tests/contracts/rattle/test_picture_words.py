"""Pictures say what their axes, colours, lines and marks are; the colours of Figure 4 are told apart."""

from itertools import combinations

import numpy as np
import pytest
from colour_difference import difference, lab_of
from matplotlib.axes import Axes

from rattle.curves import codimension_two, trace
from rattle.plot import FIGURES, basins, colour, draw, plane
from rattle.plot.areas import areas_figure

TYPES = ((1, 1, 0), (1, 1, 1), (2, 2, 1), (2, 2, 2), (3, 3, 2), (3, 3, 3), (4, 4, 2), (5, 5, 2), (8, 8, 6))
FIGURE_4 = ("quiet", "chaotic", *TYPES)
APART, APART_WITHOUT_GREEN = 20.0, 8.0  # CIEDE2000


def test_the_types_of_figure_4_are_told_apart() -> None:
    for one, other in combinations(FIGURE_4, 2):
        colours = colour(one), colour(other)
        for least, seen in (
            (APART, [lab_of(each, np.eye(3)) for each in colours]),
            (APART_WITHOUT_GREEN, [*map(lab_of, colours)]),
        ):
            assert difference(*seen) > least, (one, other)


def test_basins_say_the_damping_and_which_way_the_speed_goes() -> None:
    figure = basins.panels(0.6, (0.0615, 0.089), resolution=20).figure
    assert figure.get_suptitle() == "damping δ = 0.6, half-backlash β = 0.6"
    first, second = figure.axes
    assert first.get_ylabel() == "impact speed v, downwards"
    assert first.yaxis_inverted()
    assert len(first.get_yticks()) > 2
    assert len(second.get_yticks()) == len(first.get_yticks())
    assert {axes.get_xlabel() for axes in figure.axes} == {"impact phase τ"}


def test_figure_6_names_its_marks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(basins, "ARCLENGTH", 20.0)
    figure = basins.draw_basins_with_manifolds(0.6, 0.1, resolution=20).figure
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"saddle", "attractor", "grazing curve Γ"} <= set(names)
    (axes,) = figure.axes
    assert axes.get_ylabel() == "impact speed v, downwards"
    assert axes.get_title() == "damping δ = 0.6, eccentricity ε = 0.1, half-backlash β = 0.6"


def inset_of(axes: Axes) -> Axes | None:
    return next((child for child in axes.child_axes if isinstance(child, Axes)), None)


def test_the_inset_of_figure_8_is_the_distance_from_sn2() -> None:
    (axes,) = draw(8).figure.axes
    inset = inset_of(axes)
    assert inset is not None
    assert inset.get_yscale() == "log"
    window = FIGURES[8].delta, FIGURES[8].epsilon
    base = trace("SN2", 0.6, *window)
    drawn = {line.get_label(): np.asarray(line.get_xydata()) for line in inset.get_lines()}
    for name in ("PD1", "G1"):
        curve = trace(name, 0.6, *window)
        for delta, above in drawn[name][::10]:
            assert above == pytest.approx(curve.at(delta)[0] - base.at(delta)[0], rel=1e-6, abs=1e-13)
            assert above > 0
    assert {"COD21", "COD23", "G1", "PD1"} == {text.get_text() for text in inset.texts}
    points = {point.name: point for point in codimension_two(0.6)}
    assert inset.get_xlim()[0] < points["COD21"].delta < points["COD23"].delta < inset.get_xlim()[1]


def test_no_inset_where_the_points_are_not_seen() -> None:
    for window in (((0.4, 0.7), (0.0, 0.3)), ((0.9, 1.0), (0.0, 0.3))):
        (axes,) = plane.plane_figure(*window).figure.axes
        assert inset_of(axes) is None
        assert axes.get_title() == "half-backlash β = 0.6"


def test_what_is_not_proved_is_in_the_key() -> None:
    figure = areas_figure([], (0.4, 1.0), (0.0, 0.3)).figure
    for axes in figure.axes:
        assert "not proved" in {text.get_text() for text in axes.get_legend().get_texts()}
