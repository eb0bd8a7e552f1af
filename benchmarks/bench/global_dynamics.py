"""Measure the speed of global dynamics: basins, their boundaries, manifolds, the crisis, a bifurcation diagram."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import rattle
from bench.measure import NANO, best_of_two
from rattle.crisis import boundary_crisis
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.manifolds import manifold

DELTA, EPSILON = 0.6, 0.1
SIDE = 1000  # cells along each axis of a picture of basins
ARCLENGTH = 20.0
STEPS = 1000  # steps of the diagram
CRISIS = 0.762  # damping at which the crisis is computed


def times() -> Iterator[tuple[str, float, str]]:
    """Yield (name, seconds, resulting rate or size) of each computation; one core, kernels compiled."""
    gear, cells = rattle.Gear(DELTA, EPSILON), SIDE * SIDE
    saddle = period_one_orbit("A", DELTA, EPSILON)
    found: dict[str, Any] = {}

    def timed(name: str, work: Callable[[], Any]) -> float:
        def run() -> None:
            found[name] = work()

        return best_of_two(run)

    for method in ("cells", "direct", "refined"):
        seconds = timed(method, partial(gear.basins, SIDE, method=method))
        yield f"basins, {method}, {SIDE} × {SIDE} cells", seconds, f"{NANO * seconds / cells:.0f} ns per cell"
    seconds = timed("entropy", lambda: rattle.basin_entropy(found["cells"]))
    yield "basin entropy of these", seconds, f"{found['entropy'].boxes / seconds:.2g} boxes per second"
    seconds = timed("uncertainty", gear.uncertainty)
    yield "uncertainty exponent", seconds, f"dimension {2 - found['uncertainty'].exponent:.3f}"
    seconds = timed("gamma", gear.gamma)
    points = sum(piece.tau.size for piece in found["gamma"])
    yield "Γ", seconds, f"{points} points"
    for kind, name in (("stable", "W^s(A)"), ("unstable", "W^u(A)")):
        seconds = timed(kind, partial(manifold, saddle, kind, 1, ARCLENGTH))
        points = found[kind].tau.size
        yield f"{name} to arclength {ARCLENGTH:g}", seconds, f"{points} points, {points / seconds:.2g} per second"
    seconds = timed("crisis", lambda: boundary_crisis(CRISIS))
    yield f"boundary crisis at δ = {CRISIS:g}", seconds, f"ε = {found['crisis'].epsilon:.10f}"
    seconds = timed("diagram", lambda: rattle.diagram((DELTA, 0.05), (DELTA, 0.15), steps=STEPS))
    seen = found["diagram"]
    yield (
        f"diagram of Figure 5, {STEPS} steps",
        seconds,
        f"{len(seen.branches)} branches, {seen.points.tau.size} points",
    )
