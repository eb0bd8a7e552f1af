"""Findings on orbits, their stability and attractors, where the paper is wrong or incomplete."""

import numpy as np
from numpy.typing import NDArray

import rattle
from rattle.attractors.samples import Outcome
from rattle.attractors.table import KINDS, Attractor
from rattle.continuation.conditions import EventKind
from rattle.curves import codimension_two, trace
from rattle.impacting.attractors.classifier import attractors_of
from rattle.impacting.bifurcations.branches import branch
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.period_one import orbits_at
from rattle.impacting.orbits.periodic import periodic_orbit
from rattle.orbits.orbits_a_to_d import PeriodOne
from rattle.paper.birth import find_birth_of_chaos
from rattle.paper.chaos import flag_settled_states
from rattle.paper.numbers import epsilon_on_curve
from rattle.paper.pictures import DELTA, Panels, attractor_label, basin_fraction, fractions_text
from rattle.paper.plane import Array, C, D
from rattle.paper.records import Finding, FindingEvidence

#: Two ε at δ = 0.6 at which the finding on the birth of chaos lists attractors; both are below the graze.
FAR_BELOW, JUST_BELOW = 0.0912, 0.096
#: Attractors with a smaller basin fraction are not counted.
SEEN = 0.005


def chaos_exponent(attractors: tuple[Attractor, ...]) -> float:
    """Return the largest Lyapunov exponent of the chaotic attractor, NaN if there is none."""
    return next((a.lyapunov[0] for a in attractors if a.kind == "chaotic"), np.nan)


def finding_on_birth_of_chaos() -> Finding:
    """Return the finding on the birth of the chaotic attractor of Figure 4(i)."""
    birth = find_birth_of_chaos()
    early, before, above, after = (
        Gear(DELTA, e).attractors(count=4096) for e in (FAR_BELOW, JUST_BELOW, 0.0974, 0.098)
    )
    return Finding(
        "birth",
        "The chaotic attractor of Figure 4(i) appears at a higher ε, after a period-doubling; smaller ones are there "
        "before",
        "At δ = 0.6 a chaotic attractor suddenly appears at ε ≈ 0.096, in a grazing bifurcation (5.1, 5.2).",
        "The attractor at that ε is periodic. P(2,2,1) has doubled, and the P(4,4,2) that it became grazes Σ⁻ only at "
        "a higher ε, with one of its two flights between impacts on Σ⁺. From there on the attractor is chaotic, with "
        "wide periodic windows up to about 0.0978. It is not the first: another P(4,4,2) doubles into a chaotic "
        "attractor at ε near 0.091, and smaller ones come and go in brief windows.",
        (
            FindingEvidence(
                f"P(2,2,1), followed from ε = 0.0945 to 0.0985, doubles at ε = {birth.flip:.10f} and exists on, "
                "unstable",
                birth.flip < 0.0955 and birth.persists,
            ),
            FindingEvidence(
                f"the doubled orbit, P(4,{birth.n_plus},{birth.n_minus}), grazes Σ⁻ at ε = {birth.graze:.10f}",
                (birth.n_plus, birth.n_minus) == (4, 2) and birth.graze > 0.097,
            ),
            FindingEvidence(
                f"ε = {JUST_BELOW}: {fractions_text(before)}",
                basin_fraction(before, "chaotic") + basin_fraction(before, "undecided")
                == 0
                < basin_fraction(before, "P(4,4,2)"),
            ),
            *(
                FindingEvidence(
                    f"ε = {e}: {fractions_text(seen)}; exponent {chaos_exponent(seen):.2f}",
                    basin_fraction(seen, "chaotic") > 0.1,
                )
                for e, seen in ((0.0974, above), (0.098, after), (FAR_BELOW, early))
            ),
        ),
    )


