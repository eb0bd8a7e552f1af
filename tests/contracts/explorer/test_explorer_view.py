"""The map of a page without a browser: what it shows of one survey after another."""

import asyncio
import re
import sqlite3
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
import pytest
import xarray as xr
from bokeh.document import Document
from param.parameterized import batch_call_watchers
from service_support import BODY, IN_A_THREAD, compute, no_cluster, points_in
from waiting import eventually

import rattle
from gear_rattle.service.access.keys import Caller
from gear_rattle.service.app import create_app
from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.address import EXAMPLE, KEYBOARD, EnteredMachine, Pair, View
from gear_rattle.service.explorer.common.news import JobStatus, StatusPublisher
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.common.viewer import PageSession
from gear_rattle.service.explorer.design.go_to import NavigationPanel
from gear_rattle.service.explorer.files import help_html
from gear_rattle.service.explorer.map import shared as map_shared
from gear_rattle.service.explorer.map import view as map_view
from gear_rattle.service.explorer.map.beside import PanelBesideMap
from gear_rattle.service.explorer.map.colouring import Colouring, compute_colouring
from gear_rattle.service.explorer.map.controls import FEATURED, MapControls
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import legend_entries_of_map
from gear_rattle.service.explorer.map.planes import ENLARGED_POINTS, MapCache, MapPlane, map_names_by_variable
from gear_rattle.service.explorer.map.readout import cell_position
from gear_rattle.service.explorer.map.shared import SharedState, default_variable, is_closed_form_map
from gear_rattle.service.explorer.map.survey_map import map_block_of_frame
from gear_rattle.service.explorer.map.view import MapView
from gear_rattle.service.explorer.page.rows import example_row, survey_row
from gear_rattle.service.explorer.places.exact import ClosedFormPlane, ExactMaps
from gear_rattle.service.explorer.point.panel import FigureBelowDiagram
from gear_rattle.service.explorer.state.events import (
    BookmarkChosen,
    PointClosed,
    PointerMoved,
    PointOpened,
    SurveyChosen,
    WindowMoved,
    WindowReset,
)
from gear_rattle.service.explorer.state.store import PageStore
from gear_rattle.service.operations.surveys import submit_survey
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest, WindowFrame, open_survey
from rattle.models import Impacting, Stiff

pytestmark = pytest.mark.usefixtures("templates_once")

REGIONS = SurveyRequest(**BODY | {"quantities": ["region"]})
STIFF = SurveyRequest(
    **BODY | {
        "model": "stiff", "kappa": 1e4, "quantities": ["region"],
        "delta": {"start": 0.8, "stop": 0.9, "num": 6},
    }
)  # fmt: skip


class Here(PageSession):
    """A viewer whose document nobody sees: changes are made at once."""

    def schedule_document_change(self, what: Callable[[], object]) -> None:
        what()


class Shown:
    """The map of a page, with its controls and the open point, as the page has them around its store."""

    def __init__(self, shared: SharedState, viewer: PageSession, view: View) -> None:
        self.shared, self.viewer = shared, viewer
        self.store = store = PageStore(view, shared.exact.request)
        self.map = MapFigure("light", store.dispatch)
        self.panel = MapView(shared, viewer, store, self.map, "")
        self.controls = MapControls(shared, store, "")
        self.go_to = NavigationPanel(store, "")
        self.beside = PanelBesideMap(
            shared, viewer, store, "light", FigureBelowDiagram(), self.go_to.panel, self.panel.readout.pane
        )
        self.title, self.said, self.readout = self.panel.title, self.panel.said, self.panel.readout
        self.lines, self.keys = self.panel.lines, self.panel.keys

    @property
    def view(self) -> View:
        return self.store.view

    @property
    def plane(self) -> MapPlane | None:
        return self.panel.plane

    @property
    def colours(self) -> Colouring | None:
        return self.panel.colours

    def follow(self, job: JobRow | None) -> None:
        """What news of this survey does; None: there is none of it any more."""
        status = {} if job is None else {job.id: JobStatus(job, None, None)}
        gone = self.view.survey if job is None else ""
        self.store.update_surveys({name: each for name, each in {**self.store.jobs, **status}.items() if name != gone})

    def choose(self, job: JobRow, is_new: bool = False) -> None:
        self.store.dispatch(SurveyChosen(job.id, is_new))
        self.follow(job)

    def hover(self, delta: float, epsilon: float) -> None:
        self.store.dispatch(PointerMoved((delta, epsilon), "map"))

    def moved(self, delta: Pair, epsilon: Pair) -> None:
        self.store.dispatch(WindowMoved((delta, epsilon)))

    def reset(self) -> None:
        self.store.dispatch(WindowReset())

    def open(self, at: Pair, machine: EnteredMachine | None = None) -> None:
        self.store.dispatch(PointOpened(at, machine))

    def change_point(self, state: PointTabsState) -> None:
        assert self.view.point is not None
        self.store.dispatch(PointOpened(self.view.point, self.view.machine, state))

    def close(self) -> None:
        self.store.dispatch(PointClosed())


