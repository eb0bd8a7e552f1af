"""The map as a figure of Bokeh: cells with a value, cells without and why, finer frames, lines, marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from bokeh.events import MouseMove, RangesUpdate, Reset, Tap
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    LinearColorMapper,
    LogColorMapper,
    Range1d,
    WheelZoomTool,
)
from bokeh.models.annotations import ColorBar
from bokeh.plotting import figure

from rattle.plot.plane import MARKERS, STYLES
from service.explorer import axes
from service.explorer.address import CRISIS, Pair
from service.explorer.colouring import CLEAR, Colouring

SHAPES = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle"}
POINTER_MS, WINDOW_MS = 50, 200
LARGEST_ZOOM = 5000.0  # beyond, a browser does not place the enlarged cells well
CRISIS_STYLE = ("#00695c", (8.0, 3.0))
INK = {"default": ("#1d2733", "#ffffff", "#c4ccd4"), "dark": ("#e4e9ee", "#171c22", "#47525e")}


def style_of(name: str) -> tuple[str, tuple[float, ...]]:
    """Colour, and dashes in pixels, of a line: those of the figures."""
    if name == CRISIS:
        return CRISIS_STYLE
    styles: dict[str, Any] = dict(STYLES)
    colour, dashes = styles[name]
    return ("#000000" if colour == "black" else colour), tuple(2.0 * d for d in dashes[1]) if dashes != "-" else ()


class Map:
    """The figure. `on_point` (clicked) and `on_pointer` (hovered) get (δ, ε), `on_window` a window or None for all."""

    def __init__(
        self,
        theme: str,
        on_point: Callable[[float, float], None],
        on_pointer: Callable[[float, float], None],
        on_window: Callable[[Pair, Pair], None],
        on_reset: Callable[[], None],
    ) -> None:
        plot: Any = figure(
            x_range=Range1d(start=0.4, end=1.0, min_interval=axes.NARROWEST),
            y_range=Range1d(start=0.0, end=0.3, min_interval=axes.NARROWEST),
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
        axes.dress(plot)
        self._dress(theme)
        self._mapper: Any = None
        self._values, self._fine, self._reasons = (
            ColumnDataSource({name: [] for name in ("image", "x", "y", "dw", "dh")}) for _ in range(3)
        )
        clear: Any = LinearColorMapper(palette=[CLEAR], low=0, high=1, nan_color=CLEAR)
        place = {"x": "x", "y": "y", "dw": "dw", "dh": "dh", "level": "image"}
        self._cells = plot.image("image", source=self._values, color_mapper=clear, **place)
        self._why = plot.image("image", source=self._reasons, color_mapper=clear, **place)
        self._finer = plot.image("image", source=self._fine, color_mapper=clear, **place)
        self._bar = ColorBar(color_mapper=clear, visible=False, width=12, padding=6, **_ink_of_bar(theme))
        plot.add_layout(self._bar, "right")
        self._lines: dict[str, tuple[ColumnDataSource, list[Any]]] = {}
        for name in (*STYLES, CRISIS):
            source, (colour, dash) = ColumnDataSource({"xs": [], "ys": []}), style_of(name)
            halo = plot.multi_line("xs", "ys", source=source, color="white", line_width=3.6, line_alpha=0.75)
            line = plot.multi_line(
                "xs",
                "ys",
                source=source,
                color=colour,
                line_width=1.7,
                line_dash=" ".join(str(round(d)) for d in dash) or "solid",
                name=name,
            )
            self._lines[name] = source, [halo, line]
        self._points = ColumnDataSource({"x": [], "y": [], "marker": [], "name": []})
        marks = plot.scatter(
            "x",
            "y",
            marker="marker",
            source=self._points,
            size=9,
            fill_color="white",
            line_color="black",
            name="points",
        )
        names = plot.text(
            "x", "y", text="name", source=self._points, x_offset=8, y_offset=-4, text_font_size="12px",
            text_color="black", text_outline_color="white",
        )  # fmt: skip
        self._marks = [marks, names]
        self._cross = ColumnDataSource({"x": [], "y": []})
        plot.scatter("x", "y", source=self._cross, marker="cross", size=26, line_color="white", line_width=5)
        plot.scatter("x", "y", source=self._cross, marker="cross", size=24, line_color="#d40078", line_width=2)
        self._box: tuple[Pair, Pair] | None = None
        self._listen(on_point, on_pointer, on_window, on_reset)

    def _dress(self, theme: str) -> None:
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

    def _listen(
        self,
        on_point: Callable[[float, float], None],
        on_pointer: Callable[[float, float], None],
        on_window: Callable[[Pair, Pair], None],
        on_reset: Callable[[], None],
    ) -> None:
        pointer, window = ColumnDataSource({"x": [], "y": []}), ColumnDataSource({"x": [], "y": []})
        for source, event, data, wait in (
            (pointer, MouseMove, "{x: [cb_obj.x], y: [cb_obj.y]}", POINTER_MS),
            (window, RangesUpdate, "{x: [cb_obj.x0, cb_obj.x1], y: [cb_obj.y0, cb_obj.y1]}", WINDOW_MS),
        ):
            code = f"""const at = {data}
                clearTimeout(source.waiting)
                source.waiting = setTimeout(() => {{ source.data = at }}, {wait})"""
            self.figure.js_on_event(event, CustomJS(args={"source": source}, code=code))

        def pointed(_attribute: str, _old: object, new: Any) -> None:
            if new["x"] and _finite(new["x"] + new["y"]):
                on_pointer(float(new["x"][0]), float(new["y"][0]))

        def moved(_attribute: str, _old: object, new: Any) -> None:
            if len(new["x"]) == 2 and _finite(new["x"] + new["y"]):
                on_window((float(new["x"][0]), float(new["x"][1])), (float(new["y"][0]), float(new["y"][1])))

        def tapped(event: Any) -> None:
            if _finite([event.x, event.y]):
                on_point(float(event.x), float(event.y))

        pointer.on_change("data", pointed)
        window.on_change("data", moved)
        self.figure.on_event(Tap, tapped)
        self.figure.on_event(Reset, lambda _event: on_reset())

    def window(self, delta: Pair, epsilon: Pair) -> None:
        """Show this window."""
        axes.show(self.figure.xaxis[0], self.figure.x_range, axes.NAMES[0], delta)
        axes.show(self.figure.yaxis[0], self.figure.y_range, axes.NAMES[1], epsilon)
        self._hide_what_is_too_large(delta)

    def moved(self, delta: Pair) -> None:
        """The viewer has moved to this range of δ."""
        self._hide_what_is_too_large(delta)

    def _hide_what_is_too_large(self, delta: Pair) -> None:
        fits = self._box is None or (self._box[0][1] - self._box[0][0]) < LARGEST_ZOOM * (delta[1] - delta[0])
        self._cells.visible = self._why.visible = fits

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the frame on the screen; a guess until a browser has said."""
        return int(self.figure.inner_width or 700), int(self.figure.inner_height or 500)

    def cells(self, delta: np.ndarray, epsilon: np.ndarray, values: np.ndarray, colours: Colouring) -> None:
        """Draw the cells of a survey; values float32 (epsilon, delta)."""
        self._box, where = box_of(delta, epsilon), image_at(delta, epsilon)
        self._colour(colours)
        shown = np.where(colours.reasons == 0, values, np.float32(np.nan))
        self._values.data = {"image": [shown], **where}
        self._reasons.data = {"image": [colours.reasons], **where}

    def frame(self, delta: np.ndarray, epsilon: np.ndarray, values: np.ndarray) -> None:
        """Draw a finer block over the cells."""
        self._fine.data = {"image": [np.asarray(values, np.float32)], **image_at(delta, epsilon)}

    def no_frame(self) -> None:
        if self._fine.data["image"]:
            self._fine.data = {name: [] for name in self._fine.data}

    def no_cells(self) -> None:
        self.no_frame()
        for source in (self._values, self._reasons):
            source.data = {name: [] for name in source.data}
        self._bar.visible = False

    def _colour(self, colours: Colouring) -> None:
        kind = LogColorMapper if colours.log else LinearColorMapper
        if type(self._mapper) is not kind or list(self._mapper.palette) != list(colours.palette):
            self._mapper = kind(palette=list(colours.palette), low=colours.low, high=colours.high, nan_color=CLEAR)
            for renderer in (self._cells, self._finer):
                renderer.glyph.color_mapper = self._mapper
            self._bar.color_mapper = self._mapper
        else:
            self._mapper.update(low=colours.low, high=colours.high)
        self._bar.visible = not colours.categorical
        palette = [CLEAR, *colours.reason_colours]
        if list(self._why.glyph.color_mapper.palette) != palette:
            self._why.glyph.color_mapper = LinearColorMapper(palette=palette, low=-0.5, high=len(palette) - 0.5)

    def line(self, name: str, pieces: Sequence[np.ndarray]) -> None:
        """Draw a curve: pieces (k, 2) of (δ, ε)."""
        source, _ = self._lines[name]
        source.data = {"xs": [piece[:, 0] for piece in pieces], "ys": [piece[:, 1] for piece in pieces]}

    def points(self, points: Sequence[tuple[str, float, float]]) -> None:
        """Mark the codimension-two points: name, δ, ε."""
        names, x, y = zip(*points, strict=True) if points else ((), (), ())
        markers = [SHAPES[MARKERS[name]] for name in names]
        self._points.data = {"x": list(x), "y": list(y), "marker": markers, "name": list(names)}

    def choose(self, names: Sequence[str]) -> None:
        """Show these overlays and no others."""
        for name, (_, renderers) in self._lines.items():
            for renderer in renderers:
                renderer.visible = name in names
        for renderer in self._marks:
            renderer.visible = "points" in names

    def cross(self, point: Pair | None) -> None:
        """Mark the point that was clicked."""
        self._cross.data = {"x": [point[0]], "y": [point[1]]} if point else {"x": [], "y": []}


def box_of(delta: np.ndarray, epsilon: np.ndarray) -> tuple[Pair, Pair]:
    """What the cells cover: half a cell more on each side."""
    halves = ((axis[-1] - axis[0]) / (2 * max(axis.size - 1, 1)) for axis in (delta, epsilon))
    dx, dy = (float(half) for half in halves)
    return (float(delta[0]) - dx, float(delta[-1]) + dx), (float(epsilon[0]) - dy, float(epsilon[-1]) + dy)


def image_at(delta: np.ndarray, epsilon: np.ndarray) -> dict[str, list[float]]:
    """Where Bokeh puts an image of these cells."""
    (left, right), (bottom, top) = box_of(delta, epsilon)
    return {"x": [left], "y": [bottom], "dw": [right - left], "dh": [top - bottom]}


def _finite(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and np.isfinite(value) for value in values)


def _ink_of_bar(theme: str) -> dict[str, Any]:
    ink, paper, line = INK[theme]
    return {
        "major_label_text_color": ink,
        "major_label_text_font_size": "13px",
        "background_fill_color": paper,
        "bar_line_color": line,
        "major_tick_line_color": ink,
    }
