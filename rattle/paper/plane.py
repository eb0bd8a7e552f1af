"""The paper's statements about its Figures 7 to 9: regions, grazing curves, and the chaos that is born on G1."""

import math

import numpy as np
from numpy.typing import NDArray

import rattle
from rattle.attractors.samples import Outcome
from rattle.curves import codimension_two
from rattle.impacting.attractors.classifier import attractors_of
from rattle.orbits.orbits_a_to_d import PeriodOne
from rattle.paper.chaos import chaotic_states, flag_settled_states
from rattle.paper.records import Statement

#: Ranges of δ and ε in Figure 7.
WINDOW = ((0.4, 1.0), (0.0, 0.3))
#: Numbers of cells along δ and ε.
CELLS = (300, 150)
A, B, C, D = range(4)
#: Distance in ε from a grazing curve at which the orbits on both sides of the curve are determined.
SIDE_DISTANCE = 1e-7

Array = NDArray[np.float64]


def plane_cell_centres(columns: int = CELLS[0], rows: int = CELLS[1]) -> tuple[Array, Array]:
    """Return δ and ε, both (columns · rows,), at the centres of the cells into which Figure 7's plane is cut."""
    (d0, d1), (e0, e1) = WINDOW
    delta = d0 + (d1 - d0) * (np.arange(columns) + 0.5) / columns
    epsilon = e0 + (e1 - e0) * (np.arange(rows) + 0.5) / rows
    one, other = np.meshgrid(delta, epsilon, indexing="ij")
    return one.ravel(), other.ravel()


def figure_7_statements(orbits: PeriodOne, region: NDArray[np.int8]) -> tuple[Statement, ...]:
    """Return the statements about the regions of Figure 7, and about the stability of the orbits A and B."""
    covered = float((region > 0).mean())
    unstable = [int(orbits.stable[k].sum()) for k in (A, B)]
    inside = [int((region == k).sum()) for k in range(1, 6)]
    return (
        Statement(
            "5.2, Fig. 7",
            "regions I to V with these orbits cover the plane",
            f"{covered:.1%} of {region.size} cells; in I to V {', '.join(map(str, inside))}",
            covered == 1 and min(inside) > 0,
        ),
        Statement(
            "5.2",
            "A and B are unstable wherever they exist",
            f"stable in {unstable[0]} and {unstable[1]} cells",
            sum(unstable) == 0,
        ),
    )


def _orbits_on_both_sides(curve: str, delta: Array) -> tuple[set[str], set[str]]:
    """Return the combinations of orbits, such as "AD", that exist just below and just above a grazing curve."""
    epsilon = rattle.grazing(curve, delta).epsilon
    both = []
    for side in (-SIDE_DISTANCE, SIDE_DISTANCE):
        exists = rattle.period_one(delta, epsilon + side).exists
        both.append(
            {"".join(n for n, there in zip("ABCD", column, strict=True) if there) or "none" for column in exists.T}
        )
    return both[0], both[1]


def grazing_statements() -> tuple[Statement, ...]:
    """Return the statements of section 5.2 about the orbits and multipliers on G1 and G2."""
    points = {point.name: point for point in codimension_two()}
    d1, d2, d3 = (points[name].delta for name in ("COD21", "COD22", "COD23"))
    before, between, after = np.linspace(0.4, d1, 61)[:-1], np.linspace(d1, d2, 62)[1:-1], np.linspace(d2, 1, 61)[1:]
    rows = []
    for where, curve, delta, below, above in (
        ("B and C vanish on G1 before COD21", "G1", before, "ABCD", "AD"),
        (
            "C vanishes and D appears on G1 before COD22 (from COD23 on: findings)",
            "G1",
            between[between > d3][2:-8],
            "AC",
            "AD",
        ),
        ("A and D appear on G2 beyond COD22", "G2", after, "none", "AD"),
    ):
        low, high = _orbits_on_both_sides(curve, delta)
        shown = f"{delta.size} δ: {' or '.join(sorted(low))} below, {' or '.join(sorted(high))} above"
        rows.append(Statement("5.2", where, shown, low == {below} and high == {above}))
    for says, name in (
        ("SN2 and PD1 touch G1 where they meet it (at COD23: findings)", "COD23"),
        ("SN1 touches G1 and G2 at COD22", "COD22"),
    ):
        orders = {f"{a}-{b}": p for (a, b), p in points[name].tangency.items()}
        shown = ", ".join(f"{pair} {p:.2f}" for pair, p in orders.items())
        rows.append(Statement("5.2, Fig. 8", says, f"order of contact {shown}", all(p > 1.9 for p in orders.values())))
    return (*rows, *_multiplier_statements(before, between, after))


