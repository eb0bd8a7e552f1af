"""The profile of a survey along the diagram of a point."""

from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np
import pytest
from service_support import BODY
from test_explorer_view import Shown, done, with_map
from waiting import eventually

import rattle
from gear_rattle.service.explorer.common.address import MapChoice, View
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.places.exact import ExactMaps
from gear_rattle.service.explorer.point.point_diagram import DiagramPicture
from gear_rattle.service.explorer.section.picture import value_range
from gear_rattle.service.explorer.section.profile import OUTSIDE, compute_profile, crossed_cells, profile_in_words
from gear_rattle.service.explorer.section.section import NO_END_POINT, ProfileSection
from gear_rattle.service.explorer.state.events import PointOpened
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest
from rattle import KINDS

pytestmark = pytest.mark.usefixtures("templates_once")


@pytest.fixture(scope="module")
def exact() -> ExactMaps:
    return ExactMaps()


@pytest.mark.parametrize(
    "ends",
    [
        ((0.45, 0.02), (0.95, 0.28)), ((0.95, 0.28), (0.45, 0.02)), ((0.6, 0.05), (0.6, 0.12)),
        ((0.5, 0.1007), (0.8, 0.1007)), ((0.3, 0.4), (0.7, 0.1)), ((1.2, 0.1), (1.3, 0.2)),
        ((0.602, 0.1007), (0.6021, 0.1007)),
    ],
)  # fmt: skip
def test_a_profile_has_the_values_of_the_cells_that_are_crossed(
    exact: ExactMaps, ends: tuple[tuple[float, float], tuple[float, float]]
) -> None:
    plane = exact.plane("region", 0)
    found = compute_profile(plane, ends)
    assert (found.positions[0], found.positions[-1]) == (0.0, 1.0)
    assert (np.diff(found.positions) > 0).all()
    assert found.cells_per_value == (1, 1)
    outside = 0
    along = np.random.default_rng(1).random(400)
    for at in along:
        delta, epsilon = (a + at * (b - a) for a, b in zip(*ends, strict=True))
        value = found.values[np.searchsorted(found.positions, at) - 1]
        cell = plane.value_and_status(delta, epsilon)
        outside += cell is None
        assert np.isnan(value) if cell is None else value == cell[0]
    assert found.gaps.get(OUTSIDE, 0.0) == pytest.approx(outside / along.size, abs=0.1)
    assert [found.names[code] for code in range(1, 6)] == list(rattle.REGIONS[1:6])


def test_a_line_crosses_cells_one_after_the_other() -> None:
    box, shape = ((0.0, 4.0), (0.0, 3.0)), (3, 4)
    at, row, column = crossed_cells(box, shape, ((0.5, 0.5), (3.5, 2.5)))
    assert at == pytest.approx([0, 1 / 6, 1 / 4, 1 / 2, 3 / 4, 5 / 6, 1])
    assert row.tolist() == [0, 0, 1, 1, 2, 2]
    assert column.tolist() == [0, 1, 1, 2, 2, 3]
    at, row, column = crossed_cells(box, shape, ((-1.0, 1.5), (1.0, 1.5)))
    assert at.tolist() == [0, 0.5, 1]
    assert (row.tolist(), column.tolist()) == ([-1, 1], [-1, 0])
    at, row, column = crossed_cells(box, shape, ((1.5, 1.5), (1.5, 1.5)))  # no way at all
    assert (at.tolist(), row.tolist(), column.tolist()) == ([0, 1], [1], [1])


def test_gaps_are_where_a_map_has_no_value(exact: ExactMaps) -> None:
    plane = exact.plane("orbit_velocity", 2)  # C
    found = compute_profile(plane, ((0.45, 0.02), (0.95, 0.28)))
    lengths, none = np.diff(found.positions), np.isnan(found.values)
    assert 0 < found.gaps["no such orbit"] < 1
    assert found.gaps["no such orbit"] == pytest.approx(lengths[none].sum())
    assert f"Gaps: {found.gaps['no such orbit']:.2g} of the way: no such orbit" in profile_in_words(found)
    low, high = value_range(found)
    assert low < np.nanmin(found.values) <= np.nanmax(found.values) < high
    drawn = np.repeat(found.values, 2)
    assert np.isnan(drawn).any()  # a line has a gap there


ATTRACTORS = SurveyRequest(**BODY | {"quantities": ["region", "attractors"], "slots": 2})


def test_the_profile_is_of_the_map_that_is_seen_or_of_the_one_that_is_chosen(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        job = done(front, ATTRACTORS)
        shown.choose(job)
        shown.controls.variable.value = "region"
        await eventually(lambda: shown.plane is not None and shown.plane.plane.name == "region")
        section = ProfileSection(shown.shared, shown.viewer, shown.store, "light", "")
        panel, fields = section.profile_place.panel, (section.delta, section.epsilon)
        shown.follow(job)
        assert not panel.visible  # no point, no diagram
        shown.store.dispatch(PointOpened((0.52, 0.06), state=PointTabsState(to=(0.68, 0.14))))
        await eventually(lambda: panel.visible)
        assert section.variable.value == "region,0"
        assert [field.value for field in fields] == [0.68, 0.14]
        data = section.profile_figure.steps.data
        assert (data["x"][0], data["x"][-1]) == (0.0, 1.0)
        assert shown.plane is not None
        region = int(shown.plane.values[0, 1])
        assert (data["value"][0], data["what"][0]) == (region, rattle.REGIONS[region])
        axis = section.profile_figure.figure.yaxis
        assert axis.major_label_overrides[region] == rattle.REGIONS[region]
        picture = DiagramPicture("light", section.profile_place.x_range)
        assert picture.figure.x_range is section.profile_figure.figure.x_range
        assert picture.figure.min_border_left == section.profile_figure.figure.min_border_left
        section.variable.value = "attractor_kind,1"
        assert shown.view.profile == MapChoice("attractor_kind", 1)
        told = {name: [value.encode()] for name, value in parse_qsl(shown.view.query()[1:])}
        assert View.parse(told).profile == shown.view.profile
        await eventually(lambda: "Kind of" in section.said.html)
        assert set(section.profile_figure.steps.data["what"]) <= {"", *KINDS}
        section.variable.value = "attractor_fraction,0"
        await eventually(lambda: "Share of" in section.said.html)
        section.low.value, section.high.value = 0.25, 0.75
        await eventually(lambda: section.profile_figure.figure.y_range.start == 0.25)
        assert shown.view.profile_limits == (0.25, 0.75)
        section.low.value = 2.0
        assert "two limits" in section.said.html
        assert shown.view.profile_limits == (0.25, 0.75)
        section.epsilon.value = 0.1
        assert shown.view.point_state.to == (0.68, 0.1)
        section.delta.value = -1.0
        assert NO_END_POINT in section.said.html
        assert shown.view.point_state.to == (0.68, 0.1)
        shown.change_point(PointTabsState(direction="delta", span=0.03))
        await eventually(lambda: section.profile_place.x_range.start == pytest.approx(0.49))
        assert section.profile_place.x_range.end == pytest.approx(0.55)
        shown.close()
        assert not panel.visible

    with_map(tmp_path, body)
