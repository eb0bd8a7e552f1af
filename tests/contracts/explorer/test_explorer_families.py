"""Families on the map: the largest one of each cell, one that is chosen, and points that are pinned."""

from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
import pytest
from service_support import BODY
from test_explorer_view import Shown, accepted, compute, done, with_map
from waiting import eventually

from gear_rattle.service.database.tables import JobRow, State
from gear_rattle.service.explorer.common.address import Pin, View
from gear_rattle.service.explorer.families.description import longest_run_of_true
from gear_rattle.service.explorer.families.view import FamiliesView
from gear_rattle.service.explorer.further.difference import DifferenceMap
from gear_rattle.service.explorer.map.colouring import compute_colouring, valueless_cells_by_reason
from gear_rattle.service.explorer.map.picture import picture_query
from gear_rattle.service.explorer.map.readout import cell_in_words
from gear_rattle.service.explorer.state.events import FamilyChosen, PinAdded, PinRemoved
from gear_rattle.service.state import ApplicationState
from gear_rattle.workers import Group, SurveyError, SurveyRequest, complete, open_family, open_survey
from gear_rattle.workers.pictures.largest import open_survey_for_map
from gear_rattle.workers.pictures.look import LARGEST, SHARE, needs_whole_survey
from gear_rattle.workers.pictures.maps import meanings_of_codes
from gear_rattle.workers.pictures.planes import map_of_variable

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(
    **BODY | {
        "delta": {"start": 0.405, "stop": 0.5, "num": 12},
        "epsilon": {"start": 0.09, "stop": 0.14, "num": 10},
        "quantities": ["region", "attractors", "lyapunov", "families"],
        "tile": {"delta": 12, "epsilon": 10},
    }
)  # fmt: skip


WITHOUT = REQUEST.model_copy(update={"quantities": (Group.REGION,)})


def joined(front: ApplicationState) -> JobRow:
    """A survey that is done, and whose families are joined."""
    survey_id = accepted(front, REQUEST).id
    compute(front, survey_id, REQUEST)
    complete(REQUEST, front.directory.store(survey_id))
    front.database.set_state(survey_id, State.SUCCESSFUL)
    return front.database.job(survey_id)


def with_families(data: Path, body: Callable[[ApplicationState, Shown, FamiliesView], Awaitable[None]]) -> None:
    """Do this with a map and its families, as a page has them."""

    async def both(front: ApplicationState, shown: Shown) -> None:
        families = FamiliesView(shown.shared, shown.viewer, shown.store, shown.map, "")
        await body(front, shown, families)
        families.drawings.stop()

    with_map(data, both)


def test_one_that_is_chosen_is_told_of_and_the_others_dimmed(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown, families: FamiliesView) -> None:
        job = joined(front)
        veil = shown.map.figure.select_one({"name": "veil"}).data_source
        shown.choose(job)
        await eventually(lambda: len(families.menu.options) > 1)  # it is there before its names are
        assert not families.said.html
        shown.controls.variable.value = LARGEST
        await eventually(lambda: shown.title.html.count("(among all)"))
        assert list(shown.controls.index.options) == ["all", "rattling"]
        shades = shown.lines.key.shades
        assert sum(each["share"] for each in shades) == pytest.approx(1.0)
        assert all(each["share"] > 0 for each in shades)  # and no others are listed
        assert "quiet" in shown.map.figure.select_one({"name": "names"}).data_source.data["name"]
        names = [name for name in families.menu.options if name.endswith(" = C")]
        families.menu.value = families.menu.options[names[0]]
        number = int(families.menu.value)
        assert shown.view.family == number
        await eventually(lambda: families.said.html)
        store = front.directory.store(job.id)
        one = open_family(store, number)
        mask = veil.data["image"][0]
        np.testing.assert_array_equal(mask == 0, one.fraction.fillna(0.0) > 0)
        plane = shown.shared.plane(job, SHARE, number, 0)
        some = plane.block(room=(3, 5), anywhere=True)  # cells that are drawn as one have what any of them has
        of = one.fraction.fillna(0.0).coarsen(epsilon=4, delta=4, boundary="pad").max()
        np.testing.assert_array_equal(some.values, of.values.astype(np.float32))
        share = float(one.fraction.fillna(0.0).mean())
        cells = one.attrs["cells"]
        assert f"is in {cells} cells, {100 * cells / 120:.3g} % of the plane; {100 * share:.3g} %" in families.said.html
        table = open_survey(store, "families").sel(curve="SN1").isel(family=number)
        if table.edges_on:
            assert f"SN1 ({100 * int(table.edges_on) / int(table.edges):.3g} %)" in families.said.html
        families.open_diagram("delta")
        assert shown.view.point is not None
        (delta, epsilon), state = shown.view.point, shown.view.point_state
        there = one.fraction.fillna(0.0).sel(epsilon=epsilon) > 0
        run = there.delta.values[np.abs(there.delta.values - delta) <= (state.span or 0.0)]
        assert there.sel(delta=run[1:-1]).all()
        assert state.direction == "delta"
        shown.close()
        shown.moved((0.42, 0.45), (0.1, 0.12))
        await eventually(lambda: veil.data["x"] != [] and veil.data["dw"][0] < 0.05)
        told = {name: [each.encode() for each in values] for name, values in parse_qs(shown.view.query()[1:]).items()}
        assert View.parse(told).family == number
        assert f"variable={LARGEST}" in picture_query(job.request, shown.view)
        families.menu.value = ""
        await eventually(lambda: not families.said.html)
        assert veil.data["image"] == []
        shown.store.dispatch(FamilyChosen(10**6))
        await eventually(lambda: "There are families 0 to" in families.said.html)
        assert (families.menu.visible, families.menu.value) == (True, "")  # for who has a wrong address
        shown.store.dispatch(FamilyChosen(number))
        await eventually(lambda: veil.data["image"] != [])
        shown.choose(accepted(front, REQUEST.model_copy(update={"seed": 1})))
        assert veil.data["image"] == []  # nothing of the one before, while it is read
        assert len(families.menu.options) == 1
        assert not families.said.html

    with_families(tmp_path, body)


