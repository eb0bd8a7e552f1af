"""Orbits of period one that exist in two planes, from many starts and continuation between cells; no circuits in it.

    python tests/references/stable_planes.py

computes tests/reference/stable_planes.json anew, in a quarter of an hour. Every cell of 64 × 64 has its own random
states, some after a few impacts; Newton's method on the return map from each gives orbits, stable or not, and these are
continued into the four neighbours, and from there on, until nothing new is found. The file holds how many stable ones
each plane has by label, how many of them no start of their own cell found, and all those of one cell in ten.
"""

import json
import math
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.impacting.map.impact_map import ImpactingPoint
from rattle.impacting.orbits.limits import quiet_limit
from rattle.numerics.compile import kernel
from rattle.orbits.return_map import (
    apply_return_map_power,
    fastest_departure,
    find_fixed_point,
    least_return_period,
    step,
)

FILE = Path(__file__).parents[1] / "reference" / "stable_planes.json"
SIDE, STARTS = 64, 1024
AFTER = np.array([0, 3, 10, 40])  # impacts
SAME = 1e-6
MOST_BOUNCES = 128
MOST_UNSTABLE = 30.0  # |trace| of orbits that are continued
EVERY = 10  # cell, whose orbits are kept

PLANES = {
    "paper": (0.6, np.linspace(0.4, 1.0, SIDE + 1), np.linspace(0.005, 0.3, SIDE + 1)),
    "small": (0.01, np.linspace(0.002, 0.05, SIDE + 1), np.linspace(0.0, 1.6 * float(quiet_limit(0.026)), SIDE + 1)),
}


def cells_of(name):
    """δ, ε, β (SIDE², each) of a plane, δ slowest."""
    beta, delta, epsilon = PLANES[name]
    delta, epsilon = (0.5 * (x[1:] + x[:-1]) for x in (delta, epsilon))
    return np.repeat(delta, SIDE), np.tile(epsilon, SIDE), np.full(SIDE * SIDE, beta)


@kernel
def solved(tau, v, k, point):
    """The orbit of k impacts on Σ⁺ in one period near a state: (found, Σ⁻ impacts, τ, v of the fastest, trace)."""
    found, tau, v = find_fixed_point(tau, v, k, point)
    if not found:
        return False, 0, tau, v, 0.0
    status, _t, _v, time, n_minus, a00, _b, _c, a11, _ln = apply_return_map_power(tau, v, k, point)
    if status != OK or abs(time - 1.0) > SAME or least_return_period(tau, v, k, point) != k:
        return False, 0, tau, v, 0.0
    tau, v = fastest_departure(tau, v, k, point)
    return True, n_minus, tau, v, a00 + a11


@kernel
def met(n_plus, n_minus, tau, v, orbits, n):
    """Return whether these rows have the orbit."""
    for i in range(n):
        label = orbits[i, 0] == n_plus and orbits[i, 1] == n_minus
        if label and abs(wrap_phase_difference(orbits[i, 2] - tau)) < SAME and abs(orbits[i, 3] - v) < SAME * v:
            return True
    return False


@kernel
def from_starts(tau, v, after, point, orbits):
    """Fill rows (n₊, n₋, τ, v, trace) with the orbits that Newton's method finds from these states and later ones."""
    found = 0
    for i in range(tau.size):
        t, w, done = tau[i], v[i], 0
        for impacts in after:
            status = OK
            while done < impacts and status == OK and w > 1e-7:
                status, t, w, _s, _below = step(t, w, point)
                done += 1
            if status != OK or not w > 1e-7:
                break
            time, k, closest, t1, w1 = 0.0, 0, 0.3, t, w
            for j in range(1, 3 * MOST_BOUNCES):
                status, t1, w1, s, _below = step(t1, w1, point)
                time += s
                if status != OK or time > 1.3:
                    break
                if abs(time - 1.0) < closest:
                    closest, k = abs(time - 1.0), j
            if k == 0 or k > MOST_BOUNCES:
                continue
            ok, n_minus, star_tau, star_v, trace = solved(t, w, k, point)
            if ok and found < orbits.shape[0] and not met(k, n_minus, star_tau, star_v, orbits, found):
                orbits[found, 0], orbits[found, 1], orbits[found, 2], orbits[found, 3] = k, n_minus, star_tau, star_v
                orbits[found, 4] = trace
                found += 1
    return found


@kernel
def continued(n_plus, n_minus, tau, v, start, end, steps):
    """The orbit carried from one parameter point to another: as `solved`."""
    ok, below, trace = False, 0, 0.0
    for i in range(1, steps + 1):
        x = i / steps
        point = ImpactingPoint(
            start.delta + x * (end.delta - start.delta),
            start.epsilon + x * (end.epsilon - start.epsilon),
            start.beta + x * (end.beta - start.beta),
            0.0,
        )
        ok, below, tau, v, trace = solved(tau, v, n_plus, point)
        if not ok or below != n_minus:
            return False, 0, tau, v, 0.0
    return ok, below, tau, v, trace


