"""Describe a map in a line above it, with the work in progress there."""

from __future__ import annotations

from html import escape

from gear_rattle.service.explorer.common.text import Text


class Heading(Text):
    """A line that is there while something is shown; a notice, or why nothing is shown, takes its place."""

    def __init__(self, sheet: str) -> None:
        super().__init__("", sheet)
        self._shown = self._progress = ""

    def show(self, what: str) -> None:
        """Say what is shown, in HTML."""
        self._shown = what
        self._write()

    def progress(self, text: str) -> None:
        """Say what is being computed, beside what is shown; nothing where nothing is."""
        self._progress = text
        if self._shown:
            self._write()

    def instead(self, html: str) -> None:
        """Nothing is shown: say why."""
        self._shown = self._progress = ""
        self.html = html

    def notice(self, text: str) -> None:
        """Say for now what is wrong."""
        self.html = f'<p class="notice" role="alert">{escape(text)}</p>'

    def _write(self) -> None:
        said = f' <span class="faint" role="status">{escape(self._progress)}</span>' if self._progress else ""
        self.html = f"<p>{self._shown}{said}</p>"