def with_map(
    data: Path,
    body: Callable[[ApplicationState, Shown], Awaitable[None]],
    looked: Callable[[], None] = lambda: None,
    **view: Any,
) -> None:
    """Do this with the map of a page."""

    async def main() -> None:
        app = create_app(Settings(data=data, preload=False), no_cluster)
        async with app.router.lifespan_context(app):
            front: ApplicationState = app.state.front
            shared = SharedState(
                front, StatusPublisher(front), MapCache(front), app.state.overlaid, ExactMaps(), looked
            )
            viewer = Here(front, Caller(), Document())
            shown = Shown(shared, viewer, View(is_variable_chosen="variable" in view, **{"overlays": ()} | view))
            viewer.document.add_root(shown.map.figure)
            await body(front, shown)
            viewer.end()

    asyncio.run(main())


def accepted(front: ApplicationState, request: SurveyRequest) -> JobRow:
    """A survey that waits."""
    return submit_survey(front, Caller(), request, force=True)


def done(front: ApplicationState, request: SurveyRequest) -> JobRow:
    """A survey that is done."""
    survey_id = accepted(front, request).id
    compute(front, survey_id, request)
    front.database.set_state(survey_id, State.SUCCESSFUL)
    return front.database.job(survey_id)


def cells(shown: Shown) -> int:
    """How many images the map has."""
    return len(shown.map.figure.select_one({"name": "cells0"}).data_source.data["image"])


async def choose_with_lines(shown: Shown, job: JobRow) -> None:
    """Choose a survey that is done, and draw a line and a point over it."""
    shown.choose(job)
    await eventually(lambda: cells(shown))
    shown.map.draw_line("SN1", [np.array([[0.5, 0.1], [0.6, 0.2]])])
    shown.map.mark_points([("COD22", 0.77, 0.09)])
    shown.hover(0.6, 0.1)
    await eventually(lambda: "Cell at" in shown.readout.html)


def assert_nothing_of_another(shown: Shown) -> None:
    """There are no cells, lines, key or reading."""
    figure = shown.map.figure
    assert cells(shown) == 0
    assert figure.select_one({"name": "SN1"}).data_source.data["xs"] == []
    assert figure.select_one({"name": "points"}).data_source.data["x"] == []
    assert shown.lines.key.shades == []
    assert "Cell at" not in shown.readout.html


@pytest.mark.parametrize("is_there", [True, False])
def test_what_the_first_page_shows_is_found_before_anybody_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_there: bool
) -> None:
    drawn, lines, looked = list[Any](), list[Any](), list[bool]()
    monkeypatch.setattr(map_shared, "compute_colouring", lambda *args: drawn.append(args) or compute_colouring(*args))
    monkeypatch.setattr(map_shared, "cache_default_lines", lambda *args: lines.append(args))

    async def ready(*_: Any, **__: Any) -> None:
        """Kernels, which are not what is waited for here."""

    async def body(front: ApplicationState, shown: Shown) -> None:
        monkeypatch.setattr(front.kernels, "wait_until_compiled", ready)
        job = done(front, REGIONS) if is_there else None
        await shown.shared.compute_default_map()
        assert len(drawn) == 1
        assert not looked  # and no processes are started for whoever may click
        if job:
            shown.choose(job)
        else:
            shown.follow(None)
        await eventually(lambda: cells(shown))
        assert looked
        assert lines == [(shown.store.model, shown.store.window)]
        assert len(drawn) == (1 if job else 2)

    with_map(tmp_path, body, lambda: looked.append(True))


