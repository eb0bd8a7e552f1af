"""The panel of a page for its clicked points: one set of texts, pictures and controls, reused for each point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import panel as pn
from bokeh.models import Range1d

from gear_rattle.service.explorer.common.address import Pair
from gear_rattle.service.explorer.common.figures import PRINTED
from gear_rattle.service.explorer.common.point_state import ANSWER, BASINS, DIAGRAM, MOTION, NUMBERS, TABS
from gear_rattle.service.explorer.common.text import TextPane
from gear_rattle.service.explorer.common.watch import WidgetWatcher, call_on_press
from gear_rattle.service.explorer.design.tolerance_fields import ToleranceFields
from gear_rattle.service.explorer.files import read_asset
from gear_rattle.service.explorer.point import basins, loudness, motion, point_diagram
from gear_rattle.service.explorer.state.events import (
    AttractorChosen,
    DiagramPointChosen,
    DirectionChosen,
    Event,
    SoundRequested,
    TabChosen,
)

MARGIN = (0, 4)
#: Styles with which two pictures stand below each other if there is no room for both side by side.
NARROW, WRAPPED = ":host { min-width: 0 !important; }", ":host { flex-wrap: wrap; min-width: 0 !important; }"
WIDE: dict[str, Any] = {"sizing_mode": "stretch_width", "margin": MARGIN}
SLIDER_STEPS = 100  # steps of the slider from the first to the last point (δ, ε) of the diagram
DIRECTIONS = {"along eccentricity ε": "epsilon", "along damping δ": "delta"}
TABS_AT_SLIDER = (BASINS, MOTION, DIAGRAM)  # tabs that show the point (δ, ε) that the slider chooses
CLICKED_STATE = -1  # value of the menu of motions for the motion from a clicked state


@dataclass(frozen=True)
class FigureBelowDiagram:
    """Panel for a figure below the diagram, empty and hidden at first.

    x_range: range of the parameter axis, which this figure and the diagram share.
    """

    panel: pn.Column = field(default_factory=lambda: pn.Column(sizing_mode="stretch_width", margin=0, visible=False))
    x_range: Range1d = field(default_factory=lambda: Range1d(start=0.0, end=1.0))


class PointPanel:
    """Panel of a point: the answer, and tabs below it. A picture is slow in a browser, so it is made at first use.

    Parameters
    ----------
    dispatch : Callable[[Event], None]
        Takes an event for each choice of a viewer.
    profile_place : FigureBelowDiagram | None
        Panel for the profile of a survey, which stands below the diagram. None for an empty panel.
    """

    def __init__(
        self, theme: str, dispatch: Callable[[Event], None], profile_place: FigureBelowDiagram | None = None
    ) -> None:
        self.theme, self._dispatch, self._profile_place = theme, dispatch, profile_place or FigureBelowDiagram()
        self._open_point_stop = 0  # position of the slider at the open point; other positions stand for other points
        self._watch = WidgetWatcher()
        self._texts = [self._create_text() for _ in range(18)]
        (
            self.likelihood_text, self.basin_fractions_text, self.parameters_text, self.loudest_motion_text,
            self.margin_text, self.under_basins, self.about_lines, self.under_motion, self.under_diagram,
            self.under_spectrum, self.sound_text, self.notebook_link_text, self.table, self.intensities_text,
            self.orbits, self.events, self.extents, self.quiet_limit_text,
        ) = self._texts  # fmt: skip
        self._tolerance = pn.Column(sizing_mode="stretch_width", margin=0)
        texts = {
            ANSWER: (
                self.basin_fractions_text,
                self.loudest_motion_text,
                self.extents,
                self.margin_text,
                self.quiet_limit_text,
            ),
            BASINS: (self.under_basins, self.about_lines),
            MOTION: (self.under_motion,),
            DIAGRAM: (self.under_diagram,),
            NUMBERS: (self.table, self.intensities_text, self.orbits, self.events),
        }
        self._bodies = {
            tab: pn.Column(
                *(each.pane for each in texts[tab]),
                visible=False, sizing_mode="stretch_width", margin=0, stylesheets=[NARROW, PRINTED],
            )
            for tab in TABS
        }  # fmt: skip
        self._bodies[ANSWER].append(self._tolerance)
        self._tabs = pn.widgets.RadioButtonGroup(
            label="What is shown of the point", options={tab.capitalize(): tab for tab in TABS}, visible=False,
            color="primary", variant="outline", css_classes=["tabs"], margin=(6, 4, 2, 4),
            sizing_mode="stretch_width", stylesheets=self._panel_stylesheets,
        )  # fmt: skip
        self._watch.call_on_change(self._tabs, self._choose_tab)
        self.column = pn.Column(
            self.likelihood_text.pane, self.parameters_text.pane, self._tabs, self.diagram_slider,
            *self._bodies.values(), self.notebook_link_text.pane,
            css_classes=["point"], sizing_mode="stretch_width", margin=0, stylesheets=[PRINTED],
        )  # fmt: skip

    def show_tab(self, tab: str) -> None:
        """Show this tab, and no other."""
        with self._watch.ignore_changes():
            self._tabs.param.update(value=tab, visible=True)
        for name, body in self._bodies.items():
            body.visible = name == tab
        self.diagram_slider.visible = tab in TABS_AT_SLIDER

    def _choose_tab(self) -> None:
        self._dispatch(TabChosen(str(self._tabs.value)))

    def _choose_diagram_point(self) -> None:
        stop = int(self.diagram_slider.value or 0)
        self._dispatch(DiagramPointChosen(None if stop == self._open_point_stop else stop / SLIDER_STEPS))

    def _choose_motion(self) -> None:
        number = self.motion_choice.value
        if number is not None and number != CLICKED_STATE:
            self._dispatch(AttractorChosen(number))

    def clear(self) -> None:
        """Remove everything that the panel shows of a point, and hide its tabs."""
        self.parameters_text.html = ""
        self._tabs.visible = self.diagram_slider.visible = False
        for body in self._bodies.values():
            body.visible = False
        self.clear_results()

    def clear_results(self) -> None:
        """Remove all results of a point. Its parameters stay: they may already be those of the next point."""
        for text in self._texts:
            if text is not self.parameters_text:
                text.html = ""
        self._tolerance.visible = False
        for name in ("picture", "motions", "spectrum", "diagram"):
            if name in self.__dict__:  # only pictures that have been made already
                getattr(self, name).clear()

    def _create_text(self, html: str = "") -> TextPane:
        return TextPane(html, *self._panel_stylesheets, margin=MARGIN)

    @property
    def _panel_stylesheets(self) -> list[str]:
        return [read_asset(name) for name in ("widgets.css", "point.css")]

    @cached_property
    def picture(self) -> basins.BasinsPicture:
        """Picture of the basins. The picture and its tab are made at first use."""
        found = basins.BasinsPicture(self.theme, self._dispatch)
        self._bodies[BASINS][:] = [
            self._create_text("<h2 class=tab>Basins of attraction</h2>").pane,
            pn.pane.Bokeh(found.figure, **WIDE),
            self.under_basins.pane,
            self.about_lines.pane,
        ]
        return found

    @cached_property
    def diagram_slider(self) -> pn.widgets.IntSlider:
        """Slider that chooses the point (δ, ε) of the diagram whose basins and motion are shown."""
        found = pn.widgets.IntSlider(
            label="", start=0, end=SLIDER_STEPS, show_value=False, stylesheets=self._panel_stylesheets, max_width=420,
            margin=(2, 16), sizing_mode="stretch_width", visible=False,
        )  # fmt: skip
        self._watch.call_on_change(found, self._choose_diagram_point)
        return found

    def show_diagram_point(self, stop: int, open_point_stop: int, at: Pair) -> None:
        """Set the slider to position `stop`, and write the point `at` (δ, ε) of this position in its label.

        stop: number from 0 to SLIDER_STEPS. open_point_stop: position of the open point. A viewer who moves the slider
        there chooses the open point itself.
        """
        self._open_point_stop = open_point_stop
        with self._watch.ignore_changes():
            self.diagram_slider.param.update(value=stop, label=f"Along the diagram, at δ {at[0]:.5g}, ε {at[1]:.5g}")

    @cached_property
    def motion_choice(self) -> pn.widgets.Select:
        """Menu from which a viewer chooses the motion that is shown."""
        found = pn.widgets.Select(
            label="Motion shown (or click in the basins)", options={}, stylesheets=self._panel_stylesheets, width=330
        )
        self._watch.call_on_change(found, self._choose_motion)
        return found

    def mark_initial_state(self, tau: float, v: float) -> None:
        """Mark a motion's initial state (τ, v) in the picture of the basins, if this picture has been made."""
        if "picture" in self.__dict__:
            self.picture.mark_initial_state(tau, v)

    def offer_motions(self, options: Mapping[str, int], chosen: int | None) -> None:
        """Fill the menu of motions. options: numbers of the motions by name. chosen: the selected number, or None."""
        with self._watch.ignore_changes():
            self.motion_choice.param.update(options=dict(options), value=chosen)

    @cached_property
    def motions(self) -> motion.MotionPictures:
        """Pictures of the motion. The pictures and their tab are made at first use."""
        found = motion.MotionPictures(self.theme)
        panes = [pn.pane.Bokeh(each, margin=0, sizing_mode="stretch_width") for each in (found.trace, found.portrait)]
        self._bodies[MOTION][:] = [
            self._create_text("<h2 class=tab>Motion</h2>").pane, self.motion_choice,
            pn.Row(*panes, **WIDE, stylesheets=[WRAPPED]),
            self.under_motion.pane,
            pn.Row(self.rpm_field, self._play_button, self.sound_text.pane, **WIDE),
            pn.pane.Bokeh(self.spectrum.figure, **WIDE),
            self.under_spectrum.pane,
        ]  # fmt: skip
        return found

    @cached_property
    def spectrum(self) -> loudness.SpectrumPicture:
        """Picture of the order spectrum of the motion that is shown."""
        return loudness.SpectrumPicture(self.theme)

    @cached_property
    def rpm_field(self) -> pn.widgets.FloatInput:
        """Field for the speed in rpm at which a motion is played as a sound."""
        style: dict[str, Any] = {"width": 130, "margin": (2, 4), "stylesheets": self._panel_stylesheets}
        return pn.widgets.FloatInput(label="Speed, rpm", value=3000.0, start=0.0, **style)

    @cached_property
    def _play_button(self) -> pn.widgets.Button:
        found = pn.widgets.Button(
            label="Play", css_classes=["play"], margin=(2, 4), align="end", stylesheets=self._panel_stylesheets
        )
        call_on_press(found, lambda: self._dispatch(SoundRequested(self.rpm_field.value)))
        return found

    @cached_property
    def _tolerance_fields(self) -> ToleranceFields:
        found = ToleranceFields(self._dispatch, self._panel_stylesheets)
        self._tolerance[:] = [found.panel]
        return found

    @property
    def visible_tolerance_fields(self) -> ToleranceFields:
        """Fields of the tolerances. Reading this property makes them visible."""
        self._tolerance.visible = True
        return self._tolerance_fields

    @cached_property
    def direction_buttons(self) -> pn.widgets.RadioButtonGroup:
        """Buttons that choose the direction of the diagram, along ε or along δ."""
        found = pn.widgets.RadioButtonGroup(
            label="Direction of the diagram",
            options=DIRECTIONS,
            color="primary",
            variant="outline",
            stylesheets=self._panel_stylesheets,
        )
        self._watch.call_on_change(found, lambda: self._dispatch(DirectionChosen(found.value)))
        return found

    def mark_position(self, at: float) -> None:
        """Mark the point that the slider chooses, if the diagram was drawn. at: the point's value of the parameter."""
        if "diagram" in self.__dict__:
            self.diagram.mark_position(at)

    def show_direction(self, chosen: str) -> None:
        """Select the button of the diagram's direction, "epsilon" or "delta"."""
        with self._watch.ignore_changes():
            self.direction_buttons.value = chosen

    @cached_property
    def diagram(self) -> point_diagram.DiagramPicture:
        """Picture of the one-parameter diagram. The picture and its tab are made at first use."""
        found = point_diagram.DiagramPicture(self.theme, self._profile_place.x_range)
        self._bodies[DIAGRAM][:] = [
            self._create_text("<h2 class=tab>One-parameter diagram</h2>").pane, self.direction_buttons, found.speeds,
            pn.pane.Bokeh(found.figure, **WIDE), self.under_diagram.pane, self._profile_place.panel,
        ]  # fmt: skip
        return found
