"""Places with names, and the windows that were shown before."""

from pathlib import Path

import numpy as np
import panel as pn
import pytest
from service_support import IN_A_THREAD, points_in
from test_explorer_view import REGIONS, STIFF, Shown, accepted, cells, done, with_map
from waiting import eventually

import rattle
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.design.places import CORNERS, CRISES, EITHER_WAY, bookmarks
from gear_rattle.service.explorer.places.example import EXAMPLE, REQUEST, load_stored_variables
from gear_rattle.service.explorer.point import parts
from gear_rattle.service.explorer.point.point_diagram import diagram_table_html
from gear_rattle.service.explorer.state.events import DiagramEndChosen
from gear_rattle.service.operations import diagrams
from gear_rattle.service.state import ApplicationState
from rattle.attractors import CHAOTIC, QUIET
from rattle.crisis import boundary_crisis
from rattle.plot.paper_ranges import FIGURE_5, FIGURE_8, FIGURE_9

pytestmark = pytest.mark.usefixtures("templates_once")


def test_the_places_are_where_the_mathematics_has_them() -> None:
    found = {point.name: (point.delta, point.epsilon) for point in rattle.curves.codimension_two(0.6)}
    named = {name.partition(",")[0]: place for name, place in CORNERS.items()}
    assert named.keys() == found.keys()
    for name, place in named.items():
        assert place == pytest.approx(found[name], abs=6e-6)
        assert all(abs(a - b) < wide / 50 for a, b, wide in zip(place, found[name], EITHER_WAY, strict=True))
    delta, epsilon = CRISES["0.6"]
    assert epsilon == pytest.approx(boundary_crisis(delta).epsilon, abs=1e-9)


def test_a_figure_s_diagram_goes_as_far_as_the_paper_s() -> None:
    for name, (delta, span) in {"5": FIGURE_5, "9": FIGURE_9}.items():
        place = bookmarks()[f"Figure {name}: diagram at δ = {delta:g}"]
        assert place.point is not None
        state = place.state
        assert state is not None
        assert PointTabsState.parse(state.address_texts()) == state
        assert diagrams.diagram_span(rattle.Gear(*place.point), "epsilon", state.span) == pytest.approx(span)
    for wrong in ("0", "-1", "nan", "inf", "1", "wide"):
        assert PointTabsState.parse({"span": wrong}).span is None


def test_the_example_is_what_its_survey_finds() -> None:
    """At random cells, with other starts: within four standard errors of both samples."""
    assert EXAMPLE.stat().st_size <= 300_000  # it comes with the wheel
    example = load_stored_variables()
    rng = np.random.default_rng(61)
    chosen = [(rng.integers(example.sizes["epsilon"]), rng.integers(example.sizes["delta"])) for _ in range(24)]
    seen = [example.isel(epsilon=i, delta=j) for i, j in chosen]
    delta, epsilon = (np.array([float(each[name]) for each in seen]) for name in ("delta", "epsilon"))
    count = 512
    table = rattle.attractors_of(delta, epsilon, count=count, v_max=7.0, seed=5)
    for number, each in enumerate(seen):
        own = table.cell == number
        for name, kind in (("quiet_fraction", QUIET), ("chaotic_fraction", CHAOTIC)):
            share = float(table.samples[own & (table.kind == kind)].sum() / count)
            error = np.sqrt(share * (1 - share) * (1 / count + 1 / 64)) + 1 / 64
            assert abs(float(each[name]) - share) <= 4 * error, (float(each.delta), float(each.epsilon), name)
    assert {0.0, 1.0} <= {float(each["quiet_fraction"]) for each in seen}  # on both sides of the quiet limit
    assert list(example.delta) == pytest.approx(REQUEST.delta.values())
    assert list(example.epsilon) == pytest.approx(REQUEST.epsilon.values())


