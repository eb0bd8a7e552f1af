"""The paper's statements about its Figures 4 to 6: basins, and the diagram along ε at δ = 0.6."""

import numpy as np

import rattle
from rattle.attractors.table import Attractor
from rattle.impacting.gear import Gear
from rattle.orbits.orbits_a_to_d import NAMES, PeriodOne
from rattle.paper.records import Statement

DELTA = 0.6
#: ε of the panels (a) to (i) of Figure 4.
PANELS = (0.056, 0.0615, 0.067, 0.0725, 0.078, 0.0835, 0.089, 0.0945, 0.1)
#: Number of initial conditions in a panel.
SAMPLES = 4096
#: Largest basin fraction that counts as "very small".
SMALL = 0.02

Panels = dict[float, tuple[Attractor, ...]]


def compute_figure_4_attractors() -> Panels:
    """Return the attractors of every panel of Figure 4, from SAMPLES initial conditions (τ, v) in [0, 1) × (0, 7)."""
    return {epsilon: Gear(DELTA, epsilon).attractors(count=SAMPLES) for epsilon in PANELS}


def attractor_label(attractor: Attractor) -> str:
    """Return the label P(m,n₊,n₋) of a periodic attractor, or the kind of another attractor."""
    if attractor.kind != "periodic":
        return attractor.kind
    return f"P({attractor.m},{attractor.n_plus},{attractor.n_minus})"


def fractions_text(attractors: tuple[Attractor, ...]) -> str:
    """Return the labels of all attractors with their basin fractions, as text."""
    return ", ".join(f"{attractor_label(a)} {a.fraction:.3f}" for a in attractors)


def basin_fraction(attractors: tuple[Attractor, ...], label: str) -> float:
    """Return the sum of the basin fractions of the attractors with this label or kind."""
    return sum(a.fraction for a in attractors if attractor_label(a) == label)


def figure_4_statements(found: Panels) -> tuple[Statement, ...]:
    """Return the statements of Figure 4's caption, and the statements of section 5.1 about this figure."""
    a, b, d, e, g, i = (found[x] for x in (0.056, 0.0615, 0.0725, 0.078, 0.089, 0.1))
    several = min(len(x) for epsilon, x in found.items() if epsilon > 0.056)
    return (
        Statement(
            "Fig. 4(a)", "all initial conditions become quiet", fractions_text(a), basin_fraction(a, "quiet") == 1
        ),
        Statement("Fig. 4", "more than one attractor in all other panels", f"{several} or more", several > 1),
        Statement(
            "Fig. 4(b)", "basin of C, P(1,1,0), is seen", fractions_text(b), basin_fraction(b, "P(1,1,0)") > SMALL
        ),
        Statement(
            "Fig. 4(d)", "very small basin of D, P(1,1,1)", fractions_text(d), 0 < basin_fraction(d, "P(1,1,1)") < SMALL
        ),
        Statement(
            "Fig. 4(e)",
            "P(2,2,2) in its place",
            fractions_text(e),
            basin_fraction(e, "P(2,2,2)") > 0 == basin_fraction(e, "P(1,1,1)"),
        ),
        Statement("Fig. 4(g)", "period four and period eight", fractions_text(g), {4, 8} <= {x.m for x in g}),
        Statement("Fig. 4(i)", "chaotic attractor", fractions_text(i), basin_fraction(i, "chaotic") > 0),
    )


def figures_5_and_6_statements() -> tuple[Statement, ...]:
    """Return the statements about Figure 5, also those of section 5.1, and the statements of Figure 6's caption."""
    epsilon = np.linspace(
        rattle.sn1(DELTA) * (1 + 1e-12), float(rattle.grazing("G1", DELTA).epsilon) * (1 - 1e-12), 801
    )
    a, b, c, d = range(4)
    orbits = rattle.period_one(DELTA, epsilon)
    constant = max(_speed_error(orbits, k, i, float(epsilon[i])) for k in (a, c) for i in range(0, 801, 100))
    speeds, phases = orbits.v[[b, d]], orbits.tau
    low, high = np.nanmin(orbits.v), np.nanmax(orbits.v)
    span = np.nanmax(speeds, axis=1) - np.nanmin(speeds, axis=1)
    apart = float(max(abs(orbits.v[b, -1] - orbits.v[c, -1]), abs(orbits.tau[b, -1] - orbits.tau[c, -1])))
    slope = float((orbits.v[b, -1] - orbits.v[b, -2]) / (epsilon[-1] - epsilon[-2]))
    here = rattle.period_one(DELTA, 0.1)
    saddles = [
        NAMES[k] for k in (a, b, d) if np.abs(here.multipliers[k]).max() > 1 and not here.multipliers[k].imag.any()
    ]
    basins = sorted({attractor_label(x) for x in Gear(DELTA, 0.1).attractors(count=SAMPLES)})
    return (
        Statement(
            "5.1, Fig. 5",
            "speed along A and C does not change",
            f"it is 2πδ = {2 * np.pi * DELTA:.4f} at 9 ε, by one step of Π",
            constant < 1e-9,
        ),
        Statement(
            "5.1, Fig. 5",
            "speed along B and D changes significantly",
            "by {:.3f} and {:.3f}".format(*span),
            bool((span > 0.1).all()),
        ),
        Statement(
            "Fig. 5",
            "speeds between 3.7 and 4.9, phases between 0.4 and 1",
            f"speeds {low:.3f} to {high:.3f}, phases {np.nanmin(phases):.3f} to {np.nanmax(phases):.3f}",
            bool(low > 3.7 and high < 4.9 and np.nanmin(phases) > 0.4 and np.nanmax(phases) < 1),
        ),
        Statement("5.1, Fig. 5", "B and C meet on G1", "they coincide there to six digits", apart < 1e-6),
        Statement("5.2", "they meet there nontangentially", f"slope dv/dε of B {slope:.1f}, of C 0", abs(slope) > 0.1),
        Statement(
            "Fig. 6",
            "A, B, D are saddles, C attracts, at ε = 0.1",
            f"saddles {', '.join(saddles)}; C stable",
            saddles == ["A", "B", "D"] and bool(here.stable[c]),
        ),
        Statement(
            "Fig. 6", "three basins: quiet, C, chaotic", ", ".join(basins), basins == ["P(1,1,0)", "chaotic", "quiet"]
        ),
    )


def _speed_error(orbits: PeriodOne, k: int, i: int, epsilon: float) -> float:
    """Return |v − 2πδ|, where v is the speed after one step of Π from orbit k. i: the index of ε in `orbits`."""
    step = Gear(DELTA, epsilon).impact(float(orbits.tau[k, i]), float(orbits.v[k, i]))
    return abs(step.v - 2 * np.pi * DELTA)
