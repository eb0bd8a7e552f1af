"""What the explorer draws of a survey, without a browser: cells, limits, legends, overlays, what a click means."""

import re
from collections.abc import Callable, Iterator
from copy import copy
from functools import partial
from types import SimpleNamespace
from typing import Any
from weakref import ref

import numpy as np
import pytest
import xarray as xr
from bokeh.document import Document
from bokeh.models import Axis, ColorBar, Label, NoOverlap
from fastapi.testclient import TestClient
from service_support import BODY, compute, front_end, front_of

from gear_rattle.service.database.tables import State
from gear_rattle.service.explorer.common.glyphs import line_style_of
from gear_rattle.service.explorer.map import planes, shared
from gear_rattle.service.explorer.map.colouring import (
    NAME_SIZE,
    Colouring,
    block_values_or_nan,
    compute_colouring,
    family_name_positions,
)
from gear_rattle.service.explorer.map.cursor import cursor_after_steps, move_window_to_cursor, zoomed_window
from gear_rattle.service.explorer.map.figure import MapFigure
from gear_rattle.service.explorer.map.overlays import codimension_two_points_in_window
from gear_rattle.service.explorer.map.planes import MapBlock, MapCache, MapPlane, PyramidMapPlane
from gear_rattle.service.explorer.map.readout import cell_in_words
from gear_rattle.service.explorer.map.shared import MOST_DRAWINGS
from gear_rattle.service.explorer.state.events import DiagramEndChosen, Event, PointOpened
from gear_rattle.workers import SurveyRequest, complete, is_incomplete, open_survey
from gear_rattle.workers.pictures.levels import level_opener, reduce_map
from gear_rattle.workers.pictures.maps import readable_description
from gear_rattle.workers.pictures.names import arrange_names, is_overlapping
from gear_rattle.workers.survey.levels import grid
from gear_rattle.workers.survey.values.quantities import variables_of_groups
from gear_rattle.workers.survey.values.schema import Group
from rattle import KINDS
from rattle.curves import codimension_two
from rattle.models import Impacting
from rattle.orbits.orbits_a_to_d import REGIONS
from rattle.plot import FIGURE_7, FIGURE_8
from rattle.plot.colours import REGION_COLOURS

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(
    **BODY | {
        "delta": {"start": 0.42, "stop": 0.98, "num": 29},
        "epsilon": {"start": 0.01, "stop": 0.29, "num": 15},
        "quantities": ["region", "orbits"],
        "tile": {"delta": 5, "epsilon": 4},
    }
)  # fmt: skip


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data")) as client:
        yield client


@pytest.fixture(scope="module")
def survey(client: TestClient) -> str:
    """The id of a survey that is done."""
    survey_id = str(client.post("/v1/surveys", json=REQUEST.model_dump(mode="json")).json()["id"])
    front = front_of(client)
    compute(front, survey_id, REQUEST)
    front.database.set_state(survey_id, State.SUCCESSFUL)
    return survey_id


