"""Maps beside the first one: of its window and cursor, of other variables and surveys, and differences."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import numpy as np
import pytest
from service_support import BODY
from test_explorer_view import accepted, done, with_map
from waiting import eventually

import rattle
from gear_rattle.service.database.tables import JobRow
from gear_rattle.service.explorer.common.address import Further, View
from gear_rattle.service.explorer.further import difference
from gear_rattle.service.explorer.further.difference import Difference, require_small
from gear_rattle.service.explorer.further.maps import FurtherMaps
from gear_rattle.service.explorer.further.one import NO_FIRST, FurtherMap
from gear_rattle.service.explorer.map.colouring import colouring
from gear_rattle.service.explorer.map.planes import MapPlane
from gear_rattle.service.explorer.map.view import MapView
from gear_rattle.service.state import Front
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.errors import SurveyError
from rattle.models import Stiff

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
    async def body(front: Front, shown: MapView) -> None:
        jobs = done(front, ORBITS), done(front, COARSER)

        def planes(variable: str, index: int) -> list[MapPlane]:
            return [shown._shared.plane(job, variable, index, 0) for job in jobs]

        for variable, index in (("orbit_velocity", 3), ("orbit_phase", 0), ("region", 0)):
            first, other = planes(variable, index)
            found = Difference(first, other)
            assert not found.is_same_grid
            for i, j in np.ndindex(found.values.shape):
                delta, epsilon = float(first.delta[j]), float(first.epsilon[i])
                mine, theirs = first.at(delta, epsilon), other.at(delta, epsilon)
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
        shades = {each.label: each.share for each in colouring(found, found.block(), "auto", False).shades}
        changed = np.mean([rattle.regions(d, e, 0.6) != rattle.regions(o, e, 0.5) for d, e, o in _pairs(first, other)])
        assert shades["different"] == pytest.approx(changed)
        (same,) = planes("orbit_velocity", 3)[:1]
        nothing = Difference(same, same)
        assert nothing.is_same_grid
        known = np.isfinite(same.values)
        assert known.any()
        assert (nothing.values[known] == 0).all()
        colours = colouring(nothing, nothing.block(), "auto", False)
        assert colours.low == -colours.high  # nothing is in the middle
        assert colours.title.startswith("difference: ")
        monkeypatch.setattr(difference, "MOST_CELLS", 23)
        with pytest.raises(SurveyError, match="23 cells and fewer, not 24: save"):
            require_small(ORBITS)

    with_map(tmp_path, body)


def _pairs(first: MapPlane, other: MapPlane) -> list[tuple[Any, Any, Any]]:
    """δ and ε of the cells that both have, and the δ of the other one's."""
    near = [(d, other.delta[np.abs(other.delta - d).argmin()]) for d in first.delta[:-1]]
    return [(np.array([d]), np.array([e]), np.array([o])) for d, o in near for e in first.epsilon]


def test_further_maps_have_the_window_and_the_cursor_of_the_first(tmp_path: Path) -> None:
    async def body(front: Front, shown: MapView) -> None:
        first, other, stiff = done(front, ORBITS), done(front, COARSER), done(front, STIFF)
        jobs: dict[str, JobRow] = {each.id: each for each in (first, other, stiff)}
        maps = FurtherMaps(shown._shared, shown._viewer, "light", "", lambda: shown)
        shown._remember = lambda view: maps.follow(view, jobs)
        shown._on_pointed = maps.point_at
        shown.choose(first)
        await eventually(lambda: shown._plane is not None)
        assert maps.add.visible
        maps._add()
        assert shown.view.further == (Further(first.id, "orbit_exists"),)  # the next one that is not shown
        one = maps._maps[0]
        assert list(one._survey.options) == ["small", "other", f"small ({stiff.id[:6]})"]
        await eventually(lambda: one._plane is not None)
        assert one.map.figure.x_range is shown.map.figure.x_range
        assert one.map.figure.y_range is shown.map.figure.y_range
        one._survey.value = f"{stiff.id},0"
        assert shown.view.further[0].survey == stiff.id
        await eventually(lambda: one._plane is not None and one._plane.id == stiff.id)
        assert one._plane is not None
        assert one._plane.plane.name == one._variable.value.partition(",")[0] == "region"  # it has no orbits
        assert one._plane.request.gear_model == Stiff(0.6, 1e4)
        assert "stiff" in one._title.html
        window = (0.8, 0.9), (0.05, 0.15)
        shown.moved(*window)
        assert one._window == window
        shown._hover(0.82, 0.1)
        await eventually(lambda: one._said.html)
        value = one._plane.at(0.82, 0.1)
        assert value is not None
        assert one._said.html.endswith(f", {rattle.REGIONS[int(value[0])]}</p>")
        shown.point_at(0.85, 0.1)
        sources = [each.map._cursor.data["x"] for each in (shown, one)]
        assert sources == [[0.85], [0.85]]
        told = {name: [value.encode()] for name, value in parse_qsl(shown.view.query()[1:])}
        assert View.parse(told).further == shown.view.further
        shown.reset()
        one._survey.value = f"{other.id},0"
        one._minus.value = ["first map less this one"]
        await eventually(lambda: isinstance(one._plane, Difference))
        assert "small less other, each cell of the first with the nearest of 3 × 4" in one._title.html
        assert not one._variable.visible  # it is that of the first map
        shown._controls._variable.value = "orbit_velocity"
        await eventually(lambda: one._plane is not None and one._plane.plane.name == "orbit_velocity_difference")
        maps._add()
        maps._add()
        maps._add()
        assert len(shown.view.further) == 3
        assert not maps.add.visible
        maps._change(1, None)
        assert [i for i, place in enumerate(maps.places) if "shown" in place.css_classes] == [0, 1]
        jobs.pop(other.id)
        maps.follow(shown.view, jobs)
        assert "no longer there" in one._title.html
        maps.end()

    with_map(tmp_path, body)


