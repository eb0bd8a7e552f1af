"""Conditions of the codimension-two points COD20 to COD23, where C grazes Σ⁻ and another curve ends (lemma 9).

Let X = ε cos 2πτ, s the time from the departure to the graze, and E = e^(−δ). The trace of C is

    T = 1 + E − 4π (1 − E) X/δ².

At COD23 the motion that makes the grazing impact has det J(1) + det J(−1) = 0
(`rattle.impacting.bifurcations`). At a graze this reduces to ∂(w₀ + w₁)/∂τ = 0.
"""

from __future__ import annotations

from collections.abc import Callable

from rattle.proof.balls import PI, arb_series

Series = arb_series


def _flip(delta: Series, x: Series, _s: Series, end: Series) -> Series:
    return delta * delta * 2 * (1 + end) - 4 * PI() * (1 - end) * x


def _equal_multipliers(delta: Series, x: Series, _s: Series, _end: Series) -> Series:
    root = (-delta / 2).exp()
    return delta * delta * (1 - root) - 4 * PI() * (1 + root) * x


def _no_square_root(delta: Series, x: Series, s: Series, end: Series) -> Series:
    early, late = (-delta * s).exp(), (-delta * (1 - s)).exp()
    impacts = 1 / (1 - early) + late / (1 - late)
    return delta * delta * (2 * (1 + end) / (1 - end) - impacts) - 4 * PI() * x


def _born(_delta: Series, x: Series, _s: Series, _end: Series) -> Series:
    return x


Condition = Callable[[Series, Series, Series, Series], Series]
#: The second condition of each point: a function of (δ, X, s, E) that vanishes there.
CONDITIONS: dict[str, Condition] = {
    "COD20": _flip,
    "COD21": _equal_multipliers,
    "COD22": _born,
    "COD23": _no_square_root,
}
