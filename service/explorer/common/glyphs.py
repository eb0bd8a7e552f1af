"""Make the glyphs of the map, without Bokeh's extra glyphs for selections, which would delay a page by 0.2 s."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.models import (
    AllIndices,
    CDSView,
    ColumnDataSource,
    CustomJSTickFormatter,
    LinearColorMapper,
    LogColorMapper,
    Node,
    UnionRenderers,
)
from bokeh.models.annotations import ColorBar, Label
from bokeh.models.glyphs import Image, Line, MultiLine, Scatter, Segment, Text, VArea
from bokeh.models.renderers import GlyphRenderer

from gear_rattle.service.explorer.files import read_asset
from gear_rattle.workers.pictures.look import COVERED, LIMIT, OPACITY, OWN_STYLES
from rattle.plot import STYLES

BAR_WIDTH, BAR_PADDING = 12, 6  # pixels
#: Text and baseline of the arrow at each end of a colour bar.
ENDS = {"left": ("◀", "middle"), "right": ("▶", "middle"), "bottom": ("▼", "top"), "top": ("▲", "bottom")}
TRANSPARENT = "#00000000"
VEIL = f"{round(COVERED * 0xFF):02x}"
ELLIPSE = "#d40078"
BAND_NAME = "limit_band"
IMAGE = ("image", "x", "y", "dw", "dh")
LINE = ("xs", "ys")
BAND = ("x", "low", "high")
POINT = ("x", "y", "marker", "name", "dx", "dy", "to_x", "to_y")


@dataclass(frozen=True)
class ScaleRenderers:
    """Renderers of a map on one colour scale, linear or logarithmic.

    A map has renderers on both scales and shows one set, because a renderer cannot change its colour mapper.

    mapper: the colour mapper that `cells`, `fine` and `bar` share. cells: renderer of the survey's cells. fine:
    renderer of finer cells in a window. bar: the colour bar.
    """

    mapper: Any
    cells: Any
    fine: Any
    bar: Any


def create_empty_source(columns: tuple[str, ...]) -> ColumnDataSource:
    """Return a data source with these columns and without rows."""
    return ColumnDataSource({name: [] for name in columns})


def share_filter_and_selection(renderers: Sequence[Any]) -> None:
    """Give renderers one index filter and one selection policy in common.

    Bokeh's default is a filter and a policy for each renderer, which would be a fifth of all Bokeh models of a page.
    """
    every, policy = AllIndices(), UnionRenderers()
    for renderer in renderers:
        renderer.view = CDSView(filter=every)
        renderer.data_source.selection_policy = policy


def remove_rows(source: ColumnDataSource) -> None:
    """Remove all rows of a source, if it has any."""
    if any(len(column) for column in source.data.values()):
        source.data = {name: [] for name in source.data}


def line_style_of(name: str) -> tuple[str, tuple[float, ...]]:
    """Return the colour of a named line, and its dashes and gaps in pixels, () for a solid line; see `rattle.plot`."""
    styles: dict[str, Any] = {**STYLES, **OWN_STYLES}
    colour, dashes = styles[name]
    return ("#000000" if colour == "black" else colour), tuple(2.0 * d for d in dashes[1]) if dashes != "-" else ()


def create_image_renderer(source: ColumnDataSource, mapper: Any, **properties: Any) -> Any:
    """Return a renderer of images that are drawn below all other glyphs."""
    glyph = Image(image="image", x="x", y="y", dw="dw", dh="dh", color_mapper=mapper)
    return _create_glyph_renderer(source, glyph, level="image", **properties)


def transparent_colour_mapper() -> Any:
    """Return a colour mapper that makes every value transparent, until its palette is replaced."""
    return LinearColorMapper(palette=[TRANSPARENT], low=0, high=1, nan_color=TRANSPARENT)


def create_veil_renderer(source: ColumnDataSource, paper: str) -> Any:
    """Return an image renderer that covers pixels of value 1 with the translucent background colour `paper`."""
    mapper = LinearColorMapper(palette=[TRANSPARENT, paper + VEIL], low=-0.5, high=1.5, nan_color=TRANSPARENT)
    return create_image_renderer(source, mapper, name="veil")


def create_colour_scales(values: ColumnDataSource, fine: ColumnDataSource, **bar: Any) -> dict[bool, ScaleRenderers]:
    """Return the linear and the logarithmic colour scale of a map.

    values: source of the survey's cells. fine: source of finer cells of a window. bar: properties of the colour bars.

    Returns
    -------
    dict[bool, ScaleRenderers]
        {False: the linear scale, True: the logarithmic scale}.
    """
    found = {}
    for log, kind in ((False, LinearColorMapper), (True, LogColorMapper)):
        mapper = kind(palette=["#000000"], low=1, high=2, nan_color=TRANSPARENT)
        cells, finer = (
            create_image_renderer(source, mapper, visible=False, name=f"{name}{log:d}")
            for name, source in (("cells", values), ("fine", fine))
        )
        numbers = CustomJSTickFormatter(code=read_asset("bar_ticks.js"))
        ends = ColorBar(
            color_mapper=mapper, formatter=numbers, visible=False, width=BAR_WIDTH, padding=BAR_PADDING, **bar
        )
        found[log] = ScaleRenderers(mapper, cells, finer, ends)
    return found


def make_range_arrows(ink: str) -> list[Any]:
    """Return two hidden labels, which `place_arrows_at_bar_ends` turns into arrows at the ends of a colour bar."""
    style: dict[str, Any] = {"text_font_size": "11px", "text_align": "center", "text_color": ink}
    return [Label(x=0, y=0, text="", visible=False, **style) for _ in range(2)]


def place_colour_bars(plot: Any, bars: Sequence[Any], is_below: bool) -> None:
    """Move the colour bars, of which one is visible at a time, below the map (`is_below`) or to its right."""
    for bar in bars:
        bar.update(width="auto" if is_below else BAR_WIDTH, height=BAR_WIDTH if is_below else "auto")
    right, below = ([each for each in side if each not in bars] for side in (plot.right, plot.below))
    # a bar joins its new side before it leaves the old one, because Bokeh drops the view of a bar that is on no side
    if is_below:
        plot.below = [*below, *bars]
        plot.right = right
    else:
        plot.right = [*right, *bars]
        plot.below = below


def place_arrows_at_bar_ends(marks: Sequence[Any], bar: Any, is_below: bool) -> None:
    """Place two arrows at the lower and the upper end of a colour bar. is_below: True if the bar is below the map."""
    across: Any = Node(target=bar, symbol="top" if is_below else "left", offset=BAR_PADDING + BAR_WIDTH // 2)
    for mark, edge, offset in zip(
        marks, ("left", "right") if is_below else ("bottom", "top"), (-BAR_PADDING, BAR_PADDING), strict=True
    ):
        end: Any = Node(target="frame", symbol=edge, offset=offset)
        x, y = (end, across) if is_below else (across, end)
        mark.update(x=x, y=y, text=ENDS[edge][0], text_baseline=ENDS[edge][1])


def create_line_renderers(source: ColumnDataSource, name: str) -> list[Any]:
    """Return the renderers of a named line: a white edge, and over it the line in its own style."""
    colour, dash = line_style_of(name)
    dashes = " ".join(str(round(each)) for each in dash) or "solid"
    halo = MultiLine(xs="xs", ys="ys", line_color="white", line_width=3.6, line_alpha=0.75)
    own = MultiLine(xs="xs", ys="ys", line_color=colour, line_width=1.7, line_dash=dashes)
    return [_create_glyph_renderer(source, halo), _create_glyph_renderer(source, own, name=name)]


def create_point_renderers(source: ColumnDataSource) -> list[Any]:
    """Return the renderers of marked points, of their names, and of leader lines to names away from their points."""
    marks = Scatter(x="x", y="y", marker="marker", size=9, fill_color="white", line_color="black")
    leaders = [
        _create_glyph_renderer(
            source, Segment(x0="x", y0="y", x1="to_x", y1="to_y", line_color=colour, line_width=width)
        )
        for colour, width in (("white", 3.0), ("black", 1.0))
    ]
    box: dict[str, Any] = {"padding": 2, "border_radius": 3}
    names = Text(
        x="x", y="y", text="name", x_offset="dx", y_offset="dy", text_align="center", text_baseline="middle",
        text_font_size="12px", text_color="black", background_fill_color="white", background_fill_alpha=0.8,
        **box,
    )  # fmt: skip
    return [*leaders, _create_glyph_renderer(source, marks, name="points"), _create_glyph_renderer(source, names)]


def create_name_renderer(source: ColumnDataSource) -> Any:
    """Return a renderer of names of regions or families, with a white edge, each `dx` pixels to the right of (x, y)."""
    glyph = Text(
        x="x", y="y", x_offset="dx", text="name", text_align="center", text_baseline="middle", text_font_size="17px",
        text_font_style="bold", text_color="black", text_outline_color="white",
    )  # fmt: skip
    return _create_glyph_renderer(source, glyph, name="names")


def create_band_renderer(source: ColumnDataSource) -> Any:
    """Return the renderer of the area between the lower and the upper ends of the design limit's intervals."""
    area = VArea(x="x", y1="low", y2="high", fill_color=OWN_STYLES[LIMIT][0], fill_alpha=OPACITY)
    return _create_glyph_renderer(source, area, name=BAND_NAME)


