"""Distributions against scipy's, draws against their correlations, gears against machines, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import rattle
from rattle.populations.copula import Copula, check_correlation_matrix
from rattle.populations.distributions import LEAST, Distribution, parse_distribution
from rattle.populations.measured import read_gears
from rattle.populations.tolerances import Tolerances

SHARES = np.array([1e-9, 0.01, 0.2, 0.5, 0.77, 0.999])
DRAWING = {"inertia": 0.003, "drag": 5e-4, "backlash": 100e-6, "radius": 0.05, "rpm": 3000.0}
MATRIX = np.array([[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]])
ROWS = np.arange(40_000)
STATISTICAL = 5.0 / np.sqrt(ROWS.size)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (rattle.Normal(3.0, 0.5), stats.norm(3.0, 0.5)),
        (rattle.Normal(3.0, 2.0, low=0.0), stats.truncnorm(-1.5, np.inf, 3.0, 2.0)),
        (rattle.Normal(3.0, 2.0, 2.0, 3.5), stats.truncnorm(-0.5, 0.25, 3.0, 2.0)),
        (rattle.Uniform(2.0, 5.0), stats.uniform(2.0, 3.0)),
        (rattle.Triangular(1.0, 1.5, 4.0), stats.triang(0.5 / 3.0, 1.0, 3.0)),
        (rattle.Triangular(1.0, 4.0, 4.0), stats.triang(1.0, 1.0, 3.0)),
        (rattle.LogNormal(2.0, 0.3), stats.lognorm(0.3, scale=2.0)),
    ],
)
def test_quantiles_are_those_of_another_library(ours: Distribution, theirs: Any) -> None:
    assert np.allclose(ours.quantile(SHARES), theirs.ppf(SHARES), rtol=1e-9)
    assert np.allclose(ours.range, theirs.ppf([LEAST, 1.0 - LEAST]), rtol=1e-7)


def test_what_was_measured_is_as_frequent_as_it_was() -> None:
    found = rattle.Measured((3.0, 1.0, 2.0, 8.0))
    assert found.range == (1.0, 8.0)
    assert np.array_equal(found.quantile((np.arange(4) + 0.5) / 4), [1.0, 2.0, 3.0, 8.0])
    assert found.quantile(np.array([0.75])) == pytest.approx(5.5)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("normal:15e-6:5e-6", rattle.Normal(15e-6, 5e-6)),
        ("normal:15e-6:5e-6:0", rattle.Normal(15e-6, 5e-6, 0.0)),
        (" normal : 1 : 2 : 0 : 3", rattle.Normal(1.0, 2.0, 0.0, 3.0)),
        ("uniform:1:2", rattle.Uniform(1.0, 2.0)),
        ("triangular:1:2:4", rattle.Triangular(1.0, 2.0, 4.0)),
        ("lognormal:2:0.1", rattle.LogNormal(2.0, 0.1)),
    ],
)
def test_distributions_are_read_from_text(text: str, meant: Distribution) -> None:
    assert parse_distribution(text) == meant


def test_draws_have_the_correlations_that_were_asked_for() -> None:
    copula = Copula(check_correlation_matrix(MATRIX, ("a", "b", "c")))
    z = copula.draw_rows(7, 0, ROWS)
    assert np.abs(np.cov(z.T) - MATRIX).max() < STATISTICAL
    assert np.abs(z.mean(axis=0)).max() < STATISTICAL
    assert np.array_equal(copula.draw_rows(7, 0, ROWS[30:32]), z[30:32])
    assert not np.array_equal(copula.draw_rows(8, 0, ROWS), z)


@pytest.mark.parametrize("i", range(3))
def test_draws_that_share_numbers_are_as_frequent_as_all_others(i: int) -> None:
    copula = Copula(MATRIX)
    z, fresh = copula.draw_rows(7, 0, ROWS), copula.draw_rows(7, 1, ROWS)
    kept, changed = copula.redraw_other_columns(i, z, fresh), copula.redraw_column(i, z, fresh)
    others = [j for j in range(3) if j != i]
    assert np.array_equal(kept[:, i], z[:, i])
    assert np.array_equal(changed[:, others], z[:, others])
    for found in (kept, changed):
        assert np.abs(np.cov(found.T) - MATRIX).max() < STATISTICAL
    # What is drawn anew depends on the old draw through the shared numbers alone.
    explained = z[:, others] - np.outer(z[:, i], MATRIX[i, others])
    left = kept[:, others] - np.outer(z[:, i], MATRIX[i, others])
    assert np.abs(explained.T @ left / ROWS.size).max() < STATISTICAL
    weights = np.linalg.solve(MATRIX[np.ix_(others, others)], MATRIX[others, i])
    before, after = (x[:, i] - z[:, others] @ weights for x in (z, changed))
    assert abs(np.mean(before * after)) < STATISTICAL


@pytest.mark.parametrize("more", [{}, {"drive": "speed"}, {"stiffness": 3e8}, {"drive": "speed", "stiffness": 3e8}])
def test_gears_are_the_machines_of_their_numbers_to_the_bit(more: dict[str, Any]) -> None:
    given = DRAWING | {"eccentricity": rattle.Uniform(5e-6, 15e-6), "rpm": rattle.Normal(3000.0, 100.0)} | more
    tolerances = Tolerances(given)
    values = tolerances.values(tolerances.copula.draw_rows(1, 0, np.arange(20)))
    points = tolerances.points(values)
    for k, row in enumerate(values):
        machine = rattle.Machine(**{**given, **dict(zip(tolerances.names, row, strict=True))})
        at = points.parameters
        kappa = at.added["kappa"][k] if at.added else None
        assert (at.delta[k], at.epsilon[k], at.beta[k], kappa) == (
            machine.delta,
            machine.epsilon,
            machine.beta,
            machine.kappa,
        )
        assert points.take([k]).units is not None
        assert points.take([k]).units.power == machine.units.power


def test_gears_that_were_measured_vary_as_they_did(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    z = random.multivariate_normal([0.0, 0.0], [[1.0, 0.7], [0.7, 1.0]], 400)
    columns = 15e-6 * np.exp(0.2 * z[:, 0]), 100e-6 + 5e-6 * z[:, 1]
    table = tmp_path / "gears.csv"
    lines = [f"{k},{e!r},{j!r}" for k, (e, j) in enumerate(zip(*map(np.ndarray.tolist, columns), strict=True))]
    table.write_text("\n".join(["gear, Eccentricity, backlash", *lines, ""]))
    measured, correlation = read_gears(table)
    assert list(measured) == ["backlash", "eccentricity"]
    assert measured["eccentricity"].values == tuple(sorted(columns[0]))
    assert correlation[0, 1] == pytest.approx(np.corrcoef(z.T)[0, 1], abs=0.02)
    tolerances = Tolerances({**DRAWING, **measured}, correlation)
    values = tolerances.values(tolerances.copula.draw_rows(0, 0, ROWS[:4000]))
    ranks = stats.spearmanr(values).statistic
    assert ranks == pytest.approx(stats.spearmanr(np.transpose(columns)).statistic, abs=0.06)


NORMAL = rattle.Normal(15e-6, 5e-6)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (DRAWING | {"eccentricity": NORMAL}, r"eccentricity .* reaches down to -1.67e-05: cut it off \(low=0\)"),
        (DRAWING | {"eccentricity": "uniform:-1e-6:1e-5"}, "must not be below 0, .* let it begin at 0"),
        (DRAWING | {"eccentricity": rattle.Normal(0.015, 1e-3)}, "eccentricity must be in metres.*mm give"),
        (DRAWING | {"eccentricity": 15e-6, "radius": rattle.Normal(50.0, 1.0)}, "radius must be in metres"),
        (DRAWING | {"eccentricity": 15e-6}, "nothing varies: give a distribution"),
        (
            DRAWING | {"eccentricity": NORMAL, "delta": 0.1},
            "delta .dimensionless. and .* both define the gear: give only one",
        ),
        (DRAWING | {"excentricity": NORMAL}, "a gear has no excentricity: it has"),
        ({"delta": 0.1, "beta": "uniform:0.1:0.2"}, "epsilon must be given too"),
        (
            DRAWING | {"eccentricity": "normal:1e-6"},
            "numbers after normal: give mean, deviation, and low and high if",
        ),
        (DRAWING | {"eccentricity": "gamma:1:2"}, "is no distribution: write a number, or normal:MEAN"),
        (DRAWING | {"eccentricity": "uniform:a:b"}, "write numbers, separated by colons"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_to_do(given: dict[str, Any], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        Tolerances(given)


@pytest.mark.parametrize(
    ("kind", "numbers", "says"),
    [
        (rattle.Normal, (15e-6, 0.0), "for a number that does not vary give the number itself, 1.5e-05"),
        (rattle.Uniform, (2.0, 2.0), "has no spread: for a number that does not vary give the number itself, 2"),
        (rattle.Triangular, (2.0, 2.0, 2.0), "has no spread"),
        (rattle.Measured, ((2.0, 2.0, 2.0),), "has no spread"),
        (rattle.LogNormal, (2.0, 0.0), "deviation must be greater than 0"),
        (rattle.Normal, (0.0, 1.0, 8.0), "has almost no probability"),
        (rattle.Triangular, (1.0, 5.0, 2.0), "the mode must be from low to high"),
        (rattle.Uniform, (3.0, 2.0), "low must be below high"),
    ],
)
def test_a_distribution_without_spread_or_order_is_refused(kind: Any, numbers: tuple[Any, ...], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        kind(*numbers)


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        ([[1.0, 0.2]], "a row and a column for each number that varies, rows and columns in this order: a, b"),
        ([[1.0, 0.2], [0.3, 1.0]], "must be symmetric"),
        ([[2.0, 0.2], [0.2, 1.0]], "1 on its diagonal.*divide each by both deviations"),
        ([[1.0, 1.2], [1.2, 1.0]], "numbers from -1 to 1"),
        ([[1.0, 1.0], [1.0, 1.0]], "these correlations are impossible"),
    ],
)
def test_a_matrix_that_is_no_correlation_is_refused(matrix: list[list[float]], says: str) -> None:
    with pytest.raises(rattle.ParameterError, match=says):
        check_correlation_matrix(matrix, ("a", "b"))


def test_the_factor_that_is_named_makes_a_matrix_possible() -> None:
    matrix = np.array([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
    with pytest.raises(rattle.ParameterError, match=r"multiply the entries off the diagonal by (0\.\d+)") as refused:
        check_correlation_matrix(matrix, ("a", "b", "c"))
    factor = float(str(refused.value).split("diagonal by ")[1].split(",")[0])
    check_correlation_matrix(np.where(np.eye(3) > 0, 1.0, factor * matrix), ("a", "b", "c"))
