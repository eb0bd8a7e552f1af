"""Findings on the paper's section 3: convexity of flights, the impact map, the contact force, low-speed bouncing."""

import math

import numpy as np

import rattle
from rattle.paper import flights, formulas
from rattle.paper.plane import WINDOW, plane_cell_centres
from rattle.paper.records import Finding, FindingEvidence, Statement

#: δ, ε, τ and v of a step of Π that meets Σ⁻ twice in a row.
EXAMPLE = (0.4, 0.25, 0.32, 5.82)
#: δ, ε and τ at which Π jumps at some speed v; then a speed below and a speed above this v. At the jump the maximum of
#: a flight touches Σ⁺.
JUMP = (0.4, 0.25, 0.46, 2.8, 2.9)


def finding_on_convexity() -> Finding:
    """Return the finding on the paper's claim that Φ'' > 0 on all flights, and where the claim fails."""
    delta, epsilon = plane_cell_centres(60, 60)
    worst = flights.find_smallest_accelerations(delta, epsilon, rattle.period_one(delta, epsilon))
    first = min(w.first_negative_epsilon for w in worst)
    column = np.linspace(0.06, 0.3, 241)
    there = np.full(column.size, 0.6)
    up = min(
        np.nan_to_num(w.first_negative_epsilon, nan=np.inf)
        for w in flights.find_smallest_accelerations(there, column, rattle.period_one(there, column))
    )
    low = min(_smallest_random_acceleration(*point) for point in ((0.6, 0.056), (0.6, 0.1), (0.762, 0.0974)))
    return Finding(
        "convexity",
        "Φ'' > 0 fails in parts of Figure 7's plane",
        "Φ'' > 0 for all parameter values under investigation, so a flight has no maximum (3.1, 3.2).",
        "Φ'' = g(t) − δΦ' with the contact force g(t) = 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt, so it is negative wherever "
        "Φ' > g/δ. Above the quiet limit ε = 2δ/√(4π² + δ²) g itself is negative at some phases. In Figures 4, 5, 6 "
        "and 9 no such flight was found.",
        (
            *(
                FindingEvidence(
                    f"{w.name}: smallest Φ'' {w.smallest:.2f}, at δ = {w.delta:.3f}, ε = {w.epsilon:.4f}; negative in "
                    f"{w.negative_share:.1%} of the cells where {w.name} exists",
                    w.smallest < 0,
                )
                for w in worst
            ),
            FindingEvidence(
                f"on these orbits negative from ε = {first:.4f} up; at δ = 0.6 from {up:.3f} up", 0.1 < first < up
            ),
            FindingEvidence(
                "flights of 500 random states at each of (δ, ε) = (0.6, 0.056), (0.6, 0.1), (0.762, 0.0974): "
                f"Φ'' ≥ {low:.2f}",
                low > 0,
            ),
        ),
    )


def _smallest_random_acceleration(delta: float, epsilon: float) -> float:
    """Return the smallest Φ'' during one step of Π from 500 random states."""
    random = np.random.default_rng(0)
    states = zip(random.random(500), 7 * random.random(500), strict=True)
    return min(
        flights.compute_reference_step(delta, epsilon, float(tau), float(v)).least_acceleration for tau, v in states
    )


def _find_jump(delta: float, epsilon: float, tau: float, low: float, high: float) -> tuple[float, float, float]:
    """Return the speed v between low and high at which Π jumps, and the speeds after Π on both sides, by bisection."""

    def speed_after_return(v: float) -> float:
        """Return the speed after one step of Π."""
        return float(rattle.iterate(delta, epsilon, tau, v, 1).v)

    below, above = speed_after_return(low), speed_after_return(high)
    for _ in range(60):
        middle = (low + high) / 2
        now = speed_after_return(middle)
        if abs(now - below) < abs(now - above):
            low, below = middle, now
        else:
            high, above = middle, now
    return low, below, above


