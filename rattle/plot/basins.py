"""Draw basins of attraction in the (τ, v) plane, with v downwards as in the paper: its Figures 4 and 6."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rattle.attractors.basins import Basins, Range
from rattle.attractors.cell_map import PhaseSpeedBox
from rattle.attractors.speeds import PAPER_SPEED, highest_sampled_speed
from rattle.attractors.table import Attractor
from rattle.errors import RattleError, require
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.gear import Gear
from rattle.models import AnyGear, Capability, model_of, with_harmonics
from rattle.orbits.manifolds import manifold
from rattle.orbits.orbits_a_to_d import NAMES, Orbit
from rattle.parameters import Harmonic
from rattle.plot.colours import Palette, legend_name, legend_sort_key
from rattle.plot.drawing import Drawing, add_outline, new_figure
from rattle.plot.labels import ROOM, Labels
from rattle.plot.paper_ranges import BETA

Array = NDArray[np.float64]

#: Default number of cells along each axis (τ and v) of drawn basins, as in the paper.
RESOLUTION = 1000
#: Largest number of intervals between ticks along the v axis of a small panel.
FEW_TICKS = 4
#: Largest number of panels in a figure.
MOST_PANELS = 9
#: Largest number of types of motion in a legend.
MOST_NAMED = 24
#: Distance between neighbouring points of Γ and of manifolds, in the (τ, v) plane.
SPACING = 0.005
#: Arclength of each of the two sides of a drawn manifold; at the paper's ε = 0.1 it covers all basin boundaries.
ARCLENGTH = 200.0
#: Colours of the manifolds of A and B: magenta and green.
MANIFOLDS = {"A": "#ff4df0", "B": "#12c040"}
#: Marker and legend entry of a period-one orbit: stable (True) and unstable (False).
CROSSES = {True: ("+", "attractor"), False: ("x", "saddle")}
DOWNWARDS = "impact speed v, downwards"
#: Points around the centre of a marker, as offsets in (τ, v); labels do not cover these points.
MARKER_OFFSETS = np.array([[0.0, 0.0], [0.01, 0.08], [-0.01, 0.08], [-0.01, -0.08], [0.01, -0.08]])
#: Two states belong to the same orbit if τ and v each differ by less than this.
SAME_ORBIT = 1e-6
#: Colour of the edges of white lines and marks.
EDGE_COLOUR = "0.25"


def largest_drawn_speed(gear: AnyGear) -> float:
    """Return the largest speed v on the axis of a picture: 7 in the paper's plane, elsewhere the natural speed."""
    return highest_sampled_speed(None, gear.delta, gear.epsilon, gear.beta)


def fold_line_at_phase_ends(tau: Array, v: Array, v_max: float) -> Array:
    """Return a line of the (τ, v) plane with its phases folded into [0, 1], without its parts above speed v_max.

    Returns
    -------
    Array
        Points (n, 2). Where the line passes τ = 0 or 1 it is cut: one piece ends at exactly this phase, a row of NaN
        follows, and the next piece begins at the other phase.
    """
    turn = np.floor(tau)
    points = [np.column_stack([tau - turn, v])]
    at = []
    for i in np.flatnonzero(np.diff(turn)):
        # the line passes only one multiple of the period here: neighbouring points are much closer than a period
        edge = max(turn[i], turn[i + 1])
        share = (edge - tau[i]) / (tau[i + 1] - tau[i])
        height = v[i] + share * (v[i + 1] - v[i])
        points.append(np.array([[edge - turn[i], height], [np.nan, np.nan], [edge - turn[i + 1], height]]))
        at += [i + 0.3, i + 0.5, i + 0.7]
    line = np.concatenate(points)[np.argsort(np.concatenate([np.arange(tau.size), at]), kind="stable")]
    beyond = line[:, 1] > v_max
    hidden = beyond & np.append(True, beyond[:-1]) & np.append(beyond[1:], True)
    line[hidden] = np.nan
    doubled = np.isnan(line[:, 0]) & np.roll(np.isnan(line[:, 0]), 1)
    return np.asarray(line[~doubled], np.float64)


def draw_basins(axes: Axes, basins: Basins, palette: Palette) -> None:
    """Draw basins as an image with one pixel for each cell."""
    colours = np.array([to_rgb(palette.colour(each)) for each in basins.attractors])
    pixels = np.round(255 * colours).astype(np.uint8)[basins.labels]
    left, right, low, high = basins.box
    axes.imshow(pixels, extent=(left, right, high, low), aspect="auto", interpolation="none", origin="upper")
    axes.set(xlim=(left, right), ylim=(high, low))


