"""The map as a figure of Bokeh: cells with a value, cells without and why, finer frames, lines, marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.core.property.descriptors import UnsetValueError
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
NO_POINTS = ("x", "y", "marker", "name", "align", "dx", "dy")
#: Where the name of a point is: those that lie close together are named on different sides.
BESIDE = {"COD21": ("right", -9, -10), "COD22": ("left", 9, -10), "COD23": ("right", -9, 14)}
UNSEEN = (700, 550)
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


@dataclass(frozen=True)
class _Scale:
    """What draws values on a linear or a logarithmic scale of colours."""

    mapper: Any
    cells: Any
    fine: Any
    bar: Any


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
        self._values, self._fine, self._reasons = (
            ColumnDataSource({name: [] for name in ("image", "x", "y", "dw", "dh")}) for _ in range(3)
        )
        place = {"x": "x", "y": "y", "dw": "dw", "dh": "dh", "level": "image"}
        self._why_mapper: Any = LinearColorMapper(palette=[CLEAR], low=0, high=1, nan_color=CLEAR)
        self._why = plot.image("image", source=self._reasons, color_mapper=self._why_mapper, **place)
        # A glyph does not take another mapper later: the linear and the logarithmic scale have glyphs of their own.
        self._scales: dict[bool, _Scale] = {}
        for log, kind in ((False, LinearColorMapper), (True, LogColorMapper)):
            mapper = kind(palette=["#000000"], low=1, high=2, nan_color=CLEAR)
            cells, fine = (
                plot.image("image", source=source, color_mapper=mapper, visible=False, **place)
                for source in (self._values, self._fine)
            )
            bar = ColorBar(color_mapper=mapper, visible=False, width=12, padding=6, **_ink_of_bar(theme))
            plot.add_layout(bar, "right")
            self._scales[log] = _Scale(mapper, cells, fine, bar)
        self._log, self._fits = False, True
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
        self._points = ColumnDataSource({name: [] for name in (*NO_POINTS,)})
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
            "x", "y", text="name", source=self._points, x_offset="dx", y_offset="dy", text_align="align",
            text_baseline="middle", text_font_size="12px", text_color="black", background_fill_color="white",
            background_fill_alpha=0.8, padding=2, border_radius=3,
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
        self._fits = self._box is None or (self._box[0][1] - self._box[0][0]) < LARGEST_ZOOM * (delta[1] - delta[0])
        self._show_scale()

    def _show_scale(self) -> None:
        self._why.visible = self._fits
        for log, scale in self._scales.items():
            scale.cells.visible = self._fits and log == self._log
            scale.fine.visible = log == self._log

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of the frame on the screen; a guess until a browser has said."""
        try:
            return max(int(self.figure.inner_width), 1), max(int(self.figure.inner_height), 1)
        except UnsetValueError:
            return UNSEEN

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
        for scale in self._scales.values():
            scale.bar.visible = False

    def _colour(self, colours: Colouring) -> None:
        self._log = colours.log
        palette = list(colours.palette)
        self._scales[colours.log].mapper.update(palette=palette, low=colours.low, high=colours.high)
        for log, scale in self._scales.items():
            scale.bar.visible = log == colours.log and not colours.categorical
        reasons = [CLEAR, *colours.reason_colours]
        self._why_mapper.update(palette=reasons, low=-0.5, high=len(reasons) - 0.5)
        self._show_scale()

    def line(self, name: str, pieces: Sequence[np.ndarray]) -> None:
        """Draw a curve: pieces (k, 2) of (δ, ε)."""
        source, _ = self._lines[name]
        source.data = {"xs": [piece[:, 0] for piece in pieces], "ys": [piece[:, 1] for piece in pieces]}

    def points(self, points: Sequence[tuple[str, float, float]]) -> None:
        """Mark the codimension-two points: name, δ, ε."""
        names, x, y = zip(*points, strict=True) if points else ((), (), ())
        markers = [SHAPES[MARKERS[name]] for name in names]
        align, dx, dy = (
            zip(*(BESIDE.get(name, ("left", 9, -10)) for name in names), strict=True) if names else ((),) * 3
        )
        columns = (x, y, markers, names, align, dx, dy)
        self._points.data = {key: list(column) for key, column in zip(NO_POINTS, columns, strict=True)}

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
