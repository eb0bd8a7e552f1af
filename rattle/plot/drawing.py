"""Helper functions for all pictures: new figures, outlines of lines and texts, and saving to files."""

from pathlib import Path
from typing import NamedTuple

from matplotlib import patheffects, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

#: Resolution of a new figure in dots per inch.
DPI = 150
#: A white outline around a line or text, which separates it from what is below it.
HALO: list[patheffects.AbstractPathEffect] = [patheffects.withStroke(linewidth=2.5, foreground="white")]
FORMATS = ("pdf", "svg", "png")


class Drawing(NamedTuple):
    """A figure, and notes on parts that are left out or differ from the request, a sentence each."""

    figure: Figure
    notes: tuple[str, ...] = ()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches, with its own canvas, because pyplot is not used."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def lay_out_axes(figure: Figure) -> FigureCanvasAgg:
    """Lay out the axes and return the canvas. Labels can be placed only when the shape of the axes is final."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
    return canvas


def add_outline(line: Line2D, colour: str, width: float) -> Line2D:
    """Give a line an edge of another colour, and return the line. width: width of the edge on each side, in points."""
    line.set_path_effects([patheffects.withStroke(linewidth=line.get_linewidth() + 2 * width, foreground=colour)])
    return line


def save(figure: Figure, path: str | Path, dpi: int = 300) -> None:
    """Write a figure to a file; the suffix of the path selects the format.

    Text in a PDF remains text (TrueType fonts). Files have no dates, so that the same figure gives the same file.

    Parameters
    ----------
    dpi : int
        Resolution of a PNG file in dots per inch.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If matplotlib does not know the format.
    """
    dates = {".pdf": "CreationDate", ".svg": "Date"}
    suffix = Path(path).suffix.lower()
    with rc_context({"pdf.fonttype": 42, "svg.hashsalt": "gear-rattle"}):
        figure.savefig(path, dpi=dpi, metadata={dates[suffix]: None} if suffix in dates else None)