@pytest.mark.parametrize("request_in_database", [None, '{"delta": 1}', "{"])
def test_what_is_damaged_or_gone_is_no_hindrance_beforehand(tmp_path: Path, request_in_database: str | None) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        survey_id = accepted(front, REGIONS).id
        front.database.set_state(survey_id, State.RUNNING)
        front.database.set_state(survey_id, State.SUCCESSFUL)  # its numbers are gone
        if request_in_database:
            with sqlite3.connect(tmp_path / "jobs.sqlite") as database:
                database.execute("UPDATE jobs SET request = ?", [request_in_database])
        await shown.shared.compute_default_map()

    with_map(tmp_path, body)


def test_a_survey_without_numbers_is_not_shown_with_those_of_the_one_before(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        await choose_with_lines(shown, done(front, REGIONS))
        assert shown.lines.key.shades
        shown.choose(accepted(front, STIFF))
        await eventually(lambda: "waits for its turn" in shown.title.html)
        assert_nothing_of_another(shown)
        assert shown.store.model == Stiff(0.6, 1e4)  # of which a click is
        assert shown.map.figure.x_range.start > 0.75
        assert shown.lines.key.overlays[0]["meaning"] == Stiff(0.6, 1e4).describe("SN1")
        names = [each["name"] for each in shown.lines.key.overlays]
        assert names == [*Stiff(0.6, 1e4).curve_names, "design_limit"]  # no crisis and no points, which it has not

    with_map(tmp_path, body)


def test_a_survey_that_is_gone_leaves_nothing_of_it(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        await choose_with_lines(shown, done(front, REGIONS))
        shown.follow(None)
        assert "no longer there" in shown.title.html
        assert_nothing_of_another(shown)
        assert shown.store.model == Impacting()

    with_map(tmp_path, body)


ORBITS = SurveyRequest(**BODY | {"quantities": ["region", "orbits"]})


def test_an_address_of_a_survey_that_is_not_there_is_said_to_be_one(tmp_path: Path) -> None:
    async def body(_front: ApplicationState, shown: Shown) -> None:
        shown.follow(None)
        assert "no longer there" in shown.title.html

    with_map(tmp_path, body, survey="nothing")


def test_the_scale_of_own_limits_is_switched_and_wrong_limits_are_told(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        controls = shown.controls

        async def drawn(limits: Pair, log: bool) -> None:
            await eventually(lambda: shown.colours is not None and shown.colours.log == log)
            await eventually(lambda: shown.view.limits == pytest.approx(limits))
            assert shown.view.log == log
            assert (controls.low.value, controls.high.value) == pytest.approx(limits)

        shown.choose(done(front, ORBITS))
        await drawn((1.5, 5.0), log=False)
        controls.log.value = ["log scale"]
        await drawn((1.5, 5.0), log=True)
        controls.log.value = []
        await drawn((1.5, 5.0), log=False)
        controls.low.value = 7.0
        assert "7 to 5: the first limit must be below the second" in controls.wrong.html
        controls.low.value = -1.0
        await drawn((-1.0, 5.0), log=False)
        assert "must be" not in controls.wrong.html
        controls.log.value = ["log scale"]
        values = shown.plane.block().values  # type: ignore[union-attr] # it is there
        await drawn((float(np.nanmin(values)), 5.0), log=True)
        controls.high.value = -0.5
        controls.low.value = -1.0
        assert "above 0" in controls.wrong.html
        assert shown.view.limits[1] == 5.0

    with_map(tmp_path, body, variable="orbit_velocity", limits=(1.5, 5.0))


def test_a_page_that_opens_in_a_deep_window_is_not_white(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, REGIONS))
        await eventually(lambda: cells(shown))
        figure = shown.map.figure
        await eventually(lambda: figure.select_one({"name": "fine0"}).data_source.data["image"])
        (image,) = figure.select_one({"name": "fine0"}).data_source.data["image"]
        assert image.shape == (ENLARGED_POINTS, ENLARGED_POINTS)
        assert np.isfinite(image).all()
        assert not figure.select_one({"name": "cells0"}).visible  # browsers would misplace cells so large

    with_map(tmp_path, body, delta=(0.6, 0.6 + 1e-6), epsilon=(0.1, 0.1 + 1e-6))


def test_a_deep_window_is_read_counted_and_never_white(tmp_path: Path) -> None:
    delta, epsilon = 0.6 + 0.3 * 0.04, 0.1 - 0.4 * 0.1 / 3  # within a cell, and away from its centre

    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, REGIONS))
        await eventually(lambda: cells(shown) and shown.plane is not None)
        plane, figure = shown.plane, shown.map.figure
        assert plane is not None
        at = plane.value_and_status(delta, epsilon)
        assert at is not None
        window = (delta - 1e-9, delta + 1e-9), (epsilon - 1e-9, epsilon + 1e-9)
        shown.moved(*window)
        fine = figure.select_one({"name": "fine0"}).data_source.data
        assert (fine["image"][0] == at[0]).all()  # as the survey has it, until the workers answer
        assert (fine["x"][0], fine["dw"][0]) == (window[0][0], pytest.approx(2e-9))
        code = rattle.REGIONS[int(at[0])]

        def shares() -> dict[str, float]:
            return {each["label"]: each["share"] for each in shown.lines.key.shades}

        await eventually(lambda: shares().get(code) == 1.0)
        await eventually(lambda: "his window" in shown.title.html)  # where one looks
        other = 1 + int(at[0]) % 5
        axes = (np.linspace(low, high, 9) for low, high in window)
        values = np.full((9, 9), other, np.int8)
        values[:3] = int(at[0])
        shown.panel.show_finer_cells(map_block_of_frame(WindowFrame(*axes, values, 1.0, 0)))
        await eventually(lambda: shares().get(code) == pytest.approx(1 / 3))
        shown.hover(delta, epsilon)
        await eventually(lambda: "outside of this window" in shown.readout.html)
        assert f"computed here</dt><dd>{rattle.REGIONS[other]}</dd>" in shown.readout.html
        shown.store.dispatch(PointerMoved((delta, epsilon), KEYBOARD))
        assert shown.said.html.endswith(f"computed here, {rattle.REGIONS[other]}</p>")
        shown.reset()
        await eventually(lambda: shares().get(code) == pytest.approx((plane.values == at[0]).mean()))

    with_map(tmp_path, body)