def gamma_line(gear: Any, v_max: float, spacing: float = SPACING) -> Array:
    """Return the grazing curve Γ of a gear as a line (k, 2) with phases in [0, 1]; it is empty if there is no Γ."""
    return _join_lines([fold_line_at_phase_ends(piece.tau, piece.v, v_max) for piece in gear.gamma(spacing)])


def draw_gamma(axes: Axes, gear: Any, width: float, v_max: float) -> Array:
    """Draw the grazing curve Γ in white, and return its line (k, 2), which is empty if there is no Γ."""
    line = gamma_line(gear, v_max)
    if len(line):
        add_outline(axes.plot(*line.T, color="white", linewidth=width, zorder=2)[0], EDGE_COLOUR, 0.3)
    return line


def _join_lines(lines: Sequence[Array]) -> Array:
    """Return several lines as one line, with a row of NaN after each of them."""
    gap = np.full((1, 2), np.nan)
    return np.concatenate([np.empty((0, 2)), *(part for line in lines for part in (line, gap))])


def _add_basin_legend(
    figure: Figure, attractors: Iterable[Attractor], palette: Palette, lines: Sequence[Line2D], columns: int
) -> None:
    """Add a legend of the lines and of the types of motion, at most the MOST_NAMED types with the largest basins."""
    largest: dict[str, Attractor] = {}
    for each in attractors:
        if legend_name(each) not in largest or each.fraction > largest[legend_name(each)].fraction:
            largest[legend_name(each)] = each
    shown = sorted(largest, key=lambda label: -largest[label].fraction)[:MOST_NAMED]
    patches = [
        Patch(facecolor=palette.colour(largest[label]), edgecolor="0.3", linewidth=0.5, label=label)
        for label in sorted(shown, key=lambda label: legend_sort_key(largest[label]))
    ]
    if len(shown) < len(largest):
        patches.append(Patch(facecolor="none", label=f"and {len(largest) - len(shown)} more"))
    figure.legend(
        handles=[*patches, *lines],
        loc="outside lower center",
        ncols=min(columns, len(patches) + len(lines)),
        fontsize=8,
        frameon=False,
        handlelength=1.6,
        columnspacing=1.4,
    )


def _orbit_marker(stable: bool, orbit: Orbit | None = None) -> Line2D:
    """Return the marker of a period-one orbit, at the orbit's state; without an orbit, a marker for the legend."""
    marker, meaning = CROSSES[stable]
    at = ([], []) if orbit is None else ([orbit.tau], [orbit.v])
    mark = Line2D(*at, ls="", marker=marker, color="white", ms=9, mew=1.6, zorder=4, label=meaning)
    return add_outline(mark, "black", 0.9)


def _gamma_legend_line(width: float) -> Line2D:
    """Return the line that stands for Γ in the legend."""
    return add_outline(Line2D([], [], color="white", linewidth=width, label="grazing curve Γ"), EDGE_COLOUR, 0.6)


