"""map.png, map.svg and map.pdf: a map as it is looked at, and the page's links to it."""

import asyncio
import warnings
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from io import BytesIO
from typing import Any
from urllib.parse import parse_qs
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from anyio import to_process
from depth import deep
from fastapi import Request
from fastapi.testclient import TestClient
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import imread
from service_support import assert_problem, compute, front_end, front_of

import rattle
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.address import DrawnMapSettings, View
from gear_rattle.service.explorer.map.picture import picture_query
from gear_rattle.service.operations.crises import CrisisCurves
from gear_rattle.service.operations.overlaid import Overlays, PictureOptions
from gear_rattle.service.routes import picture
from gear_rattle.workers import ClusterLostError, SurveyError, SurveyRequest, open_survey
from gear_rattle.workers.pictures import maps
from gear_rattle.workers.pictures.look import OWN_STYLES, SHARE, FinerCells, MapPictureOptions, OverlayData
from gear_rattle.workers.pictures.maps import draw_map, render_map_picture
from gear_rattle.workers.pictures.overlay import draw_curves
from rattle.models import Capability

pytestmark = pytest.mark.usefixtures("templates_once")

ASKED = {
    "delta": {"start": 0.5, "stop": 0.8, "num": 7},
    "epsilon": {"start": 0.02, "stop": 0.2, "num": 10},
    "quantities": ["region", "orbits"],
}
WINDOW = {"delta_min": 0.61, "delta_max": 0.69, "epsilon_min": 0.05, "epsilon_max": 0.09}
LOOK = MapPictureOptions((0.61, 0.69), (0.05, 0.09))


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture(scope="module")
def survey_id(client: TestClient) -> str:
    """The id of a survey whose tiles are done."""
    found = str(client.post("/v1/surveys", json=ASKED | {"name": "of <pictures> $\\frac$ --"}).json()["id"])
    compute(front_of(client), found, SurveyRequest(**ASKED))
    return found


@pytest.fixture(scope="module")
def survey(client: TestClient, survey_id: str) -> xr.Dataset:
    with open_survey(front_of(client).directory.store(survey_id)) as dataset:
        return dataset.load()


def drawn(dataset: xr.Dataset, plane: xr.DataArray, look: MapPictureOptions) -> tuple[np.ndarray, object, Figure]:
    """Return the values and the scale of the cells of a map, and the figure."""
    figure = Figure()
    axes = figure.add_subplot()
    draw_map(axes, dataset, plane, look=look)
    mesh = axes.collections[-1]
    return np.ma.filled(mesh.get_array(), np.nan), mesh.norm, figure


def test_a_window_has_its_cells_and_those_around_them(survey: xr.Dataset) -> None:
    cut = LOOK.cut_to_window(survey)
    np.testing.assert_allclose(cut["delta"], [0.6, 0.65, 0.7])
    np.testing.assert_allclose(cut["epsilon"], [0.04, 0.06, 0.08, 0.1])
    values, _, figure = drawn(cut, cut["region"], LOOK)
    np.testing.assert_array_equal(values, rattle.regions(*np.meshgrid(cut["delta"], cut["epsilon"])))
    assert figure.axes[0].get_xlim() == LOOK.delta
    assert figure.axes[0].get_ylim() == LOOK.epsilon
    for beyond in ((0.4, 0.41), (0.9, 1.0), (0.601, 0.602)):  # without a cell inside: two, or they have no width
        assert MapPictureOptions(delta=beyond).cut_to_window(survey)["delta"].size == 2


@pytest.mark.parametrize("log", [False, True])
def test_colours_span_what_is_chosen(survey: xr.Dataset, log: bool) -> None:
    plane = survey["orbit_velocity"].isel(orbit=0)
    known = plane.values[np.isfinite(plane.values)]
    least, most = float(known.min()), float(known.max())
    for look, ends in (
        (MapPictureOptions(span=(2.0, 3.0), log=log), (2.0, 3.0)),
        (MapPictureOptions(span="full", log=log), (least, most)),
        (MapPictureOptions(span="robust", log=log), tuple(np.percentile(known, (2.0, 98.0)))),
    ):
        _, norm, _ = drawn(survey, plane, look)
        assert isinstance(norm, LogNorm) == log
        assert (norm.vmin, norm.vmax) == pytest.approx(ends)  # type: ignore[attr-defined]