def finding_on_cod23() -> Finding:
    """Return the finding on COD23, the codimension-two point at which SN2 and PD1 end."""
    points = {point.name: point for point in codimension_two()}
    equal, ends = points["COD21"], points["COD23"]
    delta = 0.7596
    graze, born = epsilon_on_curve("G1", delta), epsilon_on_curve("SN2", delta)
    between = orbits_at(delta, (graze + born) / 2, 0.6)
    names = "".join(orbit.name for orbit in between)
    beyond, below = 0.7604, 0.7592
    exponents = _exponents_near_g1(below, 1e-7)
    return Finding(
        "COD23",
        "SN2 and PD1 do not meet G1 in COD21",
        "SN2, PD1 and G1 meet in COD21, where the multipliers turn real; between COD21 and COD22 B never appears and "
        "D is born on G1 (5.2, captions of Figures 7 and 8).",
        "They meet at a third point, COD23, at slightly higher damping. Near grazing the trace of B and D is M/u, "
        "with u the speed at Σ⁻ and M a function of the grazing orbit; their saddle-node and their flip reach the "
        "graze where M changes sign, and that is not where the multipliers are equal. From COD21 to COD23, B and D "
        "are still born in SN2 below G1, B and C vanish on G1, and chaos can be there below it. In Figure 8 they are "
        "a ninth of a division apart.",
        (
            FindingEvidence(
                f"COD21 ({equal.delta:.7f}, {equal.epsilon:.7f}), COD23 ({ends.delta:.7f}, {ends.epsilon:.7f})",
                ends.delta - equal.delta > 1e-3,
            ),
            FindingEvidence(
                f"δ = {delta}: SN2 at ε = {born:.9f}, G1 at {graze:.9f}; half way between exist {', '.join(names)}",
                names == "ABCD",
            ),
            FindingEvidence(
                f"δ = {below}, 1e-7 below G1, where C attracts: chaos as well, with exponent {exponents.mean():.2f} "
                "in 100,000 impacts",
                bool(exponents.size and exponents.min() > 0.3),
            ),
            FindingEvidence(
                f"δ = {beyond}, beyond COD23: SN2 is absent", not trace("SN2", delta=(beyond, beyond + 0.01)).at(beyond)
            ),
        ),
    )


def _exponents_near_g1(delta: float, below: float) -> Array:
    """Return the largest Lyapunov exponents of unsettled trajectories that begin near the orbit that grazes on G1.

    below: ε on G1 minus ε of the gear. A trajectory is unsettled if it neither repeats nor becomes quiet.

    Returns
    -------
    Array
        First Lyapunov exponents per forcing period.
    """
    graze = rattle.grazing("G1", delta)
    epsilon = float(graze.epsilon) - below
    tau, v = np.meshgrid(graze.tau + np.linspace(-0.01, 0.01, 40), graze.v + np.linspace(-0.05, 0.05, 40))
    near = rattle.iterate(delta, epsilon, tau, v, 3000)
    left = ~flag_settled_states(delta, epsilon, near.tau.ravel(), near.v.ravel())
    end = rattle.iterate_tangent(delta, epsilon, near.tau.ravel()[left], near.v.ravel()[left], 100_000)
    return end.lyapunov[0][~flag_settled_states(delta, epsilon, end.tau, end.v)]


def finding_on_stability_of_c(orbits: PeriodOne, region: NDArray[np.int8]) -> Finding:
    """Return the finding on PDC, the flip of C, which the paper does not have."""
    inside = np.isin(region, (2, 3, 4))
    part = float((~orbits.stable[C] & inside).sum() / inside.sum())
    flip, graze = epsilon_on_curve("PDC", 0.5), epsilon_on_curve("G1", 0.5)
    epsilon = np.linspace(flip, graze, 102)[1:-1]
    c = rattle.period_one(0.5, epsilon)
    unstable = bool((c.exists[C] & ~c.stable[C]).all())
    orbit = next(x for x in orbits_at(0.5, 0.19, 0.6) if x.name == "C")
    away = [
        float(x) for x in rattle.iterate(0.5, 0.19, orbit.tau, orbit.v + 1e-9, np.array([0, 10, 20, 30])).v - orbit.v
    ]
    return Finding(
        "stability of C",
        "C is not stable throughout regions II to IV",
        "In regions II, III and IV the P(1,1,0) solution C is stable (5.2).",
        "C flips on a curve that the paper does not have (PDC): ε² = (δ coth(δ/2) − 2)² + (δ² coth(δ/2)/2π)², which "
        "lies below G1 for δ < 0.5418.",
        (
            FindingEvidence(
                f"C is unstable in {part:.1%} of the part of Figure 7's plane that II, III and IV take", part > 0.2
            ),
            FindingEvidence(
                f"δ = 0.5: PDC at ε = {flip:.7f}, G1 at {graze:.7f}; unstable at all of {epsilon.size} ε between",
                unstable,
            ),
            FindingEvidence(
                f"δ = 0.5, ε = 0.19: multiplier {orbit.multipliers[0].real:.4f}; a state 1e-9 from C is "
                f"{abs(away[2]):.1e} away after 20 impacts, {abs(away[3]):.1e} after 30",
                orbit.multipliers[0].real < -1 and abs(away[3]) > 1e3 * 1e-9,
            ),
        ),
    )