def panels(
    delta: float,
    epsilon: Sequence[float],
    beta: float = BETA,
    resolution: int = RESOLUTION,
    tau: Range = None,
    v: Range = None,
    harmonics: Sequence[Harmonic] = (),
    **added: float | None,
) -> Drawing:
    """Draw Figure 4 of the paper: a panel of basins for each ε, with one legend.

    The state at the centre of every cell is followed until its attractor is known.

    Parameters
    ----------
    delta, beta : float
        Damping and half-backlash.
    epsilon : sequence of float
        An eccentricity for each panel.
    resolution : int
        Cells along each axis.
    tau, v : Range
        Ranges (low, high) of the axes; None: the ranges of `Gear.basins`.
    harmonics : sequence of (int, float, float)
        Harmonics of the forcing besides the first, for a model that takes them: see `rattle.Gear`.
    **added : float, optional
        The parameters that a model adds, by name; without them the impacting model is drawn.

    Returns
    -------
    Drawing
        The figure, and notes on parts that are left out or differ from the request.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    require(1 <= len(epsilon) <= MOST_PANELS, f"epsilon must be 1 to {MOST_PANELS} numbers, got {len(epsilon)}")
    model = with_harmonics(model_of(beta, **added), harmonics)
    gears = [model.gear(delta, each) for each in epsilon]
    columns = next(n for n in (1, 2, 3) if n * n >= len(gears))
    rows = -(-len(gears) // columns)
    figure = new_figure(0.7 + 2.25 * columns, 1.2 + 2.3 * rows)
    found: list[Attractor] = []
    palette = Palette()
    v_max = max(map(largest_drawn_speed, gears))
    for i, gear in enumerate(gears):
        axes = figure.add_subplot(rows, columns, i + 1)
        basins = gear.basins(resolution, v_max, "direct", tau=tau, v=v)
        found += basins.attractors
        draw_basins(axes, basins, palette)
        if Capability.GAMMA in model.has:
            draw_gamma(axes, gear, 0.7, basins.v_max)
        axes.set_title(f"({'abcdefghi'[i]}) ε = {gear.epsilon:g}", fontsize=9, pad=4)
        _set_few_ticks(axes, basins.box, first=i % columns == 0, last=i >= len(gears) - columns)
    figure.suptitle(f"damping δ = {gears[0].delta:g}, {model}", fontsize=10)
    _add_basin_legend(figure, found, palette, [_gamma_legend_line(1.2)] if Capability.GAMMA in model.has else [], 5)
    return Drawing(figure)


def _set_few_ticks(axes: Axes, box: PhaseSpeedBox, first: bool, last: bool) -> None:
    """Put tick labels and axis names only at the first panel of a row (v) and at the last panel of a column (τ).

    first, last: whether this is the first panel of its row, and the last panel of its column.
    """
    phases = [box.tau_low, 0.5 * (box.tau_low + box.tau_high), box.tau_high]
    axes.set_xticks(phases, [f"{x:.4g}" for x in phases])
    axes.yaxis.set_major_locator(MaxNLocator(FEW_TICKS))
    axes.tick_params(labelsize=8, labelbottom=last, labelleft=first)
    axes.set_xlabel("impact phase τ" if last else "", fontsize=9)
    axes.set_ylabel(DOWNWARDS if first else "", fontsize=9)


def draw_basins_with_manifolds(
    delta: float, epsilon: float, beta: float = BETA, resolution: int = RESOLUTION
) -> Drawing:
    """Draw Figure 6 of the paper: basins at one point, with A to D, the stable manifolds of the saddles A and B, and Γ.

    Parts that do not exist at this point are left out, with a note.

    Parameters
    ----------
    delta, epsilon, beta : float
        The point.
    resolution : int
        Cells along each axis.

    Returns
    -------
    Drawing
        The figure, and notes on parts that are left out or differ from the request.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    gear = Gear(delta, epsilon, beta)
    v_max = largest_drawn_speed(gear)
    basins = gear.basins(resolution, v_max, "direct")
    orbits = {orbit.name: orbit for orbit in gear.orbits()}
    figure = new_figure(6.4, 6.2)
    axes = figure.add_subplot()
    palette = Palette()
    draw_basins(axes, basins, palette)
    notes, drawn = [], {}
    for name in MANIFOLDS:
        line, why = manifold_line(gear, orbits.get(name), name, arclength=ARCLENGTH)
        if why:
            notes.append(why)
        if len(line):
            drawn[name] = line
            axes.plot(*line.T, color=MANIFOLDS[name], linewidth=1.1, zorder=1.5)
    gamma = draw_gamma(axes, gear, 1.6, v_max)
    if not len(gamma):
        notes.append(f"Γ is left out: no flight with v below {v_max:.3g} grazes Σ⁻")
    shown = {name: orbit for name, orbit in orbits.items() if orbit.v < v_max}
    missing = [name for name in NAMES if name not in shown]
    if missing:
        notes.append(f"{', '.join(missing)} left out: there is no such orbit with v below {v_max:.3g} at this point")
    for orbit in shown.values():
        axes.add_line(_orbit_marker(orbit.stable, orbit))
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "0.25", "0.5", "0.75", "1"])
    if v_max == PAPER_SPEED:
        axes.set_yticks(range(8))
    axes.set_xlabel("impact phase τ", fontsize=11)
    axes.set_ylabel(DOWNWARDS, fontsize=11)
    axes.set_title(
        f"damping δ = {gear.delta:g}, eccentricity ε = {gear.epsilon:g}, half-backlash β = {beta:g}", fontsize=10
    )
    lines = [Line2D([], [], color=MANIFOLDS[name], label=_stable_manifold_label(name)) for name in drawn]
    lines += [_gamma_legend_line(1.6)] if len(gamma) else []
    lines += [_orbit_marker(stable) for stable in CROSSES if any(orbit.stable is stable for orbit in shown.values())]
    _add_basin_legend(figure, basins.attractors, palette, lines, 6)
    _write_labels(axes, basins, shown, drawn, gamma)
    figure.set_layout_engine("none")  # a further layout would move the axes away from labels already placed
    return Drawing(figure, tuple(notes))