@pytest.fixture
def leveled(client: TestClient, survey: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The same survey, in the store of which are levels."""
    monkeypatch.setattr(grid, "LARGEST_WITHOUT_LEVELS", 16)
    monkeypatch.setattr(grid, "LARGEST_NOT_HALVED", 8)
    store = front_of(client).directory.store(survey)
    if is_incomplete(REQUEST, store):
        complete(REQUEST, store)
    return survey


@pytest.fixture
def plane(client: TestClient, survey: str) -> MapPlane:
    front = front_of(client)
    found, whole = MapCache(front).plane(front.database.job(survey), "region", 0)
    assert whole
    return found


def new_map(heard: Callable[[Event], None] = lambda _event: None) -> MapFigure:
    found = MapFigure("light", heard)
    Document().add_root(found.figure)
    return found


def shares_of(plane: MapPlane, block: MapBlock) -> dict[str, float]:
    return {shade.label: shade.share for shade in compute_colouring(plane, block, "auto", False).shades}


def test_cells_are_drawn_where_they_are(plane: MapPlane) -> None:
    drawn = new_map()
    drawn.draw_cells(plane.block(), compute_colouring(plane, plane.block(), "auto", False))
    source = drawn.figure.select_one({"name": "cells0"}).data_source.data
    rows, columns = source["image"][0].shape
    x = source["x"][0] + (np.arange(columns) + 0.5) * source["dw"][0] / columns
    y = source["y"][0] + (np.arange(rows) + 0.5) * source["dh"][0] / rows
    np.testing.assert_allclose(x, REQUEST.delta.values())
    np.testing.assert_allclose(y, REQUEST.epsilon.values())
    np.testing.assert_array_equal(source["image"][0], plane.values)


def test_a_large_survey_is_drawn_with_what_is_rare_and_whole_where_one_looks_closer(plane: MapPlane) -> None:
    room = (8, 8)
    assert plane.has_more_cells_than_pixels(room)
    assert not plane.has_more_cells_than_pixels((29, 15))
    block = plane.block(room=room)
    assert block.values.shape == (4, 8)  # of 15 × 29, four of each axis in one
    for i, j in np.ndindex(4, 8):
        codes, counts = np.unique(plane.values[4 * i : 4 * i + 4, 4 * j : 4 * j + 4], return_counts=True)
        rare = codes[2 * counts <= counts.sum()]
        assert block.values[i, j] in (rare if rare.size else codes)
    step = plane.delta[1] - plane.delta[0]
    np.testing.assert_allclose(block.delta, plane.delta[0] + 1.5 * step + 4 * step * np.arange(8))
    np.testing.assert_allclose(block.box[0], (plane.delta[0] - step / 2, plane.delta[0] + 31.5 * step))
    for label, share in shares_of(plane, plane.block(room=(15, 8))).items():  # not of what is shown
        assert share == pytest.approx((plane.values == REGIONS.index(label)).mean(), abs=0.002)
    assert sum(shares_of(plane, block).values()) == pytest.approx(1)
    window = ((plane.delta[9] - 1e-3, plane.delta[13] + 1e-3), (plane.epsilon[2], plane.epsilon[6]))
    close = plane.block(window, room)
    np.testing.assert_array_equal(block_values_or_nan(plane, close), plane.values[2:7, 9:14])
    np.testing.assert_array_equal(close.delta, plane.delta[9:14])


@pytest.mark.parametrize(("variable", "index"), [("region", 0), ("orbit_exists", 2), ("orbit_velocity", 3)])
def test_of_a_survey_with_levels_is_read_what_is_drawn(
    client: TestClient, leveled: str, variable: str, index: int
) -> None:
    front = front_of(client)
    job = front.database.job(leveled)
    plane, whole = MapCache(front).plane(job, variable, index)
    assert whole
    assert isinstance(plane, PyramidMapPlane)
    in_memory = MapPlane(front, job, variable, index)
    in_memory.update(job)
    some = ((plane.delta[3], plane.delta[12]), (plane.epsilon[5], plane.epsilon[11]))
    for window in (None, some):
        for room in ((40, 40), (16, 8), (9, 9), (4, 4)):
            found, expected = plane.block(window, room), in_memory.block(window, room)
            if room[0] > 4:  # for which it has a level
                np.testing.assert_allclose(found.values, expected.values, rtol=1e-6)
                np.testing.assert_array_equal(found.status, expected.status)
                assert found.shares == pytest.approx(expected.shares)
                assert found.box == expected.box
    close = ((plane.delta[3], plane.delta[4]), (plane.epsilon[5], plane.epsilon[6]))
    np.testing.assert_array_equal(plane.enlarged_block(close).values, in_memory.enlarged_block(close).values)
    assert str(plane.value_and_status(plane.delta[9], plane.epsilon[5])) == str(
        in_memory.value_and_status(plane.delta[9], plane.epsilon[5])
    )
    assert plane.values.size == 0


def test_a_picture_is_drawn_from_levels(client: TestClient, leveled: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same as from all cells, of which none is read."""
    store, room = front_of(client).directory.store(leveled), (9, 16)
    with open_survey(store) as survey:
        whole = reduce_map(survey, "region", 0, room, None)
        monkeypatch.setattr("gear_rattle.workers.pictures.levels.reduce_cells", None)
        levels = level_opener(partial(open_survey, store), None, True)
        drawn = reduce_map(survey, "region", 0, room, levels)
    xr.testing.assert_identical(drawn, whole)
    assert drawn.region.shape == (8, 15)
    assert client.get(f"/v1/surveys/{leveled}/map.png").content.startswith(b"\x89PNG")


def test_a_map_that_takes_long_is_read_a_piece_at_a_time(
    client: TestClient, survey: str, plane: MapPlane, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planes, "MOST_CELLS_AT_ONCE", 1)
    clock = iter(np.arange(0.0, 1e3, 0.6))
    monkeypatch.setattr(planes, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    job = front_of(client).database.job(survey)
    slow = MapPlane(front_of(client), job, "region", 0)
    known = []
    while not slow.update(job):
        known.append(int((slow.status > 0).sum()))
    assert 0 < known[0] < known[-1] < REQUEST.n_cells
    np.testing.assert_array_equal(slow.values, plane.values)
    assert (slow.status > 0).all()


def test_legend_colours_and_limits_are_the_map_s(plane: MapPlane) -> None:
    block = plane.block()
    found = compute_colouring(plane, block, "auto", False)
    for shade in found.shades:
        code = REGIONS.index(shade.label)
        assert shade.colour == REGION_COLOURS[code]
        assert shade.share == pytest.approx((plane.values == code).mean())
        assert found.palette[int(code - found.low - 0.5)] == shade.colour
    own = compute_colouring(plane, block, (2.0, 3.0), False)
    assert (own.low, own.high) == (found.low, found.high)  # codes have none of their own
    drawn = new_map()
    drawn.draw_cells(block, found)
    mapper = drawn.figure.select_one({"name": "cells0"}).glyph.color_mapper
    assert (mapper.low, mapper.high, list(mapper.palette)) == (found.low, found.high, list(found.palette))


@pytest.mark.parametrize("log", [False, True])
def test_own_limits_and_the_scale_of_colours(client: TestClient, survey: str, log: bool) -> None:
    front = front_of(client)
    speeds, _ = MapCache(front).plane(front.database.job(survey), "orbit_velocity", 0)
    found = compute_colouring(speeds, speeds.block(), (1.5, 4.0), log)
    drawn = new_map()
    drawn.draw_cells(speeds.block(), found)
    shown, other = (drawn.figure.select_one({"name": f"cells{number:d}"}) for number in (log, not log))
    assert (shown.visible, other.visible) == (True, False)
    mapper = shown.glyph.color_mapper
    assert type(mapper).__name__ == ("LogColorMapper" if log else "LinearColorMapper")
    assert (mapper.low, mapper.high) == (1.5, 4.0)
    (bar,) = [each for each in drawn.figure.right if each.visible and isinstance(each, ColorBar)]
    assert bar.color_mapper is mapper


@pytest.mark.parametrize(("limits", "below", "above"), [((1.5, 4.0), 0, 1), ((3.5, 9.0), 1, 0), ("full", 0, 0)])
def test_values_beyond_the_limits_are_marked(
    client: TestClient, survey: str, limits: Any, below: bool, above: bool
) -> None:
    front = front_of(client)
    speeds, _ = MapCache(front).plane(front.database.job(survey), "orbit_velocity", 0)
    found = compute_colouring(speeds, speeds.block(), limits, False)
    values = speeds.values[np.isfinite(speeds.values)]
    low, high = (found.low, found.high) if limits == "full" else limits
    beyond = float((values < np.float32(low)).mean()), float((values > np.float32(high)).mean())
    assert found.shares_beyond == pytest.approx(beyond)
    assert [share > 0 for share in beyond] == [below, above]
    drawn = new_map()
    drawn.draw_cells(speeds.block(), found)
    marks = {each.text: each.visible for each in drawn.figure.select({"type": Label})}
    assert marks == {"▼": below, "▲": above}
    assert ("below the scale" in found.note, "above the scale" in found.note) == (below, above)


def test_zeros_have_no_colour_of_a_log_scale(client: TestClient, survey: str) -> None:
    front = front_of(client)
    speeds, _ = MapCache(front).plane(front.database.job(survey), "orbit_velocity", 0)
    block = speeds.block()
    where = np.flatnonzero(np.isfinite(block.values))[:5]
    block.values.flat[where] = [0.0, 0.0, 0.0, -1.0, -2.0]
    found = compute_colouring(speeds, block, "auto", True)
    (zero,) = [each for each in found.shades if each.label == "zero or below"]
    assert zero.share == pytest.approx(5 / block.values.size)
    assert found.reason_colours[found.reasons.flat[where[0]] - 1] == zero.colour
    assert found.low == block.values[block.values > 0].min()
    drawn = new_map()
    drawn.draw_finer_cells(block.values, block.box)
    drawn.draw_cells(block, found)
    for name in ("cells1", "fine1"):
        image = drawn.figure.select_one({"name": name}).data_source.data["image"][0]
        np.testing.assert_array_equal(np.isfinite(image), block.values > 0)
    drawn.draw_cells(block, compute_colouring(speeds, block, "auto", False))
    image = drawn.figure.select_one({"name": "fine0"}).data_source.data["image"][0]
    np.testing.assert_array_equal(image, block.values)


def test_attractors_have_phases_that_mean_something(
    client: TestClient,
) -> None:
    request = SurveyRequest(**BODY | {"quantities": ["attractors"], "slots": 2})
    front = front_of(client)
    survey_id = str(client.post("/v1/surveys?force=true", json=request.model_dump(mode="json")).json()["id"])
    compute(front, survey_id, request)
    front.database.set_state(survey_id, State.SUCCESSFUL)
    job = front.database.job(survey_id)
    kinds, phases, periods = (
        MapCache(front).plane(job, name, 0)[0] for name in ("attractor_kind", "attractor_phase", "attractor_m")
    )
    periodic = kinds.values == KINDS.index("periodic")
    assert 0 < periodic.sum() < periodic.size
    np.testing.assert_array_equal(np.isfinite(phases.values), periodic)
    found = compute_colouring(phases, phases.block(), "auto", False)
    assert [each.label for each in found.shades] == ["no periodic attractor in this slot"]
    assert "attractor 0 of each cell, by falling share" in found.title
    many = np.ones((40, 50), np.float32)
    many[0, 0], many[1:3] = 144.0, 2.0
    same = MapBlock(np.linspace(0, 1, 50), np.linspace(0, 1, 40), many, np.ones(many.shape, np.int8), phases.box)
    assert compute_colouring(periods, same, "auto", False).high == 2.0  # one long period is not what colours are for
    assert compute_colouring(periods, same, "full", False).high == 144.0


def test_lines_have_the_colours_of_the_key_and_their_points() -> None:
    drawn = new_map()
    pieces = [np.array([[0.5, 0.1], [0.6, 0.2]])]
    for name in ("SN1", "G1"):
        drawn.draw_line(name, pieces)
        line = drawn.figure.select_one({"name": name})
        assert line.glyph.line_color == line_style_of(name)[0]
        np.testing.assert_array_equal(line.data_source.data["xs"][0], [0.5, 0.6])
        np.testing.assert_array_equal(line.data_source.data["ys"][0], [0.1, 0.2])
    drawn.show_overlays(["SN1"])
    assert drawn.figure.select_one({"name": "SN1"}).visible
    assert not drawn.figure.select_one({"name": "G1"}).visible


def test_what_is_clicked_is_delta_and_epsilon() -> None:
    heard: list[Event] = []
    drawn = new_map(heard.append)
    for x, y in ((0.6, 0.1), (None, 0.1), (0.39, 0.1), (0.6, -0.01)):  # the last two on the numbers of an axis
        drawn.tap(SimpleNamespace(x=x, y=y, modifiers=None))
    drawn.tap(SimpleNamespace(x=0.7, y=0.2, modifiers={"shift": True, "ctrl": False, "alt": False}))
    assert heard == [PointOpened((0.6, 0.1)), DiagramEndChosen((0.7, 0.2))]
    drawn.tap(SimpleNamespace(x=0.6000000012, y=0.1234567891, modifiers=None))
    assert heard[-1] == PointOpened((0.6, pytest.approx(0.1234567891, abs=1e-5)))
    drawn.show_window(((0.6, 0.6 + 1e-9), (0.1, 0.1 + 1e-9)))
    drawn.tap(SimpleNamespace(x=0.6 + 1.23e-10, y=0.1 + 4.56e-10, modifiers=None))
    assert heard[-1] == PointOpened(
        (pytest.approx(0.6 + 1.23e-10, abs=1e-13), pytest.approx(0.1 + 4.56e-10, abs=1e-13))
    )


def test_the_cursor_steps_through_cells(plane: MapPlane) -> None:
    window, axes = plane.box, (plane.delta, plane.epsilon)
    at = (plane.delta[10], plane.epsilon[5])
    assert cursor_after_steps(axes, at, window, [2, -1, 0, 0]) == (plane.delta[12], plane.epsilon[4])
    assert cursor_after_steps(axes, at, window, [0, 0, 1, -1]) == (
        plane.delta[13],
        plane.epsilon[3],
    )  # tenths of the window
    assert cursor_after_steps(axes, at, window, [-99, 99, 0, 0]) == (plane.delta[0], plane.epsilon[-1])
    narrow = ((at[0], at[0] + 4e-3), (at[1], at[1] + 4e-3))
    assert cursor_after_steps(axes, at, narrow, [1, 2, 0, 0]) == pytest.approx((at[0] + 1e-4, at[1] + 2e-4))
    assert move_window_to_cursor(narrow, at) == narrow
    (low, high), (bottom, top) = move_window_to_cursor(narrow, (at[0] + 5e-3, at[1]))
    assert (high - low, bottom, top) == pytest.approx((4e-3, *narrow[1]))
    assert low < at[0] + 5e-3 < high
    (low, high), _ = zoomed_window(window, at, 0.5, plane.box)
    assert high - low == pytest.approx((window[0][1] - window[0][0]) / 2)
    assert (at[0] - low) / (high - low) == pytest.approx((at[0] - window[0][0]) / (window[0][1] - window[0][0]))
    (low, high), _ = zoomed_window(window, at, 1e6, plane.box)
    assert high - low == pytest.approx(3 * (window[0][1] - window[0][0]))


def test_a_cell_in_words(plane: MapPlane) -> None:
    said = cell_in_words(plane, 0.6, 0.11, plane.box)
    assert said.startswith("δ 0.6000, ε 0.1100: region of the plane")
    assert said.endswith(f", {REGIONS[int(plane.values[5, 9])]}")
    assert cell_in_words(plane, 2.0, 0.11, plane.box).endswith("outside of the survey")
    cell = plane.cell_at(0.607, 0.113)
    assert cell is not None
    assert (float(cell["delta"]), float(cell["epsilon"])) == (plane.delta[9], plane.epsilon[5])


def test_a_map_that_stays_as_it_is_is_drawn_once_for_all_pages(
    plane: MapPlane, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, other = list[Any](), copy(plane)  # the same cells, of another survey or computed again
    monkeypatch.setattr(shared, "compute_colouring", lambda *of: drawn.append(of) or len(drawn))
    shared.cached_cells_and_colours.cache_clear()

    def draw(of: MapPlane, log: bool, side: int = 20) -> Any:
        return shared.cached_cells_and_colours(ref(of), "auto", log, (side, side))[1]

    assert draw(plane, False) == draw(plane, False) == 1
    assert draw(plane, True) == 2
    assert draw(other, False) == 3
    for number in range(MOST_DRAWINGS - 1):
        draw(plane, True, 21 + number)
        assert draw(plane, True) == 2  # what is looked at stays
    assert draw(plane, False) == len(drawn) == 3 + MOST_DRAWINGS
    alone = ref(other)
    del other
    drawn.clear()
    assert alone() is None  # nothing but the atlas keeps maps
    shared.cached_cells_and_colours.cache_clear()


def test_labels_of_no_axis_lie_over_each_other() -> None:
    """δ and ε on two sides each, and a machine's speeds and eccentricities."""
    plot = new_map().figure
    axes = [part for part in (*plot.below, *plot.left, *plot.above, *plot.right) if isinstance(part, Axis)]
    assert [type(axis.major_label_policy) for axis in axes] == [NoOverlap] * 6


def test_what_has_no_state_is_one_model_for_all_renderers() -> None:
    """Every model takes time of whoever opens a page, here and in the browser."""
    plot = new_map().figure
    assert len(plot.renderers) > 30
    assert len({each.view.filter.id for each in plot.renderers}) == 1
    assert len({each.view.id for each in plot.renderers}) == len(plot.renderers)
    assert len({each.data_source.selection_policy.id for each in plot.renderers}) == 1


def test_a_point_that_is_not_in_the_window_has_no_name_in_it() -> None:
    model, window = Impacting(0.8), ((0.4, 1.005), (0.0, 0.3))
    inside = [each for each in codimension_two(0.8) if each.delta <= 1.005]
    assert [each.name for each in inside] == ["COD20"]  # COD21 is at 1.007: its name would reach into the window
    assert codimension_two_points_in_window(model, window) == [(each.name, each.delta, each.epsilon) for each in inside]
    assert codimension_two_points_in_window(model, ((0.4, 1.005), (0.0, 0.2))) == []
    assert len(codimension_two_points_in_window(model, ((0.4, 1.1), (0.0, 0.3)))) == 4


@pytest.mark.parametrize("room", [(250, 400), (700, 550), (1400, 1000)])
def test_names_of_families_are_as_far_apart_as_their_letters_are_wide(room: tuple[int, int]) -> None:
    codes = np.repeat(np.tile(np.arange(1, 9), 5).reshape(5, 8), 12, axis=1).repeat(20, axis=0)
    codes += np.repeat(8 * (np.arange(5) % 3), 20)[:, None]
    delta, epsilon = np.linspace(0.4, 1.0, codes.shape[1]), np.linspace(0.0, 0.3, codes.shape[0])
    block = MapBlock(delta, epsilon, codes.astype(np.float32), np.ones_like(codes, np.int8), ((0.4, 1.0), (0.0, 0.3)))
    places = family_name_positions(block, {code: f"{code}: P(1,{code},0)" for code in range(1, 25)}, room)
    at = [((x - 0.4) / 0.6 * room[0], y / 0.3 * room[1]) for x, y in places.values()]
    assert len(at) > 1
    for i, (x, y) in enumerate(at):
        assert NAME_SIZE[0] / 2 - 5 * room[0] / 96 <= x <= room[0] - NAME_SIZE[0] / 2 + 5 * room[0] / 96  # a few cells
        for other in at[i + 1 :]:
            assert abs(x - other[0]) > 0.95 * NAME_SIZE[0] or abs(y - other[1]) > 0.95 * NAME_SIZE[1]


SIZES = {"telephone": (290, 300), "laptop": (560, 520), "wide": (1300, 850)}
WINDOWS = {"Figure 7": FIGURE_7, "Figure 8": FIGURE_8, "between": ((0.5, 0.8), (0.05, 0.2))}
Boxes = list[tuple[float, float, float, float]]


def boxes_on_screen(shown: MapFigure, size: tuple[int, int]) -> tuple[Boxes, Boxes]:
    """Boxes of the codimension-two points' names and of their marks, in pixels."""
    data = shown.figure.select_one({"name": "points"}).data_source.data
    names, marks = [], []
    for x, y, name, dx, dy in zip(*(data[key] for key in ("x", "y", "name", "dx", "dy")), strict=True):
        left, bottom = (
            side * (at - span.start) / (span.end - span.start)
            for side, at, span in zip(size, (x, y), (shown.figure.x_range, shown.figure.y_range), strict=True)
        )
        half = 4.6 * len(name)  # pixels: capitals of 12 px DejaVu Sans have 8.4 to 9.4, digits 7.6, and 2 of padding
        names.append((left + dx - half, bottom - dy - 9, left + dx + half, bottom - dy + 9))
        marks.append((left - 5, bottom - 5, left + 5, bottom + 5))
    return names, marks


@pytest.mark.parametrize("window", WINDOWS.values(), ids=WINDOWS)
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_names_of_points_cover_no_mark_and_no_other_name(
    monkeypatch: pytest.MonkeyPatch, window: planes.Ranges, size: tuple[int, int]
) -> None:
    monkeypatch.setattr(MapFigure, "pixels", size)
    shown = new_map()
    shown.show_window(window)
    shown.mark_pins({"1": (0.77, 0.0985)})
    points = codimension_two_points_in_window(Impacting(0.6), window)
    shown.mark_points(points)
    data = shown.figure.select_one({"name": "points"}).data_source.data
    assert data["name"] == [name for name, _, _ in points]
    assert len(points) == (3 if window == FIGURE_8 else 4)
    names, marks = boxes_on_screen(shown, size)
    for number, name in enumerate(names):
        assert 0 <= name[0] < name[2] <= size[0]
        assert 0 <= name[1] < name[3] <= size[1]
        assert not any(is_overlapping(name, other) for other in (*names[:number], *marks))
    leaders = zip(data["x"], data["y"], data["to_x"], data["to_y"], strict=True)
    for (x, y, to_x, to_y), name, mark in zip(leaders, names, marks, strict=True):
        has_leader = (x, y) != (to_x, to_y)
        beside = name[0] - 10 < mark[2] and mark[0] < name[2] + 10 and name[1] - 10 < mark[3] and mark[1] < name[3] + 10
        assert beside or has_leader


def test_names_of_regions_stay_inside_the_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MapFigure, "pixels", (300, 300))
    shown = new_map()
    shown.show_window(FIGURE_7)
    codes = np.ones((30, 60), np.float32)
    delta, epsilon = np.linspace(0.405, 0.995, 60), np.linspace(0.005, 0.295, 30)
    block = MapBlock(delta, epsilon, codes, codes.astype(np.int8), FIGURE_7)
    written = {"II": (0.405, 0.15), "I": (0.7, 0.15)}
    reasons = np.zeros(codes.shape, np.uint8)
    shown.draw_cells(block, Colouring("", ("#ffffff",), 0.5, 1.5, False, True, (), reasons, (), names=written))
    names = shown.figure.select_one({"name": "names"}).data_source.data
    assert names["name"] == ["II", "I"]
    assert 300 * (0.405 - 0.4) / 0.6 + names["dx"][0] >= 10  # pixels from the left edge: half of what II takes
    assert names["dx"][1] == 0.0


def test_a_name_without_room_is_left_out() -> None:
    assert arrange_names([(20.0, 20.0)], [(45.0, 18.0)], (40.0, 40.0)) == [None]
    (found,) = arrange_names([(50.0, 50.0)], [(45.0, 18.0)], (400.0, 400.0))
    assert found is not None
    assert found.leader_end is None
    everywhere = [(200.0, 200.0)] * 12
    placed = arrange_names(everywhere, [(45.0, 18.0)] * 12, (400.0, 400.0))
    assert sum(each is not None and each.leader_end is not None for each in placed) >= 3


def test_names_and_titles_of_maps_are_written_as_everywhere() -> None:
    request = SurveyRequest(**BODY | {"quantities": list(Group)})
    names = planes.maps_by_name(request)
    assert "orbit speed, A" in names
    assert not [name for name in names if "velocity" in name or "_" in name]
    titles = [readable_description(each.long_name) for each in variables_of_groups(request.quantities, request.model)]
    assert "m of P(m,n₊,n₋), forcing periods; 0 unless periodic" in titles
    assert "n₋ of P(m,n₊,n₋), impacts on or contacts with Σ⁻; 0 unless periodic" in titles
    assert not [title for title in titles if re.search(r"velocit|[nvΣ][+-]", title)]