def finding_on_impact_map() -> Finding:
    """Return the finding on the impact map: a fourth case of flights, and a jump of Π."""
    v, below, above = _find_jump(*JUMP)
    step = flights.compute_reference_step(*EXAMPLE)
    delta, epsilon = plane_cell_centres(300, 150)
    random = np.random.default_rng(0)
    count = rattle.iterate(
        delta, epsilon, random.random((8, delta.size)), 7 * random.random((8, delta.size)), 1
    ).n_minus
    share = float((count > 1).mean())
    least = float((epsilon / rattle.quiet_limit(delta))[(count > 1).any(axis=0)].min())
    names = ", ".join("Σ⁺" if wall > 0 else "Σ⁻" for wall in step.walls)
    times = ", ".join(f"{time:.3f}" for time in step.times)
    return Finding(
        "impact map",
        "The impact map has more than three cases, and it is not continuous everywhere",
        "From Σ⁺ a trajectory returns after no impact, a graze, or one impact on Σ⁻, and Π is continuous (Figures 1 "
        "and 3, 3.16).",
        "Where Φ'' < 0 on the way up, a flight from Σ⁻ can have a maximum in the gap and meet Σ⁻ again. Where the "
        "maximum of a flight touches Σ⁺, Π jumps: on one side of that state the flight ends there at speed 0, on the "
        "other it goes on.",
        (
            FindingEvidence(
                "δ = {}, ε = {}, from Σ⁺ at phase {} with speed {}: ".format(*EXAMPLE)
                + f"{names} after {times} periods",
                step.walls[:2] == (-1, -1),
            ),
            FindingEvidence(
                "δ = {}, ε = {}, phase {}: ".format(*JUMP)
                + f"at v = {v:.9f} the speed after Π jumps from {abs(below):.3f} "
                f"to {above:.3f}",
                abs(above - below) > 0.1,
            ),
            FindingEvidence(
                f"Σ⁻ twice: {share:.4%} of {count.size} random states over Figure 7's plane, all at more "
                f"than {math.floor(least * 100) / 100:.2f} of the quiet limit",
                bool(share > 0 and least > 1),
            ),
        ),
    )


def finding_on_contact_force() -> Finding:
    """Return the finding on the paper's claims that the contact force g is positive and that (3.13) always holds."""
    delta = np.linspace(*WINDOW[0], 2001)
    top = WINDOW[1][1]
    beyond = float(np.clip(1 - rattle.quiet_limit(delta) / top, 0, 1).mean())
    least = 2 * delta**2 / (delta**2 + 4 * np.pi**2)
    never = float((least / top).mean())
    phase = np.linspace(0, 1, 1001)
    at = float(formulas.acceleration_by_formula(phase, 0.0, 0.4, 0.2).min())
    # ε at the end of region I: the smaller of SN1 and G2; fmin ignores a curve that does not exist (NaN)
    born = np.fmin(rattle.sn1(delta), rattle.grazing("G2", delta).epsilon)
    return Finding(
        "contact force",
        "Neither positive g nor (3.13) holds throughout Figure 7's plane",
        "g will always be positive; (3.13) will always be satisfied for the parameter values that we investigate "
        "(3.1.1).",
        "As printed g is a square, so it cannot be negative, but it vanishes where Φ'' does on departure. What the "
        "argument needs is Φ'' > 0, which for small v is the condition for permanent contact, ε < 2δ/√(4π² + δ²). "
        "Above it there is no quiet motion at all, which the paper does not say. (3.13) for v → 0 is ε > 2δ²/(δ² + "
        "4π²); it fails only at small ε inside region I.",
        (
            FindingEvidence(f"quiet motion is impossible in {beyond:.1%} of Figure 7's plane", 0.2 < beyond < 0.3),
            FindingEvidence(
                f"δ = 0.4, ε = 0.2: Φ'' on departure at small speed is {at:.2f} at its worst phase", at < 0
            ),
            FindingEvidence(
                f"(3.13) fails for v → 0 in {never:.1%} of the plane, up to ε = {least[-1]:.4f} at δ = 1; all of it "
                "in region I",
                bool(never > 0.05 and (least < born).all()),
            ),
        ),
    )


