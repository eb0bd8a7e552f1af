"""Measure how long curves take to trace, for `make bench MEASURED=curves`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import rattle
from bench.measure import PLANE, best

MAGNIFIED = (0.74, 0.78), (0.092, 0.1)  # (δ, ε) of Figure 8


def bifurcations() -> Iterator[tuple[str, float, int]]:
    """Yield (name, seconds, number of points) for the curves of Figures 7 and 8, five branches, and a cascade."""
    turns = count()

    def figures() -> int:
        beta = 0.6 + 1e-12 * next(turns)  # another β each time, so that no cached curve is returned
        traced = (
            rattle.curves.trace(name, beta, *window) for window in (PLANE, MAGNIFIED) for name in rattle.curves.NAMES
        )
        return sum(map(len, traced)) + len(rattle.curves.codimension_two(beta))

    motions = [a for a in rattle.Gear(0.6, 0.089).attractors(count=512) if a.kind == "periodic"]
    orbits = [rattle.periodic_orbit(0.6, 0.089, a.tau, a.v, a.n_plus) for a in motions]
    d = next(orbit for orbit in rattle.Gear(0.6, 0.075).orbits() if orbit.name == "D")
    stable = rattle.periodic_orbit(0.6, 0.075, d.tau, d.v)
    for name, work in (
        ("Figures 7 and 8", figures),
        (f"branches of {len(orbits)} motions", lambda: sum(len(rattle.branch(orbit)) for orbit in orbits)),
        ("six period doublings of D", lambda: len(rattle.cascade(stable, span=(0.05, 0.16)))),
    ):
        points = work()  # compiles kernels that are not in the cache yet
        yield name, best([work])[0], points
