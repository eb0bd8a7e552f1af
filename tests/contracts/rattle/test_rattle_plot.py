"""The paper's figures: what they show is what the library computes, named where it lies, whatever the parameters."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from depth import DEEP, deep, either
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from scipy.ndimage import distance_transform_edt
from typer.testing import CliRunner
from waiting import HANG

from gear_rattle.service.cli import app, main
from rattle import Attractor, Gear, ParameterError, attractors_of
from rattle.attractors.basins import Basins, flag_boundary_cells
from rattle.curves import codimension_two, trace
from rattle.impacting.orbits.period_one import regions as region_of
from rattle.orbits.orbits_a_to_d import PAPER_REGIONS, REGIONS
from rattle.plot import FIGURES, basins, colour, draw, legend_name, plane, save
from rattle.plot.colours import Palette
from rattle.plot.drawing import new_figure
from rattle.plot.paper_figures import ParameterForm, RangeArgument, parse_option, request
from rattle.plot.paper_ranges import FIGURE_7, FIGURE_8
from rattle.plot.plane import IN_PAPER, draw_curve, mark_codimension_two_points

CELLS = 120


@cache
def direct(epsilon: float) -> Basins:
    return Gear(0.6, epsilon).basins(CELLS, method="direct")


@pytest.fixture(scope="module")
def figure_4() -> Figure:
    return basins.panels(0.6, (0.0615, 0.089, 0.1), resolution=CELLS).figure


@pytest.fixture(scope="module")
def figure_6() -> Figure:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(basins, "ARCLENGTH", either(150.0, basins.ARCLENGTH))
        drawing = basins.draw_basins_with_manifolds(0.6, 0.1, resolution=CELLS)
    assert drawing.notes == ()
    return drawing.figure


@pytest.fixture(scope="module")
def figure_7() -> Figure:
    return draw(7).figure


@pytest.fixture(scope="module")
def figure_8() -> Figure:
    return draw(8).figure


def legend(figure: Figure) -> dict[str, tuple[float, ...]]:
    (found,) = figure.legends
    patches = zip(found.get_texts(), found.get_patches(), strict=False)  # the lines come last
    return {text.get_text(): to_rgb(patch.get_facecolor()) for text, patch in patches}


def texts(axes: Axes) -> dict[str, Text]:
    return {text.get_text(): text for text in axes.texts}


def lines(axes: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): line.get_xydata() for line in axes.get_lines() if len(line.get_xdata()) > 1}


# Colours


def test_quiet_is_the_yellow_of_the_map_of_the_quiet_fraction() -> None:
    assert colour("quiet") == to_hex(colormaps["viridis"](1.0)) == "#fde725"


def test_colours_are_those_of_the_paper() -> None:
    """Quiet is not, and P(4,4,2), yellow in the paper, has the dark blue that the paper has for quiet."""
    dark, light = np.array(to_rgb(colour((4, 4, 2)))), np.array(to_rgb(colour((1, 1, 0))))
    assert dark.argmax() == light.argmax() == 2
    assert dark.sum() < light.sum() - 1
    pale, deep = np.array(to_rgb(colour((1, 1, 1)))), np.array(to_rgb(colour((2, 2, 2))))
    assert (np.argsort(pale) == [2, 1, 0]).all()
    assert (np.argsort(deep) == [2, 1, 0]).all()
    assert deep.sum() < pale.sum()
    red, green, blue = to_rgb(colour("chaotic"))
    assert red > 0.8 > 0.2 > max(green, blue)
    assert np.ptp(to_rgb(colour("undecided"))) == 0


def test_the_types_of_a_picture_are_told_apart() -> None:
    rng, cells = np.random.default_rng(7), either(60, 150)
    delta, epsilon, beta = (
        rng.uniform(0.4, 1.0, cells),
        rng.uniform(0.03, 0.3, cells),
        rng.choice([0.3, 0.6, 1.2], cells),
    )
    found = attractors_of(delta, epsilon, beta, 64)
    several = 0
    for cell in range(cells):
        rows = np.flatnonzero((found.cell == cell) & (found.kind == 2))
        types = {(int(found.m[i]), int(found.n_plus[i]), int(found.n_minus[i])) for i in rows}
        palette = Palette()
        shades = np.array([to_rgb(palette.colour(each)) for each in (*sorted(types), "quiet", "chaotic", "undecided")])
        apart = np.hypot.reduce(shades[:, None] - shades, axis=2)
        assert apart[~np.eye(len(shades), dtype=bool)].min() > 0.15, types
        several += len(types) > 1
    assert several > 0.13 * cells


def test_many_types_of_one_picture_are_told_apart() -> None:
    """There are as many as at weak damping; the paper's motions have their own colours, and earlier colours stay."""
    rng = np.random.default_rng(3)
    types = [tuple(map(int, each)) for each in np.column_stack([rng.integers(1, high, 30) for high in (12, 30, 10)])]
    palette = Palette()
    shades = {each: palette.colour(each) for each in ("quiet", (1, 1, 0), (4, 4, 2), (8, 8, 6), *types)}
    assert all(shades[each] == colour(each) for each in ("quiet", (1, 1, 0), (4, 4, 2), (8, 8, 6)))
    assert all(palette.colour(each) == shade for each, shade in shades.items())
    assert sum(shades[each] != colour(each) for each in types) > 5
    rgb = np.array([to_rgb(shade) for shade in shades.values()])
    apart = np.abs(rgb[:, None] - rgb).max(axis=2) + np.eye(len(rgb))
    assert apart.min() > 0.08