def test_a_large_survey_is_drawn_for_the_pixels_that_a_browser_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_view, "SIDE", 2)

    async def body(front: ApplicationState, shown: Shown) -> None:
        source = shown.map.figure.select_one({"name": "cells0"}).data_source
        shown.choose(done(front, REGIONS))
        await eventually(lambda: [each.shape for each in source.data["image"]] == [(4, 6)])
        for name, size in (("inner_width", 5), ("inner_height", 3)):
            shown.map.figure.set_from_json(name, size)
        await eventually(lambda: [each.shape for each in source.data["image"]] == [(2, 3)])

    with_map(tmp_path, body)


THIRD = SurveyRequest(**BODY | {"quantities": ["region"], "beta": {"start": 0.5, "stop": 0.6, "num": 2}})


def test_a_slider_chooses_the_slice_of_a_third_axis(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        job = done(front, THIRD)
        shown.choose(job)
        await eventually(lambda: cells(shown))
        slider = shown.controls.slice
        assert (slider.visible, slider.end, slider.value, slider.label) == (True, 1, 1, "β = 0.6")  # as in the address
        assert shown.store.model == Impacting(0.6)
        with open_survey(front.directory.store(job.id)) as survey:
            assert (survey.region.values[0] != survey.region.values[1]).any()
            for number, beta in ((0, 0.5), (1, 0.6)):
                slider.value = number
                await eventually(lambda: shown.plane is not None)
                assert (shown.view.slice, shown.store.model, slider.label) == (number, Impacting(beta), f"β = {beta}")
                assert ("slice=1" in shown.view.query()) == (number == 1)
                assert shown.plane is not None
                assert shown.plane.request.gear_model == Impacting(beta)
                assert (shown.plane.values == survey.region.values[number]).all()
                assert (shown.plane.status == 1).all()
        shown.choose(done(front, REGIONS))
        await eventually(lambda: shown.plane is not None and cells(shown))
        assert not slider.visible

    with_map(tmp_path, body, slice=1)


def test_the_list_tells_of_a_third_axis(tmp_path: Path) -> None:
    async def body(front: ApplicationState, _shown: Shown) -> None:
        job = accepted(front, THIRD)
        row = survey_row(JobStatus(job, None, None), View(survey=job.id, variable="region", slice=1), True)
        assert (row["size"], row["slice"]) == ("6 × 4 × 2", ["beta", 1])
        assert ["β", "0.5 … 0.6, 2 values"] in row["facts"]

    with_map(tmp_path, body)


def test_without_any_survey_the_plane_is_shown_as_it_is_known(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.follow(None)
        await eventually(lambda: cells(shown) and "the gear runs quietly from most starts" in shown.title.html)
        assert shown.view.variable == shown.controls.variable.value == "quiet_fraction"
        example = shown.plane
        assert isinstance(example, ClosedFormPlane)
        shown.controls.buttons.chosen = "lyapunov_max"
        await eventually(lambda: "chaotic where the exponent is above 0" in shown.title.html)
        assert shown.view.variable == shown.controls.variable.value == "lyapunov_max"
        example = shown.plane
        shown.controls.variable.value = "region"
        await eventually(lambda: shown.plane is not example and "region of the plane" in shown.title.html)
        plane, figure = shown.plane, shown.map.figure
        assert isinstance(plane, ClosedFormPlane)
        assert (plane.values == rattle.regions(plane.delta[None], plane.epsilon[:, None], 0.6)).all()
        assert (figure.x_range.start, figure.x_range.end) == pytest.approx((0.4, 1.0))
        assert (figure.y_range.start, figure.y_range.end) == pytest.approx((0.0, 0.3))
        assert {each["label"] for each in shown.lines.key.shades} == {"I", "II", "III", "IV", "V"}
        shown.hover(0.6, 0.1)
        await eventually(lambda: "Cell at δ 0.6, ε 0.1" in shown.readout.html)
        assert "<dt>status</dt><dd>ok</dd>" in shown.readout.html
        for orbit in rattle.Gear(0.6, 0.1).orbits():
            assert f"<td>{orbit.name}</td><td>{'stable' if orbit.stable else 'unstable'}" in shown.readout.html
        shown.controls.variable.value = "orbit_velocity"
        await eventually(lambda: shown.plane is not plane and shown.plane is not None)
        assert shown.plane is not None
        here = shown.plane.value_and_status(0.6, 0.1)
        assert here is not None
        assert here[0] == pytest.approx(2 * np.pi * 0.6, abs=0.02)  # of A: 2πδ
        shown.choose(accepted(front, STIFF))
        await eventually(lambda: "waits for its turn" in shown.title.html)
        assert_nothing_of_another(shown)

    with_map(tmp_path, body)


def test_a_map_that_a_survey_lacks_keeps_its_button_and_says_what_to_compute(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        def missing() -> dict[str, str]:
            return {each["label"]: each["about"] for each in shown.controls.buttons.buttons if each["missing"]}

        shown.follow(None)
        await eventually(lambda: shown.controls.buttons.buttons)
        assert [each["label"] for each in shown.controls.buttons.buttons] == [each.button for each in FEATURED]
        assert missing() == {}  # the example has all of them
        shown.choose(done(front, SurveyRequest(**BODY | {"quantities": ["region", "attractors", "lyapunov"]})))
        await eventually(missing)
        assert [each["label"] for each in shown.controls.buttons.buttons] == [each.button for each in FEATURED]
        (about,) = missing().values()
        assert about.startswith("Loudness: not computed in this survey.")
        assert "intensity is ticked" in about
        shown.controls.buttons.chosen = "worst_level"  # nobody can press it
        assert shown.view.variable == "quiet_fraction"
        for each in FEATURED:  # a survey with the named group has the map
            maps = map_names_by_variable(
                SurveyRequest(**BODY | {"quantities": sorted({"attractors", str(each.group)})})
            )
            assert set(each.variables) & set(maps), each.button
        mesh = {"model": "inelastic", "restitution": 0.9, "harmonics": [(20, 0.003, 0.0)], "quantities": ["attractors"]}
        shown.choose(accepted(front, SurveyRequest(**BODY | mesh)))
        assert missing()["Regions"].endswith("because its model has no quantity region.")

    with_map(tmp_path, body)


def test_the_example_is_still_there_beside_surveys(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, STIFF))
        await eventually(lambda: cells(shown))
        shown.store.dispatch(SurveyChosen(EXAMPLE))
        await eventually(lambda: cells(shown) and "which comes with the explorer" in shown.title.html)
        assert isinstance(shown.plane, ClosedFormPlane)
        assert shown.store.request is shown.shared.exact.request
        assert shown.store.model == Impacting()
        assert shown.map.figure.x_range.start == pytest.approx(0.4)
        assert shown.view.query() == "?survey=example&variable=quiet_fraction&overlays=none"
        shown.open((0.6, 0.1))
        await eventually(lambda: "64 starts, quiet" in shown.readout.summary)
        row = example_row(shown.shared.exact.request)
        assert row["name"] == "Example: the paper's plane at β = 0.6"
        assert (row["id"], row["size"]) == (EXAMPLE, "200 × 150")
        assert ["sample", "64 initial conditions"] in row["facts"]

    with points_in(IN_A_THREAD):
        with_map(tmp_path, body)


@pytest.mark.parametrize(
    ("asked", "filling"),
    [
        ({"quantities": ["region", "orbits", "attractors"]}, "quiet_fraction"),
        ({"quantities": ["region", "basins"]}, "basin_entropy"),
        ({"quantities": ["region", "orbits"]}, "region"),  # no other is there
        ({"quantities": ["grazing"]}, "status"),
        ({"quantities": ["region", "attractors"], "model": "stiff", "kappa": 1e4}, "quiet_fraction"),
    ],
)
def test_the_usual_map_of_a_survey_that_is_computed_is_one_that_fills_in(asked: dict[str, Any], filling: str) -> None:
    request = SurveyRequest(**BODY | asked)
    assert default_variable(request, False) == filling
    first = next(iter(map_names_by_variable(request)))
    assert default_variable(request, True) == (first if is_closed_form_map(request, first) else filling)


def test_a_map_that_nobody_chose_fills_in_from_where_its_survey_begins(tmp_path: Path) -> None:
    asked = SurveyRequest(**BODY)

    async def body(front: ApplicationState, shown: Shown) -> None:
        job = accepted(front, asked)
        shown.choose(job)
        await eventually(lambda: cells(shown))
        assert shown.view.variable == "region"
        front.database.set_state(job.id, State.RUNNING)
        shown.follow(front.database.job(job.id))
        await eventually(lambda: "The first cells of this survey" in shown.title.html)
        assert shown.view.variable == shown.controls.variable.value == "quiet_fraction"
        for number in (0, 1):
            compute(front, job.id, asked, slice(number, number + 1))
            shown.follow(front.database.job(job.id))
            left = 1 - front.database.job(job.id).cells_done / asked.n_cells
            await eventually(lambda left=left: shown.colours and shown.colours.shades[0].share == pytest.approx(left))
            assert shown.colours is not None
            assert "ends quiet" in shown.colours.title
            assert shown.colours.shades[0].label == "not computed"
        shown.controls.variable.value = "region"
        await eventually(lambda: "before the survey has computed" in shown.title.html)
        front.database.set_state(job.id, State.ACCEPTED)  # it waits for its turn again
        shown.follow(front.database.job(job.id))
        front.database.set_state(job.id, State.RUNNING)
        shown.follow(front.database.job(job.id))
        assert shown.view.variable == "region"  # which was chosen
        # as where another survey has been submitted
        shown.choose(accepted(front, asked.model_copy(update={"beta": 0.5})), is_new=True)
        assert shown.view.variable == "region"
        front.database.set_state(shown.view.survey, State.RUNNING)
        shown.follow(front.database.job(shown.view.survey))
        assert shown.view.variable == "quiet_fraction"

    with_map(tmp_path, body)


def test_few_lines_are_on_until_a_viewer_chooses_and_over_regions_all_of_their_borders(tmp_path: Path) -> None:
    async def body(_front: ApplicationState, shown: Shown) -> None:
        shown.follow(None)
        await eventually(lambda: cells(shown))
        assert shown.lines.key.chosen == ["SN1", "G1", "quiet_limit"]
        assert not shown.map.figure.select_one({"name": "SN2"}).visible
        with batch_call_watchers(shown.lines.key):  # in a page the key may report its lines after the page has set them
            shown.controls.variable.value = "region"
        await eventually(lambda: "region of the plane" in shown.title.html)
        assert shown.lines.key.chosen == [*rattle.curves.NAMES, "points"]
        assert shown.map.figure.select_one({"name": "SN2"}).visible
        assert "overlays" not in shown.view.query()  # nobody has chosen them
        shown.lines.key.chosen = ["G2", "SN1"]
        assert shown.view.overlays == ("SN1", "G2")
        shown.controls.variable.value = "quiet_fraction"
        await eventually(lambda: "ends quiet" in shown.title.html)
        assert shown.lines.key.chosen == ["SN1", "G2"]
        assert "overlays=SN1,G2" in shown.view.query()

    with_map(tmp_path, body, overlays=None)


def test_each_line_has_the_sentence_of_the_help() -> None:
    rows = dict(re.findall(r"<td>(.*?)</td>\s*<td>(.*?)</td>", help_html()))
    found = {each["label"]: each["meaning"] for each in legend_entries_of_map(Impacting())}
    points = found.pop("COD20–23")
    assert found == {label: rows[label] for label in found}
    assert set(found) == {*rattle.curves.NAMES} - {"quiet_limit"} | {
        "quiet limit",
        "crisis: chaos ends",
        "design limit",
    }
    for point in ("COD20", "COD21", "COD22", "COD23"):
        assert f"{point}: {rows[point]}" in points


def test_a_cell_is_read_again_once_it_is_computed(tmp_path: Path) -> None:
    asked = SurveyRequest(**BODY | {"quantities": ["attractors"]})
    at = float(asked.delta.values()[0]), float(asked.epsilon.values()[0])

    async def body(front: ApplicationState, shown: Shown) -> None:
        job = accepted(front, asked)
        front.database.set_state(job.id, State.RUNNING)
        shown.choose(front.database.job(job.id))
        compute(front, job.id, asked, slice(1, 2))
        shown.follow(front.database.job(job.id))
        await eventually(lambda: cells(shown))
        shown.hover(*at)
        await eventually(lambda: "<p>not computed</p>" in shown.readout.html)
        compute(front, job.id, asked, slice(1))
        shown.follow(front.database.job(job.id))
        await eventually(lambda: "<dt>quiet fraction</dt>" in shown.readout.html)  # the mouse does not move

    with_map(tmp_path, body)


def test_beside_an_open_point_its_cell_is_one_line_until_it_is_unfolded(tmp_path: Path) -> None:
    asked = SurveyRequest(**BODY | {"quantities": ["region", "attractors"], "initial_conditions": {"count": 64}})
    here, there = ((float(asked.delta.values()[i]), float(asked.epsilon.values()[i])) for i in (1, 3))

    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, asked))
        await eventually(lambda: shown.plane is not None and cells(shown))
        (unfold,) = shown.readout.pane.select(pn.widgets.Button)
        assert "Point at the map" in shown.readout.html
        shown.hover(*here)
        await eventually(lambda: "Cell at" in shown.readout.html)
        assert not shown.readout.is_folded
        shown.open(there)
        await eventually(lambda: shown.readout.is_folded)
        assert shown.plane is not None
        cell = shown.plane.cell_at(*there)
        assert cell is not None
        share, error = (100 * float(cell[name]) for name in ("quiet_fraction", "fraction_error"))
        assert f": 64 starts, quiet {share:.0f} ± {error:.0f} %</p>" in shown.readout.summary
        assert "not of the open point" in shown.readout.html
        unfold.clicks += 1
        assert not shown.readout.is_folded
        shown.hover(*here)
        at = f"Survey&#x27;s grid cell at δ {here[0]:g}"
        await eventually(lambda: at in shown.readout.summary)
        assert not shown.readout.is_folded  # as the viewer left it
        shown.store.dispatch(BookmarkChosen(((0.5, 0.6), (0.1, 0.2)), None, {}))
        await eventually(lambda: "Point at the map" in shown.readout.html)  # nothing of the old cell is left

    with points_in(IN_A_THREAD):
        with_map(tmp_path, body)


