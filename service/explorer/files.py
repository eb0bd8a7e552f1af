"""The scripts, styles and template of the page, each read once."""

from functools import cache
from pathlib import Path

ASSETS = Path(__file__).parent / "assets"


@cache
def asset(name: str) -> str:
    """Return the text of one of them."""
    return (ASSETS / name).read_text()