def test_zeros_of_a_logarithmic_scale_are_told_apart(survey: xr.Dataset) -> None:
    plane = survey["orbit_velocity"].isel(orbit=0).copy()
    plane[0, :] = 0.0
    values, norm, figure = drawn(survey, plane, MapPictureOptions(log=True))
    assert np.isnan(values[0]).all()
    assert isinstance(norm, LogNorm)
    assert "zero or below" in figure.axes[0].get_legend_handles_labels()[1]


def test_lines_are_those_that_are_chosen(client: TestClient, survey_id: str, survey: xr.Dataset) -> None:
    axes = Figure().add_subplot()
    assert len(draw_curves(axes, survey, ("SN1", "points"))) == 1
    here = f"/v1/surveys/{survey_id}/map.png"
    pictures = [client.get(here, params={"lines": lines}) for lines in ("", "SN1", "SN1,points")]
    assert len({each.content for each in pictures}) == len({each.headers["etag"] for each in pictures}) == 3


def test_a_drawing_says_what_it_is(client: TestClient, survey_id: str) -> None:
    here = f"/v1/surveys/{survey_id}/map"
    answer = client.get(f"{here}.svg", params=WINDOW | {"caption": "true"})
    assert answer.headers["content-type"] == "image/svg+xml"
    assert ElementTree.fromstring(answer.content).tag == "{http://www.w3.org/2000/svg}svg"
    assert "<pictures>" not in answer.text
    for said in ("of &lt;pictures&gt;", "delta_min=0.61", f"gear-rattle {rattle.__version__}"):
        assert said in answer.text.replace("\n", ""), said
    plain = client.get(f"{here}.svg", params=WINDOW)
    assert rattle.__version__ not in plain.text.replace("\n", "")
    sheet, picture = (client.get(f"{here}.{form}", params=WINDOW) for form in ("pdf", "png"))
    assert sheet.headers["content-type"] == "application/pdf"
    assert sheet.content.startswith(b"%PDF-")
    assert len({each.headers["etag"] for each in (answer, plain, sheet, picture)}) == 4


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ({"delta_min": 0.5}, "query.delta_max"),
        ({"delta_min": 0.5, "delta_max": 0.5}, "query.delta_min"),
        ({"epsilon_min": 0.1, "epsilon_max": 0.1 + 1e-15}, "query.epsilon_min"),
        ({"low": 3, "high": 2}, "query.low"),
        ({"lines": "SN1,SN9"}, "query.lines"),
        ({"pixels_delta": 300}, "query.pixels_epsilon"),
        ({"pixels_delta": 4096, "pixels_epsilon": 4096}, "query.pixels_delta"),
        ({"lines": "design_limit", "share": 1}, "query.share"),
        ({"family": -1}, "query.family"),
        ({"low": 1e-200, "high": 1, "log": "true"}, "query.low"),
        ({"span": "wide"}, "query.span"),
        ({"delta_min": "nan", "delta_max": 1}, "query.delta_min"),
    ],
)
def test_looks_that_are_refused(client: TestClient, survey_id: str, query: dict[str, str], field: str) -> None:
    for form in ("png", "svg"):
        assert_problem(client.get(f"/v1/surveys/{survey_id}/map.{form}", params=query), 422, field)


