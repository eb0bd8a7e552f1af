"""The reducer: a pure function of a page's view and an event that returns the next view."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gear_rattle.service.explorer.common.address import (
    MOST_FURTHER,
    MOST_PINS,
    EnteredMachine,
    Pair,
    PointerPosition,
    Ranges,
    View,
)
from gear_rattle.service.explorer.common.point_state import DIAGRAM, MOTION, PointTabsState
from gear_rattle.service.explorer.state import events
from gear_rattle.service.explorer.state.events import Event

MOST_WINDOWS = 200  # most windows that Back remembers


def reduce(view: View, event: Event) -> View:
    """Return the view after an event.

    Parameters
    ----------
    view : View
        View before the event.
    event : Event
        What the viewer or the page did, see `gear_rattle.service.explorer.state.events`.

    Returns
    -------
    View
        The new view; the same view if the event cannot be carried out.
    """
    match event:
        case events.SurveyChosen(survey, is_new):
            return _show_survey(replace(view, is_variable_chosen=view.is_variable_chosen and not is_new), survey)
        case events.VariableChosen(variable):
            return replace(view, variable=variable, index=0, limits="auto", is_variable_chosen=True)
        case events.DefaultMapChosen(variable, index, number):
            return replace(view, variable=variable, index=index, slice=number)
        case events.MapIndexChosen(index):
            return replace(view, index=index)
        case events.SliceChosen(number):
            return replace(view, slice=number, family=None)  # each slice has families of its own
        case events.ColourRangeChosen(limits, log):
            return replace(view, limits=limits, log=log)
        case events.MapDrawn(seen, limits):
            is_own = seen is not None and isinstance(view.limits, tuple) and view.limits == limits
            # on a log scale, the map replaces an entered lower limit of 0 or less by the least positive value
            drawn = seen.limits if is_own and seen is not None and seen.limits is not None else view.limits
            return replace(view, seen=seen, limits=drawn)
        case events.OverlaysChosen(overlays):
            return replace(view, overlays=overlays)
        case events.RequiredShareSet(share):
            return replace(view, share=share)
        case events.FamilyChosen(family):
            return replace(view, family=family)
        case events.WindowMoved(window):
            (left, right), (bottom, top) = window
            return _show_window(view, window) if left < right and bottom < top and right > 0 else view
        case events.WindowReset():
            return _show_window(view, None)
        case events.WindowBackChosen():
            if not view.before:
                return view
            turned = replace(view, before=view.before[:-1], after=(*view.after, view.window))
            return _set_window(turned, view.before[-1])
        case events.WindowForwardChosen():
            if not view.after:
                return view
            turned = replace(view, after=view.after[:-1], before=(*view.before, view.window))
            return _set_window(turned, view.after[-1])
        case events.PointerMoved(at, source):
            return replace(view, pointer=PointerPosition(at, source))
        case events.PointOpened(point, machine, state):
            return _open_point(view, point, machine, state)
        case events.TabChosen(tab):
            return _change_point_state(view, tab=tab)
        case events.AttractorChosen(attractor):
            return _change_point_state(view, attractor=attractor, start=None, tab=MOTION)
        case events.InitialConditionChosen(start):
            return _change_point_state(view, start=start, tab=MOTION)
        case events.DirectionChosen(direction):
            return _change_point_state(view, direction=direction, to=None, at=None, tab=DIAGRAM)
        case events.DiagramPointChosen(at):
            return _change_point_state(view, at=at)
        case events.YieldRequested(tolerance):
            return replace(_change_point_state(view, tolerance=tolerance), yields=view.yields + 1)
        case events.SoundRequested(rpm):
            return replace(view, rpm=rpm, sounds=view.sounds + 1)
        case events.DiagramEndChosen(to):
            return _set_diagram_line_to(view, to)
        case events.PointClosed():
            return _close_open_point(view)
        case events.BookmarkChosen(window, point, state):
            moved = replace(_show_window(view, window), pointer=None)
            return _close_open_point(moved) if point is None else _open_point(moved, point, None, state)
        case events.ProfileChosen(profile, limits):
            return replace(view, profile=profile, profile_limits=limits)
        case events.ComparisonMapAdded(further):
            return replace(view, further=(*view.further, further)[:MOST_FURTHER])
        case events.ComparisonMapChanged(index, further):
            return replace(view, further=(*view.further[:index], further, *view.further[index + 1 :]))
        case events.ComparisonMapRemoved(index):
            return replace(view, further=(*view.further[:index], *view.further[index + 1 :]))
        case events.PinAdded(pin):
            return replace(view, pins=tuple(dict.fromkeys((*view.pins, pin)))[:MOST_PINS])
        case events.PinRemoved(pin):
            return replace(view, pins=tuple(each for each in view.pins if each != pin))


def _show_survey(view: View, survey: str) -> View:
    """Show another survey, and remove the pointer.

    Returns
    -------
    View
        If another survey was shown before, its window, slice, family and open point are removed. If the example was
        shown, they stay.
    """
    if survey == view.survey:
        return view
    if not view.survey:
        return replace(view, survey=survey, pointer=None)
    left = replace(_close_open_point(view), delta=None, epsilon=None, slice=0, family=None)
    return replace(left, survey=survey, pointer=None)


def _show_window(view: View, window: Ranges | None) -> View:
    """Show a window, or the whole survey (None), and remember the previous window for Back."""
    if window == view.window:
        return view
    return _set_window(replace(view, before=(*view.before, view.window)[-MOST_WINDOWS:], after=()), window)


def _set_window(view: View, window: Ranges | None) -> View:
    delta, epsilon = window or (None, None)
    return replace(view, delta=delta, epsilon=epsilon)


def _open_point(view: View, point: Pair, machine: EnteredMachine | None, state: PointTabsState | None) -> View:
    """Open a point (δ, ε), if δ > 0 and ε ≥ 0.

    state: new state of the point's tabs, or None, see `PointOpened`.

    Returns
    -------
    View
        The view with the open point; the given view if the point is not allowed.
    """
    if point[0] <= 0 or point[1] < 0:
        return view
    if state is None:
        is_open = (view.point, view.machine) == (point, machine)
        state = view.point_state if is_open else PointTabsState(tab=view.point_state.tab)
    # a pointer at another point is dropped, so that the numbers beside the map are those of the opened point's cell
    pointer = view.pointer if view.pointer is not None and view.pointer.at == point else None
    return replace(view, point=point, machine=machine, point_state=state.with_changes(), pointer=pointer)


def _close_open_point(view: View) -> View:
    """Close the open point."""
    return replace(view, point=None, point_state=PointTabsState(), machine=None)


def _change_point_state(view: View, **fields: Any) -> View:
    """Change some fields of the state of the open point's tabs."""
    return view if view.point is None else replace(view, point_state=view.point_state.with_changes(**fields))


def _set_diagram_line_to(view: View, to: Pair) -> View:
    """Let the diagram run from the open point to the point `to` (δ, ε). If no point is open, open `to`."""
    if view.point is None:
        return _open_point(view, to, None, None)
    return _change_point_state(view, to=to, at=None, tab=DIAGRAM) if to[0] > 0 and to[1] >= 0 else view
