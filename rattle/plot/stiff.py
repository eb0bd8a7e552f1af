"""Draw the convergence of the stiff gear to the impacting model: motions, curves, the quiet limit, and a graze."""

import numpy as np
from matplotlib.axes import Axes

from rattle.errors import require
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.bifurcations.branches import branch
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import orbits_at
from rattle.impacting.orbits.periodic import PeriodicOrbit, periodic_orbit
from rattle.plot.drawing import Drawing, new_figure
from rattle.stiff import StiffGear, continue_from_limit, saddle_node_1, stiff_branch
from rattle.stiff import quiet_limit as stiff_quiet_limit

COLOURS = {"A": "#1f5fa8", "B": "#e08214", "C": "#4d9221", "D": "#b2182b"}
#: Default point, at which A to D all exist.
DELTA, EPSILON = 0.6, 0.075
STIFFNESSES = 10.0 ** np.arange(2.0, 8.5, 0.5)
#: Stiffnesses κ that the panel of the graze compares with the impacting model.
GRAZE_STIFFNESSES = (1e4, 1e5, 1e6)
#: The panel of the graze shows speeds from the speed of Γ minus this number to the speed of Γ plus this number.
GRAZE_REACH = 0.003


def stiff_figure(delta: float = DELTA, epsilon: float = EPSILON, beta: float = 0.6) -> Drawing:
    """Draw the distances between the stiff gear and the impacting model against the stiffness κ.

    Three panels show the distances between the motions A to D, between their multipliers, and between the bifurcations
    and quiet limits of both models. The fourth panel shows the speed after one return for speeds on both sides of Γ:
    the impacting model has a square root there, the stiff gear a steep but smooth curve.

    Returns
    -------
    Drawing
        The figure.

    Raises
    ------
    ParameterError
        If A to D of the impacting model do not all exist at (delta, epsilon).
    RattleError
        If a motion or a curve cannot be followed.
    """
    limits = {orbit.name: orbit for orbit in orbits_at(delta, epsilon, beta)}
    require(
        len(limits) == 4,
        f"A to D do not all exist at delta = {delta:g}, epsilon = {epsilon:g}: choose a point of region III or IV",
    )
    motions = {name: periodic_orbit(delta, epsilon, x.tau, x.v, 1, beta) for name, x in limits.items()}
    figure = new_figure(10.0, 8.0)
    distances, multipliers, curves, graze = figure.subplots(2, 2).ravel()
    _draw_motions(distances, multipliers, motions)
    _draw_bifurcation_offsets(curves, motions["D"])
    _draw_graze(graze, Gear(delta, epsilon, beta))
    figure.suptitle(f"δ = {delta:g}, ε = {epsilon:g}, β = {beta:g}", fontsize=11)
    return Drawing(figure)


def _draw_motions(distances: Axes, multipliers: Axes, motions: dict[str, PeriodicOrbit]) -> None:
    """Draw, against κ, the distances of A to D of the stiff gear from the same motions of the impacting model.

    distances: axes for the distances in (τ, v). multipliers: axes for the change of the sum of both multipliers.
    motions: {name: the motion of the impacting model}.
    """
    for name, limit in motions.items():
        kappas, off, change = [], [], []
        for kappa in STIFFNESSES[STIFFNESSES >= 1e3]:
            found = continue_from_limit(limit, float(kappa))
            kappas.append(kappa)
            off.append(np.hypot(wrap_phase_difference(found.tau - limit.tau), found.v - limit.v))
            change.append(abs(sum(found.multipliers) - sum(limit.multipliers)))
        distances.loglog(kappas, off, ".-", color=COLOURS[name], label=name)
        multipliers.loglog(kappas, change, ".-", color=COLOURS[name], label=name)
    for axes, title, label in (
        (distances, "motions A to D", "distance in (τ, v) from the impacting model"),
        (multipliers, "their multipliers", "change of the sum of both"),
    ):
        _draw_power_law(axes, 1e3, -0.5, "κ$^{-1/2}$")
        axes.set(xlabel="stiffness κ", ylabel=label, title=title)
        axes.legend(fontsize=8, frameon=False)