def finding_on_factor_three() -> Finding:
    """Return the finding on the change of speed in a small bounce, which the paper prints three times too large."""
    orders = formulas.measure_error_orders()
    rate, periods = formulas.bounce_speed_decay_rate(0.02, 1_500_000)
    third, printed = (formulas.decay_rate_by_formula(factor, 0.005, 2.0) for factor in (1 / 3, 1.0))
    damping = formulas.DELTA
    return Finding(
        "factor three",
        "The change of speed in a small bounce is a third of the printed one, which settles how quiet motion is "
        "approached",
        "Φ'(t̄) = v + (f/g) v² (after 3.8), from Φ to second order; numerical simulations indicate that slightly more "
        "energy is lost than gained per period.",
        "Φ'(t̄) = v + (f/3g) v² + O(v³). The cubic term of Φ that (3.8) leaves out changes t̄ at order v², and "
        "through Φ'' that is a change of Φ'(t̄) of the same order as the one that is kept. Summed up, v³ e^(δt)/g(t) "
        "is conserved, so below the quiet limit v always falls, by e^(−δ/3) per forcing period (energy by e^(−2δ/3)).",
        (
            FindingEvidence(
                f"error of the printed formula falls as v^{orders.speed_as_printed:.2f}: its v² term is wrong; "
                f"with f/3g as v^{orders.speed_with_third:.2f}",
                abs(orders.speed_as_printed - 2) < 0.1 and abs(orders.speed_with_third - 3) < 0.1,
            ),
            FindingEvidence(
                f"δ = {damping}, ε = {formulas.EPSILON}, 1.5 million exact bounces from v = 0.02, {periods:.1f} "
                f"periods: ln v falls by {rate:.5f} per period; δ/3 = {damping / 3:.5f}",
                abs(rate - damping / 3) < 1e-4,
            ),
            FindingEvidence(
                f"bounces by the formula with f/3g: {third:.3f} per period, with the printed f/g {printed:.3f}, near "
                f"δ = {damping}",
                abs(third - damping / 3) < 0.02 and abs(printed - damping) < 0.04,
            ),
        ),
    )


def finding_on_extremes_of_f() -> Finding:
    """Return the finding on the paper's (3.11) and (3.12): the extremes of f are printed with a factor v² too much."""
    v, delta, epsilon = 0.05, 0.6, 0.1
    values = formulas.f(np.arange(4000) / 4000, v, delta, epsilon)
    sign = np.array([-1, 1])
    right = 2 * (-(delta**2) * (v + 4 * np.pi) + sign * 2 * np.pi * epsilon * (delta**2 + 4 * np.pi**2))
    off = float(np.abs(np.array([values.min(), values.max()]) - right).max())
    return Finding(
        "extremes of f",
        "The extremes of f are printed with a factor v² that belongs to f v²",
        "f_min, f_max = 2v² (−δ² (v + 4π) ∓ 2πε (δ² + 4π²)) (3.11, 3.12).",
        "From (3.9), f_min, f_max = 2 (−δ² (v + 4π) ∓ 2πε (δ² + 4π²)). Signs, and so (3.13), are not affected.",
        (
            FindingEvidence(
                f"v = {v}, δ = {delta}, ε = {epsilon}: (3.9) over all phases from {values.min():.6f} to "
                f"{values.max():.6f}, without v² {right[0]:.6f} and {right[1]:.6f}",
                off < 1e-9,
            ),
        ),
    )


def formula_statements() -> tuple[Statement, ...]:
    """Return the correct formulas of the paper's section 3.1.1, and its (4.1), as statements with evidence."""
    orders = formulas.measure_error_orders()
    delta = np.linspace(0.4, 0.77, 38)
    sn1 = np.abs(2 - delta / np.tanh(delta / 2))
    below, above = (rattle.period_one(delta, sn1 * (1 + side)).exists[[0, 2]] for side in (-1e-9, 1e-9))
    return (
        Statement(
            "(3.6)",
            "Φ to second order in h = t − t*",
            f"error falls as h^{orders.displacement:.2f}",
            orders.displacement > 2.9,
        ),
        Statement("(3.7)", "Φ' to second order in h", f"error falls as h^{orders.velocity:.2f}", orders.velocity > 2.9),
        Statement(
            "(3.8)",
            "time to the next impact",
            f"error falls as v^{orders.time:.2f} (up to the sign)",
            orders.time > 1.9,
        ),
        Statement(
            "(4.1)",
            "A and C exist for ε > |2 − δ coth(δ/2)|",
            f"at {delta.size} δ up to COD22 they exist just above and not just below",
            bool(above.all() and not below.any()),
        ),
    )
