"""Pictures, with matplotlib, which the extra `plot` installs: the paper's figures, diagrams, the plane of the curves.

No picture uses pyplot or other global state of matplotlib: servers draw in threads.
"""

from rattle.errors import MissingExtraError

try:
    import matplotlib  # noqa: F401 - whether it is there
except ImportError as error:
    raise MissingExtraError("pictures need matplotlib: pip install 'gear-rattle[plot]'") from error

from rattle.plot.colours import colour, name_of
from rattle.plot.crisis import crisis_figure
from rattle.plot.diagram import branch_figure, diagram_figure
from rattle.plot.drawing import Drawing, save
from rattle.plot.paper_figures import FIGURES, PaperFigure, draw
from rattle.plot.stiff import stiff_figure

__all__ = [
    "FIGURES",
    "Drawing",
    "PaperFigure",
    "branch_figure",
    "colour",
    "crisis_figure",
    "diagram_figure",
    "draw",
    "name_of",
    "save",
    "stiff_figure",
]