def _draw_bifurcation_offsets(axes: Axes, motion_d: PeriodicOrbit) -> None:
    """Draw, against κ, the distances in ε of the stiff gear's SN1, SN2, PD1 and quiet limit from the impacting model's.

    motion_d: the motion D of the impacting model; the branch of D along ε has SN2 and PD1.
    """
    delta, beta = motion_d.delta, motion_d.beta
    span = 0.5 * motion_d.epsilon, 1.6 * motion_d.epsilon
    truth = {str(event.kind): event.epsilon for event in branch(motion_d, "epsilon", span).events}
    found: dict[str, list[tuple[float, float]]] = {"SN1": [], "SN2": [], "PD1": [], "quiet limit": []}
    for kappa in STIFFNESSES:
        found["SN1"].append((kappa, saddle_node_1(delta, float(kappa), beta).epsilon - float(sn1_formula(delta))))
        found["quiet limit"].append((kappa, float(stiff_quiet_limit(delta, kappa) - quiet_limit(delta))))
        if kappa < 1e3:
            continue
        events = stiff_branch(continue_from_limit(motion_d, float(kappa)), "epsilon", span).events
        for kind, name in (("SN", "SN2"), ("PD", "PD1")):
            near = [event.orbit.epsilon for event in events if event.kind == kind]
            if near and kind in truth:
                found[name].append((kappa, min(near, key=lambda x: abs(x - truth[kind])) - truth[kind]))
    for (name, points), colour in zip(found.items(), COLOURS.values(), strict=True):
        if points:
            kappas, off = np.array(points).T
            axes.loglog(kappas, np.abs(off), ".-", color=colour, label=name)
    _draw_power_law(axes, 1e3, -0.5, "κ$^{-1/2}$")
    _draw_power_law(axes, 1e3, -1.0, "κ$^{-1}$")
    axes.set(xlabel="stiffness κ", ylabel="distance in ε from the impacting model", title="curves and quiet limit")
    axes.legend(fontsize=8, frameon=False)


def _draw_power_law(axes: Axes, start: float, power: float, label: str) -> None:
    """Draw a reference line proportional to κ^power that is above all curves at κ = `start`."""
    lines = [np.asarray(line.get_xydata()) for line in axes.get_lines()]
    heights = [float(line[np.searchsorted(line[:, 0], start), 1]) for line in lines]
    ends = np.array([start, 1e8])
    dashes = ":" if power == -0.5 else "--"
    axes.loglog(ends, 2.0 * max(heights) * (ends / start) ** power, "k", ls=dashes, lw=1.0, label=label)


def _draw_graze(axes: Axes, gear: Gear) -> None:
    """Draw the speed after one return against the speed before it, across the grazing curve Γ."""
    piece = max(gear.gamma(), key=lambda each: each.tau.size)
    i = piece.tau.size // 2
    tau, middle = float(piece.tau[i]) % 1.0, float(piece.v[i])
    v = middle + np.linspace(-GRAZE_REACH, GRAZE_REACH, 801)
    for kappa, colour in zip(GRAZE_STIFFNESSES, ("#fdae61", "#f46d43", "#a50026"), strict=True):
        stiff = StiffGear(gear.delta, gear.epsilon, gear.beta, kappa)
        axes.plot(v - middle, [stiff.impact(tau, x).v for x in v], color=colour, label=f"κ = {kappa:g}")
    axes.plot(v - middle, [gear.impact(tau, x).v for x in v], "k", lw=1.0, label="impacting")
    axes.locator_params(axis="x", nbins=5)
    axes.set(
        xlabel="speed v less that of Γ", ylabel="speed of the next impact", title=f"one return across Γ, τ = {tau:.3f}"
    )
    axes.legend(fontsize=8, frameon=False)
