"""The scripts, styles and template of the page, and its help, each read once."""

from functools import cache
from pathlib import Path

from gear_rattle.service.web.documents import document_body

ASSETS = Path(__file__).parent / "assets"
TOUR = Path(__file__).parents[1] / "documents" / "tour.md"


@cache
def asset(name: str) -> str:
    """Return the text of a file in the folder `assets`, such as "page.css"."""
    return (ASSETS / name).read_text()


@cache
def tour_html() -> str:
    """Return the help of the page as HTML."""
    return document_body(TOUR)
