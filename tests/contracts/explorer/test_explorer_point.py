"""The view of one parameter point without a browser: its words, its parts, and how they come together."""

import asyncio
import os
import re
from collections.abc import Awaitable, Callable
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from bokeh.models import HoverTool
from depth import either
from service_support import no_cluster
from waiting import HANG, eventually

import rattle
from gear_rattle.service.app import create_app
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.address import View
from gear_rattle.service.explorer.common.point_state import PointTabsState
from gear_rattle.service.explorer.design.places import CRISES
from gear_rattle.service.explorer.places.exact import ExactMaps
from gear_rattle.service.explorer.places.example import REQUEST as EXAMPLE
from gear_rattle.service.explorer.point import parts, words, work
from gear_rattle.service.explorer.point.basins import MOST_NAMED, basins_legend
from gear_rattle.service.explorer.point.motion import motion_caption
from gear_rattle.service.explorer.point.panel import PointPanel
from gear_rattle.service.explorer.point.parts import DiagramContents, DrawnBranchPart, EventImpacts
from gear_rattle.service.explorer.point.point_diagram import (
    DiagramPicture,
    dense_speed_range,
    diagram_caption,
    diagram_legend_html,
    place_event_names,
    speed_range,
)
from gear_rattle.service.explorer.point.view import PointView
from gear_rattle.service.explorer.point.work import prepare_processes
from gear_rattle.service.explorer.state.events import DiagramPointChosen, TabChosen
from gear_rattle.service.explorer.state.store import PageStore
from gear_rattle.service.operations import diagrams
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from rattle.models import AnyGear, Impacting, Model, Stiff
from rattle.plot import FIGURE_5
from rattle.plot.colours import Palette
from rattle.stiff import StiffGear

# Words


@pytest.mark.parametrize(
    ("delta", "epsilon", "likely", "safe"),
    [
        (0.6, 0.03, ["quietly in 100 %", "No start came to rattle", "below 0.374 %"], ["No impact slower than 7"]),
        (0.6, 0.1, ["quietly in 7", "Otherwise it rattles: chaotic", "every forcing period, P(1,1,0)"], ["speed 2.5"]),
        (0.6, 0.2, ["From every start the gear rattles", "It rattles"], ["margin is 0"]),
        (0.6, 0.1899, ["quiet"], ["cannot be computed"]),
    ],
)  # fmt: skip
def test_a_sentence_for_an_engineer(delta: float, epsilon: float, likely: list[str], safe: list[str]) -> None:
    gear = rattle.Gear(delta, epsilon)
    said = words.likelihood_in_words(gear, parts.sampled_attractors(gear, 1024))
    assert all(word in said for word in likely), said
    said = words.margin_in_words(gear, parts.compute_quiet_margin(gear))
    assert all(word in said for word in safe), said


def test_the_numbers_of_the_sentence_are_the_library_s() -> None:
    gear = rattle.Gear(0.6, 0.089)
    found = parts.sampled_attractors(gear, 512)
    quiet = next(each for each in gear.attractors(512) if each.kind == "quiet")
    numbers = [float(x) for x in re.findall(r"([\d.]+) %", words.likelihood_in_words(gear, found))]
    low, high = quiet.fraction_interval
    assert numbers[:4] == pytest.approx([100 * quiet.fraction, 95, 100 * low, 100 * high], rel=5e-3)
    assert words.number_text(gear.quiet_limit) in words.quiet_limit_in_words(gear)
    margin = parts.compute_quiet_margin(gear)
    assert margin[:3] == gear.boundary_distance(7.0)
    assert margin.leads_to is not None
    assert margin.leads_to.kind != "quiet"
    assert f"speed {margin.v:.4g}" in words.margin_in_words(gear, margin)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (1e-5, "less than 0.05 %"),
        (1 - 1e-5, "at least 99.95 %"),
        (0.9995, "at least 99.95 %"),
        (0.12345, "12.3 %"),
    ],
)
def test_shares(value: float, said: str) -> None:
    assert words.percent_text(value) == said


@pytest.mark.parametrize(
    ("pair", "said"),
    [
        ((complex(0.1, 0.7), complex(0.1, -0.7)), "0.1 ± 0.7i"),
        ((complex(-2.5), complex(0.25)), "−2.5, 0.25"),
        ((complex(np.inf), complex(0)), "∞, 0"),
        (None, "–"),
    ],
)
def test_multipliers(pair: tuple[complex, complex] | None, said: str) -> None:
    assert words.multipliers_text(pair) == said


# Parts