def outline_renderers(source: ColumnDataSource) -> list[Any]:
    """Return the renderers of a closed line with a white edge."""
    strokes = (("white", 4.0, 0.8), (ELLIPSE, 2.0, 1.0))
    return [
        _create_glyph_renderer(source, Line(x="x", y="y", line_color=colour, line_width=width, line_alpha=alpha))
        for colour, width, alpha in strokes
    ]


def cross_renderers(source: ColumnDataSource) -> list[Any]:
    """Return the renderers of a cross with a white edge."""
    return _edged_markers(source, "cross", (26, "white", 5), (24, "#d40078", 2))


def ring_renderers(source: ColumnDataSource) -> list[Any]:
    """Return the renderers of a ring with a white edge."""
    return _edged_markers(source, "circle", (17, "white", 5), (17, "black", 2))


def create_pin_renderers(source: ColumnDataSource) -> list[Any]:
    """Return the renderers of pins: each is a number in a disc."""
    disc = Scatter(x="x", y="y", marker="circle", size=20, fill_color="white", line_color="black", line_width=1.5)
    number = Text(
        x="x", y="y", text="name", text_align="center", text_baseline="middle", text_font_size="12px",
        text_font_style="bold", text_color="black",
    )  # fmt: skip
    return [
        _create_glyph_renderer(source, disc, name="pins"),
        _create_glyph_renderer(source, number, name="names of pins"),
    ]


def _edged_markers(source: ColumnDataSource, marker: str, *strokes: tuple[int, str, int]) -> list[Any]:
    return [
        _create_glyph_renderer(
            source,
            Scatter(x="x", y="y", marker=marker, size=size, line_color=colour, line_width=width, fill_color=None),
        )
        for size, colour, width in strokes
    ]


def _create_glyph_renderer(source: ColumnDataSource, glyph: Any, **properties: Any) -> Any:
    return GlyphRenderer(data_source=source, glyph=glyph, nonselection_glyph=None, muted_glyph=None, **properties)