def finding_on_stability_of_d(delta: Array, epsilon: Array, orbits: PeriodOne, region: NDArray[np.int8]) -> Finding:
    """Return the finding on PD2, the flip at which D regains its stability."""
    stable = orbits.stable[D]
    five, patch = region == 5, (region == 3) & (epsilon > 0.2)
    again = epsilon_on_curve("PD2", 0.4)
    seen = Gear(0.5, 0.29).attractors(count=1024)
    part = float((stable & five).sum() / five.sum())
    return Finding(
        "stability of D",
        "D is not unstable throughout regions IV and V",
        "In region IV both P(1,1,1) solutions are unstable; in region V all solutions are (5.2).",
        "D regains stability at high ε in a second flip (PD2). So there is a second part of the plane with the orbits "
        "and stability of region III, and a part of region V with a stable D.",
        (
            FindingEvidence(f"δ = 0.4: D is stable again from ε = {again:.7f}", abs(again - 0.2395) < 1e-4),
            FindingEvidence(
                f"stable D with A, B and C above ε = 0.2: δ from {delta[patch].min():.3f} to {delta[patch].max():.3f}, "
                f"{patch.mean():.1%} of Figure 7's plane",
                bool(patch.any()),
            ),
            FindingEvidence(
                f"stable D in {part:.1%} of region V, for δ up to {delta[stable & five].max():.3f}", part > 0.01
            ),
            FindingEvidence(f"δ = 0.5, ε = 0.29 (V): {fractions_text(seen)}", basin_fraction(seen, "P(1,1,1)") > 0.01),
        ),
    )


def finding_on_g1_multipliers() -> Finding:
    """Return the finding on the Floquet multipliers along G1, at dampings below and above COD20."""
    corner = codimension_two()[0]
    delta = np.linspace(0.4, 0.6, 20001)
    multipliers = rattle.grazing("G1", delta).multipliers
    turns = float(delta[np.abs(multipliers[0].imag) > 0].min())
    low = multipliers[:, 0].real
    outside = float(delta[np.abs(multipliers[0]) > 1].max())
    return Finding(
        "multipliers on G1",
        "On G1 the multipliers are real, one beyond −1, at small damping",
        "For δ below COD21 the multipliers on G1 are a complex pair inside the unit circle; from λ₁λ₂ = e^(−δ), "
        "stability at grazing depends solely on δ (5.2).",
        "The product does not decide stability. Both are real and negative for small δ, and one is beyond −1 below the "
        "point COD20 where PDC meets G1: what grazes there is an unstable C.",
        (
            FindingEvidence(
                f"δ = 0.4: {low[0]:.4f} and {low[1]:.4f}", bool(low[0] < -1 and not multipliers[:, 0].imag.any())
            ),
            FindingEvidence(
                f"one beyond −1 up to COD20 ({corner.delta:.7f}, {corner.epsilon:.7f})",
                abs(outside - corner.delta) < 2e-5,
            ),
            FindingEvidence(f"complex from δ = {turns:.4f} on", turns > corner.delta),
        ),
    )