def test_attractors_have_their_letters_and_multipliers() -> None:
    gear = rattle.Gear(0.6, 0.089)
    found = parts.sampled_attractors(gear, 256)
    stable = {orbit.name: orbit for orbit in gear.orbits() if orbit.stable}
    assert {letter for letter in found.letters if letter} == set(stable)
    for each, letter, multipliers in zip(found.attractors, found.letters, found.multipliers, strict=True):
        assert (multipliers is None) == (each.kind != "periodic")
        if multipliers is not None:  # the product of an orbit's multipliers is exp(−δm)
            assert abs(multipliers[0] * multipliers[1] - np.exp(-0.6 * each.m)) < 1e-9
        if letter:
            assert each.v == pytest.approx(stable[letter].v, abs=1e-6)


def test_lines_are_the_manifolds_and_gamma() -> None:
    gear = rattle.Gear(0.6, 0.1)
    found = {line.name: line.points for line in parts.compute_plane_lines(gear).lines}
    assert set(found) == {"Γ", "Wˢ(A)", "Wˢ(B)", "Wᵘ(A)"}
    a = next(orbit for orbit in gear.orbits() if orbit.name == "A")
    for name in ("Wˢ(A)", "Wᵘ(A)"):
        assert np.nanmin(np.hypot(found[name][:, 0] - a.tau, found[name][:, 1] - a.v)) < 0.02
    assert len(parts.compute_plane_lines(rattle.Gear(0.6, 0.03)).lines) <= 1  # no saddle there


@pytest.mark.parametrize(("delta", "epsilon"), [(0.6, 0.1), (0.03, 0.005), (1e-9, 0.0), (5.0, 3.0)])
def test_a_diagram_stays_inside_the_plane(delta: float, epsilon: float) -> None:
    gear = rattle.Gear(delta, epsilon)
    low, high = diagrams.diagram_span(gear, "delta")
    assert 0 < low < delta < high
    low, high = diagrams.diagram_span(gear, "epsilon")
    assert 0 <= low <= epsilon < high


def test_a_view_where_real_gears_are_has_their_scales() -> None:
    gear = rattle.Gear(0.003632, 5.8468e-4, 0.0047582)
    highest = parts.largest_sampled_speed(gear.delta, gear.epsilon, gear.beta)
    assert highest == pytest.approx(1.5 * np.sqrt(16 * np.pi * gear.delta * gear.beta) + 2 * np.pi * gear.epsilon)
    assert parts.compute_basins(gear, 20, "cells").v_max == highest
    for line in parts.compute_plane_lines(gear).lines:
        steps = np.abs(np.diff(line.points, axis=0)) / [1.0, highest / 7]
        assert np.nanmax(steps[:, 1]) < 0.05 + 1e-9, line.name
    low, high = diagrams.diagram_span(gear, "epsilon")
    assert high - low < gear.epsilon
    more = rattle.Gear(0.03, 0.005, 0.03)  # more damping: a margin of weak damping takes a while
    assert (
        parts.compute_quiet_margin(more).v_max == parts.largest_sampled_speed(more.delta, more.epsilon, more.beta) < 7
    )
    assert PointTabsState(start=(0.3, 0.02)).without_start_above(highest).start == (0.3, 0.02)
    assert PointTabsState(start=(0.3, 4.0)).without_start_above(highest).start is None


def test_a_set_of_orbits_that_is_no_region_is_named() -> None:
    gear = rattle.Gear(0.049079, 0.01905, 0.022042)
    assert ": orbits A, B and D, no region of the paper." in words.point_in_words(gear)
    assert "orbits A, B and D" in words.orbits_table(parts.compute_period_one_orbits(gear))
    assert ": region III." in words.point_in_words(rattle.Gear(0.6, 0.07))


def test_the_birth_of_rattle_is_told_where_it_happens() -> None:
    assert "P(1,1,0), begins at ε = 0.05964." in words.quiet_limit_in_words(rattle.Gear(0.6, 0.05))
    for beyond_cod22 in (rattle.Gear(0.8, 0.1), rattle.Gear(0.05, 1e-4, 0.001)):
        assert "begins" not in words.quiet_limit_in_words(beyond_cod22)


def test_a_legend_of_many_basins_names_the_largest() -> None:
    found = rattle.Gear(0.6, 0.089).basins(40)
    many = replace(
        found,
        attractors=tuple(replace(found.attractors[1], n_plus=k) for k in range(1, 41)),
        labels=np.repeat(np.arange(40), 40).reshape(40, 40),
    )
    said = basins_legend(many, (), Palette())
    assert said.count("<li>") == MOST_NAMED + 1
    assert f"and {40 - MOST_NAMED} more, {100 * (40 - MOST_NAMED) / 40:.3g} % in all" in said


