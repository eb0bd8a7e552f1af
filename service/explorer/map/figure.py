"""Draw the map in a Bokeh figure: cells with and without a value, finer cells of a window, lines, and marks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import floor, log10, nan
from typing import Any

import numpy as np
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.events import MouseMove, RangesUpdate, Reset, Tap
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    Range1d,
    WheelZoomTool,
)
from bokeh.plotting import figure

from gear_rattle.service.explorer.common import glyphs
from gear_rattle.service.explorer.common.address import Pair, Ranges
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.figures import INK
from gear_rattle.service.explorer.design import axes
from gear_rattle.service.explorer.map.colouring import Colouring
from gear_rattle.service.explorer.map.planes import UNSEEN, MapBlock
from gear_rattle.service.explorer.state.events import (
    DiagramEndChosen,
    Event,
    PointerMoved,
    PointOpened,
    WindowMoved,
    WindowReset,
)
from gear_rattle.workers.pictures.look import LIMIT, OWN_STYLES
from gear_rattle.workers.pictures.names import Box, arrange_names, box_about
from gear_rattle.workers.survey.machine import SurveyedMachine
from rattle.plot import MARKERS, STYLES

SHAPES = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle"}
#: Sizes in pixels, so that the name of a codimension-two point covers no other name and no pin. LETTER, ROW: width of a
#: letter and height of a row of such a name. REGION_LETTER, REGION_ROW: the same for the name of a region or a family.
#: DISC: half the side of the square that a pin takes.
LETTER, ROW, REGION_LETTER, REGION_ROW, DISC = 9.0, 19.0, 9.0, 20.0, 11.0
POINTER_MS, WINDOW_MS = 50, 200
BAR_ROOM = 110  # width of the colour bar with its numbers, in pixels; fixed, because Bokeh does not measure new numbers
NARROW = 500  # a figure narrower than this, in pixels, has its colour bar below the map instead of beside it
LARGEST_ZOOM = 5000.0  # a survey wider than this many windows is not drawn, because browsers would misplace its cells


class MapFigure:
    """Figure of a map. The figure dispatches an event for each action of a viewer in it.

    Parameters
    ----------
    leader : MapFigure | None
        Figure whose window this figure shares, None for a window of its own.
    """

    def __init__(
        self, theme: str, dispatch: Callable[[Event], None], leader: MapFigure | None = None, name: str = "map"
    ) -> None:
        self._dispatch = dispatch
        self._leader, self._window = leader or self, ((nan, nan), (nan, nan))
        spans = (leader.figure.x_range, leader.figure.y_range) if leader else _default_ranges()
        plot: Any = figure(
            x_range=spans[0],
            y_range=spans[1],
            tools="pan,box_zoom,wheel_zoom,zoom_in,zoom_out,reset",
            toolbar_location="above",
            sizing_mode="stretch_both",
            min_height=320,
            match_aspect=False,
            lod_threshold=None,
        )
        plot.toolbar.logo = None
        plot.toolbar.active_scroll = plot.select_one(WheelZoomTool)
        self.figure: Any = plot
        plot.name = name
        self._axes = axes.MapAxes(plot, is_follower=leader is not None)
        self._apply_theme(theme)
        self._values, self._fine, self._reasons = (glyphs.create_empty_source(glyphs.IMAGE) for _ in range(3))
        self._veiled = glyphs.create_empty_source(glyphs.IMAGE)
        self._reason_colour_mapper = glyphs.transparent_colour_mapper()
        self._reason_renderer = glyphs.create_image_renderer(self._reasons, self._reason_colour_mapper)
        self._scales = glyphs.create_colour_scales(self._values, self._fine, **_colour_bar_style(theme))
        self._log = False
        self._lines: dict[str, tuple[ColumnDataSource, list[Any]]] = {}
        for line in (*STYLES, *OWN_STYLES):
            source = glyphs.create_empty_source(glyphs.LINE)
            self._lines[line] = source, glyphs.create_line_renderers(source, line)
        self._points, self._limit_band_source = (
            glyphs.create_empty_source(glyphs.POINT),
            glyphs.create_empty_source(glyphs.BAND),
        )
        self._names = glyphs.create_empty_source(("x", "y", "name", "dx"))
        self.cross_at, self.cursor_at, self.ellipse_at = (glyphs.create_empty_source(("x", "y")) for _ in range(3))
        self.pins_at = glyphs.create_empty_source(("x", "y", "name"))
        self._marks, self._band = (
            glyphs.create_point_renderers(self._points),
            glyphs.create_band_renderer(self._limit_band_source),
        )
        images = (each for scale in self._scales.values() for each in (scale.cells, scale.fine))
        lines = (each for _, pair in self._lines.values() for each in pair)
        plot.renderers = [
            self._reason_renderer,
            *images,
            glyphs.create_veil_renderer(self._veiled, INK[theme][1]),
            self._band,
            *lines,
            *glyphs.outline_renderers(self.ellipse_at),
            glyphs.create_name_renderer(self._names),
            *self._marks,
            *glyphs.cross_renderers(self.cross_at),
            *glyphs.ring_renderers(self.cursor_at),
            *glyphs.create_pin_renderers(self.pins_at),
        ]
        glyphs.share_filter_and_selection(plot.renderers)
        self._range_arrows = glyphs.make_range_arrows(INK[theme][0])
        for mark in self._range_arrows:
            plot.add_layout(mark, "right")  # not "center", where the frame would cut off the arrow
        self._is_narrow, self._is_categorical = False, True
        self._place_colour_bars()
        plot.on_change("outer_width", handler_in_event_loop(self._on_width))
        for side in ("inner_width", "inner_height"):
            plot.on_change(side, handler_in_event_loop(lambda _attribute, _old, _new: self._position_names()))
        self._marked_points: list[tuple[str, float, float]] = []
        self._box_of_cells: Ranges | None = None
        self._finer_cells: tuple[np.ndarray, Ranges] | None = None
        self._listen_to_browser(name)

    def _apply_theme(self, theme: str) -> None:
        ink, paper, line = INK[theme]
        plot = self.figure
        plot.update(background_fill_color=paper, border_fill_color=paper, outline_line_color=line)
        plot.grid.visible = False
        for axis in (*plot.xaxis, *plot.yaxis):
            axis.update(
                axis_label_text_color=ink, major_label_text_color=ink, axis_line_color=line, major_tick_line_color=ink,
                minor_tick_line_color=line, axis_label_text_font_size="14px", major_label_text_font_size="13px",
                axis_label_text_font_style="normal", major_tick_in=0, major_tick_out=5,
            )  # fmt: skip

    def tap(self, event: Any) -> None:
        """Open the clicked point or, with Shift held, draw the diagram from the open point to the clicked point."""
        if _are_finite([event.x, event.y]) and self._is_inside(event.x, event.y):
            held = event.modifiers is not None and event.modifiers["shift"]
            at = self._round_point(event.x, event.y)
            self._dispatch(DiagramEndChosen(at) if held else PointOpened(at))

    def _round_point(self, x: float, y: float) -> Pair:
        """Round a clicked point to a hundredth of a pixel, so that its numbers in addresses and fields are short."""
        ranges, sides = (self.figure.x_range, self.figure.y_range), self.pixels
        steps = [(each.end - each.start) / (100 * side) for each, side in zip(ranges, sides, strict=True)]
        delta, epsilon = (round(at, -floor(log10(step))) for at, step in zip((float(x), float(y)), steps, strict=True))
        return delta, epsilon

    def _listen_to_browser(self, name: str) -> None:
        pointer, window = ColumnDataSource({"x": [], "y": []}), ColumnDataSource({"x": [], "y": []})
        for source, event, data, wait in (
            (pointer, MouseMove, "{x: [cb_obj.x], y: [cb_obj.y]}", POINTER_MS),
            (window, RangesUpdate, "{x: [cb_obj.x0, cb_obj.x1], y: [cb_obj.y0, cb_obj.y1]}", WINDOW_MS),
        ):
            code = f"""const at = {data}
                clearTimeout(source.waiting)
                source.waiting = setTimeout(() => {{ source.data = at }}, {wait})"""
            self.figure.js_on_event(event, CustomJS(args={"source": source}, code=code))

        def on_pointer(_attribute: str, _old: object, new: Any) -> None:
            if new["x"] and _are_finite(new["x"] + new["y"]):
                self._dispatch(PointerMoved((float(new["x"][0]), float(new["y"][0])), name))

        def on_window(_attribute: str, _old: object, new: Any) -> None:
            if len(new["x"]) == 2 and _are_finite(new["x"] + new["y"]):
                (left, right), (bottom, top) = (sorted(map(float, new[axis])) for axis in "xy")
                self._report_window(((left, right), (bottom, top)))

        pointer.on_change("data", handler_in_event_loop(on_pointer))
        window.on_change("data", handler_in_event_loop(on_window))
        self.figure.on_event(Tap, handler_in_event_loop(self.tap))
        self.figure.on_event(Reset, handler_in_event_loop(lambda _event: self._dispatch(WindowReset())))

    def _on_width(self, _attribute: str, _old: object, width: int) -> None:
        if (width < NARROW) != self._is_narrow:
            self._is_narrow = width < NARROW
            self._place_colour_bars()

    def _place_colour_bars(self) -> None:
        glyphs.place_colour_bars(self.figure, [scale.bar for scale in self._scales.values()], self._is_narrow)
        glyphs.place_arrows_at_bar_ends(self._range_arrows, self._scales[self._log].bar, self._is_narrow)
        self._reserve_bar_width()

    def _reserve_bar_width(self) -> None:
        """Keep room for the colour bar and its numbers at the right of the map, if the bar is there."""
        self.figure.min_border_right = None if self._is_narrow or self._is_categorical else BAR_ROOM

    def _is_inside(self, delta: float, epsilon: float) -> bool:
        """Return whether a point is inside the frame of the map, not beside it on an axis."""
        x, y = self.figure.x_range, self.figure.y_range
        return all(
            min(span.start, span.end) <= at <= max(span.start, span.end) for span, at in ((x, delta), (y, epsilon))
        )

    def _report_window(self, window: Ranges) -> None:
        """Dispatch the window that the browser shows; if several maps share and report the window, dispatch it once."""
        if window != self._leader._window:
            self._leader._window = window
            self._dispatch(WindowMoved(window))

    def show_window(self, window: Ranges) -> None:
        """Show a window. A window that the browser reported is not sent back, because the browser may have moved on."""
        if self._leader is self and window != self._window:
            self._window = window
            self._axes.show_window(*window)
        self._update_visibility_of_cells()
        self._position_names()

    def _update_visibility_of_cells(self) -> None:
        is_drawn = not self.has_too_large_cells
        self._reason_renderer.visible = is_drawn
        for log, scale in self._scales.items():
            scale.cells.visible = is_drawn and log == self._log
            scale.fine.visible = log == self._log

    @property
    def has_too_large_cells(self) -> bool:
        """True if the window is so narrow that the survey's cells are too large on the screen to be drawn."""
        if self._box_of_cells is None:
            return False
        (left, right), ((low, high), _) = self._box_of_cells[0], self._leader._window
        return right - left >= LARGEST_ZOOM * (high - low)

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the frame in pixels; UNSEEN until a browser has reported them."""
        try:
            return max(int(self.figure.inner_width), 1), max(int(self.figure.inner_height), 1)
        except UnsetValueError:
            return UNSEEN

    def draw_cells(self, block: MapBlock, colours: Colouring) -> None:
        """Draw the cells of a survey in these colours, and the names of regions or families."""
        self._box_of_cells, where = block.box, image_position_and_size(block.box)
        self._apply_colours(colours)
        shown = np.where(colours.reasons == 0, block.values, np.float32(np.nan))
        places = list(colours.names.values())
        self._names.data = {
            "x": [x for x, _ in places],
            "y": [y for _, y in places],
            "name": list(colours.names),
            "dx": [0.0] * len(places),
        }
        self._position_names()
        self._values.data = {"image": [shown], **where}
        self._reasons.data = {"image": [colours.reasons], **where}

    def draw_finer_cells(self, values: np.ndarray, box: Ranges) -> None:
        """Draw finer cells over the cells of the survey. values: (epsilon, delta). box: the box of all `values`."""
        self._finer_cells = np.asarray(values, np.float32), box
        self._show_finer_cells()

    def _show_finer_cells(self) -> None:
        if self._finer_cells is None:
            glyphs.remove_rows(self._fine)
            return
        values, box = self._finer_cells
        shown = np.where(values > 0, values, np.float32(np.nan)) if self._log else values
        self._fine.data = {"image": [shown], **image_position_and_size(box)}

    def dim_cells(self, mask: np.ndarray, box: Ranges) -> None:
        """Dim cells. mask: bool (epsilon, delta), True for a cell to dim. box: the box that `mask` covers."""
        self._veiled.data = {"image": [mask.astype(np.uint8)], **image_position_and_size(box)}

    def undim_cells(self) -> None:
        """Remove the dimming of cells."""
        glyphs.remove_rows(self._veiled)

    def remove_finer_cells(self) -> None:
        """Remove the finer cells of a window, so that the survey's own cells are visible there."""
        self._finer_cells = None
        self._show_finer_cells()

    def remove_cells(self) -> None:
        """Remove the survey's cells, the finer cells and the colour bar."""
        self.remove_finer_cells()
        for source in (self._values, self._reasons, self._names):
            glyphs.remove_rows(source)
        for scale in self._scales.values():
            scale.bar.visible = False
        for mark in self._range_arrows:
            mark.visible = False
        self._is_categorical = True
        self._reserve_bar_width()

    def _apply_colours(self, colours: Colouring) -> None:
        if self._log != colours.log:
            self._log = colours.log
            glyphs.place_arrows_at_bar_ends(self._range_arrows, self._scales[self._log].bar, self._is_narrow)
            self._show_finer_cells()
        palette = list(colours.palette)
        self._scales[colours.log].mapper.update(palette=palette, low=colours.low, high=colours.high)
        for log, scale in self._scales.items():
            scale.bar.visible = log == colours.log and not colours.categorical
        for mark, share in zip(self._range_arrows, colours.shares_beyond, strict=True):
            mark.visible = share > 0
        self._is_categorical = colours.categorical
        self._reserve_bar_width()
        reasons = [glyphs.TRANSPARENT, *colours.reason_colours]
        self._reason_colour_mapper.update(palette=reasons, low=-0.5, high=len(reasons) - 0.5)
        self._update_visibility_of_cells()

    def draw_line(self, name: str, pieces: Sequence[np.ndarray]) -> None:
        """Draw a named curve. pieces: arrays (k, 2) of its points (δ, ε)."""
        source, _ = self._lines[name]
        source.data = {"xs": [piece[:, 0] for piece in pieces], "ys": [piece[:, 1] for piece in pieces]}

    def draw_limit_band(self, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Draw the intervals of the design limit as one area, from ε = low (k,) to high (k,) at the dampings x (k,)."""
        self._limit_band_source.data = {"x": x, "low": low, "high": high}

    def mark_points(self, points: Sequence[tuple[str, float, float]]) -> None:
        """Mark codimension-two points, each given as (name, δ, ε)."""
        self._marked_points = list(points)
        self._position_names()

    def _position_names(self) -> None:
        """Move the names of regions or families into the frame, and name the codimension-two points that have room."""
        self._move_region_names_inside()
        if not self._marked_points:
            glyphs.remove_rows(self._points)
            return
        names, x, y = (list(column) for column in zip(*self._marked_points, strict=True))
        placed = arrange_names(
            [self._screen_position(*at) for at in zip(x, y, strict=True)],
            [(LETTER * len(name) + 4, ROW) for name in names],
            self.pixels,
            self._occupied_boxes(),
        )
        rows = []
        for name, at_x, at_y, found in zip(names, x, y, placed, strict=True):
            left, bottom = self._screen_position(at_x, at_y)
            shown = (name, found.centre[0] - left, bottom - found.centre[1]) if found else ("", 0.0, 0.0)
            end = self._plane_position(*found.leader_end) if found and found.leader_end else (at_x, at_y)
            rows.append((at_x, at_y, SHAPES[MARKERS[name]], *shown, *end))
        self._points.data = {
            key: list(column) for key, column in zip(glyphs.POINT, zip(*rows, strict=True), strict=True)
        }

    def _move_region_names_inside(self) -> None:
        data, width = self._names.data, self.pixels[0]
        moved = []
        for x, y, name in zip(data["x"], data["y"], data["name"], strict=True):
            at, half = self._screen_position(x, y)[0], REGION_LETTER * len(name) / 2 + 3
            moved.append(min(max(at, half), width - half) - at if 0 <= at <= width else 0.0)
        if moved != data["dx"]:
            self._names.data = {**data, "dx": moved}

    def _occupied_boxes(self) -> list[Box]:
        """Return the boxes of the pins and of the names of regions or families on the screen, in pixels."""
        regions, pins = self._names.data, self.pins_at.data
        return [
            *(
                box_about(
                    (self._screen_position(x, y)[0] + dx, self._screen_position(x, y)[1]),
                    (REGION_LETTER * len(name) + 6, REGION_ROW),
                )
                for x, y, name, dx in zip(*(regions[key] for key in ("x", "y", "name", "dx")), strict=True)
            ),
            *(
                box_about(self._screen_position(x, y), (2 * DISC, 2 * DISC))
                for x, y in zip(pins["x"], pins["y"], strict=True)
            ),
        ]

    def _screen_position(self, delta: float, epsilon: float) -> tuple[float, float]:
        """Return the position of a point on the screen, in pixels from the lower left corner of the frame."""
        x, y = (
            side * (at - span.start) / (span.end - span.start)
            for side, at, span in zip(self.pixels, (delta, epsilon), self._axis_ranges, strict=True)
        )
        return x, y

    def _plane_position(self, x: float, y: float) -> tuple[float, float]:
        delta, epsilon = (
            span.start + at / side * (span.end - span.start)
            for side, at, span in zip(self.pixels, (x, y), self._axis_ranges, strict=True)
        )
        return delta, epsilon

    @property
    def _axis_ranges(self) -> tuple[Any, Any]:
        return self.figure.x_range, self.figure.y_range

    def remove_lines(self) -> None:
        """Remove all curves, the codimension-two points, and the area of the design limit."""
        self._marked_points = []
        for source in (self._points, self._limit_band_source, *(source for source, _ in self._lines.values())):
            glyphs.remove_rows(source)

    def show_overlays(self, names: Sequence[str]) -> None:
        """Show the lines and marks with these names, and hide all others."""
        for name, (_, renderers) in self._lines.items():
            for renderer in renderers:
                renderer.visible = name in names
        for renderer in self._marks:
            renderer.visible = "points" in names
        self._band.visible = LIMIT in names

    def mark_point(self, point: Pair | None) -> None:
        """Mark `point`, which is the open point or the chosen point of its diagram; None removes the mark."""
        _set_marker(self.cross_at, point)

    def mark_pins(self, points: Mapping[str, Pair]) -> None:
        """Mark the pinned points, each with its number, which is its key in `points`."""
        found = {
            "x": [x for x, _ in points.values()],
            "y": [y for _, y in points.values()],
            "name": list(points),
        }
        if found != self.pins_at.data:
            self.pins_at.data = found
            self._position_names()

    def draw_lines_at_point(self, points: np.ndarray | None) -> None:
        """Draw lines at the open point, such as the ellipse of its tolerances; None removes them.

        points: (k, 2) points (δ, ε) of the lines, with a row of NaN between two lines.
        """
        if points is None:
            glyphs.remove_rows(self.ellipse_at)
        else:
            self.ellipse_at.data = {"x": points[:, 0], "y": points[:, 1]}

    def show_axes_of(self, machine: SurveyedMachine | None) -> None:
        """Show the speeds and eccentricities of a machine along the axes; without a machine (None) show δ and ε."""
        self._axes.show(machine)

    def mark_cursor(self, point: Pair | None) -> None:
        """Mark the position of the keyboard's cursor, or of the mouse in another map; None removes the mark."""
        _set_marker(self.cursor_at, point)


def _default_ranges() -> tuple[Range1d, Range1d]:
    """Return the ranges of δ and of ε in the paper's plane."""
    delta, epsilon = (
        Range1d(start=low, end=high, min_interval=axes.NARROWEST) for low, high in ((0.4, 1.0), (0.0, 0.3))
    )
    return delta, epsilon


def _set_marker(source: ColumnDataSource, point: Pair | None) -> None:
    if point is None:
        glyphs.remove_rows(source)
    else:
        source.data = {"x": [point[0]], "y": [point[1]]}


def image_position_and_size(box: Ranges) -> dict[str, list[float]]:
    """Return position (x, y) and size (dw, dh) of an image that covers this box, as properties of a Bokeh image."""
    (left, right), (bottom, top) = box
    return {"x": [left], "y": [bottom], "dw": [right - left], "dh": [top - bottom]}


def _are_finite(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and np.isfinite(value) for value in values)


def _colour_bar_style(theme: str) -> dict[str, Any]:
    ink, paper, line = INK[theme]
    return {
        "major_label_text_color": ink,
        "major_label_text_font_size": "13px",
        "background_fill_color": paper,
        "bar_line_color": line,
        "major_tick_line_color": ink,
    }
