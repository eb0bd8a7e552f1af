"""Pictures: every map of a survey, finished or not, and the three panels with the curves where they belong."""

import sys
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from depth import deep
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.text import Annotation, Text
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import (
    QUANTITIES,
    Axis,
    Group,
    SurveyError,
    SurveyRequest,
    create_store,
    open_survey,
    tiles_of,
)
from gear_rattle.workers.pictures.figure import survey_figure
from gear_rattle.workers.pictures.maps import WITHOUT_VALUE, colour_scale_of, render_map_picture
from rattle.plot.colours import REGION_COLOURS

REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.8, num=8),
    epsilon=Axis(start=0.02, stop=0.2, num=8),
    initial_conditions={"count": 2},
    tile={"delta": 4, "epsilon": 4},
)
EVERYTHING = REQUEST.model_copy(update={"quantities": tuple(Group)})
Pair = tuple[float, float]
MAPS = [quantity.name for quantity in QUANTITIES if quantity.is_per_cell]
#: Codes, phases, shares, exponents, numbers, and one that is whole.
USUAL = {"region", "attractor_kind", "attractor_phase", "quiet_fraction", "lyapunov_max", "sample_energy", "status"}
USUAL |= {"attractor_n_minus"}

pytestmark = pytest.mark.usefixtures("templates_once")


def survey(path: Path, request: SurveyRequest = REQUEST, tiles: slice = slice(None)) -> xr.Dataset:
    create_store(request, path)
    for tile in tiles_of(request)[tiles]:
        compute_and_write_tile(request, str(path), tile)
    return open_survey(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return survey(tmp_path_factory.mktemp("whole") / "survey.zarr").load()


@pytest.fixture(scope="module")
def partial(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return survey(tmp_path_factory.mktemp("partial") / "survey.zarr", EVERYTHING, tiles=slice(1, 2)).load()


def pixels(png: bytes) -> np.ndarray:
    return matplotlib.image.imread(BytesIO(png))


def lines(axes: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): line.get_xydata() for line in axes.get_lines() if len(line.get_xdata()) > 1}


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in USUAL else deep) for name in MAPS])
def test_every_map_of_a_running_survey_is_drawn(partial: xr.Dataset, name: str) -> None:
    picture = pixels(render_map_picture(partial, name))
    grey = np.all(np.isclose(picture[..., :3], 0.78, atol=0.005), axis=-1)
    assert 0.35 < grey.mean() < 0.7  # three of its four tiles are not computed


def test_an_empty_survey_is_drawn(tmp_path: Path) -> None:
    empty = survey(tmp_path / "survey.zarr", tiles=slice(0))
    assert render_map_picture(empty, "lyapunov_max").startswith(b"\x89PNG")
    assert len(survey_figure(empty).axes) == 6


def test_slots_are_drawn_by_index(whole: xr.Dataset) -> None:
    first, second = (pixels(render_map_picture(whole, "orbit_phase", index)) for index in (0, 2))
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("name", "index", "message"),
    [
        ("no_such", 0, "there are attractor_fraction"),
        ("quiet", 0, "did you mean quiet_fraction"),
        ("grazing_epsilon", 0, "no map"),
        ("delta", 0, "no map"),
        ("orbit_phase", 4, "from 0 to 3"),
        ("orbit_phase", -1, "from 0 to 3"),
        ("region", 1, "leave the index out"),
    ],
)
def test_what_is_no_map_is_refused(whole: xr.Dataset, name: str, index: int, message: str) -> None:
    with pytest.raises(SurveyError, match=message):
        render_map_picture(whole, name, index)