def test_numbers_of_things_and_periods() -> None:
    assert [words.count_in_words(count, "event") for count in (0, 1, 2, 1024)] == [
        "0 events", "1 event", "2 events", "1,024 events",
    ]  # fmt: skip
    assert words.repetition_in_words(1, words.period_name(None)) == "every forcing period"
    alone = rattle.Machine(0.003, 5e-4, 1e-4, 1e-5, 0.05, rpm=3000)
    assert words.repetition_in_words(2, words.period_name(alone)) == "every 2 revolutions"
    other = {"driven_teeth": 31, "driven_inertia": 0.01, "driven_drag": 1e-3, "driven_eccentricity": 1e-5}
    pair = replace(alone, teeth=20, **other)
    assert pair.revolutions == 31
    assert words.repetition_in_words(2, words.period_name(pair)) == "every 2 forcing periods"


def test_a_table_folds_what_comes_after_six_rows() -> None:
    rows = [(str(i), "x") for i in range(7)]
    said = words.folded_html_table("Seven", ("Row", "Text"), rows)
    assert "<summary>All 7 rows</summary>" in said
    assert said.count("<tr>") == 8  # with the head
    assert "<details>" not in words.folded_html_table("Six", ("Row", "Text"), rows[:6])


def test_a_survey_s_cell_answers_where_it_lists_all_attractors() -> None:
    plane = ExactMaps().plane("quiet_fraction", 0)  # of the example
    at = 0.6, 0.0995
    cell = plane.cell_at(*at)
    assert cell is not None
    found = parts.attractors_of_survey_cell(cell, 64)
    assert found is not None
    axes = zip((plane.delta, plane.epsilon), at, strict=True)
    gear = rattle.Gear(*(float(axis[np.abs(axis - here).argmin()]) for axis, here in axes))
    expected = {each.name: each for each in gear.attractors(64)}
    assert {each.name for each in found.attractors} == set(expected)
    for each in found.attractors:
        assert each.fraction == expected[each.name].fraction
        assert each.fraction_interval == pytest.approx(expected[each.name].fraction_interval, abs=1e-12)
    assert words.likelihood_in_words(gear, found) == words.likelihood_in_words(
        gear, parts.SampledAttractors(64, tuple(expected.values()), (None,) * len(expected), ("",) * len(expected))
    )
    assert parts.attractors_of_survey_cell(cell.isel(attractor=slice(0, 1)), 64) is None  # some are not listed
    assert parts.attractors_of_survey_cell(cell.drop_vars("attractor_kind"), 64) is None


def test_a_bar_has_the_shares_of_all_attractors() -> None:
    found = parts.sampled_attractors(rattle.Gear(0.6, 0.1), 64)
    said = words.basin_fractions_bar_html(found, Palette())
    shares = [float(each) for each in re.findall(r"flex-grow:([\d.]+)", said)]
    assert shares == pytest.approx([each.fraction for each in found.attractors], abs=1e-6)
    assert re.search(r'role="img" aria-label="Shares of starts: quiet 7[\d.]+ %; chaotic', said)


def drawn(marks: EventImpacts, v: np.ndarray, upward: np.ndarray) -> DiagramContents:
    """A diagram with these events, and an unstable motion that has these speeds."""
    at = np.linspace(0.1, 0.2, v.size)
    stroke = DrawnBranchPart(at, v, at, "P(1,1,0), A", False)
    return DiagramContents("epsilon", None, (0.0, 1.0), (stroke,), marks, (), at, v, at, upward)


def test_events_are_told_beside_their_motions_and_markers_explained() -> None:
    at = np.array([0.1, 0.1, 0.2])
    marks = EventImpacts(at, at, at, ("SN", "PD", "PD"), ("SN1", "", ""), ("P(1,1,0)", "P(2,2,1)", "P(2,2,1)"))
    found = drawn(marks, at, np.array([True, False, False]))
    picture = DiagramPicture("light")
    picture.show(found, 0.1)
    tools = [each for each in picture.figure.toolbar.tools if isinstance(each, HoverTool)]
    assert sorted((each.attachment, len(each.renderers)) for each in tools) == [("left", 1), ("right", 1)]
    (events,) = [each.renderers[0].data_source.data for each in tools if each.attachment == "right"]
    assert events["what"][:2] == ["SN1, saddle-node of P(1,1,0)", "period doubling of P(2,2,1)"]
    assert events["marker"] == ["circle", "diamond", "diamond"]
    said = diagram_legend_html(found, "light")
    for word in ("unstable", "swept upward", "swept downward", "saddle-node", "period doubling", "here"):
        assert word in said
    for word in ("grazing", ">stable"):
        assert word not in said
    assert "1 periodic motion, 0 events, among them SN1." in diagram_caption(found)


