"""The reducer and the store of a page, without Panel: what each event makes of a view, and who is told of it."""

from dataclasses import replace
from typing import Any

import pytest

from gear_rattle.service.explorer.common.address import (
    MOST_FURTHER,
    MOST_PINS,
    ComparisonChoice,
    DrawnMapSettings,
    EnteredMachine,
    MapChoice,
    Pin,
    PointerPosition,
    Ranges,
    View,
)
from gear_rattle.service.explorer.common.point_state import PointTabsState, PointTolerances
from gear_rattle.service.explorer.places.example import REQUEST
from gear_rattle.service.explorer.state import events
from gear_rattle.service.explorer.state.events import Event
from gear_rattle.service.explorer.state.reducer import MOST_WINDOWS, reduce
from gear_rattle.service.explorer.state.store import JOBS, PageStore, window_of_request

WINDOW: Ranges = (0.5, 0.6), (0.1, 0.2)
CLOSER: Ranges = (0.5, 0.55), (0.1, 0.15)
MACHINE = EnteredMachine(0.003, 5e-4, 1e-4, 1.5e-5, 0.05, 3000.0)
FURTHER = tuple(ComparisonChoice("a", name) for name in ("region", "status", "quiet_fraction"))


def after(view: View, *happened: Event) -> View:
    for event in happened:
        view = reduce(view, event)
    return view


@pytest.mark.parametrize(
    ("event", "changed"),
    [
        (events.VariableChosen("region"), {"variable": "region", "index": 0, "limits": "auto"}),
        (events.DefaultMapChosen("region", 1, 2), {"variable": "region", "index": 1, "slice": 2}),
        (events.MapIndexChosen(3), {"index": 3}),
        (events.SliceChosen(2), {"slice": 2, "family": None}),
        (events.ColourRangeChosen((0.1, 0.2), True), {"limits": (0.1, 0.2), "log": True}),
        (events.OverlaysChosen(("SN1",)), {"overlays": ("SN1",)}),
        (events.RequiredShareSet(0.9), {"share": 0.9}),
        (events.FamilyChosen(7), {"family": 7}),
        (events.ProfileChosen(MapChoice("a"), (1.0, 2.0)), {"profile": MapChoice("a"), "profile_limits": (1.0, 2.0)}),
        (events.ProfileChosen(MapChoice("region")), {"profile": MapChoice("region"), "profile_limits": None}),
    ],
)  # fmt: skip
def test_what_is_chosen_is_in_the_view(event: Event, changed: dict[str, object]) -> None:
    view = View(survey="a", variable="status", index=5, family=1, limits=(0.0, 1.0), profile_limits=(0.0, 1.0))
    assert reduce(view, event) == replace(view, **changed)  # type: ignore[arg-type]


def test_another_survey_keeps_neither_window_nor_point() -> None:
    view = View(point=(0.6, 0.1), delta=WINDOW[0], epsilon=WINDOW[1], variable="region", further=FURTHER)
    first = reduce(view, events.SurveyChosen("a"))
    assert first == replace(view, survey="a")  # those of the address belong to the first
    other = reduce(replace(first, slice=2, family=3, machine=MACHINE), events.SurveyChosen("b"))
    assert other == View(survey="b", variable="region", further=FURTHER)
    assert reduce(first, events.SurveyChosen("a")) == first


def test_a_new_survey_shows_its_usual_variable() -> None:
    view = after(View(), events.VariableChosen("region"), events.SurveyChosen("a"))
    assert view.is_variable_chosen
    assert not reduce(view, events.SurveyChosen("b", is_new=True)).is_variable_chosen


def test_own_limits_begin_where_the_colours_do_that_are_drawn() -> None:
    seen = DrawnMapSettings((0.2, 1.0), True, None)
    own = View(limits=(-1.0, 1.0), log=True)
    assert reduce(own, events.MapDrawn(seen, (-1.0, 1.0))).limits == (0.2, 1.0)
    assert reduce(own, events.MapDrawn(seen, (-2.0, 1.0))).limits == (-1.0, 1.0)  # they were drawn for others
    assert reduce(View(), events.MapDrawn(seen)).limits == "auto"
    assert reduce(own, events.MapDrawn(DrawnMapSettings(None, False, None), (-1.0, 1.0))).limits == (-1.0, 1.0)
    assert reduce(View(), events.MapDrawn(seen)).seen == seen


def test_windows_are_gone_back_to_and_forward_again() -> None:
    back, forward = events.WindowBackChosen(), events.WindowForwardChosen()
    nowhere = View()
    assert reduce(nowhere, back) is reduce(nowhere, forward) is nowhere
    view = after(nowhere, events.WindowMoved(WINDOW), events.WindowMoved(CLOSER))
    assert view.window == CLOSER
    assert after(view, back).window == WINDOW
    assert after(view, back, back).window is None
    assert after(view, back, back, back).window is None
    assert after(view, back, back, forward).window == WINDOW
    assert after(view, back, back, forward, forward, forward).window == CLOSER
    other = after(view, back, events.WindowReset())
    assert other.window is None
    assert after(other, forward).window is None  # another way was taken
    assert after(other, back).window == WINDOW
    assert reduce(view, events.WindowMoved(CLOSER)) is view
    for number in range(2 * MOST_WINDOWS):
        view = reduce(view, events.WindowMoved(((0.1 + number, 1.0 + number), WINDOW[1])))
    assert len(view.before) == MOST_WINDOWS