def test_a_legend_names_the_largest_basins_of_many() -> None:
    figure = new_figure(4, 4)
    one = Attractor("periodic", 1, 1, 0, 0.5, (0.0, 1.0), 0.1, 1.0, (-1.0, -1.0), 0.0)
    many = [replace(one, n_plus=k, fraction=1 / k) for k in range(1, basins.MOST_NAMED + 4)]
    basins._add_basin_legend(figure, many, Palette(), [], 5)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[0] == "P(1,1,0)"
    assert names[-1] == "and 3 more"
    assert f"P(1,{basins.MOST_NAMED},0)" in names
    assert f"P(1,{basins.MOST_NAMED + 1},0)" not in names


def test_a_type_has_one_colour_and_one_name(figure_4: Figure, figure_6: Figure) -> None:
    for shown in (legend(figure_4), legend(figure_6)):
        for attractor in Gear(0.6, 0.1).attractors(64):
            assert shown[legend_name(attractor)] == to_rgb(colour(attractor))
    assert legend(figure_4)["P(1,1,0)"] == to_rgb(colour((1, 1, 0)))
    assert next(iter(legend(figure_4))) == "quiet"
    assert list(legend(figure_4))[-1] == "chaotic"


@pytest.mark.parametrize(
    "motion", ["none", "periodic", "", (1, 1), (0, 1, 0), (1, 0, 0), (1, 1, -1), (1, 1.5, 0), None, 4]
)
def test_what_is_no_motion_has_no_colour(motion: object) -> None:
    with pytest.raises(ParameterError):
        colour(motion)  # type: ignore[arg-type] # refused, that is the test


# Basins


def test_pixels_are_the_basins(figure_4: Figure) -> None:
    for axes, epsilon in zip(figure_4.axes, (0.0615, 0.089, 0.1), strict=True):
        expected = direct(epsilon)
        shades = np.array([to_rgb(colour(each)) for each in expected.attractors])
        (image,) = axes.get_images()
        assert np.abs(image.get_array() / 255 - shades[expected.labels]).max() < 0.002
        assert tuple(image.get_extent()) == (0, 1, 7, 0)
        assert (axes.get_xlim(), axes.get_ylim()) == ((0, 1), (7, 0))
        assert axes.get_title().endswith(f"ε = {epsilon:g}")


def test_gamma_is_where_flights_graze(figure_4: Figure) -> None:
    for axes, epsilon in zip(figure_4.axes, (0.0615, 0.089, 0.1), strict=True):
        (line,) = [each.get_xydata() for each in axes.get_lines()]
        inside = line[~np.isnan(line[:, 0]) & (line[:, 1] > 0.1)][5:-5:40]
        above, below = ([Gear(0.6, epsilon).impact(t, v + by).n_minus for t, v in inside] for by in (-0.01, 0.01))
        assert set(above) == {0}
        assert 0 not in below


def test_manifolds_encapsulate_the_basins(figure_6: Figure) -> None:
    axes = figure_6.axes[0]
    on = np.zeros((CELLS, CELLS), bool)
    for line in axes.get_lines():
        if line.get_color() in basins.MANIFOLDS.values():
            tau, v = line.get_xydata()[~np.isnan(line.get_xdata())].T
            inside = v < 7
            on[(v[inside] / 7 * CELLS).astype(int), (tau[inside] * CELLS).astype(int) % CELLS] = True
    edge = flag_boundary_cells(direct(0.1).labels)
    away = distance_transform_edt(~np.tile(on, 3))[:, CELLS : 2 * CELLS]
    assert away[edge].max() < 2.5  # cells
    assert (away[~edge] > 2.5).mean() > 0.5


