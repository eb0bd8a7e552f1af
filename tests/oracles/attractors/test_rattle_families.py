"""Families of attractors: against closed forms, the equations of impact times, branches, and more samples."""

import numpy as np
import pytest
from scipy.ndimage import label as components

import rattle
from rattle import stiff
from rattle.attractors.samples import Outcome
from rattle.families.pieces import GridPiece
from rattle.families.sums import NO_FAMILY, QUIET_FAMILY
from rattle.models import Impacting

DELTA, EPSILON = np.linspace(0.405, 0.6, 27), np.linspace(0.05, 0.16, 23)
COUNT = 16


@pytest.fixture(scope="module")
def found():
    return rattle.families_of(DELTA, EPSILON, count=COUNT)


@pytest.fixture(scope="module")
def grid(found):
    """δ and ε of every row."""
    row, column = np.divmod(found.attractors.cell, DELTA.size)
    return DELTA[column], EPSILON[row]


def label(table, i):
    return int(table.m[i]), int(table.n_plus[i]), int(table.n_minus[i])


def partition(found):
    """Families as sets of what belongs to them, in the order of their numbers; orbits to the bit."""
    rows = found.attractors
    i, j = np.divmod(rows.cell, found.delta.size)
    columns = found.delta[j], found.epsilon[i], rows.kind, rows.m, rows.n_plus, rows.n_minus, rows.tau, rows.v
    members = {}
    for number, *row in zip(found.family, *columns, strict=True):
        members.setdefault(int(number), set()).add(tuple(row))
    return members


@pytest.mark.parametrize(("orbit", "name"), [(2, (1, 1, 0)), (3, (1, 1, 1))])
def test_families_of_c_and_d_are_the_connected_parts_of_where_these_are_stable(found, orbit, name):
    """The closed form knows where; there is one such orbit in a cell."""
    stable = rattle.period_one(DELTA, EPSILON[:, None]).stable[orbit]
    parts, number = components(stable)
    family = np.full(stable.size, NO_FAMILY)
    rows = [i for i in np.flatnonzero(found.attractors.kind == Outcome.PERIODIC) if label(found.attractors, i) == name]
    family[found.attractors.cell[rows]] = found.family[rows]
    assert np.array_equal(family.reshape(stable.shape) != NO_FAMILY, stable)
    assert len({*zip(parts.ravel(), family, strict=True)}) == number + (not stable.all())
    assert number > 0


