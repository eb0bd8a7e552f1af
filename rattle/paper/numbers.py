"""Compute each number that the paper states, at β = 0.6."""

import math
from collections.abc import Callable

import rattle
from rattle.curves import codimension_two, trace
from rattle.errors import RattleError
from rattle.paper.birth import find_birth_of_chaos
from rattle.paper.chaos import bracket_end_of_chaos
from rattle.paper.records import StatedNumber

#: For each number: its place in the paper, its digits as printed, and the key of the finding that explains why the
#: number is wrong ("" if it is right).
STATED = {
    "SN1 at δ = 0.6": ("5.1, Fig. 5", "≈ 0.0596", ""),
    "SN2 at δ = 0.6": ("5.1, Fig. 5", "≈ 0.0687", ""),
    "PD1 at δ = 0.6": ("5.1, Fig. 5", "≈ 0.076", ""),
    "chaotic attractor appears at δ = 0.6": ("5.1", "≈ 0.096", "birth"),
    "chaotic attractor ends at δ = 0.6": ("5.1, 6", "≈ 0.1109", ""),
    "G1 at δ = 0.6": ("5.1, Fig. 5", "≈ 0.1445", ""),
    "SN1 at δ = 0.762": ("5.2, Fig. 9", "≈ 0.09585", ""),
    "G1 at δ = 0.762": ("5.2, Fig. 9", "≈ 0.09606", ""),
    "chaotic attractor ends at δ = 0.762": ("5.2, 6, Fig. 9", "≈ 0.09742", ""),
    "λ₁ of C on G1 at δ = 0.762": ("5.2", "≈ 0.8349", ""),
    "λ₂ of C on G1 at δ = 0.762": ("5.2", "≈ 0.5590", ""),
    "COD21: multipliers on G1 turn real, δ": ("5.2, Figs. 7, 8", "≈ 0.7590", ""),
    "COD21: multipliers on G1 turn real, ε": ("5.2, Figs. 7, 8", "≈ 0.09550", ""),
    "λ₁ = λ₂ at COD21": ("5.2", "≈ 0.6842", ""),
    "COD21: SN2 and PD1 meet G1, δ": ("5.2, Figs. 7, 8", "≈ 0.7590", "COD23"),
    "COD21: SN2 and PD1 meet G1, ε": ("5.2, Figs. 7, 8", "≈ 0.09550", "COD23"),
    "COD22: SN1 meets G1 and G2, δ": ("5.2, Figs. 7, 8", "≈ 0.7701", ""),
    "COD22: SN1 meets G1 and G2, ε": ("5.2, Figs. 7, 8", "≈ 0.09789", ""),
    "λ₁ = λ₂ = 2/3, δ": ("5.2", "≈ 0.8109", ""),
}

#: The numbers that are proved (docs/proofs.md), each as a curve and its damping, or as a codimension-two point and one
#: of its coordinates.
PROVED = {
    **{f"{curve} at δ = {delta}": (curve, delta) for curve in ("SN1", "G1") for delta in ("0.6", "0.762")},
    "SN2 at δ = 0.6": ("SN2", "0.6"),
    "PD1 at δ = 0.6": ("PD1", "0.6"),
    "COD21: multipliers on G1 turn real, δ": ("COD21", "delta"),
    "COD21: multipliers on G1 turn real, ε": ("COD21", "epsilon"),
    "COD21: SN2 and PD1 meet G1, δ": ("COD23", "delta"),
    "COD21: SN2 and PD1 meet G1, ε": ("COD23", "epsilon"),
    "COD22: SN1 meets G1 and G2, δ": ("COD22", "delta"),
    "COD22: SN1 meets G1 and G2, ε": ("COD22", "epsilon"),
}


def epsilon_on_curve(curve: str, delta: float) -> float:
    """Return ε of a bifurcation curve at one damping; NaN if the curve does not exist there."""
    found = trace(curve, delta=(delta - 0.01, delta + 0.01)).at(delta)
    return found[0] if found else math.nan


def _functions_of_stated_numbers() -> dict[str, Callable[[], float | tuple[float, float]]]:
    """Return {name of a number in STATED: function that computes the number}.

    Returns
    -------
    dict[str, Callable[[], float | tuple[float, float]]]
        A function returns the number, or both ends of an interval that contains it. It may raise RattleError.

    Raises
    ------
    RattleError
        COD21, COD22 or COD23 was not found.
    """
    points = {point.name: point for point in codimension_two()}
    missing = {"COD21", "COD22", "COD23"} - set(points)
    if missing:
        raise RattleError(f"{', '.join(sorted(missing))} was not found at beta = 0.6: report this as a bug")
    equal, ends, fold = points["COD21"], points["COD23"], points["COD22"]
    first, second = rattle.grazing("G1", 0.762).multipliers
    return {
        "SN1 at δ = 0.6": lambda: epsilon_on_curve("SN1", 0.6),
        "SN2 at δ = 0.6": lambda: epsilon_on_curve("SN2", 0.6),
        "PD1 at δ = 0.6": lambda: epsilon_on_curve("PD1", 0.6),
        "chaotic attractor appears at δ = 0.6": lambda: find_birth_of_chaos().graze,
        "chaotic attractor ends at δ = 0.6": lambda: bracket_end_of_chaos(0.6, 0.1107, 0.1112, 2e-6),
        "G1 at δ = 0.6": lambda: epsilon_on_curve("G1", 0.6),
        "SN1 at δ = 0.762": lambda: epsilon_on_curve("SN1", 0.762),
        "G1 at δ = 0.762": lambda: epsilon_on_curve("G1", 0.762),
        "chaotic attractor ends at δ = 0.762": lambda: bracket_end_of_chaos(0.762, 0.0973, 0.0976, 1e-6),
        "λ₁ of C on G1 at δ = 0.762": lambda: float(first.real),
        "λ₂ of C on G1 at δ = 0.762": lambda: float(second.real),
        "COD21: multipliers on G1 turn real, δ": lambda: equal.delta,
        "COD21: multipliers on G1 turn real, ε": lambda: equal.epsilon,
        "λ₁ = λ₂ at COD21": lambda: math.exp(-equal.delta / 2),
        "COD21: SN2 and PD1 meet G1, δ": lambda: ends.delta,
        "COD21: SN2 and PD1 meet G1, ε": lambda: ends.epsilon,
        "COD22: SN1 meets G1 and G2, δ": lambda: fold.delta,
        "COD22: SN1 meets G1 and G2, ε": lambda: fold.epsilon,
        "λ₁ = λ₂ = 2/3, δ": lambda: -2 * math.log(2 / 3),
    }


def paper_numbers(finding: str | None = None) -> tuple[StatedNumber, ...]:
    """Return all numbers in the paper's order, or only those that the finding with the key `finding` explains."""
    computed = _functions_of_stated_numbers()
    return tuple(
        StatedNumber(where, what, paper, computed[what](), key)
        for what, (where, paper, key) in STATED.items()
        if finding is None or key == finding
    )
