"""Maps beside the first one: of its window and cursor, of other variables and surveys, and differences."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import parse_qsl

import numpy as np
import pytest
from service_support import BODY
from test_explorer_view import Shown, accepted, done, with_map
from waiting import eventually

import rattle
from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import ComparisonChoice, View
from gear_rattle.service.explorer.further import difference
from gear_rattle.service.explorer.further.difference import DifferenceMap, require_small_survey
from gear_rattle.service.explorer.further.maps import ComparisonMaps
from gear_rattle.service.explorer.further.one import NO_FIRST
from gear_rattle.service.explorer.map import overlays
from gear_rattle.service.explorer.map.colouring import compute_colouring
from gear_rattle.service.explorer.map.planes import MapPlane
from gear_rattle.service.explorer.map.shared import SharedState
from gear_rattle.service.explorer.state.events import (
    ComparisonMapAdded,
    ComparisonMapChanged,
    ComparisonMapRemoved,
    OverlaysChosen,
    PointerMoved,
    SurveyChosen,
)
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.errors import SurveyError
from rattle.models import DEFAULT_MODEL, MODELS, Model, Stiff

pytestmark = pytest.mark.usefixtures("templates_once")

ORBITS = SurveyRequest(**BODY | {"quantities": ["region", "orbits"]})
COARSER = SurveyRequest(
    **BODY | {
        "name": "other", "beta": 0.5, "quantities": ["region", "orbits"],
        "delta": {"start": 0.52, "stop": 0.66, "num": 3},
    }
)  # fmt: skip

FEW = {"delta": {"start": 0.8, "stop": 0.9, "num": 2}, "epsilon": {"start": 0.05, "stop": 0.15, "num": 2}}
STIFF = SurveyRequest(
    **BODY | FEW | {"model": "stiff", "kappa": 1e4, "quantities": ["region"], "tile": {"delta": 2, "epsilon": 2}}
)

REGIONS = SurveyRequest(**BODY | FEW | {"quantities": ["region"], "tile": {"delta": 2, "epsilon": 2}})
NARROWER = REGIONS.model_copy(update={"beta": 0.5})
THIRD = SurveyRequest(**BODY | {"quantities": ["region"], "beta": {"start": 0.5, "stop": 0.6, "num": 2}})


def test_a_difference_is_of_each_cell_with_the_one_that_it_is_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        jobs = done(front, ORBITS), done(front, COARSER)

        def planes(variable: str, index: int) -> list[MapPlane]:
            return [shown.shared.plane(job, variable, index, 0) for job in jobs]

        for variable, index in (("orbit_velocity", 3), ("orbit_phase", 0), ("region", 0)):
            first, other = planes(variable, index)
            found = DifferenceMap(first, other)
            assert not found.has_same_grid
            for i, j in np.ndindex(found.values.shape):
                delta, epsilon = float(first.delta[j]), float(first.epsilon[i])
                mine, theirs = first.value_and_status(delta, epsilon), other.value_and_status(delta, epsilon)
                assert mine is not None
                assert found.status[i, j] == (theirs is not None)
                if theirs is None or np.isnan(mine[0] - theirs[0]):
                    assert np.isnan(found.values[i, j])
                    continue
                expected = mine[0] - theirs[0]
                if variable == "region":
                    expected = float(expected != 0)
                elif variable == "orbit_phase":
                    expected -= round(expected)
                assert found.values[i, j] == pytest.approx(expected, abs=1e-6)
        assert np.isfinite(found.values).sum() == 4 * 5  # of six columns the last is beyond
        shades = {each.label: each.share for each in compute_colouring(found, found.block(), "auto", False).shades}
        changed = np.mean([rattle.regions(d, e, 0.6) != rattle.regions(o, e, 0.5) for d, e, o in _pairs(first, other)])
        assert shades["different"] == pytest.approx(changed)
        (same,) = planes("orbit_velocity", 3)[:1]
        nothing = DifferenceMap(same, same)
        assert nothing.has_same_grid
        known = np.isfinite(same.values)
        assert known.any()
        assert (nothing.values[known] == 0).all()
        colours = compute_colouring(nothing, nothing.block(), "auto", False)
        assert colours.low == -colours.high  # nothing is in the middle
        assert colours.title.startswith("difference: ")
        monkeypatch.setattr(difference, "MOST_CELLS", 23)
        with pytest.raises(SurveyError, match="at most 23 cells, and one of these surveys has 24 cells"):
            require_small_survey(ORBITS)

    with_map(tmp_path, body)


def _pairs(first: MapPlane, other: MapPlane) -> list[tuple[Any, Any, Any]]:
    """δ and ε of the cells that both have, and the δ of the other one's."""
    near = [(d, other.delta[np.abs(other.delta - d).argmin()]) for d in first.delta[:-1]]
    return [(np.array([d]), np.array([e]), np.array([o])) for d, o in near for e in first.epsilon]