def test_a_place_is_gone_to_and_left_again(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, REGIONS))
        await eventually(lambda: cells(shown) and shown.plane is not None)
        named = shown.go_to.named
        whole = shown.store.window
        named.value = about = bookmarks()["Figure 8: about COD21 and COD22"]
        assert shown.store.window == FIGURE_8
        assert named.value == about
        named.value = diagram = bookmarks()["Figure 9: diagram at δ = 0.762"]
        assert shown.view.point == pytest.approx((0.762, 0.0967))
        assert "p.span=0.001" in shown.view.query()
        assert named.value == diagram
        shown.close()
        assert named.value == about  # the window is still that of Figure 8
        shown.keys.execute("back")
        assert shown.store.window == whole
        assert named.value == ""
        shown.keys.execute("forward")
        assert shown.map.figure.x_range.start == FIGURE_8[0][0]
        shown.choose(accepted(front, STIFF))
        named.value = bookmarks()["Figure 7: the plane"]
        assert "of the impacting gear" in shown.go_to.said.html
        assert named.value == ""

    with_map(tmp_path, body)


def test_the_form_of_a_point_closes_once_the_point_is_shown(tmp_path: Path) -> None:
    async def body(_front: ApplicationState, shown: Shown) -> None:
        shown.follow(None)
        panel = shown.go_to.panel
        (button,) = (each for each in panel.select(pn.widgets.Button) if "go-to" in each.css_classes)
        button.clicks += 1
        assert button.label == "Close this form"
        (show,) = (each for each in panel.select(pn.widgets.Button) if each.label == "Show")
        delta, _ = panel.select(pn.widgets.FloatInput)[:2]
        delta.value = 0.0
        show.clicks += 1
        assert "above 0" in shown.go_to.said.html
        assert panel[1].visible  # what is wrong is corrected there
        delta.value = 0.7
        show.clicks += 1
        assert shown.view.point == (0.7, 0.1)
        assert not panel[1].visible
        assert button.label == "Go to a point"

    with points_in(IN_A_THREAD):
        with_map(tmp_path, body)


def test_the_way_to_another_point_has_the_events_between() -> None:
    here, to = (0.55, 0.05), (0.65, 0.08)  # SN1, SN2 and PD1 lie between
    found = parts.compute_diagram_contents(rattle.Gear(*here), "epsilon", to=to, steps=30, count=4)
    assert found.span == (0.0, 1.0)
    named = {each.name: each for each in found.events if each.name}
    assert {"SN1", "SN2"} <= named.keys()
    for each in named.values():
        way = (each.delta - here[0]) / (to[0] - here[0])
        assert each.epsilon == pytest.approx(here[1] + way * (to[1] - here[1]), abs=1e-12)
        assert 0 < way < 1
    born = named["SN1"]
    assert born.epsilon == pytest.approx(rattle.Gear(born.delta, born.epsilon).sn1, abs=1e-9)
    assert max(abs(each - 1.0) for each in born.multipliers[:1]) < 1e-4  # one of them is 1, the other e^(−δ)
    assert abs(born.multipliers[0] * born.multipliers[1] - np.exp(-born.delta)) < 1e-9
    said = diagram_table_html(found)
    for each in named.values():
        assert f'data-point="{each.delta!r},{each.epsilon!r}"' in said
    assert said.count("<tr>") == len(found.events) + 1
    assert ("∞, 0" in said) == any(each.kind == "GR" for each in found.events)
    state = PointTabsState.parse({"to": "0.65,0.08"})
    assert state.to == to
    assert PointTabsState.parse(state.address_texts()) == state
    for wrong in ("0,1", "1", "1,-1", "nan,1", "a,b"):
        assert PointTabsState.parse({"to": wrong}).to is None


def test_a_click_with_shift_goes_through(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, REGIONS))
        await eventually(lambda: cells(shown) and shown.plane is not None)
        shown.store.dispatch(DiagramEndChosen((0.55, 0.05)))  # nothing is open: then it is
        assert shown.view.point == (0.55, 0.05)
        shown.store.dispatch(DiagramEndChosen((0.65, 0.08)))
        assert shown.view.point == (0.55, 0.05)
        assert "p.to=0.65,0.08" in shown.view.query()
        line = shown.map.ellipse_at.data
        assert (list(line["x"][-2:]), list(line["y"][-2:])) == ([0.55, 0.65], [0.05, 0.08])
        keys = shown.map.figure.tags[0]
        keys.data = {"steps": [0], "number": [0], "word": ["point 0.7,0.09"]}
        assert shown.view.point == (0.7, 0.09)
        assert "p.to" not in shown.view.query()
        keys.data = {"steps": [0], "number": [0], "word": ["point nonsense"]}
        assert shown.view.point == (0.7, 0.09)

    with points_in(IN_A_THREAD):
        with_map(tmp_path, body)