def test_figure_has_regions_curves_and_points(whole: xr.Dataset) -> None:
    panels = [axes for axes in survey_figure(whole).axes if axes.get_xlabel()]
    assert [axes.get_title() for axes in panels] == [
        "Regions",
        "Quiet fraction of the sample",
        "Largest Lyapunov exponent",
    ]
    curves = lines(panels[0])
    assert set(curves) == {"SN1", "SN2", "PD1", "G1", "G2", "PDC", "quiet limit"}  # PD2 is above this map
    assert [text.get_text() for text in panels[0].get_legend().get_texts()] == list(curves)
    g1 = curves["G1"][np.argsort(curves["G1"][:, 0])]
    assert np.interp(0.6, *g1.T) == pytest.approx(0.144452777, abs=1e-4)
    texts = {text.get_text() for text in panels[0].texts}
    assert texts == {"I", "II", "III", "IV", "V", "COD20", "COD21", "COD22", "COD23"}
    points = {text.get_text(): text.xy for text in panels[0].texts if isinstance(text, Annotation)}
    assert points["COD21"] == pytest.approx((0.759042986991, 0.095502531889), abs=1e-9)


def test_a_map_s_key_names_the_other_sets_of_orbits_that_are_there() -> None:
    codes = np.array([[1, 5, 14], [13, 13, 0]], np.int8)
    flags = {"flag_meanings": " ".join(("not_computed", *rattle.REGIONS[1:]))}
    plane = xr.DataArray(codes, dims=("epsilon", "delta"), name="region", attrs=flags)
    cmap, norm, ticks, labels = colour_scale_of(plane, codes[codes > 0])
    assert labels == ["I", "II", "III", "IV", "V", "BD", "ABD"]
    assert ticks is not None
    assert [to_hex(cmap(norm(code))) for code in ticks] == [REGION_COLOURS[int(code)] for code in ticks]
    assert len(REGION_COLOURS) == len(set(REGION_COLOURS)) == len(rattle.REGIONS)


def test_curves_end_where_their_orbits_do(whole: xr.Dataset) -> None:
    curves = lines(survey_figure(whole).axes[0])
    for name, last in (("SN1", 0.770147), ("SN2", 0.760121), ("PD1", 0.760121), ("PDC", 0.541770), ("G1", 0.770147)):
        drawn = curves[name][~np.isnan(curves[name][:, 1]), 0]
        assert drawn.max() == pytest.approx(last, abs=1e-3)


AXES = {"full": ((0.4, 1.0), (0.005, 0.3)), "Figure 8": ((0.74, 0.78), (0.092, 0.1)), "corner": ((0.75, 2), (0.0, 0.1))}


@pytest.mark.parametrize("beta", [0.6, pytest.param(0.45, marks=deep)])
@pytest.mark.parametrize(
    ("delta", "epsilon"),
    [pytest.param(*axes, id=name, marks=() if name == "full" else deep) for name, axes in AXES.items()],
)
def test_labels_do_not_overlap(tmp_path: Path, delta: Pair, epsilon: Pair, beta: float) -> None:
    axes = {
        "delta": Axis(start=delta[0], stop=delta[1], num=9),
        "epsilon": Axis(start=epsilon[0], stop=epsilon[1], num=8),
    }
    figure = survey_figure(survey(tmp_path / "survey.zarr", SurveyRequest(**axes, beta=beta, quantities=("region",))))
    figure.canvas.draw()
    panel = figure.axes[0]
    names = [Text.get_window_extent(text) for text in panel.texts if text.get_text().startswith("COD")]
    numbers = [Text.get_window_extent(text) for text in panel.texts if not text.get_text().startswith("COD")]
    for i, box in enumerate(names):
        assert panel.get_window_extent().contains(*box.min)
        assert panel.get_window_extent().contains(*box.max)
        assert not any(box.overlaps(other) for other in names[:i] + numbers)


def test_the_map_of_the_regions_has_the_curves_too(whole: xr.Dataset) -> None:
    def red(png: bytes) -> float:
        return float(np.all(np.isclose(pixels(png)[..., :3], (0.773, 0.106, 0.106), atol=0.01), axis=-1).mean())

    assert red(render_map_picture(whole, "region")) > 0.001 > red(render_map_picture(whole, "orbit_exists")) == 0


