"""Do samples that are called chaotic settle later? Random cells, each such sample followed ten times as long.

    python tests/references/settles_later.py small 300 1
    python tests/references/settles_later.py limit 300 1 --count 2 4 8 16 64

Laws: `small` is where real gears are, δ log-uniform in 1e-3 … 0.3, β/δ in 0.3 … 3, ε in 0.1 … 1.6 of the quiet limit;
`large` is δ in 0.3 … 1.5, β in 0.2 … 1.2, ε up to 1.6 of the quiet limit. `limit` is δ in 0.4 … 1, β in 0.2 … 1.2, ε in
0.98 … 1 of the quiet limit; `plane` is Figure 7's: δ in 0.4 … 1, ε in 0.005 … 0.3, β = 0.6. `stiff` is `small` for the
stiff gear, κ log-uniform in 1e4 … 1e7. Followed by plain iteration of the map, without balls of capture, Newton's
method or a cycle search: a sample has settled if at the end it is certain to become quiet (stiff: it is quiet) or is
back within CLOSE of where it was. The tables are in docs/decisions/0026-labels.md and 0049-about-to-rest.md.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

import rattle
from rattle.attractors.samples import Outcome
from rattle.attractors.table import tabulate_attractors
from rattle.flight.forcing import DRIFT, contact_force
from rattle.flight.law import natural_speed
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.map.impact_map import apply_impact_map
from rattle.impacting.map.quiet import capture_invariant_limit
from rattle.impacting.orbits.limits import quiet_limit
from rattle.numerics.compile import kernel
from rattle.numerics.sampling import initial_conditions
from rattle.parameters import Parameters
from rattle.stiff.attractors.classifier import StiffClassifier
from rattle.stiff.map.flow import QUIET
from rattle.stiff.map.return_map import StiffPoint, step

COUNT, TIMES, LONGEST_PERIOD, CLOSE = 64, 10, 4096, 1e-7
SMALL = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
LARGE = (1.5, 0.3)
EDGES = {"small": SMALL, "large": LARGE, "limit": LARGE, "plane": LARGE, "stiff": SMALL}


class Cell(NamedTuple):
    """Result and cost of the samples of one cell."""

    delta: float
    epsilon: float
    beta: float
    kappa: float
    chaotic: int
    undecided: int
    wrong: int
    impacts: int
    seconds: float


def cells(law, n, seed):
    """(δ, ε, β, κ) of n random cells; κ is ∞ for the impacting gear."""
    rng = np.random.default_rng(seed)
    kappa = np.full(n, np.inf)
    if law == "limit":
        delta, beta, share = rng.uniform(0.4, 1.0, n), rng.uniform(0.2, 1.2, n), rng.uniform(0.98, 1.0, n)
    elif law == "plane":
        delta, epsilon = rng.uniform(0.4, 1.0, n), rng.uniform(0.005, 0.3, n)
        return delta, epsilon, np.full(n, 0.6), kappa
    elif law != "large":
        delta = np.exp(rng.uniform(np.log(1e-3), np.log(0.3), n))
        beta = delta * np.exp(rng.uniform(np.log(0.3), np.log(3.0), n))
        share = rng.uniform(0.1, 1.6, n)
    else:
        delta, beta, share = rng.uniform(0.3, 1.5, n), rng.uniform(0.2, 1.2, n), rng.uniform(0.1, 1.6, n)
    if law == "stiff":
        kappa = 10 ** rng.uniform(4.0, 7.0, n)
    return delta, share * quiet_limit(delta), beta, kappa


@kernel
def settled(tau, v, impacts, delta, epsilon, beta, unit, invariant):
    """Return whether a state is at rest or periodic after so many impacts: plain iteration, then a search."""
    for _ in range(impacts):
        status, tau, v, _time, _below = apply_impact_map(tau, v, delta, epsilon, beta, DRIFT)
        if status != 0:
            return False
        angle = 2.0 * np.pi * tau
        if v * v * v <= invariant * contact_force(np.sin(angle), np.cos(angle), delta, epsilon, DRIFT):
            return True
    t, w = tau, v
    for _ in range(LONGEST_PERIOD):
        status, t, w, _time, _below = apply_impact_map(t, w, delta, epsilon, beta, DRIFT)
        apart = abs(t - tau)
        if status != 0 or (min(apart, 1.0 - apart) < CLOSE and abs(w - v) < CLOSE * unit):
            return status == 0
    return False


@kernel
def settled_stiff(tau, v, impacts, delta, epsilon, beta, kappa, unit):
    """The same for the stiff gear, whose quiet motion is a contact without end."""
    point = StiffPoint(delta, epsilon, beta, kappa)
    for _ in range(impacts):
        status, tau, v, _time, _below = step(tau, v, point)
        if status != 0:
            return status == QUIET
    t, w = tau, v
    for _ in range(LONGEST_PERIOD):
        status, t, w, _time, _below = step(t, w, point)
        apart = abs(t - tau)
        if status != 0:
            return status == QUIET
        if min(apart, 1.0 - apart) < CLOSE and abs(w - v) < CLOSE * unit:
            return True
    return False


def settles(tau, v, impacts, point, unit):
    """Return whether a state at a point (δ, ε, β, κ) settles."""
    if np.isfinite(point[3]):
        return settled_stiff(tau, v, impacts, *point, unit)
    return settled(tau, v, impacts, *point[:3], unit, capture_invariant_limit(*point[:3]))


def watched(point, count=COUNT):
    """One cell, labelled and watched."""
    began = time.process_time()
    *arrays, kappa = (np.array([x]) for x in point)
    v_max = natural_speed(*arrays)
    states = initial_conditions(*arrays, count, v_max, 0)
    is_stiff = np.isfinite(point[3])
    found = (
        StiffClassifier.classify(Parameters.from_values("stiff", *arrays, kappa=kappa), *states)
        if is_stiff
        else ImpactingClassifier.classify(Parameters.from_values("impacting", *arrays), *states)
    )
    seconds = time.process_time() - began
    table, row = tabulate_attractors(found)
    kind, samples = table.kind[row], found.samples
    chaotic = np.flatnonzero(kind == Outcome.CHAOTIC)
    most = TIMES * int(samples.impacts[chaotic].max(initial=0))
    wrong = sum(settles(samples.tau[k], samples.v[k], most, point, v_max[0] / 7.0) for k in chaotic)
    impacts = int(samples.impacts.sum())
    return Cell(*point, chaotic.size, int(np.sum(kind == Outcome.UNDECIDED)), int(wrong), impacts, seconds)


def line(name, chosen, count):
    """One row of the table."""
    n = count * len(chosen)
    total = [sum(getattr(cell, field) for cell in chosen) for field in ("chaotic", "undecided", "wrong", "impacts")]
    chaotic, undecided, wrong, impacts = total
    share = wrong / chaotic if chaotic else 0.0
    return (
        f"| {name} | {len(chosen)} | {chaotic / n:.3f} | {share:.4f} | {wrong / n:.4f} | {undecided / n:.4f} | "
        f"{impacts / n:.0f} | {sum(cell.seconds for cell in chosen) / len(chosen):.4f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("law", choices=EDGES)
    parser.add_argument("cells", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--count", type=int, nargs="+", default=[COUNT], help="samples of a cell")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    points = list(zip(*(map(float, x) for x in cells(asked.law, asked.cells, asked.seed)), strict=True))
    with ProcessPoolExecutor(asked.workers, get_context("spawn")) as pool:
        for count in asked.count:
            found = list(pool.map(partial(watched, count=count), points))
            print(f"{rattle.__version__}, law {asked.law}, seed {asked.seed}, {count} samples, {TIMES} times the watch")
            print_table(EDGES[asked.law], found, count)


def print_table(edges, found, count):
    """Print the table of these cells, and the cells with most samples that are wrong or undecided."""
    print("| δ | cells | called chaotic | of these settle | of all | undecided | impacts per sample | s per cell |")
    print("|---|---|---|---|---|---|---|---|")
    for high, low in pairwise(edges):
        chosen = [cell for cell in found if low <= cell.delta < high]
        if chosen:
            print(line(f"{low:g} … {high:g}", chosen, count))
    print(line("all", found, count))
    for cell in sorted(found, key=lambda cell: -cell.wrong)[:12]:
        if cell.wrong or cell.undecided:
            print(cell)


if __name__ == "__main__":
    main()
