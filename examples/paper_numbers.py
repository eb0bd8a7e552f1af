"""Print, as a Markdown table, the numbers that Mason and Piiroinen (2009) state, beside the ones computed here.

python examples/paper_numbers.py
"""

from collections.abc import Callable

import numpy as np

import rattle
from rattle import curves

B, D = 1, 3


def bisect(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The ε at which a statement that is false at low and true at high becomes true."""
    while high - low > 1e-13:
        middle = (low + high) / 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def sn2(delta: float, near: tuple[float, float]) -> float:
    """Where B and D are born."""
    return bisect(lambda e: bool(rattle.period_one(delta, e).exists[B]), *near)


def pd1(delta: float, near: tuple[float, float]) -> float:
    """Where D loses stability."""
    return bisect(lambda e: not rattle.period_one(delta, e).stable[D], *near)


def figure4(epsilon: float) -> str:
    """Basin fractions of 4096 initial conditions at δ = 0.6, from 0.005 up."""
    found = [a for a in rattle.Gear(0.6, epsilon).attractors(count=4096) if a.fraction >= 0.005]
    names = (f"P({a.m},{a.n_plus},{a.n_minus})" if a.kind == "periodic" else a.kind for a in found)
    return ", ".join(f"{name} {a.fraction:.3f}" for name, a in zip(names, found, strict=True))


def rows() -> list[tuple[str, str, str]]:
    """What, the paper's value, the computed value."""
    grazing = rattle.grazing("G1", 0.762)
    first, second = (f"{x.real:.10f}" for x in grazing.multipliers)
    low, high = rattle.robust_chaos_interval()
    points = {point.name: (point.delta, point.epsilon) for point in curves.codimension_two()}
    d, e = points["COD21"]
    table = [
        ("SN1 at δ = 0.6", "≈ 0.0596", f"{rattle.sn1(0.6):.10f}"),
        ("SN2 at δ = 0.6", "≈ 0.0687", f"{sn2(0.6, (0.065, 0.072)):.10f}"),
        ("PD1 at δ = 0.6", "≈ 0.076", f"{pd1(0.6, (0.07, 0.08)):.10f}"),
        ("G1 at δ = 0.6", "≈ 0.1445", f"{rattle.grazing('G1', 0.6).epsilon:.10f}"),
        ("SN1 at δ = 0.762", "≈ 0.09585", f"{rattle.sn1(0.762):.10f}"),
        ("G1 at δ = 0.762", "≈ 0.09606", f"{grazing.epsilon:.10f}"),
        ("λ₁, λ₂ of C on G1 at δ = 0.762", "≈ 0.8349, ≈ 0.5590", f"{first}, {second}"),
        ("COD21", "(0.7590, 0.09550)", f"({d:.10f}, {e:.10f})"),
        ("λ at COD21", "≈ 0.6842", f"{np.exp(-d / 2):.10f}"),
        ("COD22", "(0.7701, 0.09789)", "({:.10f}, {:.10f})".format(*points["COD22"])),
        ("COD20, where PDC meets G1", "not reported", "({:.10f}, {:.10f})".format(*points["COD20"])),
        ("robust chaos, δ", "(0.7590, 0.7701)", f"({low:.10f}, {high:.10f})"),
        ("λ = 2/3 as a double multiplier, δ", "≈ 0.8109", f"{-2 * np.log(2 / 3):.10f}"),
        ("flip of C (PDC) at δ = 0.5", "not reported", f"{rattle.flip(0.5):.10f}"),
    ]
    for epsilon in (0.056, 0.0615, 0.067, 0.0725, 0.078, 0.0835, 0.089, 0.0945, 0.1):
        table.append((f"Figure 4, ε = {epsilon}", "picture", figure4(epsilon)))
    return table


def main() -> None:
    """Print the table."""
    print("| what (β = 0.6) | paper | computed |\n|---|---|---|")
    for row in rows():
        print("| {} | {} | {} |".format(*row))


if __name__ == "__main__":
    main()
