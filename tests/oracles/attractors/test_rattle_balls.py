"""Balls of capture grown in lanes beside the same grown one flight at a time, and what is done with samples of many
cells at once beside the same done cell by cell.
"""

import numpy as np
import pytest

import rattle
from rattle.attractors.ball import CaptureCentres, centres_of_new_regions, find_capture_radii_one_by_one
from rattle.attractors.chaos import SAME_FOOTPRINT, write_attractor_numbers
from rattle.attractors.rows import attractor_rows
from rattle.attractors.samples import GRID, Outcome, SampleSets
from rattle.attractors.speeds import highest_sampled_speeds
from rattle.impacting.attractors.balls import find_capture_radii_in_lanes
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.map.iterate import lane_block_of_thread
from rattle.numerics.sampling import initial_conditions
from rattle.parameters import Parameters

RNG = np.random.default_rng(45)  # of the planes
PLANES = {
    "Figure 7": (RNG.uniform(0.4, 1.0, 60), RNG.uniform(0.05, 1.3, 60), np.full(60, 0.6)),
    "a small gap": (RNG.uniform(0.3, 1.2, 40), RNG.uniform(0.3, 1.6, 40), np.full(40, 0.3)),
    "strong damping": (RNG.uniform(1.5, 4.0, 20), RNG.uniform(0.5, 1.5, 20), np.full(20, 0.6)),
    "weak damping": (np.full(4, 0.02), np.linspace(0.3, 1.5, 4), np.full(4, 0.02)),
}


def around_orbits(delta, share, beta):
    """Return the attractors of cells, ε in units of the quiet limit, and the centres of their first capture regions."""
    epsilon = share * rattle.quiet_limit(delta)
    speeds = highest_sampled_speeds(None, delta, epsilon, beta)
    states = initial_conditions(delta, epsilon, beta, 16, speeds, 1)
    found = ImpactingClassifier.classify(Parameters.from_values("impacting", delta, epsilon, beta), *states, 20_000)
    return found, centres_of_new_regions(np.zeros(delta.size, np.int64), found.orbits, found.cells)


@pytest.mark.parametrize("plane", PLANES)
def test_balls_grown_in_lanes_are_those_grown_one_flight_at_a_time(plane):
    found, centres = around_orbits(*PLANES[plane])
    assert centres.radius.size > 4
    alone = centres._replace(radius=centres.radius.copy())
    find_capture_radii_one_by_one(alone, found.cells)
    find_capture_radii_in_lanes(lane_block_of_thread(), centres, found.cells)
    assert len(np.unique(alone.radius)) > 2
    np.testing.assert_array_equal(centres.radius, alone.radius)


def test_a_radius_does_not_depend_on_the_other_balls():
    found, centres = around_orbits(*PLANES["Figure 7"])
    order = np.random.default_rng(1).permutation(centres.radius.size)
    mixed = CaptureCentres._make(x[order] for x in centres)
    find_capture_radii_in_lanes(lane_block_of_thread(), centres, found.cells)
    find_capture_radii_in_lanes(lane_block_of_thread(), mixed, found.cells)
    np.testing.assert_array_equal(mixed.radius, centres.radius[order])


def test_what_is_done_with_the_samples_of_many_cells_is_what_is_done_with_those_of_each():
    rng = np.random.default_rng(45)
    size = rng.integers(1, 20, 50)
    sets = SampleSets(rng.permutation(1000)[: size.sum()], size)
    values, holds = rng.integers(0, 100, 1000), rng.random(size.sum()) < 0.9
    each = np.split(sets.sample_numbers, np.cumsum(size)[:-1])
    evenly = [here[np.arange(min(12, here.size)) * here.size // min(12, here.size)] for here in each]
    np.testing.assert_array_equal(sets.select_evenly(12).sample_numbers, np.concatenate(evenly))
    np.testing.assert_array_equal(sets.select_evenly(12).size, [here.size for here in evenly])
    of_each = np.split(holds, np.cumsum(size)[:-1])
    np.testing.assert_array_equal(sets.cells_where_all(holds), [here.all() for here in of_each])
    np.testing.assert_array_equal(sets.largest_by_cell(values), [values[here].max() for here in each])
    np.testing.assert_array_equal(sets.smallest_by_cell(values), [values[here].min() for here in each])
    for here, other in zip(sets.split_by_cell(), each, strict=True):
        np.testing.assert_array_equal(here, other)


def test_footprints_are_grouped_within_their_cell():
    rng = np.random.default_rng(45)
    size = np.array([3, 1, 12, 2])
    boxes = (np.uint64(0b11) << rng.integers(0, 6, (18, GRID)).astype(np.uint64)) * (rng.random((18, GRID)) < 0.1)
    number = np.zeros(18, np.int64)
    write_attractor_numbers(boxes.copy(), size, number)
    for i, n in zip(np.cumsum(size) - size, size, strict=True):
        visited = [{(r, c) for r in range(GRID) for c in range(64) if int(row[r]) >> c & 1} for row in boxes[i : i + n]]
        groups = {k: {k} for k in range(n)}
        joined = True
        while joined:
            joined = False
            for k in sorted(groups):
                for j in [j for j in sorted(groups) if j < k]:
                    if k in groups and len(visited[k] & visited[j]) > SAME_FOOTPRINT * min(
                        map(len, (visited[k], visited[j]))
                    ):
                        visited[j] |= visited[k]
                        groups[j] |= groups.pop(k)
                        joined = True
        for first, members in groups.items():
            assert {int(x) for x in number[i + np.array(sorted(members))]} == {first}


@pytest.mark.parametrize("missed", [False, True])
def test_rows_are_what_sorting_all_samples_gives(missed):
    rng = np.random.default_rng(45)
    cells, count = 30, 16
    cell = np.repeat(np.arange(cells), count)
    kind = rng.choice([Outcome.QUIET, Outcome.PERIODIC, Outcome.CHAOTIC, Outcome.UNDECIDED], cells * count)
    which = np.where(np.isin(kind, [Outcome.PERIODIC, Outcome.CHAOTIC]), rng.integers(0, 3, kind.size), 0)
    impacts, time = rng.integers(1, 1000, kind.size), rng.random(kind.size)
    known = rng.integers(3, 6, cells) if missed else np.zeros(cells, np.int64)
    row = np.empty(kind.size, np.int64)
    rows = attractor_rows(kind, which, impacts, time, known, row)
    of = [(int(c), int(k), int(w)) for c, k, w in zip(cell, kind, which, strict=True)]
    expected = sorted({*of, *((c, Outcome.PERIODIC, j) for c in range(cells) for j in range(known[c]))})
    assert list(zip(rows.cell.tolist(), rows.kind.tolist(), rows.number_in_kind.tolist(), strict=True)) == expected
    np.testing.assert_array_equal(row, [expected.index(each) for each in of])
    for i, each in enumerate(expected):
        mine = np.array([k for k, other in enumerate(of) if other == each], np.int64)
        assert rows.sample_count[i] == mine.size
        assert rows.impacts[i] == impacts[mine].sum()
        assert rows.watched[i] == (time[mine].min() if mine.size else np.inf)
        assert rows.first_sample[i] == (mine[0] if mine.size else kind.size - 1)