def beside(shown: Shown, shared: SharedState | None = None) -> ComparisonMaps:
    """The maps beside that of a page."""
    return ComparisonMaps(shared or shown.shared, shown.viewer, shown.store, shown.map, "light", "")


def test_further_maps_have_the_window_and_the_cursor_of_the_first(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        first, other, stiff = done(front, ORBITS), done(front, COARSER), done(front, STIFF)
        maps = beside(shown)
        shown.choose(first)
        for job in (other, stiff):
            shown.follow(job)
        await eventually(lambda: shown.plane is not None)
        assert maps.add_button.visible
        maps.add_button.clicks += 1
        assert shown.view.further == (ComparisonChoice(first.id, "orbit_exists"),)  # the next one that is not shown
        one = maps.maps[0]
        assert list(one.survey.options) == ["small", "other", f"small ({stiff.id[:6]})"]
        await eventually(lambda: one.plane is not None)
        assert one.figure.figure.x_range is shown.map.figure.x_range
        assert one.figure.figure.y_range is shown.map.figure.y_range
        one.survey.value = f"{stiff.id},0"
        assert shown.view.further[0].survey == stiff.id
        await eventually(lambda: one.plane is not None and one.plane.id == stiff.id)
        assert one.plane is not None
        assert one.plane.plane.name == one.variable.value.partition(",")[0] == "region"  # it has no orbits
        assert one.plane.request.gear_model == Stiff(0.6, 1e4)
        assert "stiff" in one.title.html
        window = (0.8, 0.9), (0.05, 0.15)
        shown.moved(*window)
        shown.hover(0.82, 0.1)
        await eventually(lambda: one.said.html)
        value = one.plane.value_and_status(0.82, 0.1)
        assert value is not None
        assert one.said.html.endswith(f", {rattle.REGIONS[int(value[0])]}</p>")
        cursors = shown.map.cursor_at, one.figure.cursor_at
        assert [each.data["x"] for each in cursors] == [[], [0.82]]  # where the pointer is, it needs no mark
        shown.store.dispatch(PointerMoved((0.85, 0.1), "further2"))
        assert [each.data["x"] for each in cursors] == [[0.85], [0.85]]
        told = {name: [value.encode()] for name, value in parse_qsl(shown.view.query()[1:])}
        assert View.parse(told).further == shown.view.further
        shown.reset()
        one.survey.value = f"{other.id},0"
        one.minus.value = ["first map less this one"]
        await eventually(lambda: isinstance(one.plane, DifferenceMap))
        assert (
            "small less other, each cell of the first survey with the nearest cell of the second, which has 3 × 4"
            in one.title.html
        )
        assert not one.variable.visible  # it is that of the first map
        shown.controls.variable.value = "orbit_velocity"
        await eventually(lambda: one.plane is not None and one.plane.plane.name == "orbit_velocity_difference")
        for _ in range(3):
            maps.add_button.clicks += 1
        assert len(shown.view.further) == 3
        assert not maps.add_button.visible
        shown.store.dispatch(ComparisonMapRemoved(1))
        assert [i for i, place in enumerate(maps.panels) if "shown" in place.css_classes] == [0, 1]
        shown.store.update_surveys({name: each for name, each in shown.store.jobs.items() if name != other.id})
        assert "no longer there" in one.title.html
        maps.end()

    with_map(tmp_path, body)


def test_what_an_address_has_that_is_not_there_is_told_and_not_tried_again_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        first, third = accepted(front, ORBITS), accepted(front, THIRD)
        asked: list[str] = []
        monkeypatch.setattr(difference, "MOST_CELLS", 0)

        def plane(job: JobRow, *_: Any) -> MapPlane:
            asked.append(job.id)
            raise SurveyError("It has no numbers yet.")

        shared = replace(shown.shared)
        object.__setattr__(shared, "plane", plane)
        maps = beside(shown, shared)
        shown.follow(first)
        shown.follow(third)
        shown.store.dispatch(ComparisonMapAdded(ComparisonChoice(third.id, "region", 0, 9)))
        one = maps.maps[0]
        assert one.survey.value == f"{third.id},1"  # the last of two slices
        assert one.survey.value in one.survey.options.values()
        await eventually(lambda: "no numbers" in one.title.html)
        for _ in range(3):
            shown.follow(third)
            await asyncio.sleep(0)
        assert asked == [third.id]
        surveys = maps.surveys
        first.cells_done += 1
        shown.follow(first)
        assert maps.surveys is surveys  # made once
        first.name = "renamed"
        shown.follow(first)
        assert list(one.survey.options) == ["renamed", "small, beta = 0.5", "small, beta = 0.6"]
        shown.store.dispatch(ComparisonMapChanged(0, ComparisonChoice(third.id, "region")))
        await eventually(lambda: len(asked) == 2)
        shown.store.dispatch(ComparisonMapChanged(0, ComparisonChoice(third.id, "region", 0, 0, minus=True)))
        assert NO_FIRST in one.title.html
        shown.store.dispatch(SurveyChosen(first.id))
        await eventually(lambda: "at most 0 cells" in one.title.html)
        assert asked == [third.id] * 2  # neither was read
        maps.end()

    with_map(tmp_path, body)


def test_lines_are_sent_once_and_taken_away_with_their_gear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        first, other = done(front, REGIONS), done(front, NARROWER)
        maps = beside(shown)
        sent: list[Model] = []
        line = np.array([[0.5, 0.1], [0.6, 0.2]])
        monkeypatch.setattr(overlays, "curve_pieces", lambda _name, model, *_: (sent.append(model), ([line], ""))[1])

        async def ready(*_: Any, **__: Any) -> None:
            """Kernels, which are not what is waited for here."""

        monkeypatch.setattr(front.kernels, "wait_until_compiled", ready)
        shown.choose(first)
        shown.follow(other)
        shown.store.dispatch(ComparisonMapAdded(ComparisonChoice(first.id, "region")))
        one = maps.maps[0]
        await eventually(lambda: one.plane is not None)
        shown.store.dispatch(OverlaysChosen(("SN1",)))
        drawn = one.figure.figure.select_one({"name": "SN1"}).data_source
        await eventually(lambda: len(drawn.data["xs"]) == 1 and len(sent) == 2)  # with the first map's
        first.cells_done += 1  # as if a tile had come
        cells = one.figure.figure.select_one({"name": "cells0"}).data_source
        before = cells.data["image"]
        shown.follow(first)
        await eventually(lambda: cells.data["image"] is not before)
        assert len(sent) == 2
        monkeypatch.setattr(overlays, "curve_pieces", lambda *_: ([], ""))
        shown.store.dispatch(ComparisonMapChanged(0, ComparisonChoice(other.id, "region")))
        await eventually(lambda: one.plane is not None and one.plane.id == other.id)
        assert drawn.data["xs"] == []
        maps.end()

    with_map(tmp_path, body)


def test_a_line_that_was_computed_for_the_map_before_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its change waits for its turn in the document when the lines are removed."""
    waiting: list[Callable[[], object]] = []
    drawn: list[str] = []

    class Kernels:
        async def wait_until_compiled(self, *_: Any, **__: Any) -> None:
            """Nothing is compiled here."""

    class Page:
        front = SimpleNamespace(kernels=Kernels())

        def start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
            return asyncio.get_running_loop().create_task(work)

        async def run_in_thread(self, work: Callable[[], Any]) -> Any:
            return work()

        def schedule_document_change(self, what: Callable[[], object]) -> None:
            waiting.append(what)

    figure: Any = SimpleNamespace(
        show_overlays=lambda _names: None, remove_lines=drawn.clear, draw_line=lambda name, _pieces: drawn.append(name)
    )
    monkeypatch.setattr(overlays, "curve_pieces", lambda *_: ([np.array([[0.5, 0.1], [0.6, 0.2]])], ""))

    async def body() -> None:
        page: Any = Page()
        lines = overlays.MapLines(page, figure)
        for is_removed in (False, True):
            lines.draw(["SN1"], MODELS[DEFAULT_MODEL](), ((0.4, 1.0), (0.0, 0.3)), is_removed)
            await eventually(lambda: len(waiting) == 1)
            if is_removed:
                lines.clear()
            waiting.pop()()
            assert drawn == ([] if is_removed else ["SN1"])

    asyncio.run(body())


def test_an_address_of_further_maps_that_cannot_be_read_is_left_out() -> None:
    asked = {"map2": [b"x"], "map3": [b"a,region,0,0,minus"], "map4": [b"a,__import__('os'),0,0"]}
    assert View.parse(asked).further == (ComparisonChoice("a", "region", minus=True),)