def test_a_diagram_s_axis_is_fitted_to_its_speeds_with_room_for_the_names_of_events() -> None:
    at, v = np.array([0.1, 0.12, 0.9]), np.array([4.7, 4.8, 4.9])
    marks = EventImpacts(at, v, at, ("SN", "PD", "GR"), ("", "PD1", ""), ("P(1,1,0)", "P(1,1,1)", "P(2,2,1)"))
    found = drawn(marks, v, np.array([True, True, True]))
    low, high = speed_range(found)
    assert (low, high) == pytest.approx((4.692, 4.908))
    picture = DiagramPicture("light")
    picture.show(found, 0.1)
    axis = picture.figure.y_range
    assert axis.start == low
    assert high < axis.end < high + 0.25 * (high - low)
    names = {each.text: each for each in place_event_names(found, 300)}
    assert set(names) == {"saddle-node P(1,1,0)", "period doubling PD1", "grazing P(2,2,1)"}
    one, other = names["saddle-node P(1,1,0)"], names["period doubling PD1"]
    assert one.row != other.row  # they are too close to stand side by side
    assert not one.collides_with(other)
    assert names["grazing P(2,2,1)"].align == "right"  # or the edge would cut it off
    assert names["grazing P(2,2,1)"].right <= 300
    many = np.linspace(0.3, 0.31, 40)
    crowd = EventImpacts(many, many, many, ("PD",) * 40, ("",) * 40, ("P(1,1,0)",) * 40)
    placed = place_event_names(drawn(crowd, many, np.ones(40, bool)), 300)
    assert 1 <= len(placed) < 10
    assert not any(one.collides_with(other) for one in placed for other in placed if one is not other)


def test_a_cascade_beside_slow_motions_fills_most_of_the_axis() -> None:
    at, beyond = FIGURE_5
    found = parts.compute_diagram_contents(rattle.Gear(at, sum(beyond) / 2), "epsilon", (beyond[1] - beyond[0]) / 2)
    low, high = speed_range(found)
    assert low < 0.5  # slow motions beyond the crisis
    dense = dense_speed_range(found)
    assert dense is not None
    cascade = found.v[(found.x < CRISES["0.6"][1]) & (found.v > 4.0)]
    height = dense[1] - dense[0]
    inside = np.clip(np.quantile(cascade, (0.01, 0.99)), *dense)
    assert np.ptp(inside) > 0.8 * height > 0.8 * np.ptp(cascade) / 1.1
    assert np.ptp(cascade) < 0.25 * (high - low)
    picture = DiagramPicture("light")
    picture.show(found, 0.1)
    assert picture.speeds.visible
    axis = picture.figure.y_range
    assert axis.start == dense[0]
    assert np.ptp(inside) > 0.5 * (axis.end - axis.start)  # names of events are above
    picture.speeds.value = "all"
    assert axis.start == low
    picture.clear()
    assert not picture.speeds.visible


def test_an_axis_without_dense_speeds_shows_all() -> None:
    v = np.linspace(1.0, 4.0, 500)
    nothing = np.array([])
    found = drawn(EventImpacts(nothing, nothing, nothing, (), (), ()), v, np.ones(500, bool))
    assert dense_speed_range(found) is None
    assert dense_speed_range(found._replace(x=nothing, v=nothing, upward=nothing.astype(bool))) is None
    picture = DiagramPicture("light")
    picture.show(found, 0.1)
    assert not picture.speeds.visible
    assert picture.figure.y_range.start == speed_range(found)[0]


def test_impacts_of_a_periodic_motion_are_those_of_its_period() -> None:
    attractor = replace(rattle.Gear(0.6, 0.1).attractors(64)[-1], kind="periodic", m=8, n_plus=8, n_minus=6)
    shown = rattle.Gear(0.6, 0.1).trajectory(attractor.tau, attractor.v, 24.0, 100)
    assert "8 impacts on the wall Φ = β and 6 on Φ = −β every 8 revolutions" in motion_caption(
        shown, "it", words.REVOLUTION, attractor
    )
    assert "it: 1 impact on the wall" in motion_caption(shown, "it", words.PERIOD, replace(attractor, n_plus=1))
    cut = f"{np.count_nonzero(shown.impact_wall == 1)} impacts on the wall Φ = β"
    assert f"{cut} and 0 on Φ = −β in 24 forcing periods" in motion_caption(shown, "it")
    for rest, said in ((1.0, "after 1 revolution."), (0.5, "after 0.5 revolutions.")):
        assert said in motion_caption(shown._replace(rest=rest), "it", words.REVOLUTION)


