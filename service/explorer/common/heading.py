"""Describe a map, and the work in progress, in a line above the map."""

from __future__ import annotations

from html import escape

from gear_rattle.service.explorer.common.text import Text


class Heading(Text):
    """Line that describes the shown map. The reason why no map is shown replaces the line."""

    def __init__(self, sheet: str) -> None:
        super().__init__("", sheet)
        self._shown = self._progress = ""

    def show(self, what: str) -> None:
        """Write the description of the shown map, in HTML."""
        self._shown = what
        self._write()

    def show_progress(self, text: str) -> None:
        """Write after the description which computation runs. This text is hidden while no map is shown."""
        self._progress = text
        if self._shown:
            self._write()

    def show_reason(self, html: str) -> None:
        """Write why no map is shown (HTML), in place of the description."""
        self._shown = self._progress = ""
        self.html = html

    def _write(self) -> None:
        said = f' <span class="faint" role="status">{escape(self._progress)}</span>' if self._progress else ""
        self.html = f"<p>{self._shown}{said}</p>"
