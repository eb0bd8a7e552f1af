"""Make the figures for one parameter point, in a light or a dark theme."""

from __future__ import annotations

from typing import Any

from bokeh.colors import RGB
from bokeh.models import Range1d
from bokeh.plotting import figure

#: Colours of the text, the background and the lines of each theme.
INK = {"light": ("#1d2733", "#ffffff", "#c4ccd4"), "dark": ("#e4e9ee", "#171c22", "#47525e")}
Limits = tuple[float, float]
#: Style that makes a column a block when it is printed. A block may continue on the next sheet of paper after any of
#: its parts; without this style the column is a flexible box, which Chromium does not divide between sheets.
PRINTED = "@media print { :host { display: block !important; } }"
LEAST_CONTRAST = 4.5  # least contrast of a thin line with a dark background, by the formula of WCAG 2
LEFT_BORDER = 62  # pixels to the left of a figure's frame, the same in stacked figures, so that their axes are in line


def themed_figure(
    name: str,
    theme: str,
    x: str,
    y: str,
    height: int,
    x_range: Limits | Range1d | None = None,
    y_range: Limits | None = None,
) -> Any:
    """Return an empty figure of full width, with the axis labels x and y and with tools to pan, zoom and save."""
    ink, paper, line = INK[theme]
    spans = {"x_range": x_range, "y_range": y_range}
    ranges: dict[str, Any] = {
        name: Range1d(start=span[0], end=span[1]) if isinstance(span, tuple) else span
        for name, span in spans.items()
        if span
    }
    found = figure(
        name=name,
        sizing_mode="stretch_width",
        height=height,
        min_width=260,
        tools="pan,box_zoom,wheel_zoom,reset,save",
        toolbar_location="above",
        background_fill_color=paper,
        border_fill_color=paper,
        outline_line_color=line,
        x_axis_label=x,
        y_axis_label=y,
        output_backend="canvas",
        stylesheets=["@media print { :host { break-inside: avoid; } }"],
        **ranges,
    )
    found.toolbar.logo = None
    for axis in found.axis:
        axis.axis_label_text_color = axis.major_label_text_color = ink
        axis.axis_line_color = axis.major_tick_line_color = ink
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "13px"
    for grid in found.grid:
        grid.grid_line_color = line
    return found


def foreground_colour(theme: str) -> str:
    """Return the colour of lines and text in a theme."""
    return INK[theme][0]


def line_colour(colour: str, theme: str) -> str:
    """Return a colour in which a thin line is visible in a theme: in the dark theme, dark colours are lightened."""
    if theme != "dark":
        return colour
    paper, found = RGB.from_hex_string(INK[theme][1]), RGB.from_hex_string(colour)
    while found.luminance + 0.05 < LEAST_CONTRAST * (paper.luminance + 0.05):
        found = found.lighten(0.02)
    return found.to_hex()