def finding_on_region_one() -> Finding:
    """Return the finding on P(1,2,0), a period-one orbit that attracts in region I."""
    random = np.random.default_rng(0)
    delta, epsilon = random.uniform(0.4, 1.0, 6000), random.uniform(0.0, 0.3, 6000)
    inside = rattle.regions(delta, epsilon) == 1
    delta, epsilon = delta[inside], epsilon[inside]
    found = attractors_of(delta, epsilon, count=64)
    other = found.kind != Outcome.QUIET
    two = other & (found.kind == Outcome.PERIODIC) & (found.n_plus == 2) & (found.n_minus == 0) & (found.m == 1)
    which = np.unique(found.cell[two])
    here, there = Gear(1.0, 0.23), Gear(DELTA, 0.12)
    seen, also = here.attractors(count=1024), there.attractors(count=1024)
    two_bounces = next(a for a in also if attractor_label(a) == "P(1,2,0)")
    orbit = periodic_orbit(DELTA, 0.12, two_bounces.tau, two_bounces.v, 2)
    born = next(e.epsilon for e in branch(orbit, "epsilon", (0.09, 0.13)).events if e.kind is EventKind.SADDLE_NODE)
    kinds = ", ".join(sorted({KINDS[k] for k in found.kind[other & ~two]})) or "nothing"
    return Finding(
        "P(1,2,0)",
        "There are more period-one solutions than A to D, and one of them attracts in region I",
        "In region I no solutions but permanent contact are present (5.2); A to D are the four period-one solutions.",
        "P(1,2,0) bounces twice on Σ⁺ per period and never reaches Σ⁻. It attracts, in a part of region I at high "
        "damping too, and at δ = 0.6 inside Figure 5's range of ε, below its axis of speeds.",
        (
            FindingEvidence(
                f"δ = 1, ε = 0.23, region {rattle.REGIONS[here.region()]}: {fractions_text(seen)}",
                here.region() == 1 and basin_fraction(seen, "P(1,2,0)") > 0.01,
            ),
            FindingEvidence(
                f"it attracts at {which.size} of {delta.size} random points of region I, δ from "
                f"{delta[which].min():.3f}, "
                f"ε from {epsilon[which].min():.3f} to {epsilon[which].max():.3f}; elsewhere there {kinds} but "
                "quiet motion",
                which.size > 0 and not (other & ~two).any(),
            ),
            FindingEvidence(
                f"δ = 0.6: born in a saddle-node at ε = {born:.7f}; ε = 0.12: {fractions_text(also)}",
                basin_fraction(also, "P(1,2,0)") > 0.05 and 0.1 < born < 0.12,
            ),
            FindingEvidence(
                "there its speeds on Σ⁺ are {:.4f} and {:.4f}".format(*orbit.speeds),
                orbit.label == (1, 2, 0) and orbit.stable and bool(orbit.speeds.max() < 3.7),
            ),
        ),
    )


def finding_on_number_of_attractors(found: Panels) -> Finding:
    """Return the finding on the number of attractors in the panels of Figure 4."""
    counts = [sum(a.fraction >= SEEN for a in attractors) for attractors in found.values()]
    c = [basin_fraction(attractors, "P(1,1,0)") for attractors in found.values()]
    rattling = [1 - basin_fraction(attractors, "quiet") for attractors in found.values()]
    lone = sorted({attractor_label(a) for a in found[0.089]})
    return Finding(
        "number of attractors",
        "The number of attractors does not fall steadily with ε",
        "The number of attractors, and the size of their basins, decreases with decreasing ε (5.1, on Figure 4).",
        "What decreases is the part of the plane that does not become quiet. The number of attractors has its maximum "
        "in panel (g), and C's basin in panel (e).",
        (
            FindingEvidence(
                f"attractors with {SEEN:.1%} of the sample or more, (a) to (i): {', '.join(map(str, counts))}",
                counts != sorted(counts) and len(lone) > counts[-1],
            ),
            FindingEvidence(f"share of C's basin: {', '.join(f'{x:.3f}' for x in c)}", c != sorted(c)),
            FindingEvidence(
                f"share that does not become quiet: {', '.join(f'{x:.3f}' for x in rattling)}",
                rattling[0] < rattling[-1],
            ),
        ),
    )
