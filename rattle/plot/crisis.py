"""Draw the boundary crisis: its curve, the curve's end at COD22, and the manifolds of A where they touch."""

import numpy as np
from matplotlib.axes import Axes

from rattle.crisis import Crisis, CrisisCurve, crisis_curve
from rattle.curves import codimension_two, trace
from rattle.impacting.orbits.limits import sn1_formula
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.manifolds import manifold
from rattle.plot.drawing import Drawing, new_figure
from rattle.plot.labels import Array, Labels
from rattle.plot.plane import IN_PAPER, STYLES, draw_curve, mark_codimension_two_points

CRISIS, STABLE = "#e08214", "#1f5fa8"
#: Arclengths of the drawn parts of the unstable and of the stable manifold.
UNSTABLE_LENGTH, STABLE_LENGTH = 14.0, 8.0
#: Margin around the unstable manifold W^u(A), as a share of the extent of W^u(A).
MANIFOLD_MARGIN = 0.25


def crisis_figure(beta: float = 0.6, resolution: float = 0.02) -> Drawing:
    """Draw the crisis curve, its end at COD22, and the manifolds W^u(A) and W^s(A) at two points of the curve.

    At the paper's β the manifolds are tangent at one of the two points; at the other point a corner of W^u(A) touches
    W^s(A). The arguments and errors are those of `rattle.crisis.crisis_curve`.

    Returns
    -------
    Drawing
        The figure, and two notes: why the curve ends at its lower end, and why at its upper end.
    """
    curve = crisis_curve(beta=beta, resolution=resolution)
    figure = new_figure(10.0, 9.0)
    plane, zoom, *panels = figure.subplots(2, 2).ravel()
    highest = float(curve.delta.max())
    contacts = [min(curve.points, key=lambda point: abs(point.delta - share * highest)) for share in (0.78, 0.99)]
    _draw_distance_from_sn1(zoom, curve)
    manifolds = [_draw_manifolds(axes, contact) for axes, contact in zip(panels, contacts, strict=True)]
    _draw_crisis_curve(plane, curve)
    for axes, (saddle, lines) in zip(panels, manifolds, strict=True):
        labels = Labels(axes, [*lines, np.array([saddle])])
        labels.add("A", saddle, size=10)
    figure.set_layout_engine("none")  # a later layout would move the axes, but not the labels that are placed
    return Drawing(figure, (f"at its lower end: {curve.low_end}", f"at its upper end: {curve.high_end}"))


def _draw_crisis_curve(axes: Axes, curve: CrisisCurve) -> None:
    """Draw the crisis curve with the paper's bifurcation curves in the (δ, ε) plane."""
    window = float(curve.delta.min()) - 0.02, float(curve.delta.max()) + 0.02
    limits = 0.55 * float(curve.epsilon.min()), 1.15 * float(curve.epsilon.max())
    lines: dict[str, Array] = {}
    for name in IN_PAPER:
        found = trace(name, curve.beta, window, limits)
        if len(found):
            lines[name] = draw_curve(axes, found, 1.0, halo=False)
    lines["crisis"] = np.column_stack([curve.delta, curve.epsilon])
    axes.plot(*lines["crisis"].T, color=CRISIS, lw=2.2)
    quiet = np.array([not point.chaotic for point in curve.points])
    marks = axes.plot(
        *lines["crisis"][quiet].T, "o", mfc="white", mec=CRISIS, ms=4, label="crisis of a periodic attractor"
    )
    changes = np.array([(point.delta, point.epsilon) for point in curve.changes]).reshape(-1, 2)
    marks += axes.plot(*changes.T, "X", color="black", ms=6, label="between tangencies and corners")
    axes.set(
        xlabel="damping δ", ylabel="eccentricity ε", xlim=window, ylim=limits, title=f"half-backlash β = {curve.beta:g}"
    )
    axes.legend(handles=marks, fontsize=8, loc="upper right", frameon=False)
    labels = mark_codimension_two_points(axes, codimension_two(curve.beta), list(lines.values())) or Labels(
        axes, list(lines.values())
    )
    for name, line in lines.items():
        labels.add_along_line(name, line, 10, CRISIS if name == "crisis" else STYLES[name][0])


def _draw_distance_from_sn1(axes: Axes, curve: CrisisCurve) -> None:
    """Draw the crisis curve near its end: its distance in ε from SN1 against its distance in δ from COD22."""
    (end,) = (point for point in codimension_two(curve.beta) if point.name == "COD22")
    offset, gap = curve.delta - end.delta, curve.epsilon - sn1_formula(curve.delta)
    near = gap < 2e-3 * end.epsilon
    axes.plot(1e4 * offset[near], gap[near], ".-", color=CRISIS)
    axes.axvline(0.0, color="black", lw=0.5)
    axes.set(yscale="log", xlabel=r"$10^4$ (δ − δ of COD22)", ylabel="ε − ε of SN1", title="The crisis beside COD22")


def _draw_manifolds(axes: Axes, crisis: Crisis) -> tuple[tuple[float, float], list[Array]]:
    """Draw the stable manifold W^s(A) and one side of the unstable manifold W^u(A), in axes that show all of this side.

    Returns
    -------
    tuple[tuple[float, float], list[Array]]
        The state (τ, v) of A, and the drawn lines.
    """
    saddle = period_one_orbit("A", crisis.delta, crisis.epsilon, crisis.beta)
    unstable = manifold(saddle, "unstable", 1, UNSTABLE_LENGTH)
    lines = []
    for side in (1, -1):
        found = manifold(saddle, "stable", side, STABLE_LENGTH)
        for i, j in zip(found.pieces[:-1], found.pieces[1:], strict=True):
            lines.append(np.column_stack([found.tau[i:j], found.v[i:j]]))
            axes.plot(*lines[-1].T, color=STABLE, lw=1.0, label="$W^s(A)$" if len(lines) == 1 else None)
    for i, j in zip(unstable.pieces[:-1], unstable.pieces[1:], strict=True):
        lines.append(np.column_stack([unstable.tau[i:j], unstable.v[i:j]]))
        axes.plot(*lines[-1].T, color=STYLES["G1"][0], lw=0.7, label="$W^u(A)$" if i == 0 else None)
    (left, right), (low, high) = ((x.min(), x.max()) for x in (unstable.tau, unstable.v))
    aside, above = MANIFOLD_MARGIN * (right - left), MANIFOLD_MARGIN * (high - low)
    axes.plot(saddle.tau, saddle.v, "ko", ms=4, zorder=5)
    axes.set(xlim=(left - aside, right + aside), ylim=(low - above, high + above))
    axes.set(xlabel="impact phase τ", ylabel="impact speed v")
    axes.set_title(f"δ = {crisis.delta:.4g}, ε = {crisis.epsilon:.6g}: {crisis.contact}")
    axes.legend(fontsize=8, loc="lower right")
    return (saddle.tau, saddle.v), lines