@pytest.mark.parametrize("wrong", [((0.6, 0.6), (0.1, 0.2)), ((0.5, 0.6), (0.2, 0.1)), ((-0.2, 0.0), (0.1, 0.2))])
def test_a_window_without_any_gear_is_not_shown(wrong: Ranges) -> None:
    view = View()
    assert reduce(view, events.WindowMoved(wrong)) is view


def test_a_point_is_opened_changed_and_closed() -> None:
    opened = reduce(View(), events.PointOpened((0.6, 0.1)))
    assert (opened.point, opened.point_state, opened.machine) == ((0.6, 0.1), PointTabsState(), None)
    changed = reduce(opened, events.AttractorChosen(2))
    assert changed.point_state == PointTabsState(attractor=2, tab="motion")
    assert reduce(changed, events.PointOpened((0.6, 0.1))) == changed
    assert reduce(changed, events.PointOpened((0.7, 0.1))).point_state == PointTabsState(
        tab="motion"
    )  # the tab stays open
    assert reduce(changed, events.PointOpened((0.6, 0.1), MACHINE)).machine == MACHINE
    span = PointTabsState(span=0.1)
    assert reduce(changed, events.PointOpened((0.7, 0.1), state=span)).point_state == span
    assert reduce(changed, events.PointClosed()) == View()
    for nowhere in ((0.0, 0.1), (0.6, -0.1)):
        assert reduce(changed, events.PointOpened(nowhere)) is changed
    assert reduce(View(), events.TabChosen("motion")) == View()


START, WIDTHS = (0.25, 4.5), PointTolerances(0.02, 0.01, 0.9)


@pytest.mark.parametrize(
    ("event", "state"),
    [
        (events.TabChosen("numbers"), {"attractor": 1, "at": 0.5, "to": (0.7, 0.2), "tab": "numbers"}),
        (events.AttractorChosen(3), {"attractor": 3, "at": 0.5, "to": (0.7, 0.2), "tab": "motion"}),
        (events.InitialConditionChosen(START), {"start": START, "at": 0.5, "to": (0.7, 0.2), "tab": "motion"}),
        (events.DirectionChosen("delta"), {"attractor": 1, "direction": "delta", "tab": "diagram"}),
        (events.DiagramPointChosen(0.25), {"attractor": 1, "at": 0.25, "to": (0.7, 0.2)}),
        (events.DiagramPointChosen(None), {"attractor": 1, "to": (0.7, 0.2)}),
        (events.YieldRequested(WIDTHS), {"attractor": 1, "at": 0.5, "to": (0.7, 0.2), "tolerance": WIDTHS}),
        (events.DiagramEndChosen((0.5, 0.0)), {"attractor": 1, "to": (0.5, 0.0), "tab": "diagram"}),
    ],
)  # fmt: skip
def test_a_choice_at_a_point_is_in_its_state(event: Event, state: dict[str, Any]) -> None:
    view = View(point=(0.6, 0.1), point_state=PointTabsState(attractor=1, at=0.5, to=(0.7, 0.2)))
    assert reduce(view, event).point_state == PointTabsState(**state)


def test_an_attractor_is_chosen_instead_of_an_initial_condition() -> None:
    view = View(point=(0.6, 0.1), point_state=PointTabsState(start=START))
    assert reduce(view, events.AttractorChosen(0)).point_state == PointTabsState(attractor=0, tab="motion")


def test_a_state_that_no_address_holds_is_in_no_view() -> None:
    view = View(point=(0.6, 0.1))
    assert reduce(view, events.TabChosen("answer")) == view  # it is open by default
    assert reduce(view, events.DiagramPointChosen(2.0)) == view
    assert reduce(view, events.PointOpened((0.6, 0.1), state=PointTabsState(span=1.0))) == view


def test_a_sound_and_a_yield_are_requested_as_often_as_a_viewer_wants() -> None:
    view = View(point=(0.6, 0.1))
    once, twice = (after(view, *[events.SoundRequested(1500.0)] * count) for count in (1, 2))
    assert (once.rpm, once.sounds, twice.rpm, twice.sounds) == (1500.0, 1, 1500.0, 2)
    assert reduce(once, events.SoundRequested(None)).rpm is None
    assert after(view, *[events.YieldRequested(WIDTHS)] * 2).yields == 2
    assert twice == view  # neither is in the address


