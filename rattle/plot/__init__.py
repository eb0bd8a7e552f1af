"""Pictures with matplotlib, which the extra `plot` installs: the paper's figures, diagrams, curves in the plane.

No function uses pyplot or other global state of matplotlib, because servers draw in threads.
"""

from rattle.errors import MissingExtraError

try:
    import matplotlib  # noqa: F401 - the import tests whether it is installed
except ImportError as error:
    raise MissingExtraError("pictures need matplotlib: pip install 'gear-rattle[plot]'") from error

from rattle.plot.areas import areas_figure
from rattle.plot.basins import MANIFOLDS, gamma_line, manifold_line, panels
from rattle.plot.colours import KIND_COLOURS, REGION_COLOURS, Palette, colour, legend_name
from rattle.plot.crisis import crisis_figure
from rattle.plot.diagram import (
    admissible_curve_parts,
    branch_figure,
    diagram_figure,
    impact_curves_along_branch,
    impacts_at_event,
    parameter_axis,
)
from rattle.plot.drawing import FORMATS, HALO, Drawing, new_figure, save
from rattle.plot.paper_figures import (
    FIGURES,
    FigureRequest,
    PaperFigure,
    StiffFigureRequest,
    draw,
    parse_option,
    request,
    stiff_request,
)
from rattle.plot.paper_ranges import BETA, FIGURE_4, FIGURE_5, FIGURE_6, FIGURE_7, FIGURE_8, FIGURE_9
from rattle.plot.plane import MARKERS, STYLES, draw_curve, draw_line, mark_codimension_two_points, polyline
from rattle.plot.restitution import (
    RestitutionPlane,
    codimension_two_figure,
    draw_restitution_figure,
    restitution_plane,
)
from rattle.plot.stiff import stiff_figure

__all__ = [
    "BETA",
    "FIGURES",
    "FIGURE_4",
    "FIGURE_5",
    "FIGURE_6",
    "FIGURE_7",
    "FIGURE_8",
    "FIGURE_9",
    "FORMATS",
    "HALO",
    "KIND_COLOURS",
    "MANIFOLDS",
    "MARKERS",
    "REGION_COLOURS",
    "STYLES",
    "Drawing",
    "FigureRequest",
    "Palette",
    "PaperFigure",
    "RestitutionPlane",
    "StiffFigureRequest",
    "admissible_curve_parts",
    "areas_figure",
    "branch_figure",
    "codimension_two_figure",
    "colour",
    "crisis_figure",
    "diagram_figure",
    "draw",
    "draw_curve",
    "draw_line",
    "draw_restitution_figure",
    "gamma_line",
    "impact_curves_along_branch",
    "impacts_at_event",
    "legend_name",
    "manifold_line",
    "mark_codimension_two_points",
    "new_figure",
    "panels",
    "parameter_axis",
    "parse_option",
    "polyline",
    "request",
    "restitution_plane",
    "save",
    "stiff_figure",
    "stiff_request",
]
