"""Labels and fractions against a long watch of every sample on its own, at 500 random cells.

The reference was computed by the library's earlier classifier (scalar map, another search for first impacts, no balls
of capture, no witnesses) with the same initial conditions: 300 cells of the plane of Figure 7, 200 of δ ∈ [0.2, 1.5],
ε ∈ [0, 0.4], β ∈ [0.2, 1.2].
"""

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import rattle

COUNT = 64
CELLS = json.loads((Path(__file__).parents[2] / "reference" / "long_watch.json").read_text())["cells"]


@pytest.fixture(scope="module")
def pairs():
    """(reference, found) of each cell, samples by label."""
    delta, epsilon, beta = (np.array([cell[name] for cell in CELLS]) for name in ("delta", "epsilon", "beta"))
    table = rattle.attractors_of(delta, epsilon, beta, COUNT)
    compared = []
    for i, cell in enumerate(CELLS):
        reference, found = Counter(), Counter()
        for kind, m, n_plus, n_minus, samples, *_ in cell["attractors"]:
            reference[kind, m, n_plus, n_minus] += samples
        for row in np.flatnonzero(table.cell == i):
            label = (int(table.m[row]), int(table.n_plus[row]), int(table.n_minus[row]))
            found[(rattle.KINDS[table.kind[row]], *label)] += int(table.samples[row])
        compared.append((reference, found))
    return compared, table


def differs(reference, found):
    """Return whether a label's fraction differs by more than rounding in a chaotic transient can change.

    Undecided samples may have any label.
    """
    open_ends = found["undecided", 0, 0, 0] + reference["undecided", 0, 0, 0]
    for label in set(reference) | set(found):
        mean = (reference[label] + found[label]) / 2
        spread = np.sqrt(2 * mean * (1 - mean / COUNT)) if mean < COUNT else 0.0
        if label[0] != "undecided" and abs(reference[label] - found[label]) > 3 * spread + open_ends:
            return True
    return False


def test_at_most_one_cell_in_a_hundred_differs_from_a_long_watch(pairs):
    compared, _ = pairs
    assert len(compared) == 500
    assert sum(differs(*pair) for pair in compared) <= 5


def test_most_cells_have_the_very_same_samples_in_every_basin(pairs):
    """Only samples on a chaotic transient depend on rounding."""
    compared, _ = pairs
    assert np.mean([reference == found for reference, found in compared]) > 0.9


def test_undecided_is_rare(pairs):
    compared, _ = pairs
    assert sum(found["undecided", 0, 0, 0] for _, found in compared) < 0.005 * COUNT * len(compared)


def test_exponents_of_chaos_agree_within_their_error_bars(pairs):
    _, table = pairs
    deviations = []
    for i, cell in enumerate(CELLS):
        rows = np.flatnonzero((table.cell == i) & (table.kind == rattle.KINDS.index("chaotic")))
        reference = [(x[5], x[6]) for x in cell["attractors"] if x[0] == "chaotic"]
        if len(rows) == len(reference) == 1 and table.samples[rows[0]] == COUNT:
            value, error = reference[0]
            deviations.append((table.first[rows[0]] - value) / np.hypot(error, table.error[rows[0]]))
    assert len(deviations) > 60
    assert np.mean(np.abs(deviations) < 1) > 0.85  # 95 % if the errors were normal and the measurements independent
    assert np.abs(np.median(deviations)) < 0.3  # no bias