def test_a_way_goes_from_the_open_point() -> None:
    assert reduce(View(), events.DiagramEndChosen((0.6, 0.1))) == reduce(View(), events.PointOpened((0.6, 0.1)))
    view = View(point=(0.6, 0.1), point_state=PointTabsState(at=0.5, attractor=1))
    state = PointTabsState(attractor=1, to=(0.7, 0.2), tab="diagram")
    assert reduce(view, events.DiagramEndChosen((0.7, 0.2))) == replace(view, point_state=state)
    assert reduce(view, events.DiagramEndChosen((0.0, 0.2))) is view


def test_a_place_has_a_window_and_a_point() -> None:
    view, span = (
        View(point=(0.6, 0.1), point_state=PointTabsState(tab="motion"), machine=MACHINE),
        PointTabsState(span=0.1),
    )
    there = reduce(view, events.BookmarkChosen(WINDOW, (0.7, 0.2), span))
    assert (there.window, there.point, there.point_state, there.machine) == (WINDOW, (0.7, 0.2), span, None)
    kept = reduce(view, events.BookmarkChosen(WINDOW, (0.7, 0.2)))
    assert kept.point_state == PointTabsState(tab="motion")
    assert reduce(view, events.BookmarkChosen(WINDOW, None)) == View(delta=WINDOW[0], epsilon=WINDOW[1])
    assert reduce(there, events.WindowBackChosen()).window is None


def test_a_pointer_elsewhere_is_dropped_where_a_point_or_a_place_is_gone_to() -> None:
    view = reduce(View(), events.PointerMoved((0.6, 0.1), "map"))
    assert reduce(view, events.PointOpened((0.6, 0.1))).pointer == view.pointer  # as a click opens it
    assert reduce(view, events.PointOpened((0.7, 0.1))).pointer is None
    assert reduce(view, events.BookmarkChosen(WINDOW, None, {})).pointer is None
    assert reduce(view, events.BookmarkChosen(WINDOW, (0.7, 0.2), None)).pointer is None


def test_maps_beside_the_first_are_added_changed_and_removed() -> None:
    view = after(View(), *(events.ComparisonMapAdded(each) for each in (*FURTHER, FURTHER[0])))
    assert view.further == FURTHER
    assert len(FURTHER) == MOST_FURTHER
    other = ComparisonChoice("b", "region")
    assert reduce(view, events.ComparisonMapChanged(1, other)).further == (FURTHER[0], other, FURTHER[2])
    assert reduce(view, events.ComparisonMapRemoved(1)).further == (FURTHER[0], FURTHER[2])


def test_pins_are_added_once_and_removed() -> None:
    pins = [Pin(0.1 * number, 0.1, 0.6) for number in range(1, MOST_PINS + 2)]
    view = after(View(), *(events.PinAdded(each) for each in (pins[0], *pins)))
    assert view.pins == tuple(pins[:MOST_PINS])
    assert reduce(view, events.PinRemoved(pins[0])).pins == tuple(pins[1:MOST_PINS])


def test_a_pointer_is_in_no_address() -> None:
    view = reduce(View(), events.PointerMoved((0.6, 0.1), "map"))
    assert view.pointer == PointerPosition((0.6, 0.1), "map")
    assert view.query() == ""


def test_a_store_tells_of_what_has_changed_and_once() -> None:
    store = PageStore(View(), REQUEST)
    told: list[str] = []

    def on_variable() -> None:
        told.append(f"variable {store.view.variable}")
        if store.view.index == 0:  # what a listener does is told after this round
            store.dispatch(events.MapIndexChosen(1))

    store.subscribe(on_variable, "variable")
    store.subscribe(lambda: told.append(f"index {store.view.index}"), "index", "variable")
    store.subscribe(lambda: told.append("surveys"), JOBS)
    store.dispatch(events.VariableChosen("region"))
    assert told == ["variable region", "index 1", "index 1"]
    told.clear()
    store.dispatch(events.MapIndexChosen(1))
    store.dispatch(events.RequiredShareSet(0.9))
    assert told == []
    store.update_surveys({})
    assert told == ["surveys"]


def test_a_listener_that_is_gone_is_not_called() -> None:
    store, told = PageStore(View(), REQUEST), list[str]()

    def on_index() -> None:
        told.append("kept")
        store.unsubscribe(gone)

    def gone() -> None:
        told.append("gone")

    store.subscribe(on_index, "index")
    store.subscribe(gone, "index")
    store.dispatch(events.MapIndexChosen(1))
    store.dispatch(events.MapIndexChosen(2))
    assert told == ["kept", "kept"]


def test_a_store_without_a_survey_has_the_example() -> None:
    store = PageStore(View(), REQUEST)
    assert store.survey_request_with_all_slices is REQUEST
    assert store.window == window_of_request(REQUEST)
    store.dispatch(events.WindowMoved(WINDOW))
    assert store.window == WINDOW
    store.dispatch(events.SurveyChosen("unknown"))
    assert (store.job, store.request, store.machine) == (None, None, None)