@pytest.mark.parametrize("direction", ["epsilon", "delta"])
def test_a_diagram_through_the_point(direction: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagrams, "default_steps", lambda _: either(20, 160))
    found = parts.compute_diagram_contents(rattle.Gear(0.6, 0.1), direction)
    assert 0 < found.x.size <= 2 * parts.DRAWN_POINTS
    assert {each.stable for each in found.branch_parts} == {True, False}
    along_a = [each for each in found.branch_parts if each.motion == "P(1,1,0), A"]
    assert along_a
    for each in along_a:  # v = 2πδ all along the branch
        at = each.x if direction == "delta" else np.full_like(each.x, 0.6)
        np.testing.assert_allclose(each.v, 2 * np.pi * at, rtol=1e-8)
        assert not each.stable
    assert set(found.event_impacts.kind) <= {"SN", "PD", "GR"}
    low, high = found.span
    assert np.all((found.event_impacts.x >= low) & (found.event_impacts.x <= high))


def test_the_link_to_the_notebook_has_the_point_and_the_diagram_to_the_last_bit() -> None:
    def asked(gear: AnyGear, *shown: Any) -> dict[str, list[str]]:
        (address,) = re.findall(r'href="([^"]+)" download', words.notebook_link(gear, *shown))
        return parse_qs(urlsplit(unescape(address)).query)

    gear = rattle.Gear(0.1 + 0.2, 0.1, 0.5)
    point = {"delta": [repr(0.1 + 0.2)], "epsilon": ["0.1"], "beta": ["0.5"]}
    assert asked(gear, "epsilon", None, None) == point | {"direction": ["epsilon"]}
    assert asked(gear, "delta", 0.01, None) == point | {"direction": ["delta"], "span": ["0.01"]}
    assert asked(gear, "epsilon", None, (0.4, 0.0)) == point | {"to_delta": ["0.4"], "to_epsilon": ["0.0"]}
    assert asked(StiffGear(0.6, 0.1, 0.5, 1e4), "epsilon", None, None)["kappa"] == ["10000.0"]


def test_a_diagram_has_as_many_steps_as_are_set_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagrams, "default_steps", lambda _: 4)
    monkeypatch.setattr(diagrams, "COUNT", 2)
    assert np.unique(parts.compute_diagram_contents(rattle.Gear(0.6, 0.03), "epsilon").x).size <= 5


# State


@pytest.mark.parametrize(
    "state",
    [
        {}, {"attractor": "0"}, {"attractor": "3"}, {"tau": "0.25", "v": "4.5"}, {"direction": "delta"},
        {"tolerance": "0.02,0.01,0.9"}, {"at": "0.25"}, {"tab": "numbers"}, {"attractor": "3", "tab": "answer"},
    ],
)  # fmt: skip
def test_a_state_is_kept(state: dict[str, str]) -> None:
    assert PointTabsState.parse(state).address_texts() == state


@pytest.mark.parametrize(
    "state",
    [
        {"attractor": "x"}, {"attractor": "-1"}, {"attractor": "1e9"}, {"tau": "nan", "v": "4"}, {"tau": "0.5"},
        {"tau": "0.5", "v": "inf"}, {"tau": "1.5", "v": "3"}, {"tau": "0.5", "v": "0"}, {"tau": "0.5", "v": "1e300"},
        {"direction": "<script>"}, {"other": "1"}, {"tolerance": "0.1"}, {"tolerance": "1,2,nan"},
        {"tolerance": "-1,1,0.9"}, {"at": "1.5"}, {"at": "nan"}, {"at": "x"}, {"tab": "table"},
    ],
)  # fmt: skip
def test_what_of_a_state_cannot_be_read_is_as_by_default(state: dict[str, str]) -> None:
    assert PointTabsState.parse(state).without_start_above(7.0) == PointTabsState()


@pytest.mark.parametrize(
    ("state", "tab"),
    [
        ({}, "answer"), ({"attractor": "0"}, "motion"), ({"tau": "0.25", "v": "4.5"}, "motion"),
        ({"direction": "delta"}, "diagram"), ({"to": "0.7,0.1"}, "diagram"), ({"span": "0.01"}, "diagram"),
        ({"at": "0.25"}, "basins"), ({"attractor": "0", "tab": "basins"}, "basins"), ({"tab": "x"}, "answer"),
    ],
)  # fmt: skip
def test_an_address_without_a_tab_opens_the_one_of_its_choice(state: dict[str, str], tab: str) -> None:
    assert PointTabsState.parse(state).shown_tab == tab


# The view

COARSER = either(6, 1)  # basins


def new_view(
    front: ApplicationState,
    delta: float,
    epsilon: float,
    model: Model,
    machine: rattle.Machine | None = None,
    panel: PointPanel | None = None,
    state: PointTabsState | None = None,
) -> PointView:
    """The view of a point, in a store of its own."""
    store = PageStore(View(point=(delta, epsilon), point_state=state or PointTabsState()), EXAMPLE)
    return PointView(panel or PointPanel("light", store.dispatch), front, store, delta, epsilon, model, machine)