def natural_speed(point):
    """About the largest speed that the motion reaches by itself."""
    return 1.1 * (math.sqrt(16 * math.pi * point.delta * point.beta) + 2 * math.pi * point.epsilon)


def sampled(cell, point):
    """Orbits (rows of n₊, n₋, τ, v, trace) found from the cell's own starts, a quarter of them twice as fast."""
    rng = np.random.default_rng(cell)
    v = natural_speed(point) * rng.random(STARTS) * np.where(np.arange(STARTS) % 4, 1.0, 2.0)
    orbits = np.zeros((4096, 5))
    n = from_starts(rng.random(STARTS), np.maximum(v, 1e-6 * natural_speed(point)), AFTER, point, orbits)
    return orbits[:n]


def existing(name):
    """For each cell of a plane the orbits that exist, with a mark if its own starts found them."""
    points = [ImpactingPoint(*map(float, x), 0.0) for x in zip(*cells_of(name), strict=True)]
    with ThreadPoolExecutor() as pool:
        known = [[(*row, True) for row in rows] for rows in pool.map(sampled, range(len(points)), points)]
    front = [(cell, row) for cell, rows in enumerate(known) for row in rows]
    while front:
        following = []
        for cell, (n_plus, n_minus, tau, v, trace, _) in front:
            if abs(trace) > MOST_UNSTABLE:
                continue
            i, j = divmod(cell, SIDE)
            for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if not (0 <= a < SIDE and 0 <= b < SIDE):
                    continue
                other = a * SIDE + b
                for steps in (1, 4):
                    ok, *row = continued(int(n_plus), int(n_minus), tau, v, points[cell], points[other], steps)
                    if ok:
                        row = (n_plus, *row)
                        rows = np.array([r[:5] for r in known[other]]).reshape(-1, 5)
                        if not met(int(n_plus), int(row[1]), row[2], row[3], rows, len(rows)):
                            known[other].append((*row, False))
                            following.append((other, known[other][-1]))
                        break
        print(name, len(following), "new", flush=True)
        front = following
    return known, points


def summary(name):
    """Return the statistics of a plane in the file."""
    known, points = existing(name)
    stable = [[r for r in rows if abs(r[4]) < 1 + math.exp(-p.delta)] for rows, p in zip(known, points, strict=True)]
    counts = Counter((int(r[0]), int(r[1])) for rows in stable for r in rows)
    missed = Counter((int(r[0]), int(r[1])) for rows in stable for r in rows if not r[5])
    kept = {
        str(cell): [[int(r[0]), int(r[1]), round(float(r[2]), 7), float(f"{r[3]:.7g}")] for r in sorted(stable[cell])]
        for cell in np.sort(np.random.default_rng(0).permutation(SIDE * SIDE)[::EVERY]).tolist()
    }
    return {"stable": {f"{a},{b}": [n, missed[a, b]] for (a, b), n in sorted(counts.items())}, "cells": kept}, stable


if __name__ == "__main__":
    from rattle.impacting.orbits.impact_times import MOST_ORBITS
    from rattle.impacting.orbits.stable import find_stable_orbits

    answers = {}
    for name in PLANES:
        answers[name], stable = summary(name)
        delta, epsilon, beta = cells_of(name)
        found = find_stable_orbits(delta, epsilon, beta, MOST_ORBITS)
        missing, more = Counter(), Counter()
        for cell, rows in enumerate(stable):
            n = found.n[cell]
            mine = np.stack([x[cell, :n] for x in found[1:]], axis=1).astype(float)
            theirs = np.array([r[:5] for r in rows]).reshape(-1, 5)
            missing.update((int(r[0]), int(r[1])) for r in rows if not met(int(r[0]), int(r[1]), r[2], r[3], mine, n))
            more.update(
                (int(r[0]), int(r[1])) for r in mine if not met(int(r[0]), int(r[1]), r[2], r[3], theirs, len(rows))
            )
        print(
            name,
            sum(map(len, stable)),
            "exist, missing",
            dict(missing),
            "more",
            sum(more.values()),
            dict(sorted(more.items())),
        )
    rows = ",\n".join(
        f'"{name}": {{"stable": {json.dumps(x["stable"])}, "cells": {{\n'
        + ",\n".join(f'"{cell}": {json.dumps(orbits)}' for cell, orbits in x["cells"].items())
        + "\n}}"
        for name, x in answers.items()
    )
    FILE.write_text("{\n" + rows + "\n}\n")