@pytest.mark.parametrize(
    ("num", "span", "expected"),
    [
        (200, (0.4015, 0.9985), "0.601"),
        (31, (0.4, 1.0), "0.6"),
        (30, (0.005, 0.3), "0.097"),
        (9, (0.7, 0.700001), "0.70000063"),
    ],
)
def test_a_cell_s_place_has_as_many_digits_as_tell_it_from_the_next(num: int, span: Pair, expected: str) -> None:
    request = SurveyRequest(delta=(*span, num), epsilon=(0.1, 0.2, 2))
    values = request.delta.values()
    near = {"0.601": 0.6005560928, "0.6": 0.6, "0.097": 0.0966, "0.70000063": 0.700000625}[expected]
    cell = xr.Dataset(coords={"delta": near, "epsilon": 0.1})
    assert cell_position(cell, request) == f"δ {expected}, ε 0.1"
    places = {cell_position(xr.Dataset(coords={"delta": each, "epsilon": 0.1}), request) for each in values}
    assert len(places) == num


def test_closed_forms_of_a_survey_are_shown_before_it_is_computed(tmp_path: Path) -> None:
    """Of what is computed already all is read, and of the other cells what is known of them."""
    asked = SurveyRequest(**BODY | {"beta": 0.5})

    async def body(front: ApplicationState, shown: Shown) -> None:
        job = accepted(front, asked)
        shown.choose(job)
        await eventually(lambda: cells(shown) and "waits for its turn" in shown.title.html)
        assert shown.view.variable == "region"
        plane = shown.plane
        assert plane is not None
        delta, epsilon = asked.delta.values(), asked.epsilon.values()
        assert (plane.values == rattle.regions(delta[None], epsilon[:, None], 0.5)).all()
        front.database.set_state(job.id, State.RUNNING)
        compute(front, job.id, asked, slice(1))
        shown.follow(front.database.job(job.id))
        await eventually(lambda: "before the survey has computed" in shown.title.html)
        assert shown.plane is plane
        first, last = (plane.cell_at(delta[each], epsilon[each]) for each in (0, -1))
        assert first is not None
        assert "attractor_kind" in first
        assert last is not None
        assert "attractor_kind" not in last
        assert last["region"] == plane.values[-1, -1]
        assert plane.cell_at(2.0, 0.1) is None
        shown.controls.variable.value = "quiet_fraction"
        await eventually(lambda: shown.plane is not plane)
        assert shown.plane is not None
        assert np.count_nonzero(shown.plane.status) == 6  # the cells of a tile

    with_map(tmp_path, body, variable="region")