def with_front(data: Path, body: Callable[[ApplicationState], Awaitable[None]], **settings: Any) -> None:
    async def main() -> None:
        app = create_app(Settings(data=data, max_point_seconds=HANG, explorer=False, **settings), no_cluster)
        async with app.router.lifespan_context(app):
            await body(app.state.front)

    asyncio.run(main())


def coarse(work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """A part of a view, computed here, with few cells and starts."""
    if work in (parts.compute_basins, parts.compute_basins_and_orbits):
        arguments = (arguments[0], 40, "cells")
    if work is parts.sampled_attractors:
        arguments = (arguments[0], 64)
    return work(*arguments)


def is_filled(view: PointView, *texts: str) -> bool:
    said = [getattr(view.panel, each).html for each in texts]
    return all(each and "computing" not in each for each in said)


async def opened(view: PointView, tab: str, *texts: str) -> None:
    """Open a tab, and wait until it is filled."""
    view.store.dispatch(TabChosen(tab))
    await eventually(lambda: is_filled(view, *texts))


def with_process(compute: Callable[..., Any], *arguments: Any) -> tuple[int, Any]:
    """What a function returns, and the process that computed it."""
    diagrams.default_steps = lambda _: either(10, 160)  # in that process
    return os.getpid(), compute(*arguments)


def test_all_parts_fill_in_and_follow_what_is_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computed: dict[str, set[int]] = {}
    known: dict[str, Any] = {}  # by what is asked: the second view needs most of it again

    async def in_process_and_noted(front: ApplicationState, *work: Any, **words: Any) -> Any:
        if (asked := repr(work)) in known:
            return known[asked]
        if work[0] is parts.compute_basins:
            work = (*work[:2], work[2] // COARSER, work[3])
        process, found = await compute_in_process(front, with_process, *work, **words)
        computed.setdefault(words["what"], set()).add(process)
        known[asked] = found
        return found

    async def body(front: ApplicationState) -> None:
        await prepare_processes(front)
        monkeypatch.setattr(work, "compute_in_process", in_process_and_noted)
        view = new_view(front, 0.6, 0.1, Impacting(0.6))
        assert "region IV" in view.panel.parameters_text.html
        assert "2.602, 0.2109" in view.panel.orbits.html
        await eventually(
            lambda: is_filled(view, "likelihood_text", "margin_text", "intensities_text", "loudest_motion_text")
        )
        expected = {"The attractors", "The intensities", "The margin", "The range of a motion", "The boundary crisis"}
        assert set(computed) <= expected  # no picture
        await eventually(lambda: is_filled(view, "extents") and set(computed) == expected)
        await opened(view, "basins", "under_basins")
        await eventually(lambda: f"{600 // COARSER} ×" in view.panel.under_basins.html)
        await opened(view, "motion", "under_motion", "under_spectrum")
        await opened(view, "numbers", "events")
        await opened(view, "diagram", "under_diagram")
        assert len(computed) == 10
        processes = set.union(*computed.values())
        assert os.getpid() not in processes  # the loop runs on
        assert len(processes) <= front.settings.max_points  # which stay warm
        assert "quietly in 7" in view.panel.likelihood_text.html
        assert "<caption>Attractors from 1,024 starts</caption>" in view.panel.table.html
        assert "chaotic" in view.panel.under_motion.html  # the first that is not quiet
        assert view.panel.events.html.count("data-point") > 6
        assert "<summary>All" in view.panel.events.html
        view.store.dispatch(TabChosen("answer"))
        assert view.store.view.point_state == PointTabsState()
        states: list[PointTabsState] = []
        view.store.subscribe(lambda: states.append(view.store.view.point_state), "point_state")
        view.panel.motion_choice.value = 2
        await eventually(lambda: view.panel.under_motion.html.startswith('<p class="faint">P(1,1,0)'))
        view.panel.picture.choose_clicked_state(type("Tap", (), {"x": 1.25, "y": 4.5}))
        await eventually(lambda: "initial condition" in view.panel.under_motion.html)
        samples = view.panel.motions.trajectory_source.data
        expected = rattle.Gear(0.6, 0.1).trajectory(0.25, 4.5, float(samples["t"][-1]), len(samples["t"]))
        np.testing.assert_array_equal(samples["phi"], expected.phi)
        view.panel.direction_buttons.value = "delta"
        await eventually(lambda: "damping δ" in view.panel.under_diagram.html)
        assert "direction=delta" in view.panel.notebook_link_text.html
        start = 0.25, 4.5
        assert states == [
            PointTabsState(attractor=2, tab="motion"), PointTabsState(start=start, tab="motion"),
            PointTabsState(start=start, direction="delta", tab="diagram"),
        ]  # fmt: skip
        again = new_view(front, 0.6, 0.1, Impacting(0.6), state=view.store.view.point_state)
        await eventually(lambda: again.panel.under_diagram.html == view.panel.under_diagram.html)
        again.store.dispatch(TabChosen("motion"))
        await eventually(lambda: again.panel.under_motion.html == view.panel.under_motion.html)
        assert again.panel.motion_choice.value == view.panel.motion_choice.value
        for each in (view, again):
            each.stop()

    with_front(tmp_path, body, max_points=either(1, 2))


def test_a_part_that_fails_says_so_and_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refusing(_: rattle.Gear) -> None:
        raise UnavailableError("a margin that takes <b>too long</b>")

    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.1, Impacting(0.6))

        async def compute(work: Any, *arguments: Any, what: str, slow: bool = False) -> Any:
            return refusing(arguments[0]) if slow and what == "The margin" else coarse(work, arguments)

        monkeypatch.setattr(view.work, "compute", compute)
        monkeypatch.setattr(diagrams, "default_steps", lambda _: 4)
        await eventually(lambda: is_filled(view, "likelihood_text", "margin_text", "intensities_text"))
        await opened(view, "basins", "under_basins")
        await opened(view, "diagram", "under_diagram")
        assert "too long" in view.panel.margin_text.html
        assert "<b>" not in view.panel.margin_text.html
        assert 'role="alert"' in view.panel.margin_text.html
        assert "quietly in 7" in view.panel.likelihood_text.html
        view.stop()

    with_front(tmp_path, body)


def test_a_view_that_is_put_away_computes_and_changes_nothing_more(tmp_path: Path) -> None:
    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.1, Impacting(0.6))
        await eventually(lambda: front.point_limiter.borrowed_tokens > 0)
        view.stop()
        said = view.panel.likelihood_text.html
        await eventually(lambda: not view.work.tasks)  # what was at work has ended, and nothing can follow
        assert view.panel.likelihood_text.html == said
        assert front.point_limiter.borrowed_tokens == 0
        assert front.point_limiter.statistics().tasks_waiting == 0

    with_front(tmp_path, body)