def _multiplier_statements(before: Array, between: Array, after: Array) -> tuple[Statement, ...]:
    """Return the statements about multipliers; arguments: δ below COD21, between COD21 and COD22, and above COD22."""
    first, middle, last = (
        rattle.grazing(c, d).multipliers for c, d in (("G1", before), ("G1", between), ("G2", after))
    )
    product = max(
        float(np.abs(m[0] * m[1] - np.exp(-d)).max()) for m, d in ((first, before), (middle, between), (last, after))
    )
    delta = codimension_two()[-1].delta
    one, other = rattle.grazing("G1", delta * (1 - 1e-13)).multipliers.real
    large, beyond = middle[0].real, last[0].real
    complex_at = first[0].imag != 0
    two_thirds = -2 * math.log(2 / 3)
    return (
        Statement("5.2", "λ₁λ₂ = e^(−δ) at grazing", "on all of G1 and G2, to twelve digits", product < 1e-12),
        Statement(
            "5.2",
            "multipliers real on G1 between COD21 and COD22, the larger in (2/3, 1) throughout",
            f"{large.min():.4f} to {large.max():.4f} at {between.size} δ",
            bool(not middle.imag.any() and large.min() > 2 / 3 and large.max() < 1),
        ),
        Statement(
            "5.2",
            "λ₁ = 1, λ₂ = e^(−δ) at COD22",
            f"{one:.6f}, {other:.6f}; e^(−δ) = {math.exp(-delta):.6f}",
            abs(one - 1) < 1e-5 and abs(other - math.exp(-delta)) < 1e-5,
        ),
        Statement("5.2", "λ₁ > 1 on G2", f"{beyond.min():.4f} to {beyond.max():.4f}", bool(beyond.min() > 1)),
        Statement(
            "5.2",
            "complex multipliers inside the unit circle on G1 before COD21 (but see the findings)",
            f"from δ = {before[complex_at].min():.3f}, moduli e^(−δ/2)",
            bool(complex_at[before > 0.56].all() and (np.abs(first[0][complex_at]) < 1).all()),
        ),
        Statement("5.2", "0.8109 lies beyond COD22", f"{two_thirds:.4f} > {delta:.4f}", two_thirds > delta),
    )


def figure_9_statements(end: float) -> tuple[Statement, ...]:
    """Return the statements about the chaotic attractor at δ = 0.762, from G1 to its end at ε = end."""
    delta = 0.762
    start = float(rattle.grazing("G1", delta).epsilon)
    epsilon = start + (end - start) * (np.arange(40) + 0.5) / 40
    tau, v = chaotic_states(delta, epsilon[0], 256)
    lost, weakest, spread = 0, math.inf, []
    for e in epsilon:
        states = rattle.iterate_tangent(delta, e, tau, v, 4000)
        tau, v = states.tau, states.v
        lost += int(flag_settled_states(delta, e, tau, v).sum())
        weakest = min(weakest, float(states.lyapunov[0].min()))
        spread.append(np.ptp(rattle.iterate(delta, e, tau[:, None], v[:, None], np.arange(40)).v))
    below = attractors_of(delta, start - 1e-6, count=1024).kind
    return (
        Statement(
            "5.2, Fig. 9",
            "robust chaos: a chaotic attractor without periodic windows from G1 on",
            f"at {epsilon.size} ε all of 256 trajectories have a first exponent above "
            f"{math.floor(10 * weakest) / 10}, {lost} settle",
            lost == 0 and weakest > 0.1 and not (below == Outcome.CHAOTIC).any(),
        ),
        Statement(
            "5.2, Fig. 9",
            "it grows until it ends",
            f"its speeds span {spread[0]:.3f} at first, {spread[-1]:.3f} at last",
            bool((np.diff(spread[::4]) > 0).all()),
        ),
    )
