"""The picture of the basins of attraction, with Γ, manifolds, the motions A to D, and a chosen initial condition."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bokeh.events import Tap
from bokeh.models import ColumnDataSource, CustomJSHover, HoverTool, LinearColorMapper

import rattle
from gear_rattle.service.explorer.common.changes import handler_in_event_loop
from gear_rattle.service.explorer.common.figures import themed_figure
from gear_rattle.service.explorer.common.glyphs import remove_rows
from gear_rattle.service.explorer.point.parts import PlaneLine
from gear_rattle.service.explorer.point.words import percent_text, swatch_html
from gear_rattle.service.explorer.state.events import Event, InitialConditionChosen
from rattle.attractors import PAPER_SPEED
from rattle.plot import MANIFOLDS, Palette, legend_name

MOST_NAMED = 24  # largest number of basins that the legend names
GAMMA = "Γ"
#: Colour and dashes of each line; both manifolds of a saddle have the same colour.
STYLES = {
    GAMMA: ("#ffffff", "solid"),
    "Wˢ(A)": (MANIFOLDS["A"], "solid"),
    "Wᵘ(A)": (MANIFOLDS["A"], "dashed"),
    "Wˢ(B)": (MANIFOLDS["B"], "solid"),
}
NAME_OF_LABEL = "return names.data.name[value] ?? ''"
STEPS = "return value < 0 ? 'not seen' : String(value)"


class BasinsPicture:
    """Picture of basins in the (τ, v) plane. A click chooses the motion that begins at the clicked state (τ, v)."""

    def __init__(self, theme: str, dispatch: Callable[[Event], None]) -> None:
        self._dispatch = dispatch
        names = "phase τ of the impact", "speed v after it"
        self.figure = themed_figure("basins", theme, *names, 460, (0.0, 1.0), (PAPER_SPEED, 0.0))
        self._v_max = PAPER_SPEED
        self.figure.grid.visible = False
        self._names = ColumnDataSource({"name": []})
        self._cells = ColumnDataSource({"label": [], "steps": []})
        self._mapper = LinearColorMapper(palette=["#9a9a9a"], low=-0.5, high=0.5)
        self._image = self.figure.image(
            "label", x=0, y=0, dw=1, dh=self._v_max, source=self._cells, color_mapper=self._mapper, level="image"
        )
        named = CustomJSHover(args={"names": self._names}, code=NAME_OF_LABEL)
        tooltips = [
            ("ends as", "@label{custom}"),
            ("impacts until certain", "@steps{custom}"),
            ("(τ, v)", "$x{%.4f}, $y{%.4g}"),
        ]
        steps = CustomJSHover(code=STEPS)
        formatters: dict[str, Any] = {"@label": named, "@steps": steps, "$x": "printf", "$y": "printf"}
        self.figure.add_tools(
            HoverTool(renderers=[self._image], tooltips=tooltips, formatters=formatters, name="cells")
        )
        self._lines: dict[str, ColumnDataSource] = {}
        for name, (shade, dash) in STYLES.items():
            width = 1.5 if dash == "solid" else 0.9
            self._lines[name] = ColumnDataSource({"tau": [], "v": []})
            edge = {"line_color": "#404040", "line_width": 2.6, "line_alpha": 0.7}
            if name == GAMMA:
                self.figure.line("tau", "v", source=self._lines[name], **edge)
            self.figure.line(
                "tau",
                "v",
                source=self._lines[name],
                line_color=shade,
                line_dash=dash,
                line_width=width,
                name=name,
            )
        self._orbits = ColumnDataSource({"tau": [], "v": [], "name": [], "aside": []})
        self._chosen = ColumnDataSource({"tau": [], "v": []})
        for size, shade in ((15, "#000000"), (11, "#ffffff")):
            self.figure.scatter(
                "tau", "v", source=self._orbits, marker="x", size=size, line_color=shade, line_width=size - 8
            )
        self.figure.text(
            "tau", "v", "name", source=self._orbits, x_offset="aside", y_offset=-5, text_color="#ffffff",
            text_outline_color="#000000", text_font_size="17px", text_font_style="bold",
        )  # fmt: skip
        for size, shade, width in ((15, "#000000", 4.5), (15, "#ffffff", 2)):
            self.figure.scatter(
                "tau", "v", source=self._chosen, marker="circle", size=size, fill_alpha=0, line_color=shade,
                line_width=width,
            )  # fmt: skip
        self.figure.on_event(Tap, handler_in_event_loop(self.choose_clicked_state))

    def choose_clicked_state(self, event: Any) -> None:
        """Choose the motion that begins where the picture was clicked."""
        if event.x is not None and event.y is not None and 0 < event.y < self._v_max:
            self._dispatch(InitialConditionChosen((float(event.x % 1.0), float(event.y))))

    def show_cells(self, basins: rattle.Basins, palette: Palette) -> None:
        """Show basins; a type of motion has the same colour in all pictures that share the palette."""
        if basins.v_max != self._v_max:
            self._v_max = basins.v_max
            self.figure.y_range.update(start=self._v_max, end=0.0)
            self._image.glyph.dh = self._v_max
        self._names.data = {"name": [legend_name(each) for each in basins.attractors]}
        self._mapper.update(
            palette=[palette.colour(each) for each in basins.attractors], high=len(basins.attractors) - 0.5
        )
        most = np.iinfo(np.int32).max
        self._cells.data = {
            "label": [basins.labels.astype(np.uint8)],
            "steps": [np.minimum(basins.steps, most).astype(np.int32)],
        }

    def show_orbits(self, orbits: tuple[rattle.Orbit, ...]) -> None:
        """Mark the motions A to D whose speeds are inside the picture."""
        shown = [orbit for orbit in orbits if orbit.v < self._v_max]
        self._orbits.data = {
            "tau": [orbit.tau for orbit in shown],
            "v": [orbit.v for orbit in shown],
            "name": [orbit.name for orbit in shown],
            # pixels from a mark to its letter: B and D stand to the left, because B is close to C, and D to A
            "aside": [-22 if orbit.name in "BD" else 9 for orbit in shown],
        }

    def show_lines(self, lines: tuple[PlaneLine, ...]) -> None:
        """Draw Γ and the manifolds."""
        for line in lines:
            self._lines[line.name].data = {"tau": line.points[:, 0], "v": line.points[:, 1]}

    def remove_lines(self) -> None:
        """Remove Γ and the manifolds."""
        for source in self._lines.values():
            remove_rows(source)

    def clear(self) -> None:
        """Remove the basins, the lines and all marks from the picture."""
        for source in (self._cells, self._orbits, self._chosen, *self._lines.values()):
            remove_rows(source)

    def mark_initial_state(self, tau: float, v: float) -> None:
        """Draw a ring around the initial state of the shown motion; remove it if this state is above the picture."""
        self._chosen.data = {"tau": [tau], "v": [v]} if v < self._v_max else {"tau": [], "v": []}


def basins_legend(basins: rattle.Basins, lines: tuple[PlaneLine, ...], palette: Palette) -> str:
    """Return the legend in HTML: the first MOST_NAMED attractors, the basin fraction of each, and the lines."""
    parts = []
    shares = np.bincount(basins.labels.ravel(), minlength=len(basins.attractors)) / basins.labels.size
    for each, share in zip(basins.attractors[:MOST_NAMED], shares, strict=False):
        parts.append(f"<li>{swatch_html(palette.colour(each))}{legend_name(each)} {percent_text(share)}</li>")
    if len(shares) > MOST_NAMED:
        parts.append(f"<li>and {len(shares) - MOST_NAMED} more, {percent_text(shares[MOST_NAMED:].sum())} in all</li>")
    for line in lines:
        shade, dash = STYLES[line.name]
        parts.append(f'<li><span class="stroke" style="border-top:3px {dash} {shade}"></span>{line.name}</li>')
    return f'<ul class="legend" aria-label="Legend of the basins">{"".join(parts)}</ul>'


def basins_caption(basins: rattle.Basins, lines: tuple[PlaneLine, ...], palette: Palette) -> str:
    """Return in HTML the legend, and below it the number of cells of the (τ, v) plane in the picture."""
    side = basins.tau.size
    how = f'<p class="faint">{side} × {side} cells. Click one to see its motion.</p>'
    return basins_legend(basins, lines, palette) + how
