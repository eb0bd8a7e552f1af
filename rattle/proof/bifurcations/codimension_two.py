"""The conditions of the codimension-two points COD20 to COD23, at which C grazes Σ⁻ and two curves meet.

Notation: τ is the phase of the departure from Σ⁺; X = ε cos 2πτ; s is the time from this departure to the graze;
E = e^(−δ); w₁ and w₀ are the velocities before and after the impact on Σ⁺. The trace of C is
T = 1 + E − 4π (1 − E) X/δ² (Lemma 9 of docs/proofs.md).

COD20: T = −1 − E, the flip of C. COD21: T = 2√E, a double multiplier. COD22: X = 0, that is T = 1 + E, where A and C
are born.
COD23: ∂(w₀ + w₁)/∂τ = 0. It is the condition det J(1) + det J(−1) = 0 of the P(1,1,1) whose impact on Σ⁻ is the graze
(`rattle.impacting.bifurcations.codimension_two`).
"""

from __future__ import annotations

from collections.abc import Callable

from rattle.proof.balls import PI, arb_series

Series = arb_series


def _flip_residual(delta: Series, x: Series, _s: Series, decay: Series) -> Series:
    """Return 2δ² (1 + E) − 4π (1 − E) X, which is 0 at a flip of C; `decay` is E = e^(−δ), and x is X = ε cos 2πτ."""
    return delta * delta * 2 * (1 + decay) - 4 * PI() * (1 - decay) * x


def _double_multiplier_residual(delta: Series, x: Series, _s: Series, _decay: Series) -> Series:
    """Return δ² (1 − √E) − 4π (1 + √E) X, E = e^(−δ), which is 0 where both multipliers of C are equal to √E."""
    root = (-delta / 2).exp()
    return delta * delta * (1 - root) - 4 * PI() * (1 + root) * x


def _cod23_residual(delta: Series, x: Series, s: Series, decay: Series) -> Series:
    """Return a number that is 0 at COD23; s is the time from Σ⁺ to the graze, and `decay` is E = e^(−δ)."""
    early, late = (-delta * s).exp(), (-delta * (1 - s)).exp()
    impacts = 1 / (1 - early) + late / (1 - late)
    return delta * delta * (2 * (1 + decay) / (1 - decay) - impacts) - 4 * PI() * x


def _birth_of_a_and_c_residual(_delta: Series, x: Series, _s: Series, _decay: Series) -> Series:
    """Return X = ε cos 2πτ, which is 0 where A and C are born (τ: the phase of the departure from Σ⁺)."""
    return x


Condition = Callable[[Series, Series, Series, Series], Series]
#: {name of a point: the function of (δ, X, s, E), in the notation above, that is 0 at the point}. The equations of the
#: graze hold at each of the points, too.
CONDITIONS: dict[str, Condition] = {
    "COD20": _flip_residual,
    "COD21": _double_multiplier_residual,
    "COD22": _birth_of_a_and_c_residual,
    "COD23": _cod23_residual,
}