@pytest.mark.parametrize(
    "query",
    [
        {"delta_min": -1e100, "delta_max": 1e100}, {"epsilon_min": 0.9e100, "epsilon_max": 1e100},
        {"delta_min": 0.6, "delta_max": 0.6 + 1e-9}, pytest.param({"delta_min": 0, "delta_max": 1e-99}, marks=deep),
        pytest.param({"variable": "orbit_velocity", "low": -1e100, "high": 1e100}, marks=deep),
        {"variable": "orbit_velocity", "low": 1e-100, "high": 1e100, "log": True},
        {"variable": "orbit_velocity", "low": -2, "high": -1, "log": True},
    ],
)  # fmt: skip
def test_extreme_looks_are_drawn(client: TestClient, survey_id: str, query: dict[str, float]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer = client.get(f"/v1/surveys/{survey_id}/map.png", params=query)
    assert answer.status_code == 200, answer.text
    assert imread(BytesIO(answer.content)).ndim == 3


def test_the_page_asks_for_the_view_as_it_is_seen(client: TestClient, survey_id: str) -> None:
    window = {"delta": (0.61, 0.69), "epsilon": (0.05, 0.09)}
    view = View(
        survey_id, "orbit_velocity", 2, limits=(0.5, 4.0), log=True, overlays=("SN1", "crisis", "points"), **window
    )
    query = picture_query(ASKED | {"beta": 0.6}, view)
    assert {name: value for name, (value,) in parse_qs(query).items()} == {
        **{name: str(value) for name, value in WINDOW.items()},
        **{"variable": "orbit_velocity", "index": "2", "low": "0.5", "high": "4.0", "log": "true"},
        **{"lines": "SN1,crisis,points", "caption": "true"},
    }
    seen = DrawnMapSettings((0.25, 8.0), False, (500, 400))
    asked = {name: value for name, (value,) in parse_qs(picture_query(ASKED, replace(view, family=2), seen)).items()}
    assert (asked["low"], asked["high"], asked.get("log")) == ("0.25", "8.0", None)
    assert (asked["pixels_delta"], asked["pixels_epsilon"], asked["family"]) == ("500", "400", "2")
    codes = parse_qs(
        picture_query(ASKED, replace(view, overlays=("design_limit",)), DrawnMapSettings(None, False, None))
    )
    assert codes["share"] == ["0.9"]
    assert not {"low", "high", "span", "pixels_delta"}.intersection(codes)
    query = picture_query(ASKED, replace(view, overlays=("SN1", "points")))
    assert client.get(f"/v1/surveys/{survey_id}/map.svg?{query}").status_code == 200
    assert parse_qs(picture_query(ASKED, View(survey_id, "region", limits="robust")))["span"] == ["robust"]


def test_what_was_found_beforehand_is_drawn(survey: xr.Dataset) -> None:
    crisis = np.array([[0.55, 0.1], [0.6, 0.12], [np.nan, np.nan], [0.7, 0.15], [0.75, 0.16]])
    limit = np.array([[0.5, 0.03], [0.8, 0.05]])
    band = np.array([0.5, 0.8]), np.array([0.02, 0.04]), np.array([0.04, 0.06])
    axes = Figure().add_subplot()
    names = ("crisis", "design_limit")
    drawn = draw_curves(axes, survey, names, OverlayData({"crisis": crisis, "design_limit": limit}, band))
    assert [each.shape for each in drawn] == [(5, 2), (2, 2)]
    for line, name, points in zip(axes.lines, names, (crisis, limit), strict=True):
        np.testing.assert_array_equal(np.column_stack(line.get_data()), points)
        assert (line.get_color(), line.get_label()) == (OWN_STYLES[name][0], name.replace("_", " "))
    (area,) = axes.collections
    assert area.get_datalim(axes.transData).extents == pytest.approx((0.5, 0.02, 0.8, 0.06))
    assert draw_curves(Figure().add_subplot(), survey, (), OverlayData({"crisis": crisis})) == []


def test_finer_cells_have_the_colours_of_the_map_and_of_codes_those_that_only_they_have(survey: xr.Dataset) -> None:
    delta, epsilon = np.linspace(0.61, 0.69, 40), np.linspace(0.05, 0.09, 30)
    exact = rattle.regions(delta, epsilon[:, None]).astype(float)
    exact[0, 0] = survey["region"].values.max() + 1
    figure = Figure()
    axes = figure.add_subplot()
    draw_map(axes, survey, survey["region"], look=LOOK, finer=FinerCells(delta, epsilon, exact))
    *_, coarse, fine = (each for each in axes.collections if each.get_array() is not None)
    np.testing.assert_array_equal(fine.get_array(), exact)
    assert fine.norm is coarse.norm
    assert fine.norm.vmin < exact[0, 0] < fine.norm.vmax
    assert (axes.get_xlim(), axes.get_ylim()) == (LOOK.delta, LOOK.epsilon)


@pytest.mark.parametrize("family", [0, pytest.param(1, marks=deep)])
def test_cells_without_the_family_that_is_chosen_are_dimmed(
    survey: xr.Dataset, family: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    share = np.zeros((2, *survey["region"].shape), np.float32)
    share[0, 2:4, 1], share[1, -1, -1] = 0.5, 1e-3
    shared = survey.assign({SHARE: (("family", "epsilon", "delta"), share)})
    covered: list[np.ndarray] = []
    cells = maps._draw_cells

    def seen(axes: Any, at: Any, values: np.ndarray, *rest: Any) -> Any:
        if isinstance(at, FinerCells):
            covered.append(values)
        return cells(axes, at, values, *rest)

    monkeypatch.setattr(maps, "_draw_cells", seen)
    assert render_map_picture(shared, "region", look=MapPictureOptions(family=family)) != render_map_picture(
        shared, "region"
    )
    np.testing.assert_array_equal(np.isnan(covered[0]), share[family] > 0)
    monkeypatch.setattr(maps, "MOST_DRAWN_CELLS", (5, 4))  # of cells that become one
    render_map_picture(shared, "region", look=MapPictureOptions(family=family))
    assert covered[1].size < covered[0].size
    assert np.isnan(covered[1]).any()
    with pytest.raises(SurveyError, match="from 0 to 1"):
        render_map_picture(shared, "region", look=MapPictureOptions(family=2))


def test_a_crisis_curve_is_computed_again_after_an_unexpected_error_only(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    crises, computed = CrisisCurves(front_of(client)), []
    expected = {0.6: [MemoryError("no memory"), np.array([[0.5, 0.1]])], 0.7: [rattle.RattleError("there is none")]}

    async def outcome(work: Any, **_: Any) -> np.ndarray:
        (beta,) = work.args
        computed.append(beta)
        found = expected[beta].pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    async def outcomes() -> list[str]:
        found = []
        for beta in (0.6, 0.6, 0.6, 0.7, 0.7):
            try:
                found.append(str((await crises.crisis_curve_of(rattle.models.Impacting(beta))).tolist()))
            except (MemoryError, rattle.RattleError) as error:
                found.append(str(error))
        return found

    monkeypatch.setattr(to_process, "run_sync", outcome)
    found = asyncio.run(outcomes())
    assert found == ["no memory", "[[0.5, 0.1]]", "[[0.5, 0.1]]", "there is none", "there is none"]
    assert computed == [0.6, 0.6, 0.7]


def test_lines_that_take_long_are_found_once_and_given_up_with_whoever_asked(
    client: TestClient, survey_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    overlaid = client.app.state.overlaid
    asked: list[Any] = []

    async def crisis(model: Any) -> np.ndarray:
        asked.append(model)
        if Capability.CRISIS in model.has:
            return np.array([[0.5, 0.1], [0.8, 0.12]])
        raise rattle.RattleError("there is none")

    async def along(*given: Any) -> AsyncIterator[Any]:
        asked.append(given)
        yield np.array([0.5, 0.8]), np.array([[0.04, np.nan], [0.03, np.nan], [0.05, np.nan]])

    monkeypatch.setattr(overlaid.crises, "crisis_curve_of", crisis)
    monkeypatch.setattr(overlaid.limits, "limits_over_damping", along)
    here = f"/v1/surveys/{survey_id}/map.svg"
    answers = [
        client.get(here, params={"lines": lines, "share": 0.75})
        for lines in ("", "crisis", "design_limit", "crisis,design_limit")
    ]
    assert [each.status_code for each in answers] == [200] * 4
    assert len({each.content for each in answers}) == 4
    for name, told in (("crisis", (False, True, False, True)), ("design_limit", (False, False, True, True))):
        colour = OWN_STYLES[name][0]
        assert tuple(f"stroke: {colour}" in each.text for each in answers) == told
    assert asked[1] == (rattle.models.Impacting(), (0.5, 0.8), 0.75)
    left = asyncio.Event()

    async def for_ever(_model: Any) -> np.ndarray:
        try:
            await asyncio.Event().wait()
        finally:
            left.set()
        raise AssertionError

    monkeypatch.setattr(overlaid.crises, "crisis_curve_of", for_ever)
    monkeypatch.setattr(picture, "DISCONNECT_CHECK_SECONDS", 0.01)
    monkeypatch.setattr(Request, "is_disconnected", gone)
    answer = client.get(here, params={"lines": "crisis"})
    assert_problem(answer, 503, code="unavailable")
    assert left.is_set()


async def gone(_request: Request) -> bool:
    """Pretend that the client has disconnected."""
    return True


@pytest.mark.parametrize("error", [SurveyError("too narrow"), ClusterLostError("no workers")])
def test_a_window_is_of_the_survey_s_cells_if_it_is_too_narrow_but_not_if_the_workers_are_lost(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, error: SurveyError
) -> None:
    async def fail(*_: object) -> None:
        raise error

    overlays = Overlays(front_of(client))
    monkeypatch.setattr(overlays.windows, "last_frame", fail)
    look = MapPictureOptions((0.6, 0.61), (0.1, 0.11), lines=())
    options = PictureOptions("region", 0, None, look, 0.5, (300, 300), False)
    found = overlays.compute_overlays(SurveyRequest(**ASKED), options)
    if isinstance(error, ClusterLostError):
        with pytest.raises(UnavailableError, match="workers were lost"):
            asyncio.run(found)
    else:
        assert asyncio.run(found).finer_cells is None
