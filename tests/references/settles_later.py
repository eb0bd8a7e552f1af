"""Do samples that are called chaotic settle later? Random cells, each such sample followed ten times as long.

    python tests/references/settles_later.py small 300 1

Laws: `small` is where real gears are, δ log-uniform in 1e-3 … 0.3, β/δ in 0.3 … 3, ε in 0.1 … 1.6 of the quiet limit;
`large` is δ in 0.3 … 1.5, β in 0.2 … 1.2, ε up to 1.6 of the quiet limit. Followed by plain iteration of the map,
without balls of capture, Newton's method or a cycle search: a sample has settled if at the end it is certain to become
quiet or is back within CLOSE of where it was. The table is in docs/decisions/0026-labels.md.
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

import rattle
from rattle.attractors.table import CHAOTIC, UNDECIDED, tabulated
from rattle.flight.law import DRIFT, contact_force, natural_speed
from rattle.impacting.attractors.classifier import classify
from rattle.impacting.map.impact_map import impact
from rattle.impacting.map.quiet import capture_invariant
from rattle.impacting.orbits.limits import quiet_limit
from rattle.numerics.compile import kernel
from rattle.numerics.sampling import initial_conditions

COUNT, TIMES, LONGEST_PERIOD, CLOSE = 64, 10, 4096, 1e-7
EDGES = {"small": (0.3, 0.1, 0.03, 0.01, 0.003, 0.001), "large": (1.5, 0.3)}


class Cell(NamedTuple):
    """What became of the samples of one cell, and what it cost."""

    delta: float
    epsilon: float
    beta: float
    chaotic: int
    undecided: int
    wrong: int
    impacts: int
    seconds: float


def cells(law, n, seed):
    """(δ, ε, β) of n random cells."""
    rng = np.random.default_rng(seed)
    if law == "small":
        delta = np.exp(rng.uniform(np.log(1e-3), np.log(0.3), n))
        beta = delta * np.exp(rng.uniform(np.log(0.3), np.log(3.0), n))
        share = rng.uniform(0.1, 1.6, n)
    else:
        delta, beta, share = rng.uniform(0.3, 1.5, n), rng.uniform(0.2, 1.2, n), rng.uniform(0.1, 1.6, n)
    return delta, share * quiet_limit(delta), beta


@kernel
def settled(tau, v, impacts, delta, epsilon, beta, unit):
    """Whether a state is at rest or periodic after so many impacts: plain iteration, then a look for a return."""
    invariant = capture_invariant(delta, epsilon, beta)
    for _ in range(impacts):
        status, tau, v, _time, _below = impact(tau, v, delta, epsilon, beta, DRIFT)
        if status != 0:
            return False
        angle = 2.0 * np.pi * tau
        if v * v * v <= invariant * contact_force(np.sin(angle), np.cos(angle), delta, epsilon, DRIFT):
            return True
    t, w = tau, v
    for _ in range(LONGEST_PERIOD):
        status, t, w, _time, _below = impact(t, w, delta, epsilon, beta, DRIFT)
        apart = abs(t - tau)
        if status != 0 or (min(apart, 1.0 - apart) < CLOSE and abs(w - v) < CLOSE * unit):
            return status == 0
    return False


def watched(point):
    """One cell, labelled and watched."""
    delta, epsilon, beta = point
    began = time.process_time()
    arrays = [np.array([x]) for x in point]
    v_max = natural_speed(*arrays)
    found = classify(*arrays, *initial_conditions(*arrays, COUNT, v_max, 0))
    seconds = time.process_time() - began
    table, row = tabulated(found)
    kind, samples = table.kind[row], found.samples
    chaotic = np.flatnonzero(kind == CHAOTIC)
    most = TIMES * int(samples.impacts[chaotic].max(initial=0))
    wrong = sum(settled(samples.tau[k], samples.v[k], most, delta, epsilon, beta, v_max[0] / 7.0) for k in chaotic)
    impacts = int(samples.impacts.sum())
    return Cell(*point, chaotic.size, int(np.sum(kind == UNDECIDED)), int(wrong), impacts, seconds)


def line(name, chosen):
    """One row of the table."""
    n = COUNT * len(chosen)
    total = [sum(getattr(cell, field) for cell in chosen) for field in ("chaotic", "undecided", "wrong", "impacts")]
    chaotic, undecided, wrong, impacts = total
    share = wrong / chaotic if chaotic else 0.0
    return (
        f"| {name} | {len(chosen)} | {chaotic / n:.3f} | {share:.4f} | {wrong / n:.4f} | {undecided / n:.4f} | "
        f"{impacts / n:.0f} | {sum(cell.seconds for cell in chosen) / len(chosen):.2f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("law", choices=EDGES)
    parser.add_argument("cells", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    points = list(zip(*(map(float, x) for x in cells(asked.law, asked.cells, asked.seed)), strict=True))
    with ProcessPoolExecutor(asked.workers, get_context("spawn")) as pool:
        found = list(pool.map(watched, points))
    print(f"{rattle.__version__}, law {asked.law}, seed {asked.seed}, {TIMES} times the watch")
    print("| δ | cells | called chaotic | of these settle | of all | undecided | impacts per sample | s per cell |")
    print("|---|---|---|---|---|---|---|---|")
    for high, low in zip(EDGES[asked.law], EDGES[asked.law][1:], strict=False):
        chosen = [cell for cell in found if low <= cell.delta < high]
        if chosen:
            print(line(f"{low:g} … {high:g}", chosen))
    print(line("all", found))
    for cell in sorted(found, key=lambda cell: -cell.wrong)[:12]:
        if cell.wrong or cell.undecided:
            print(cell)


if __name__ == "__main__":
    main()