def test_curves_outside_the_map_are_left_out(tmp_path: Path) -> None:
    corner = {"delta": Axis(start=0.9, stop=1.0, num=4), "epsilon": Axis(start=0.01, stop=0.05, num=4)}
    request = SurveyRequest(**corner, quantities=("region",))
    (axes, _) = survey_figure(survey(tmp_path / "survey.zarr", request)).axes
    assert set(lines(axes)) == set()
    assert {text.get_text() for text in axes.texts} == {"I"}


@deep
def test_another_backlash_has_other_curves(tmp_path: Path, whole: xr.Dataset) -> None:
    request = REQUEST.model_copy(update={"beta": 0.5, "quantities": (Group.REGION,)})
    other = survey_figure(survey(tmp_path / "survey.zarr", request)).axes[0]
    tops = [lines(axes)["G1"][:, 1].max() for axes in (other, survey_figure(whole).axes[0])]
    assert tops[0] < tops[1] - 0.01
    assert all(text.get_text() != "COD22" or text.xy[0] < 0.7 for text in other.texts)


@pytest.mark.parametrize(("name", "panels"), [("region", 1), ("quiet_fraction", 1), ("lyapunov_max", 1)])
def test_missing_quantities_have_no_panel(whole: xr.Dataset, name: str, panels: int) -> None:
    figure = survey_figure(whole[[name, "status"]])
    assert len([axes for axes in figure.axes if axes.get_xlabel()]) == panels


def test_nothing_to_draw_says_so(whole: xr.Dataset) -> None:
    with pytest.raises(SurveyError, match="compute a survey with one of region"):
        survey_figure(whole[["status"]])


def test_drawing_in_threads_gives_the_same_pictures(whole: xr.Dataset) -> None:
    names = ["region", "lyapunov_max", "quiet_fraction"]
    alone = [render_map_picture(whole, name) for name in names]
    with ThreadPoolExecutor(3) as pool:
        assert list(pool.map(lambda name: render_map_picture(whole, name), names)) == alone


def test_no_global_drawing_state() -> None:
    assert "gear_rattle.workers.pictures.maps" in sys.modules
    assert "pyplot" not in vars(sys.modules["gear_rattle.workers.pictures.maps"])
    assert "plt" not in vars(sys.modules["gear_rattle.workers.pictures.figure"])


def test_colour_bars_say_what_they_measure(whole: xr.Dataset) -> None:
    bars = [axes for axes in survey_figure(whole).axes if not axes.get_xlabel()]
    assert [axes.get_ylabel() for axes in bars] == [
        "region",
        "quiet fraction, share of the sample",
        "lyapunov max, per forcing period",
    ]


def test_every_panel_has_ticks_and_only_quiet_is_one_word_everywhere(whole: xr.Dataset) -> None:
    figure = survey_figure(whole)
    figure.canvas.draw()
    panels = [axes for axes in figure.axes if axes.get_xlabel()]
    for axes in panels:
        assert axes.get_ylabel() == "eccentricity ε"
        assert any(label.get_text() and label.get_visible() for label in axes.get_yticklabels())
    shown = [text.get_text() for text in panels[2].get_legend().get_texts()]
    assert WITHOUT_VALUE["lyapunov_max"] in shown
    assert "none" not in shown


def test_an_opened_survey_draws_itself(whole: xr.Dataset) -> None:
    from gear_rattle import open_survey as opened  # registers the accessor

    assert callable(opened)
    figure = whole.rattle.plot()
    panel, bar = figure.axes
    assert [label.get_text() for label in bar.get_yticklabels()] == ["I", "II", "III", "IV", "V"]
    assert "SN1" in {text.get_text() for text in panel.get_legend().get_texts()}
    assert whole.rattle.plot("orbit_phase", 2).axes[1].get_ylabel() == "orbit phase, forcing periods"
    with pytest.raises(SurveyError, match="no map"):
        whole.rattle.plot("delta")
