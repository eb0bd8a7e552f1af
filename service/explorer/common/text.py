"""Panes of the page whose text changes often."""

from __future__ import annotations

from html import escape
from typing import Any

import panel as pn
from bokeh.models.widgets import Div

STYLE = ":host { font: 13px/1.45 system-ui, sans-serif; } .bk-clearfix { display: block !important; width: 100%; }"


def alert_html(message: str, kind: str = "notice") -> str:
    """Return the HTML of a message that screen readers read out at once. kind: CSS class, "notice" or "wrong"."""
    return f'<p class="{kind}" role="alert">{escape(message)}</p>'


def faint_html(text: str) -> str:
    """Return the HTML of a text in faint colour, because it is less important."""
    return f'<p class="faint">{escape(text)}</p>'


class TextPane:
    """Pane of HTML. A change sends the text only, where Panel's own pane would send all styles again."""

    def __init__(self, html: str = "", *sheets: str, margin: Any = 0, is_spoken: bool = False) -> None:
        spoken = {"role": "status", "aria-live": "polite"} if is_spoken else {}
        self._model = Div(
            text=html,
            stylesheets=[STYLE, *sheets],
            margin=0,
            disable_math=True,
            html_attributes=spoken,
            sizing_mode="stretch_width",
        )
        self.pane = pn.pane.Bokeh(self._model, sizing_mode="stretch_width", margin=margin)

    @property
    def html(self) -> str:
        """HTML of the pane."""
        return str(self._model.text)

    @html.setter
    def html(self, html: str) -> None:
        self._model.text = html


class MapHeading(TextPane):
    """Line that describes the shown map. While no map is shown, the line gives the reason."""

    def __init__(self, sheet: str) -> None:
        super().__init__("", sheet)
        self._shown = self._progress = ""

    def show_description(self, description: str) -> None:
        """Write the description of the shown map, in HTML."""
        self._shown = description
        self._write_line()

    def show_progress(self, text: str) -> None:
        """Write a note after the description: the computation that runs, or why the map has no finer cells.

        The note is hidden while no map is shown.
        """
        self._progress = text
        if self._shown:
            self._write_line()

    def show_reason_for_no_map(self, html: str) -> None:
        """Show `html`, the reason why no map is shown, in place of the description."""
        self._shown = self._progress = ""
        self.html = html

    def _write_line(self) -> None:
        said = f' <span class="faint" role="status">{escape(self._progress)}</span>' if self._progress else ""
        self.html = f"<p>{self._shown}{said}</p>"