def test_entered_orbits_solve_the_equations_of_their_cell(found, grid):
    """Each happens and attracts, and its multipliers are those that are listed."""
    rows = found.attractors
    entered = np.flatnonzero(found.entered)
    assert not rows.samples[entered].any()
    assert entered.size > 10
    for i in entered[:: max(1, entered.size // 20)]:
        orbit = rattle.periodic_orbit(grid[0][i], grid[1][i], rows.tau[i], rows.v[i], int(rows.n_plus[i]))
        assert (orbit.m, orbit.n_plus, orbit.n_minus) == label(rows, i)
        assert orbit.admissible
        assert orbit.stable
        assert np.log(abs(np.array(orbit.multipliers)).max()) / orbit.m == pytest.approx(rows.first[i], abs=1e-7)


def test_no_row_is_lost_and_none_is_twice(found):
    rows = rattle.attractors_of(DELTA, EPSILON[:, None], count=COUNT)
    for name in ("cell", "kind", "m", "samples", "tau", "v"):
        assert np.array_equal(getattr(found.attractors, name)[~found.entered], getattr(rows, name))
    told = found.attractors.kind
    assert np.array_equal(found.family == QUIET_FAMILY, told == Outcome.QUIET)
    assert np.array_equal(found.family == NO_FAMILY, told == Outcome.UNDECIDED)


def test_the_way_through_the_grid_decides_nothing(found):
    """Read from its other end, the grid has the same families, with the same bits; only ties may be numbered anew."""
    other = partition(rattle.families_of(DELTA[::-1], EPSILON[::-1], count=COUNT))
    mine = partition(found)
    assert {frozenset(x) for x in mine.values()} == {frozenset(x) for x in other.values()}
    assert [len(mine[i]) for i in range(1, 20)] == [len(other[i]) for i in range(1, 20)]


def test_a_piece_learns_the_same_orbits_in_any_parts(found):
    """Row by row of cells it ends with what the whole join has, each orbit once, with the samples of its cell."""
    rows = found.attractors.take((found.attractors.kind == Outcome.PERIODIC) & ~found.entered)
    piece = GridPiece((EPSILON.size, DELTA.size), Impacting().cells(DELTA, EPSILON))
    order = np.random.default_rng(2).permutation(EPSILON.size)
    for part in np.array_split(order, 6):
        here = np.isin(rows.cell // DELTA.size, part)
        piece.add_attractors(rows.take(here))
    orbits, n = piece.orbits, piece.n
    expected = found.attractors.kind == Outcome.PERIODIC
    columns = [getattr(found.attractors, name)[expected] for name in ("cell", "m", "n_plus", "n_minus")]
    known = np.where(found.entered, -1, found.attractors.samples)[expected]
    both = [
        sorted(zip(*(x[:many].tolist() for x in of), strict=True))
        for many, of in ((n, (*orbits[:4], piece.samples)), (known.size, (*columns, known)))
    ]
    assert both[0] == both[1]
    assert np.sort(orbits.tau[:n]) == pytest.approx(np.sort(found.attractors.tau[expected]), abs=1e-6)


def test_the_table_tells_what_its_rows_say(found, grid):
    table, rows = found.table, found.attractors
    assert np.all(np.diff(table.cells[1:]) <= 0)
    for number in (0, 1, 2, table.cells.size // 2, table.cells.size - 1):
        of = found.family == number
        share = rows.samples[of] / COUNT
        assert set(rows.kind[of]) == {table.kind[number]}
        assert {label(rows, i) for i in np.flatnonzero(of)} == {label(table, number)}
        assert table.cells[number] == np.unique(rows.cell[of]).size
        assert table.unsampled[number] == (share == 0).sum()
        assert table.largest_fraction[number] == share.max()
        assert table.mean_fraction[number] == pytest.approx(share.sum() / table.cells[number])
        assert (table.delta_low[number], table.delta_high[number]) == (grid[0][of].min(), grid[0][of].max())
        assert (table.epsilon_low[number], table.epsilon_high[number]) == (grid[1][of].min(), grid[1][of].max())
        best = of & (grid[0] == table.delta_at[number]) & (grid[1] == table.epsilon_at[number])
        assert (rows.samples[best] / COUNT).max() == share.max()
        here = found.fractions(number)
        assert np.isfinite(here).sum() == table.cells[number]
        assert np.nansum(here) == pytest.approx(share.sum())
    parts = [found.fractions(number) for number in range(table.cells.size)]
    undecided = np.bincount(rows.cell[found.family == NO_FAMILY], minlength=DELTA.size * EPSILON.size)
    assert np.nansum(parts, axis=0).ravel()[undecided == 0] == pytest.approx(1.0)


def test_two_orbits_of_one_family_in_a_cell_are_told(found):
    pairs = np.stack([found.family, found.attractors.cell])[:, found.family > 0]
    several, number = np.unique(pairs, axis=1, return_counts=True)
    assert {*several[0][number > 1]} == {*np.flatnonzero(found.table.monodromy)}


def test_a_branch_stays_in_its_family(found, grid):
    """Pseudo-arclength follows a stable motion past centres of cells, and these have it in one family."""
    rows = found.attractors
    periodic = np.flatnonzero((rows.kind == Outcome.PERIODIC) & (rows.samples > 0))
    passed = 0
    for i in periodic[:: periodic.size // 6]:
        start = rattle.periodic_orbit(grid[0][i], grid[1][i], rows.tau[i], rows.v[i], int(rows.n_plus[i]))
        branch = rattle.branch(start, "epsilon", (EPSILON[0], EPSILON[-1]), 100)
        good = branch.stable & branch.admissible
        first, last = branch.start, branch.start
        while first > 0 and good[first - 1]:
            first -= 1
        while last < good.size - 1 and good[last + 1]:
            last += 1
        epsilon = branch.epsilon[first : last + 1]
        if not np.all(np.diff(epsilon) * np.sign(epsilon[-1] - epsilon[0]) > 0):
            continue
        inside = np.flatnonzero((epsilon.min() < EPSILON) & (epsilon.max() > EPSILON))
        column = rows.cell[i] % DELTA.size
        for j in inside:
            nearest = first + np.argmin(abs(epsilon - EPSILON[j]))
            orbit = rattle.periodic_orbit(
                grid[0][i], EPSILON[j], branch.tau[nearest], branch.v[nearest], int(rows.n_plus[i])
            )
            fastest = np.array(orbit.speeds)[np.array(orbit.walls) > 0].max()
            here = np.flatnonzero((rows.cell == j * DELTA.size + column) & (found.family == found.family[i]))
            assert abs(rows.v[here] - fastest).min(initial=np.inf) < 1e-6
            passed += 1
    assert passed > 20


def test_joining_finds_what_more_samples_find():
    """Joining finds half of the stable orbits that few samples miss, and nothing that does not exist.

    Five samples miss one in eight of the stable orbits of longer periods that 256 samples find.
    """
    delta, epsilon = np.linspace(0.405, 0.425, 12), np.linspace(0.1, 0.115, 12)
    few, many = (rattle.families_of(delta, epsilon, count=count).attractors for count in (5, 256))

    def orbits(rows, sampled):
        keep = np.flatnonzero((rows.kind == Outcome.PERIODIC) & (rows.m > 1) & (rows.samples >= sampled))
        return {(int(rows.cell[i]), *label(rows, i), round(float(rows.v[i]), 6)) for i in keep}

    exist = orbits(many, 3)
    sampled, joined = (len(orbits(few, least) & exist) / len(exist) for least in (1, 0))
    assert 1.0 - joined < 0.6 * (1.0 - sampled)
    assert orbits(few, 0) <= orbits(many, 0)


def test_chaos_ends_at_the_boundary_crisis():
    """At δ = 0.6 the chaotic attractor is one family up to ε = 0.11088676, and none of its cells is beyond.

    At 0.111 what is left of it lives so long that one cell in eleven is called chaotic, by chance of the last bits.
    """
    crisis, epsilon = 0.11088676, np.linspace(0.1085, 0.1135, 21)
    epsilon = epsilon[(epsilon < crisis) | (epsilon > crisis + 0.0003)]
    found = rattle.families_of([0.6, 0.6001], epsilon, count=64)
    chaotic = np.flatnonzero(found.table.kind == Outcome.CHAOTIC)
    assert (found.table.cells[chaotic] > 0).all()
    assert found.table.epsilon_high[chaotic].max() == epsilon[epsilon < crisis].max()


def test_the_stiff_gear_has_families():
    """Far from grazes and at a stiffness as large as this, those of its limit."""
    delta, epsilon = np.linspace(0.5, 0.52, 3), np.linspace(0.07, 0.08, 3)
    soft = stiff.families_of(delta, epsilon, 0.6, 1e5, count=16)
    hard = rattle.families_of(delta, epsilon, 0.6, count=16)
    for table in (soft.table, hard.table):
        whole = table.cells == 9
        assert {label(table, i) for i in np.flatnonzero(whole)} == {(0, 0, 0), (1, 1, 0)}


@pytest.mark.parametrize(
    ("delta", "epsilon", "message"),
    [
        ([[0.5]], [0.1], "delta must be a list of numbers, the values of an axis"),
        ([0.5], 0.1, "epsilon must be a list of numbers, the values of an axis"),
        ([0.5, 0.7, 0.6], [0.1], "the values of delta must rise or fall"),
        ([0.5], [0.1, 0.1], "the values of epsilon must rise or fall"),
        ([-0.5], [0.1], "delta must be greater than 0"),
    ],
)
def test_what_is_no_grid_is_refused(delta, epsilon, message):
    with pytest.raises(rattle.ParameterError, match=message):
        rattle.families_of(delta, epsilon)


def test_one_motion_has_one_number_where_a_step_between_cells_fails():
    """D in region III: Newton's method does not lead from one of these cells to the next, 64 steps in between do."""
    delta, epsilon = np.array([0.6553191489361703, 0.6680851063829788]), np.array([0.07957446808510638])
    found = rattle.families_of(delta, epsilon, count=COUNT)
    rows = [
        i for i in np.flatnonzero(found.attractors.kind == Outcome.PERIODIC) if label(found.attractors, i) == (1, 1, 1)
    ]
    one, other = rows
    between = rattle.period_one(np.linspace(*delta, 65), epsilon[0])
    assert between.stable[3].all()
    assert np.abs(np.diff(between.tau[3])).max() < 0.005
    assert found.attractors.cell[one] != found.attractors.cell[other]
    assert found.family[one] == found.family[other]