def test_what_an_address_has_that_is_not_there_is_told_and_not_tried_again_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body(front: Front, shown: MapView) -> None:
        first, third = accepted(front, ORBITS), accepted(front, THIRD)
        jobs = {each.id: each for each in (first, third)}
        maps = FurtherMaps(shown._shared, shown._viewer, "light", "", lambda: shown)
        shown._remember = lambda view: maps.follow(view, jobs)
        asked: list[str] = []
        monkeypatch.setattr(difference, "MOST_CELLS", 0)

        def plane(job: JobRow, *_: Any) -> MapPlane:
            asked.append(job.id)
            raise SurveyError("It has no numbers yet.")

        shared = replace(shown._shared)
        object.__setattr__(shared, "plane", plane)
        maps._shared = shared
        maps.follow(replace(shown.view, further=(Further(third.id, "region", 0, 9),)), jobs)
        one = maps._maps[0]
        assert one._survey.value == f"{third.id},1"  # the last of two slices
        assert one._survey.value in one._survey.options.values()
        await eventually(lambda: "no numbers" in one._title.html)
        for _ in range(3):
            maps.follow(replace(shown.view, further=(Further(third.id, "region", 0, 9),)), jobs)
            await asyncio.sleep(0)
        assert asked == [third.id]
        surveys = maps._surveys
        jobs[first.id].cells_done += 1
        maps.follow(replace(shown.view, further=(Further(third.id, "region"),)), jobs)
        assert maps._surveys is surveys  # made once
        jobs[first.id].name = "renamed"
        maps.follow(replace(shown.view, further=(Further(third.id, "region"),)), jobs)
        assert list(one._survey.options) == ["renamed", "small, beta = 0.5", "small, beta = 0.6"]
        await eventually(lambda: len(asked) == 2)
        minus = (Further(third.id, "region", 0, 0, minus=True),)
        maps.follow(replace(shown.view, further=minus), jobs)
        assert NO_FIRST in one._title.html
        maps.follow(replace(shown.view, survey=first.id, variable="region", further=minus), jobs)
        await eventually(lambda: "0 cells and fewer" in one._title.html)
        assert asked == [third.id] * 2  # neither was read
        maps.end()

    with_map(tmp_path, body)


def test_lines_are_sent_once_and_taken_away_with_their_gear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(front: Front, shown: MapView) -> None:
        first, other = done(front, REGIONS), done(front, NARROWER)
        jobs = {each.id: each for each in (first, other)}
        maps = FurtherMaps(shown._shared, shown._viewer, "light", "", lambda: shown)
        sent: list[str] = []

        async def lines(_self: FurtherMap, plane: MapPlane, *_: Any) -> None:
            sent.append(plane.id)

        monkeypatch.setattr(FurtherMap, "_draw_lines", lines)

        async def follow(job: JobRow) -> FurtherMap:
            further = (Further(job.id, "region"),)
            maps.follow(replace(shown.view, survey=first.id, variable="region", further=further), jobs)
            one = maps._maps[0]
            await eventually(lambda: one._plane is not None and one._plane.id == job.id and sent[-1:] == [job.id])
            return one

        one = await follow(first)
        one.map.line("SN1", [np.array([[0.5, 0.1], [0.6, 0.2]])])
        jobs[first.id].cells_done += 1  # as if a tile had come
        drawn: list[int] = []
        monkeypatch.setattr(one, "_count", lambda: drawn.append(1))
        await follow(first)
        await eventually(lambda: drawn)
        assert sent == [first.id]
        line = one.map.figure.select_one({"name": "SN1"}).data_source
        assert line.data["xs"] != []
        await follow(other)
        assert line.data["xs"] == []
        maps.end()

    with_map(tmp_path, body)


def test_an_address_of_further_maps_that_cannot_be_read_is_left_out() -> None:
    asked = {"map2": [b"x"], "map3": [b"a,region,0,0,minus"], "map4": [b"a,__import__('os'),0,0"]}
    assert View.parse(asked).further == (Further("a", "region", minus=True),)
