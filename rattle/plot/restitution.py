"""Draw the paper's plane at several restitutions r, and codimension-two points as curves in (δ, ε, r)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patches import Patch
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import AttractorTable
from rattle.errors import RattleError
from rattle.inelastic import NAMES, follow_codimension_two
from rattle.models import Impacting, Inelastic, Model
from rattle.plot.colours import KIND_COLOURS, NAMED
from rattle.plot.drawing import HALO, Drawing, new_figure
from rattle.plot.plane import MARKERS, STYLES, draw_line, polyline

Array = NDArray[np.float64]
#: {type of motion: colour}. The number of a type is its position in this dictionary, from QUIET_ALONE to UNDECIDED.
SHOWN = {
    "quiet alone": KIND_COLOURS["quiet"],
    "P(1,1,0)": NAMED[1, 1, 0],
    "P(1,1,1)": NAMED[1, 1, 1],
    "other periodic": NAMED[4, 4, 2],
    "with contact phases": "#3f9b63",
    "undecided": KIND_COLOURS["undecided"],
}
QUIET_ALONE, P_110, P_111, OTHER_PERIODIC, CONTACT, UNDECIDED, CHAOTIC = range(7)
#: Colour scale of the largest Lyapunov exponent of chaos, per forcing period; larger exponents have the last colour.
EXPONENTS = Normalize(0.0, 1.6)
CHAOS = ListedColormap(colormaps["Reds"](np.linspace(0.35, 1.0, 256)), name="chaos")
#: Restitutions r at which a marker is drawn on the curves.
MARKED_RESTITUTIONS = (1.0, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
POINT_COLOURS = {"COD20": "#7b3294", "COD21": "#c51b1b", "COD23": "#1f5fa8", "COD22": "black"}


@dataclass(frozen=True)
class RestitutionPlane:
    """The attractors of the cells epsilon (m,) × delta (n,), row by row, at one restitution.

    table: the attractors of all cells. count: the number of samples of each cell.
    """

    restitution: float
    beta: float
    delta: Array
    epsilon: Array
    table: AttractorTable
    count: int

    @property
    def model(self) -> Model:
        """The model of the plane: impacting at restitution 1, otherwise inelastic."""
        return Impacting(self.beta) if self.restitution == 1.0 else Inelastic(self.beta, self.restitution)

    def fraction_of(self, kind: Outcome) -> Array:
        """Return the basin fraction (m, n) of all attractors of a kind."""
        found = np.zeros(self.epsilon.size * self.delta.size)
        rows = self.table.kind == kind
        np.add.at(found, self.table.cell[rows], self.table.samples[rows] / self.count)
        return found.reshape(self.epsilon.size, self.delta.size)

    @property
    def contact_fraction(self) -> Array:
        """The basin fraction (m, n) of periodic attractors with contact phases."""
        found = np.zeros(self.epsilon.size * self.delta.size)
        rows = (self.table.kind == Outcome.PERIODIC) & (self.table.contacts > 0)
        np.add.at(found, self.table.cell[rows], self.table.samples[rows] / self.count)
        return found.reshape(self.epsilon.size, self.delta.size)

    @property
    def exponent(self) -> Array:
        """The largest Lyapunov exponent of the chaotic attractors of each cell (m, n), NaN in cells without chaos."""
        found = np.full(self.epsilon.size * self.delta.size, np.nan)
        rows = self.table.kind == Outcome.CHAOTIC
        np.fmax.at(found, self.table.cell[rows], self.table.first[rows])
        return found.reshape(self.epsilon.size, self.delta.size)

    @property
    def dominant_types(self) -> NDArray[np.int64]:
        """Type of the motion with the most samples in each cell, quiet running left out.

        The shape is (m, n) = (epsilon.size, delta.size). A type is an index of SHOWN, or CHAOTIC. Undecided samples
        count as one motion. Cells in which all samples become quiet have the type QUIET_ALONE.
        """
        found = np.full(self.epsilon.size * self.delta.size, QUIET_ALONE)
        most = np.zeros(found.size, np.int64)
        for row in range(self.table.kind.size):
            cell, samples = int(self.table.cell[row]), int(self.table.samples[row])
            if self.table.kind[row] != Outcome.QUIET and samples > most[cell]:
                most[cell], found[cell] = samples, self._type_of_row(row)
        return found.reshape(self.epsilon.size, self.delta.size)

    def _type_of_row(self, row: int) -> int:
        """Return the type of a row of the table that is not quiet: an index of SHOWN, or CHAOTIC."""
        if self.table.kind[row] != Outcome.PERIODIC:
            return CHAOTIC if self.table.kind[row] == Outcome.CHAOTIC else UNDECIDED
        if self.table.contacts[row] > 0:
            return CONTACT
        return {(1, 1, 0): P_110, (1, 1, 1): P_111}.get(self.table.label(row), OTHER_PERIODIC)


def restitution_plane(
    restitution: float, delta: Array, epsilon: Array, beta: float = 0.6, count: int = 64
) -> RestitutionPlane:
    """Compute the attractors of all cells of a plane at one restitution.

    Parameters
    ----------
    restitution, beta : float
        Restitution in (0, 1] and half-backlash > 0.
    delta, epsilon : ndarray
        Dampings (n,) and eccentricities (m,), both in rising order.
    count : int
        Number of initial conditions of a cell.

    Returns
    -------
    RestitutionPlane
        Attractors of the cells (m, n), row by row.

    Raises
    ------
    ParameterError
        If a number is outside its domain.
    """
    empty = RestitutionPlane(restitution, beta, delta, epsilon, AttractorTable.empty(), count)
    table = empty.model.attractors_of(delta, epsilon[:, None], SampleSpec(count=count))
    return RestitutionPlane(restitution, beta, delta, epsilon, table, count)


def draw_restitution_figure(planes: Sequence[RestitutionPlane]) -> Drawing:
    """Draw planes side by side, with the bifurcation curves.

    The colour of a cell shows its type (`RestitutionPlane.dominant_types`). If the type is chaotic, the colour shows
    the largest Lyapunov exponent of the cell.

    Returns
    -------
    Drawing
        The figure.
    """
    figure = new_figure(3.1 * len(planes) + 0.9, 4.0)
    row = figure.subplots(1, len(planes), sharex=True, sharey=True, squeeze=False)[0]
    for axes, plane in zip(row, planes, strict=True):
        _draw_plane(axes, plane)
        axes.set(xlabel="damping δ", title=f"r = {plane.restitution:g}")
    row[0].set_ylabel("eccentricity ε")
    bar = figure.colorbar(ScalarMappable(EXPONENTS, CHAOS), ax=row.tolist(), pad=0.01, extend="max")
    bar.set_label("chaos: largest exponent per period")
    seen = np.unique(np.concatenate([plane.dominant_types.ravel() for plane in planes]))
    patches = [Patch(color=ink, label=name) for i, (name, ink) in enumerate(SHOWN.items()) if i in seen]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=8, frameon=False)
    return Drawing(figure)


def _draw_plane(axes: Axes, plane: RestitutionPlane) -> None:
    """Draw one plane with its bifurcation curves."""
    inks = ListedColormap(list(SHOWN.values()))
    shown = np.ma.masked_greater(plane.dominant_types, UNDECIDED)
    axes.pcolormesh(plane.delta, plane.epsilon, shown, cmap=inks, vmin=-0.5, vmax=len(SHOWN) - 0.5, rasterized=True)
    chaos = np.ma.masked_where(plane.dominant_types != CHAOTIC, plane.exponent)
    axes.pcolormesh(plane.delta, plane.epsilon, chaos, cmap=CHAOS, norm=EXPONENTS, rasterized=True)
    window = _axis_ends(plane.delta), _axis_ends(plane.epsilon)
    for name in NAMES:
        try:
            curve = plane.model.trace(name, *window)
        except RattleError:
            continue
        if len(curve):
            draw_line(axes, name, polyline(curve), STYLES[name], 0.9, halo=True)
    axes.set(xlim=window[0], ylim=window[1])


def _axis_ends(values: Array) -> tuple[float, float]:
    """Return the first and the last value of an axis."""
    return float(values[0]), float(values[-1])


def codimension_two_figure(beta: float = 0.6) -> Drawing:
    """Draw the codimension-two points COD20 to COD23 as curves in (δ, ε, r), from r = 1 downwards.

    Returns
    -------
    Drawing
        The figure.

    Raises
    ------
    RattleError
        If the elastic gear has no such points at this half-backlash.
    """
    figure = new_figure(10.0, 4.6)
    places, wedge = figure.subplots(1, 2)
    curves = {name: follow_codimension_two(name, beta) for name in POINT_COLOURS}
    for name, curve in curves.items():
        places.plot(curve.delta, curve.epsilon, color=POINT_COLOURS[name], label=name, lw=1.4)
        for r in MARKED_RESTITUTIONS:
            try:
                point = curve.at(r)
            except RattleError:
                continue
            places.plot(*point, MARKERS[name], color="white", markeredgecolor=POINT_COLOURS[name], ms=4)
            if name == "COD22":
                text = places.annotate(f"r = {r:g}", point, (6, 1), textcoords="offset points", fontsize=8)
                text.set_path_effects(HALO)
    places.margins(x=0.12)  # a wider margin leaves room for the labels of r
    places.set(xlabel="damping δ", ylabel="eccentricity ε", title=f"half-backlash β = {beta:g}")
    places.legend(fontsize=8, frameon=False)
    last = curves["COD22"]
    for name in ("COD21", "COD23"):
        curve = curves[name]
        apart = np.interp(curve.restitution, last.restitution[::-1], last.delta[::-1]) - curve.delta
        inside = curve.restitution >= last.restitution.min()
        wedge.plot(curve.restitution[inside], apart[inside], color=POINT_COLOURS[name], label=f"COD22 − {name}")
    wedge.set(xlabel="restitution r", ylabel="width of the wedge in δ", title="from where chaos begins in G1, to COD22")
    wedge.legend(fontsize=8, frameon=False)
    return Drawing(figure)