def manifold_line(
    gear: AnyGear,
    orbit: Orbit | None,
    name: str,
    kind: str = "stable",
    arclength: float = ARCLENGTH,
    spacing: float = SPACING,
) -> tuple[Array, str | None]:
    """Return the stable or unstable manifold of A or B as a line with phases in [0, 1].

    orbit: A or B, or None if it does not exist. kind: "stable" or "unstable". arclength: the length of each side.

    Returns
    -------
    tuple[Array, str | None]
        The line (k, 2), and a note that says why a part of it is missing. The note is None if no part is missing, and
        also if `orbit` is None.
    """
    if orbit is None:
        return np.empty((0, 2)), None  # no note: `draw_basins_with_manifolds` has one for all missing orbits
    if orbit.stable:
        return np.empty((0, 2)), f"{name} is stable there: it has no {kind} manifold to draw"
    sides, why, v_max = [], None, largest_drawn_speed(gear)
    for side in (1, -1):
        try:
            grown = manifold(gear.saddle(orbit), kind, side, arclength, spacing, unit=v_max / PAPER_SPEED)
        except RattleError as error:
            why = f"a side of the {kind} manifold of {name} is left out: {error}"
            continue
        for start, end in _connected_ranges(grown.pieces, grown.gap):
            sides.append(fold_line_at_phase_ends(grown.tau[start:end], grown.v[start:end], v_max))
    return _join_lines(sides), why


def _connected_ranges(pieces: NDArray[np.int64], gap: Array) -> list[tuple[int, int]]:
    """Return for each connected part of a manifold the range (start, end) of its points.

    pieces, gap: fields of `Manifold`. Neighbouring pieces are connected if the distance `gap` between their ends is 0.

    Returns
    -------
    list[tuple[int, int]]
        The ranges, in the order of the points.
    """
    cuts = [0, *pieces[1:-1][gap > 0].tolist(), int(pieces[-1])]
    return list(pairwise(cuts))


def _stable_manifold_label(name: str) -> str:
    """Return the label of the stable manifold of an orbit in matplotlib's mathematical text: "$W^s(A)$" for A."""
    return f"$W^s({name})$"


def _write_labels(
    axes: Axes, basins: Basins, orbits: dict[str, Orbit], manifolds: dict[str, Array], gamma: Array
) -> None:
    """Write the names of orbits, of manifolds and Γ, and of those basins that have enough room for a name."""
    around = MARKER_OFFSETS * [1.0, basins.v_max / PAPER_SPEED]
    marks = [np.array([orbit.tau, orbit.v]) + around for orbit in orbits.values()]
    labels = Labels(axes, [*manifolds.values(), gamma, *marks])
    for name, orbit in orbits.items():
        labels.add(name, (orbit.tau, orbit.v), size=12, white_edge=True)
    for i, attractor in enumerate(basins.attractors):
        symbol = _basin_symbol(attractor, orbits)
        if symbol and not labels.add_name_within(symbol, basins.labels[::-1] == i, size=13):
            place, room = labels.widest_free_position(basins.labels[::-1] == i)
            if room > 2.0:
                labels.add(symbol, place, size=13, white_edge=True)
    for name, line in (*((_stable_manifold_label(name), line) for name, line in manifolds.items()), ("Γ", gamma)):
        inside = line[~np.isnan(line[:, 0]) & (line[:, 1] < basins.v_max)]
        if len(inside):
            chosen = inside[:: max(1, len(inside) // 60)]
            labels.add(name, *((float(tau), float(v)) for tau, v in chosen), size=12, room=3 * ROOM, white_edge=True)


def _basin_symbol(attractor: Attractor, orbits: dict[str, Orbit]) -> str | None:
    """Return the paper's symbol for the basin of an attractor, or None if the paper has no symbol for it."""
    if attractor.kind == "quiet":
        return r"$\Delta_L$"
    if attractor.kind == "chaotic":
        return r"$\Delta_{Ch}$"
    for name, orbit in orbits.items():
        if (
            abs(orbit.v - attractor.v) < SAME_ORBIT
            and abs(wrap_phase_difference(orbit.tau - attractor.tau)) < SAME_ORBIT
        ):
            return rf"$\Delta_{name}$"
    return None
