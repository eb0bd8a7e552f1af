"""Answers of populations, against outputs whose shares, quantiles and indices are known in closed form."""

import numpy as np
import pytest

import rattle
from rattle.populations.answers import Population, mean_of_shares, quantile_estimate
from rattle.populations.gears import FAILS, NOT_ASKED, PASSES, UNKNOWN, ComputedGears
from rattle.populations.plan import PopulationPlan
from rattle.populations.tolerances import Tolerances

GIVEN = {"delta": rattle.Normal(3.0, 0.2), "epsilon": rattle.Normal(3.0, 0.2), "beta": rattle.Normal(3.0, 0.2)}
WEIGHTS = np.array([0.12, 0.08, -0.05])  # of the normal numbers, in a share of quiet runs about ½
MATRIX = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.3], [0.0, 0.3, 1.0]])


def imitated(matrix: np.ndarray | None, count: int = 4, pairs: int = 20_000) -> Population:
    """A population whose gears run quietly with a probability that is linear in their numbers."""
    plan = PopulationPlan(Tolerances(GIVEN, matrix), gears=pairs, count=count, pairs=pairs)
    rows = np.arange(plan.rows)
    values = plan.values(rows)
    chance = 0.5 + (values - 3.0) / 0.2 @ WEIGHTS
    quiet = np.random.default_rng(5).random((rows.size, count)) < np.clip(chance, 0.0, 1.0)[:, None]
    energy = np.sort(np.where(quiet, 0.0, 1.0), axis=1)
    none = np.zeros(rows.size)
    return Population(plan, ComputedGears(plan.parts(rows), values, none, none, none, energy, none.astype(np.int64)))


@pytest.mark.parametrize("matrix", [np.eye(3), MATRIX])
def test_indices_of_a_linear_output_are_those_in_closed_form(matrix: np.ndarray) -> None:
    found = imitated(matrix).indices()
    whole = WEIGHTS @ matrix @ WEIGHTS
    alone = (matrix @ WEIGHTS) ** 2 / whole
    rest = WEIGHTS**2 / np.diag(np.linalg.inv(matrix)) / whole
    for name, first, total in zip(GIVEN, alone, rest, strict=True):
        for index, exact in ((found[name].first, first), (found[name].total, total)):
            assert index.low - 0.01 <= exact <= index.high + 0.01
            assert index.high - index.low < 0.2


def test_indices_of_the_energy_are_those_of_the_quiet_share_where_it_is_one_less_that() -> None:
    population = imitated(MATRIX, pairs=2000)
    quiet, energy = population.indices(), population.indices("energy")
    for name in GIVEN:
        assert energy[name].first == pytest.approx(quiet[name].first)


def test_the_share_of_quiet_runs_is_within_its_interval() -> None:
    found = imitated(MATRIX).quiet
    assert found.low < 0.5 < found.high
    assert found.high - found.low < 0.012


def test_intervals_of_shares_hold_the_truth_as_often_as_they_say() -> None:
    random, held = np.random.default_rng(1), []
    for _ in range(400):
        chance = random.beta(0.8, 0.2, 200)
        found = mean_of_shares(random.binomial(4, chance) / 4)
        held.append(found.low <= 0.8 <= found.high)
    assert 0.92 <= np.mean(held) <= 0.98


def test_gears_that_are_all_alike_leave_room_for_others() -> None:
    assert mean_of_shares(np.ones(100)) == pytest.approx((1.0, float(rattle.wilson_interval(100, 100)[0]), 1.0))
    assert mean_of_shares(np.zeros(100)).low == 0.0
    assert mean_of_shares(np.zeros(100)).high > 0.03


def test_intervals_of_quantiles_hold_the_truth_as_often_as_they_say() -> None:
    random, held = np.random.default_rng(2), []
    for _ in range(400):
        scale = random.exponential(size=(300, 1))  # a gear's samples resemble each other
        found = quantile_estimate(np.sort(scale * random.exponential(size=(300, 4)), axis=1), 0.75)
        held.append(found.low <= 1.1419168 <= found.high)
    assert 0.92 <= np.mean(held) <= 0.98


def test_the_quantile_of_that_distribution_is_the_one_that_is_used_above() -> None:
    """P(XY ≤ x) = 1 − 2√x K₁(2√x) of two exponential numbers."""
    from scipy.special import k1

    root = 2.0 * np.sqrt(1.1419168)
    assert 1.0 - root * k1(root) == pytest.approx(0.75, abs=2e-4)


def test_rows_of_which_nothing_is_known_do_not_count() -> None:
    values = np.arange(400.0).reshape(100, 4)
    with_unknown = np.concatenate([values, np.full((50, 4), np.nan)])
    assert quantile_estimate(with_unknown, 0.5) == quantile_estimate(values, 0.5)


def test_an_end_that_no_gear_reaches_is_infinite() -> None:
    found = quantile_estimate(np.arange(20.0)[:, None], 0.99)
    assert found.value == 19.0
    assert found.high == np.inf


def test_what_is_unknown_widens_the_yield() -> None:
    population = imitated(None, pairs=100)
    assert population.passing is None
    verdict = np.full(population.plan.rows, NOT_ASKED)
    verdict[:50] = PASSES
    sure = Population(population.plan, population.rows._replace(verdict=verdict))
    verdict = verdict.copy()
    verdict[:20], verdict[20:30] = UNKNOWN, FAILS
    unsure = Population(population.plan, population.rows._replace(verdict=verdict))
    assert sure.passing == pytest.approx((1.0, float(rattle.wilson_interval(50, 50)[0]), 1.0))
    assert unsure.passing == pytest.approx(
        (0.6, float(rattle.wilson_interval(20, 50)[0]), float(rattle.wilson_interval(40, 50)[1]))
    )


def test_undecided_samples_widen_the_share_and_count_in_no_mean() -> None:
    population = imitated(None, pairs=1000)
    energy = population.rows.energy.copy()
    energy[:, -1] = np.nan
    unsure = Population(population.plan, population.rows._replace(energy=energy))
    assert unsure.undecided == 0.25
    assert unsure.quiet.high - unsure.quiet.low > 0.2
    assert unsure.quiet.value <= population.quiet.value
    worst = unsure.worst(3)
    assert [each.energy for each in worst] == [1.0] * 3
    assert all(each.numbers.keys() == GIVEN.keys() for each in worst)


def test_nothing_is_said_of_gears_that_do_not_differ() -> None:
    population = imitated(None, pairs=200)
    same = Population(population.plan, population.rows._replace(energy=np.zeros_like(population.rows.energy)))
    with pytest.raises(rattle.RattleError, match="differ by no more than their sampling errors"):
        same.indices()
    with pytest.raises(rattle.ParameterError, match="of must be one of quiet, energy"):
        same.indices("noise")
    lone = Population(PopulationPlan(Tolerances(GIVEN), gears=10, pairs=0), population.rows)
    with pytest.raises(rattle.RattleError, match="give `pairs` above 0"):
        lone.indices()
