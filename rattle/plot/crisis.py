"""The crisis: its curve among the bifurcation curves, its way into COD22, and both manifolds of A at a contact."""

from typing import TYPE_CHECKING

import numpy as np

from rattle import curves
from rattle.crisis import Crisis, CrisisCurve, crisis_curve
from rattle.limits import sn1
from rattle.manifolds import manifold
from rattle.saddles import period_one_saddle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CURVES = {"SN1": "tab:blue", "SN2": "tab:cyan", "PD1": "tab:olive", "G1": "tab:green", "G2": "tab:purple"}
ARCLENGTH = {"unstable": 14.0, "stable": 8.0}


def _plane(axes: "Axes", curve: CrisisCurve) -> None:
    low, high = float(curve.delta.min()) - 0.02, float(curve.delta.max()) + 0.02
    for name, colour in CURVES.items():
        found = curves.trace(name, curve.beta, (low, high))
        axes.plot(found.delta, found.epsilon, color=colour, lw=1, label=name)
    chaotic = np.array([point.chaotic for point in curve.points])
    axes.plot(curve.delta, curve.epsilon, color="tab:red", lw=2, label="crisis with A")
    axes.plot(
        curve.delta[~chaotic], curve.epsilon[~chaotic], "o", mfc="white", mec="tab:red", ms=4, label="in a window"
    )
    for point in curve.changes:
        axes.plot(point.delta, point.epsilon, "s", color="black", ms=4, label="tangency | corner")
    for cod in curves.codimension_two(curve.beta):
        if low < cod.delta < high:
            axes.plot(cod.delta, cod.epsilon, "k.", ms=6)
            axes.annotate(cod.name, (cod.delta, cod.epsilon), (4, -10), textcoords="offset points", fontsize=7)
    axes.set(xlabel="δ", ylabel="ε", xlim=(low, high), ylim=(0.6 * curve.epsilon.min(), 1.15 * curve.epsilon.max()))
    axes.legend(fontsize=7)


def _zoom(axes: "Axes", curve: CrisisCurve) -> None:
    """ε − SN1 against the distance from COD22."""
    (cod,) = (point for point in curves.codimension_two(curve.beta) if point.name == "COD22")
    offset, gap = curve.delta - cod.delta, curve.epsilon - sn1(curve.delta)
    near = gap < 2e-3 * cod.epsilon
    axes.plot(1e4 * offset[near], gap[near], ".-", color="tab:red")
    axes.axvline(0.0, color="black", lw=0.5)
    axes.set(yscale="log", xlabel="10⁴ (δ − δ of COD22)", ylabel="ε − SN1", title="beside COD22")


def _contact(axes: "Axes", crisis: Crisis) -> None:
    saddle = period_one_saddle("A", crisis.delta, crisis.epsilon, crisis.beta)
    for kind, side, colour in (("unstable", 1, "tab:red"), ("stable", 1, "tab:blue"), ("stable", -1, "tab:blue")):
        found = manifold(saddle, kind, side, ARCLENGTH[kind])
        for i, j in zip(found.pieces[:-1], found.pieces[1:], strict=True):
            axes.plot(found.tau[i:j], found.v[i:j], color=colour, lw=0.6)
        if kind == "unstable":
            box = [(x.min() - 0.2 * np.ptp(x), x.max() + 0.2 * np.ptp(x)) for x in (found.tau, found.v)]
    axes.plot(saddle.tau, saddle.v, "ko", ms=4)
    axes.set(
        xlabel="τ",
        ylabel="v",
        xlim=box[0],
        ylim=box[1],
        title=f"W^u(A), W^s(A), δ = {crisis.delta:.4g}: {crisis.contact}",
    )


def crisis_figure(beta: float = 0.6, resolution: float = 0.02) -> "Figure":
    """The crisis curve, its way into COD22, and W^u(A) (red) with W^s(A) (blue) at a tangency and at a corner."""
    from matplotlib.figure import Figure

    curve = crisis_curve(beta=beta, resolution=resolution)
    figure = Figure(figsize=(11, 9), layout="constrained")
    plane, zoom, one, other = figure.subplots(2, 2).ravel()
    _plane(plane, curve)
    _zoom(zoom, curve)
    middle = min(curve.points, key=lambda point: abs(point.delta - 0.78 * curve.delta.max()))
    corner = min(curve.points, key=lambda point: abs(point.delta - 0.99 * curve.delta.max()))
    _contact(one, middle)
    _contact(other, corner)
    return figure