def test_an_empty_slot_is_not_taken_for_a_cell_without_attractors(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown, _families: FamiliesView) -> None:
        survey_id = accepted(front, REQUEST).id
        compute(front, survey_id, REQUEST)
        atlas, store = shown.shared.atlas, front.directory.store(survey_id)
        before, _ = atlas.plane(front.database.job(survey_id), "attractor_kind", 0)
        found = compute_colouring(before, before.block(), "auto", False)
        assert "by falling share until families are joined" in found.title
        complete(REQUEST, store)
        front.database.set_state(survey_id, State.SUCCESSFUL)
        stored = open_survey(store)
        kinds = stored.attractor_kind.values
        (slot,) = np.flatnonzero(
            ((kinds == 0) & (kinds > 0).any(axis=0)).any(axis=(1, 2)) & (kinds > 0).any(axis=(1, 2))
        )[:1]
        plane, _ = atlas.plane(front.database.job(survey_id), "attractor_kind", int(slot))
        np.testing.assert_array_equal(plane.values, kinds[slot])  # slots as they are since the join
        found = compute_colouring(plane, plane.block(), "auto", False)
        assert f"slot {slot}, by family: a cell's other attractors are in other slots" in found.title
        shades = {each.label: each.share for each in found.shades}
        assert "none" not in shades
        assert shades["empty slot"] == pytest.approx((kinds[slot] == 0).mean())
        i, j = np.argwhere((kinds[slot] == 0) & (kinds > 0).any(axis=0))[0]
        assert cell_in_words(plane, plane.delta[j], plane.epsilon[i], plane.box).endswith(", empty slot")
        moved, _ = atlas.plane(front.database.job(survey_id), "attractor_kind", 0)
        np.testing.assert_array_equal(moved.values, kinds[0])  # read anew: they have been moved
        assert needs_whole_survey("attractor_kind", REQUEST)  # windows are not joined
        assert not needs_whole_survey("attractor_kind", REQUEST.model_copy(update={"slots_by": "fraction"}))
        with open_survey_for_map(partial(open_survey, store), LARGEST) as dataset:
            assert [meanings_of_codes(map_of_variable(dataset, LARGEST, which))[0] for which in (0, 1)] == [
                "undecided",
                "only quiet",
            ]
        exponents, _ = atlas.plane(front.database.job(survey_id), "lyapunov_max", 0)
        assert "only quiet" in valueless_cells_by_reason(exponents, exponents.block())  # as in the figure of a survey

    with_families(tmp_path, body)


def test_what_has_no_families_yet_says_so(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown, families: FamiliesView) -> None:
        running, without = done(front, REQUEST), done(front, WITHOUT)
        shown.choose(running)
        shown.store.dispatch(FamilyChosen(3))
        await eventually(lambda: "are not joined yet" in families.said.html)
        assert families.panel.visible
        assert not families.menu.visible
        shown.controls.variable.value = LARGEST
        await eventually(lambda: "are not joined yet" in shown.title.html)
        shown.choose(without)
        assert not families.panel.visible
        assert LARGEST not in shown.controls.variable.options.values()

    with_families(tmp_path, body)


def test_families_of_two_surveys_are_not_compared(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown, _: FamiliesView) -> None:
        plane = shown.shared.plane(joined(front), LARGEST, 0, 0)
        with pytest.raises(SurveyError, match="numbered differently"):
            DifferenceMap(plane, plane)
        window = plane.block(((0.42, 0.43), (0.1, 0.11)))
        whole, part = (compute_colouring(plane, each, "auto", False) for each in (plane.block(), window))
        assert (part.palette, part.low, part.high) == (whole.palette, whole.low, whole.high)  # in every window

    with_families(tmp_path, body)


def test_pins_are_marked_with_their_numbers_on_maps_of_their_gear(tmp_path: Path) -> None:
    async def body(front: ApplicationState, shown: Shown) -> None:
        shown.choose(done(front, WITHOUT))
        await eventually(lambda: shown.plane is not None)
        pins = Pin(0.42, 0.1, 0.6), Pin(0.5, 0.1, 0.5), Pin(0.45, 0.12, 0.6)
        for pin in pins:
            shown.store.dispatch(PinAdded(pin))
        assert shown.map.pins_at.data == {"x": [0.42, 0.45], "y": [0.1, 0.12], "name": ["1", "3"]}
        shown.store.dispatch(PinRemoved(pins[0]))
        assert shown.map.pins_at.data["name"] == ["2"]

    with_map(tmp_path, body)


def test_the_longest_run_is_found_in_any_row() -> None:
    there = np.array([[1, 1, 0, 1, 1, 0], [0, 1, 1, 1, 0, 0], [1, 0, 0, 1, 1, 1]], bool)
    assert longest_run_of_true(there) == (1, 1, 4)
    assert longest_run_of_true(there[:, ::-1]) in {(1, 2, 5), (2, 0, 3)}
    assert longest_run_of_true(np.zeros((2, 3), bool)) == (0, 0, 0)