def test_figure_6_is_labelled(figure_6: Figure) -> None:
    axes = figure_6.axes[0]
    figure_6.canvas.draw()
    written = texts(axes)
    symbols = {r"$\Delta_L$": "quiet", r"$\Delta_C$": "periodic", r"$\Delta_{Ch}$": "chaotic"}
    assert set(written) == {"A", "B", "C", "D", "$W^s(A)$", "$W^s(B)$", "Γ", *symbols}
    found = direct(0.1)
    for symbol, kind in symbols.items():
        tau, v = written[symbol].get_position()
        assert found.attractors[found.labels[int(v / 7 * CELLS), int(tau * CELLS)]].kind == kind
    for orbit in Gear(0.6, 0.1).orbits():
        assert written[orbit.name].xy == pytest.approx((orbit.tau, orbit.v))
    check_boxes(axes)


def check_boxes(axes: Axes) -> None:
    """Every text is inside the axes, and none covers another."""
    frame, boxes = axes.get_window_extent(), [Text.get_window_extent(text) for text in axes.texts]
    for i, box in enumerate(boxes):
        assert frame.contains(*box.min)
        assert frame.contains(*box.max)
        turned = axes.texts[i].get_rotation() % 90
        assert turned or not any(box.overlaps(other) for other in boxes[:i])


def test_lines_are_folded_at_the_sides() -> None:
    tau = np.linspace(-0.75, 1.55, 24)
    line = basins.fold_line_at_phase_ends(tau, 1.0 + tau, v_max=2.2)
    real = line[~np.isnan(line[:, 0])]
    assert np.isnan(line[:, 0]).sum() == 3
    assert ((real[:, 0] >= 0) & (real[:, 0] <= 1)).all()
    assert np.sort(real[np.isin(real[:, 0], (0.0, 1.0))], axis=0) == pytest.approx(
        np.array([[0, 1], [0, 1], [1, 2], [1, 2]])
    )
    assert real[:, 1].max() < 2.4
    assert np.abs(np.diff(line, axis=0)[~np.isnan(np.diff(line[:, 0]))]).max() < 0.11


