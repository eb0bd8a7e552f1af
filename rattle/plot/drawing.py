"""Draw pictures: a figure with its own canvas, notes on missing parts, and how it is written."""

from pathlib import Path
from typing import NamedTuple

from matplotlib import patheffects, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

DPI = 150
#: White around a line or text, so that it can be told from what it covers.
HALO: list[patheffects.AbstractPathEffect] = [patheffects.withStroke(linewidth=2.5, foreground="white")]
FORMATS = ("pdf", "svg", "png")


class Drawing(NamedTuple):
    """A figure, and what it lacks or has otherwise than asked, a sentence each."""

    figure: Figure
    notes: tuple[str, ...] = ()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches, with a canvas of its own."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def lay_out(figure: Figure) -> FigureCanvasAgg:
    """Place the axes as they will be drawn: where a label is clear of a line depends on their shape."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
    return canvas


def outlined(line: Line2D, colour: str, width: float) -> Line2D:
    """Give a line an edge of another colour, so much wider in points on each side."""
    line.set_path_effects([patheffects.withStroke(linewidth=line.get_linewidth() + 2 * width, foreground=colour)])
    return line


def save(figure: Figure, path: str | Path, dpi: int = 300) -> None:
    """Write a figure; the suffix is the format. Text in a PDF is text (TrueType), and the same figure is the same file.

    Raises OSError, and ValueError on a format that matplotlib does not know.

    Parameters
    ----------
    dpi : int
        Of a PNG.
    """
    dates = {".pdf": "CreationDate", ".svg": "Date"}
    suffix = Path(path).suffix.lower()
    with rc_context({"pdf.fonttype": 42, "svg.hashsalt": "gear-rattle"}):
        figure.savefig(path, dpi=dpi, metadata={dates[suffix]: None} if suffix in dates else None)