def test_where_the_next_point_is_comes_before_what_the_last_had_is_taken_away(tmp_path: Path) -> None:
    async def body(front: ApplicationState) -> None:
        first, left = new_view(front, 0.6, 0.1, Impacting(0.6)), list[str]()
        panel = first.panel
        first.stop()
        panel.margin_text.html = "safe so far"
        panel.parameters_text.pane.object.on_change(
            "text", lambda _attr, _old, _new: left.append(panel.margin_text.html)
        )
        new_view(front, 0.55, 0.08, Impacting(0.6), panel=panel).stop()
        assert left == ["safe so far"]
        assert "margin" in panel.margin_text.html  # of the next one, that is computed
        assert panel.parameters_text.html
        panel.clear()  # a point that is closed
        assert panel.parameters_text.html == panel.margin_text.html == ""

    with_front(tmp_path, body)


@pytest.mark.parametrize(("delta", "epsilon"), [(-1.0, 0.1), (0.6, float("nan")), (0.0, 0.1)])
def test_a_point_outside_the_plane_is_told(tmp_path: Path, delta: float, epsilon: float) -> None:
    async def body(front: ApplicationState) -> None:
        first = new_view(front, 0.6, 0.1, Impacting(0.6))
        panel = first.panel
        first.stop()
        view = new_view(front, delta, epsilon, Impacting(0.6), panel=panel)
        assert "must" in view.panel.likelihood_text.html
        assert panel.parameters_text.html == panel.margin_text.html == ""
        view.store.dispatch(TabChosen("motion"))
        view.stop()
        assert "must" in view.panel.likelihood_text.html

    with_front(tmp_path, body)


def test_the_survey_s_answer_comes_first_and_the_sharper_one_replaces_it(tmp_path: Path) -> None:
    cell = ExactMaps().plane("quiet_fraction", 0).cell_at(0.6, 0.1)
    assert cell is not None
    surveyed = parts.attractors_of_survey_cell(cell, 64)
    assert surveyed is not None

    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.1, Impacting(0.6))
        view.show_survey_attractors(surveyed)
        assert "from 64 starts" in view.panel.likelihood_text.html
        assert "from the survey's grid cell" in view.panel.likelihood_text.html
        await eventually(lambda: "from 1,024 starts" in view.panel.likelihood_text.html)
        assert "grid cell" not in view.panel.likelihood_text.html
        view.show_survey_attractors(surveyed)  # too late
        assert "from 1,024 starts" in view.panel.likelihood_text.html
        view.stop()

    with_front(tmp_path, body)