@pytest.mark.parametrize(
    ("point", "missing", "basin"),
    [
        ((0.6, 0.05, 0.6), "A, B, C, D", "L"),  # nothing but quiet motion
        pytest.param((0.6, 0.25, 0.6), "B, C", "Ch", marks=deep),  # above the quiet limit
        ((0.6, 0.1, 1.2), "B, D", "C"),
        ((0.6, 5.0, 0.6), "A, B, C, D", "Ch"),
    ],
)
def test_what_does_not_exist_is_left_out_and_said(
    point: tuple[float, ...], missing: str, basin: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(basins, "ARCLENGTH", 20.0)
    delta, epsilon, beta = point
    drawing = basins.draw_basins_with_manifolds(delta, epsilon, beta, resolution=20)
    assert any(note.startswith(f"{missing} left out: ") for note in drawing.notes)
    assert any(basin in text for text in texts(drawing.figure.axes[0]) if "Delta" in text)
    names = {orbit.name for orbit in Gear(*point).orbits() if orbit.v < 7}
    assert names == {text for text in texts(drawing.figure.axes[0]) if text in "ABCD"}


# The plane


@pytest.mark.parametrize("number", [7, 8])
def test_curves_are_those_of_the_library(number: int, figure_7: Figure, figure_8: Figure) -> None:
    (axes,) = (figure_7 if number == 7 else figure_8).axes
    window = FIGURES[number].delta, FIGURES[number].epsilon
    assert (axes.get_xlim(), axes.get_ylim()) == window
    drawn = lines(axes)
    step = np.ptp(window, axis=1) / 300
    for name in IN_PAPER:
        points = drawn[name][~np.isnan(drawn[name][:, 0])]
        exact = trace(name, 0.6, *window)
        some = exact.delta[:: max(1, len(exact) // 20)]
        for delta in some:
            for epsilon in exact.at(delta):
                away = np.abs((points - [delta, epsilon]) / step).max(axis=1)
                assert away.min() < 3
                i = int(away.argmin())
                near = points[max(i - 3, 0) : i + 4]
                near = near[np.argsort(near[:, 0])]
                assert np.interp(delta, *near.T) == pytest.approx(epsilon, abs=0.3 * step[1])


def test_figure_7_is_labelled(figure_7: Figure) -> None:
    (axes,) = figure_7.axes
    figure_7.canvas.draw()
    written = texts(axes)
    assert set(written) >= {*IN_PAPER, "COD21", "COD22", "COD20", "COD23", "PDC", "PD2", "quiet limit", *PAPER_REGIONS}
    check_boxes(axes)
    for text in axes.texts:
        if text.get_text() in REGIONS:
            assert region_of(*text.get_position()) == REGIONS.index(text.get_text())
    assert sum(text.get_text() == "III" for text in axes.texts) == 2  # the second one above PD2


def test_labels_lie_at_their_curves(figure_7: Figure, figure_8: Figure) -> None:
    for (axes,) in (figure_7.axes, figure_8.axes):
        drawn = lines(axes)
        for name in IN_PAPER:
            pixels = axes.transData.transform(drawn[name][~np.isnan(drawn[name][:, 0])])
            box = Text.get_window_extent(texts(axes)[name])
            centre = (np.array(box.min) + box.max) / 2
            assert 5 < np.hypot(*(pixels - centre).T).min() < 30


def test_figure_8_is_labelled(figure_8: Figure) -> None:
    (axes,) = figure_8.axes
    figure_8.canvas.draw()
    assert set(texts(axes)) >= {*IN_PAPER, "COD21", "COD22", "COD23", *PAPER_REGIONS}
    check_boxes(axes)
    dashed = texts(axes)["Figure 9"]
    assert dashed is not None
    assert any(len(line) == 2 and (line[:, 0] == 0.762).all() for line in lines(axes).values())


@pytest.mark.parametrize(
    ("delta", "epsilon", "beta"),
    [
        pytest.param((0.4, 1.0), (0, 0.3), 0.3, marks=deep),
        ((0.78, 1.0), (0, 0.05), 0.6),
        pytest.param((0.1, 2.0), (0, 1), 1.2, marks=deep),
        pytest.param((0.4, 1.0), (0, 0.3), 3.0, marks=deep),
    ],
)
def test_other_planes_are_drawn(delta: RangeArgument, epsilon: RangeArgument, beta: float, tmp_path: Path) -> None:
    figure = plane.plane_figure(delta, epsilon, beta).figure
    (axes,) = figure.axes
    assert (axes.get_xlim(), axes.get_ylim()) == (delta, epsilon)
    for text in axes.texts:
        if text.get_text() in REGIONS and not hasattr(text, "xy"):
            assert region_of(*text.get_position(), beta) == REGIONS.index(text.get_text())
    assert "Figure 5" not in texts(axes) or beta == 0.6
    save(figure, tmp_path / "plane.svg")


# Parameters and the command


def test_options_are_numbers_or_a_range() -> None:
    assert parse_option("--delta", []) is None
    assert parse_option("--delta", ["0.1"]) == (0.1,)
    assert parse_option("--delta", ["0.1", "0.3"]) == (0.1, 0.3)
    assert parse_option("--delta", ["0.1:0.3"]) == RangeArgument(0.1, 0.3)
    for texts_ in (["x"], [""], ["1:2:3"], [":"], ["1:2", "3"], ["1:"]):
        with pytest.raises(ParameterError, match="--delta"):
            parse_option("--delta", texts_)


@pytest.mark.parametrize(
    ("number", "epsilon"),
    [
        (3, None),
        (10, None),
        (4, RangeArgument(0.05, 0.1)),
        (4, ()),
        (6, (0.1, 0.2)),
        (6, -0.1),
        (6, float("nan")),
        (7, 0.1),
        (7, (0.3, 0.1)),
        (8, (0.1, 0.2, 0.3)),
        (7, RangeArgument(0.1, float("inf"))),
        (6, "0.1"),
    ],
)
def test_other_parameters_are_refused(number: int, epsilon: object) -> None:
    with pytest.raises(ParameterError):
        request(number, epsilon=epsilon)  # type: ignore[arg-type] # refused, that is the test


def test_every_figure_takes_its_own_parameters() -> None:
    for number, figure in FIGURES.items():
        asked = request(number, figure.delta, figure.epsilon)
        assert (asked.delta, asked.epsilon, asked.beta) == (figure.delta, figure.epsilon, 0.6)
        assert isinstance(figure.delta_form, ParameterForm)


def test_the_command_writes_figures(tmp_path: Path) -> None:
    out = tmp_path / "new" / "figures"
    arguments = ["figure", "8", "--delta", "0.75:0.78", "--out", str(out), "--format", "pdf", "--format", "png"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert {path.name for path in out.iterdir()} == {"figure8.pdf", "figure8.png"}
    lines = result.output.splitlines()
    assert lines[0] == "Figure 8, the same curves around COD21 and COD22 …"  # before the first is computed
    assert str(out / "figure8.pdf") in result.output.replace("\n", "")
    assert (out / "figure8.pdf").read_bytes().startswith(b"%PDF")
    assert min(matplotlib.image.imread(out / "figure8.png").shape[:2]) > 1000
    if DEEP:
        first = (out / "figure8.pdf").read_bytes()
        CliRunner().invoke(app, arguments[:-2])
        assert (out / "figure8.pdf").read_bytes() == first


@pytest.mark.parametrize(
    "arguments",
    [
        ["3"],
        ["7", "3"],
        ["7", "store.zarr"],
        ["7", "--epsilon", "0.1"],
        ["6", "--epsilon", "0.05:0.1"],
        ["all", "--delta", "0.6"],
        ["4", "--delta", "x"],
        ["7", "--delta", "1:0.5"],
        ["4", "--beta", "-1"],
        ["7", "--format", "gif"],
        ["4", "--kappa", "1e4"],
        ["5", "--kappa", "-1"],
        ["stiff", "--kappa", "1e4"],
        ["stiff", "--epsilon", "0.05:0.1"],
        ["7", "--out", "FILE"],
        ["7", "--out", "FILE/below"],
        ["store.zarr", "--out", "FILE"],
        ["a.zarr", "b.png", "c"],
        ["no_such.zarr"],
    ],
)
def test_the_command_refuses(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "FILE").touch()
    monkeypatch.chdir(tmp_path)
    for request_ in ("FigureRequest", "StiffFigureRequest"):
        monkeypatch.setattr(f"rattle.plot.paper_figures.{request_}.draw", lambda _: pytest.fail("computed first"))
    monkeypatch.setattr(sys, "argv", ["rattle", "figure", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "Traceback" not in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["FILE"]


def test_matplotlib_is_an_extra() -> None:
    code = """
import sys
import rattle
assert "matplotlib" not in sys.modules
sys.modules["matplotlib"] = None
try:
    import rattle.plot
except rattle.RattleError as error:
    assert "gear-rattle[plot]" in str(error) and isinstance(error, ImportError)
    del sys.modules["matplotlib"]
    import rattle.plot
    assert "matplotlib.pyplot" not in sys.modules
else:
    raise SystemExit("matplotlib was not needed")
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=HANG)


@pytest.mark.parametrize("window", [FIGURE_7, FIGURE_8, ((0.5, 0.8), (0.05, 0.2))], ids=["7", "8", "between"])
@pytest.mark.parametrize("size", [(3.5, 2.8), (6.8, 5.2), (10.0, 7.0)], ids=["small", "usual", "large"])
def test_names_of_points_cover_no_marker_and_no_other_name(
    window: tuple[RangeArgument, RangeArgument], size: RangeArgument
) -> None:
    figure = new_figure(*size)
    axes = figure.add_subplot(xlim=window[0], ylim=window[1])
    with np.errstate(all="ignore"):
        lines = [draw_curve(axes, trace(name, 0.6, *window)) for name in IN_PAPER]
        points = codimension_two(0.6)
    axes.set(xlim=window[0], ylim=window[1])
    labels = mark_codimension_two_points(axes, points, lines)
    assert labels is not None
    figure.set_layout_engine("none")
    inside = [
        (each.delta, each.epsilon)
        for each in points
        if all(low <= at <= high for at, (low, high) in zip((each.delta, each.epsilon), window, strict=True))
    ]
    names = [Text.get_window_extent(text, labels.renderer) for text in axes.texts]
    assert len(names) == len(inside) >= 3
    half = labels.renderer.points_to_pixels(2.25)
    for number, name in enumerate(names):
        for mark in inside:
            x, y = axes.transData.transform(mark)
            assert x + half <= name.x0 or name.x1 <= x - half or y + half <= name.y0 or name.y1 <= y - half
        assert not any(name.overlaps(other) for other in names[:number])