def test_basins_and_motion_follow_the_slider_along_the_diagram(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.089, Impacting(0.6), state=PointTabsState(tab="basins"))

        async def compute(work: Any, *arguments: Any, **_: Any) -> Any:
            return coarse(work, arguments)

        def is_shown(gear: rattle.Gear) -> bool:
            labels = view.panel.picture.figure.select_one({"level": "image"}).data_source.data["label"]
            return bool(labels and np.array_equal(labels[0], gear.basins(40, None, "cells").labels))

        def is_followed(gear: rattle.Gear, attractors: tuple[rattle.Attractor, ...]) -> bool:
            named = [each for each in attractors if each.name == first.name]
            shown = (named or [each for each in attractors if each.kind != "quiet"])[0]
            t, phi = (view.panel.motions.trajectory_source.data[each] for each in ("t", "phi"))
            return len(t) > 0 and np.array_equal(phi, gear.trajectory(shown.tau, shown.v, float(t[-1]), len(t)).phi)

        monkeypatch.setattr(view.work, "compute", compute)
        own, slider = rattle.Gear(0.6, 0.089), view.panel.diagram_slider
        first = next(each for each in own.attractors(64) if each.kind != "quiet")
        await eventually(lambda: is_shown(own) and "Wˢ(A)" in view.panel.under_basins.html)
        low, high = diagrams.diagram_span(own, "epsilon")
        home, there = slider.value, rattle.Gear(0.6, 0.25 * low + 0.75 * high)
        slider.value = 75
        assert view.store.view.point_state.at == 0.75
        assert f"at δ 0.6, ε {there.epsilon:.5g}" in slider.label
        await eventually(lambda: is_shown(there))
        assert "Wˢ(A)" not in view.panel.under_basins.html
        view.store.dispatch(TabChosen("motion"))
        attractors = there.basins(40, None, "cells").attractors
        await eventually(lambda: is_followed(there, attractors))
        slider.value = home
        assert view.store.view.point_state == PointTabsState(tab="motion")
        assert is_shown(own)
        assert "Wˢ(A)" in view.panel.under_basins.html
        await eventually(lambda: is_followed(own, (first,)))
        view.store.dispatch(DiagramPointChosen(0.75))
        await eventually(lambda: is_shown(there))
        view.stop()

    with_front(tmp_path, body)


def test_a_point_of_the_stiff_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.075, Stiff(0.6, 1e4))
        asked: list[str] = []

        async def compute(work: Any, *arguments: Any, what: str, **_slow: bool) -> Any:
            asked.append(what)
            return coarse(work, arguments)

        monkeypatch.setattr(view.work, "compute", compute)
        monkeypatch.setattr(diagrams, "default_steps", lambda _: 4)
        assert "stiffness κ = 10000" in view.panel.parameters_text.html
        await eventually(lambda: is_filled(view, "likelihood_text", "margin_text", "orbits"))
        await opened(view, "basins", "under_basins")
        await eventually(lambda: asked.count("The basins") == 3)
        await opened(view, "motion", "under_motion", "under_spectrum")
        await opened(view, "diagram", "under_diagram")
        gear = StiffGear(0.6, 0.075, 0.6, 1e4)
        quiet = next(each for each in gear.attractors(64) if each.kind == "quiet")
        assert words.percent_text(quiet.fraction) in view.panel.likelihood_text.html
        assert "region III" in view.panel.orbits.html
        assert words.number_text(gear.orbits()[0].v) in view.panel.orbits.html
        named = {each.name for each in gear.orbits() if each.stable}
        assert named
        for name in named:  # known after the attractors were told
            assert f" = {name}" in view.panel.likelihood_text.html
            assert f" = {name}</th>" in view.panel.table.html
        tools = [each for each in view.panel.diagram.figure.toolbar.tools if isinstance(each, HoverTool)]
        (told,) = [each.renderers[0].data_source.data["what"] for each in tools if each.attachment == "right"]
        assert told
        assert all(
            re.fullmatch(r"(\w+, )?(saddle-node|period doubling|grazing) of P\(\d+,\d+,\d+\)", it) for it in told
        )
        samples = view.panel.motions.trajectory_source.data
        assert np.abs(samples["phi"]).max() > 0.6  # the walls give way
        assert "only for the impacting model" in view.panel.margin_text.html
        assert "The margin" not in asked
        named = re.findall(r"</span>([^<]*\([AB]\)|Γ)</li>", view.panel.under_basins.html)
        assert named == ["Wˢ(A)", "Wˢ(B)", "Wᵘ(A)"]
        view.stop()

    with_front(tmp_path, body)
