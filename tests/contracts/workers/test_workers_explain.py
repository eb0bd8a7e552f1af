"""Explanations of the boundaries of a survey: of all boundaries of regions, on any plane, and reasons for the rest."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from depth import deep, either
from typer.testing import CliRunner
from written import compute_and_write_tile

import rattle
from gear_rattle.service.cli import app
from gear_rattle.workers import (
    Axis,
    SurveyError,
    SurveyRequest,
    create_store,
    join_attractors_of_survey,
    open_survey,
    tiles_of,
)
from gear_rattle.workers.boundaries.explain import MOST_CURVES, BoundaryExplanation, explain
from gear_rattle.workers.boundaries.labels import PERIODIC
from gear_rattle.workers.boundaries.pairs import CellGrid, are_pairs_crossed
from rattle import curves

pytestmark = pytest.mark.usefixtures("templates_once")

COLUMNS, ROWS = either((8, 9), (11, 13))


def regions_only(beta: float, delta: tuple[float, float], epsilon: tuple[float, float], num: int = 31) -> xr.Dataset:
    axes = {"delta": np.linspace(*delta, num), "epsilon": np.linspace(*epsilon, num + 1)}
    region = rattle.regions(axes["delta"], axes["epsilon"][:, None], beta)
    cells = ("epsilon", "delta")
    status = np.ones(region.shape, np.int8)
    return xr.Dataset({"region": (cells, region), "status": (cells, status)}, coords=axes, attrs={"beta": beta})


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("explain") / "survey.zarr"
    request = SurveyRequest(
        delta=Axis(start=0.55, stop=0.8, num=COLUMNS),
        epsilon=Axis(start=0.055, stop=0.135, num=ROWS),
        initial_conditions={"count": 24},
    )
    create_store(request, path)
    for tile in tiles_of(request):
        compute_and_write_tile(request, str(path), tile)
    return path


@pytest.mark.parametrize(
    ("beta", "delta", "epsilon"),
    [
        pytest.param(0.6, (0.4, 1.0), (0.005, 0.3), marks=deep),  # so does the next test, of all but a wrong cell
        pytest.param(0.6, (0.2, 1.5), (0.001, 0.4), marks=deep),
        pytest.param(0.6, (0.755, 0.775), (0.094, 0.099), marks=deep),
        pytest.param(0.2, (0.05, 0.6), (0.0, 0.3), marks=deep),
        (0.35, (0.2, 1.5), (0.001, 0.4)),
        (1.2, (0.2, 1.7), (0.001, 0.6)),
    ],
)
def test_every_boundary_of_regions_is_explained(
    beta: float, delta: tuple[float, float], epsilon: tuple[float, float]
) -> None:
    """Other planes than Figure 7's hold region 0 too, where A or C returns early or more orbits P(1,1,1) are born."""
    found = explain(regions_only(beta, delta, epsilon))
    assert found.pairs.region.sum() > 50
    assert found.region_explained[found.pairs.region].all()
    assert not found.unexplained_groups


def test_a_boundary_that_no_curve_makes_is_left_over() -> None:
    """The check can fail: a cell with a wrong region has four neighbours that nothing passes between."""
    dataset = regions_only(0.6, (0.4, 1.0), (0.005, 0.3))
    i, j = 3, 25  # in region I, far from every curve
    assert (dataset["region"][i - 1 : i + 2, j - 1 : j + 2] == 1).all()
    dataset["region"][i, j] = 4
    found = explain(dataset)
    assert found.pairs.region.sum() - found.region_explained.sum() == 4
    assert {rest.change for rest in found.unexplained_groups} == {"region I | IV", "region IV | I"}
    assert sum(rest.n_pairs for rest in found.unexplained_groups) == 4


def test_crossings_are_those_of_a_closed_form() -> None:
    grid = CellGrid(regions_only(0.6, (0.4, 1.0), (0.005, 0.3)))
    pairs = grid.differing_pairs()
    found = are_pairs_crossed(curves.trace("SN1", 0.6, (0.4, 1.0), (0.005, 0.3)), grid, pairs)
    ends = [np.array([grid.point(cell) for cell in side]) for side in (pairs.first, pairs.second)]
    above = [epsilon > rattle.sn1(delta) for delta, epsilon in (side.T for side in ends)]
    before_cod22 = np.minimum(ends[0][:, 0], ends[1][:, 0]) < 0.76
    assert (found[before_cod22] == (above[0] != above[1])[before_cod22]).all()
    assert found.any()


@pytest.fixture(scope="module")
def explained(store: Path) -> BoundaryExplanation:
    with open_survey(store) as dataset:
        return explain(dataset, either(10, MOST_CURVES))


def test_what_changes_between_attractors(explained: BoundaryExplanation) -> None:
    found = explained
    assert found.region_explained[found.pairs.region].all()
    differ, explained = found.pairs.attractors, found.attractors_explained
    assert differ.sum() > 0.2 * COLUMNS * ROWS
    assert explained.sum() / differ.sum() > 0.5
    assert found.crossed[explained].all()
    left = (differ & ~explained).sum()
    assert sum(rest.n_pairs for rest in found.unexplained_groups) == left
    for rest in found.unexplained_groups:
        assert rest.why
        (d0, e0), (d1, e1) = rest.example
        assert (d0 == d1) != (e0 == e1)
    others = {item.curve.name for item in found.explaining_curves} - set(curves.NAMES)
    assert any(item.n_explained_pairs for item in found.explaining_curves if item.curve.name in others)


@pytest.fixture(scope="module")
def joined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a survey with so few samples that motions of small basins are missed in some cells."""
    path = tmp_path_factory.mktemp("explain") / "joined.zarr"
    request = SurveyRequest(
        delta=Axis(start=0.5, stop=0.66, num=COLUMNS),
        epsilon=Axis(start=0.062, stop=0.1, num=ROWS),
        quantities=("region", "attractors", "lyapunov", "families"),
        initial_conditions={"count": 6},
    )
    create_store(request, path)
    for tile in tiles_of(request):
        compute_and_write_tile(request, str(path), tile)
    join_attractors_of_survey(request, path)
    return path


@pytest.fixture(scope="module")
def sampled(joined: Path) -> BoundaryExplanation:
    with open_survey(joined) as dataset, open_survey(joined, "families") as families:
        return explain(dataset, 0, families)


def test_what_samples_missed_is_told_by_families(joined: Path, sampled: BoundaryExplanation) -> None:
    """In each such pair the motion that one cell lacks exists there and is stable, if followed from the other cell."""
    with open_survey(joined) as dataset:
        found, grid = sampled, CellGrid(dataset)
        assert found.differ_by_samples_only.sum() > 3
        n = np.flatnonzero(found.differ_by_samples_only)[0]
        ends = zip(found.pairs.first[n], found.pairs.second[n], strict=True)
        i, j = (slice(max(min(two) - 1, 0), max(two) + 2) for two in ends)
        without = explain(dataset.isel(epsilon=i, delta=j), 0)  # the cells about one such pair
    assert without.pairs.attractors.any()
    assert not without.differ_by_samples_only.any()
    assert not (found.differ_by_samples_only & found.attractors_explained).any()
    left = found.pairs.attractors & ~found.attractors_explained & ~found.differ_by_samples_only
    assert sum(rest.n_pairs for rest in found.unexplained_groups) == left.sum()
    followed = 0
    for n in np.flatnonzero(found.differ_by_samples_only):
        ends = [grid.attractors(cell) for cell in (found.pairs.first[n], found.pairs.second[n])]
        points = [grid.point(cell) for cell in (found.pairs.first[n], found.pairs.second[n])]
        for here, there in ((0, 1), (1, 0)):
            for each in ends[here]:
                if each.label[0] == PERIODIC and each.label not in [other.label for other in ends[there]]:
                    orbit = rattle.periodic_orbit(*points[here], each.tau, each.v, each.label[2])
                    beyond = rattle.continue_to(orbit, *points[there])
                    assert isinstance(beyond, rattle.PeriodicOrbit)
                    assert beyond.stable
                    followed += 1
    assert followed > 3


def printing(monkeypatch: pytest.MonkeyPatch, found: BoundaryExplanation, most_curves: int, families: bool) -> None:
    """Let the command ask for this explanation, which is there."""

    def known(_: xr.Dataset, curves: int, group: xr.Dataset | None) -> BoundaryExplanation:
        assert (curves, group is not None) == (most_curves, families)
        return found

    monkeypatch.setattr("gear_rattle.workers.boundaries.explain.explain", known)


def test_the_command_tells_what_samples_missed(
    joined: Path, sampled: BoundaryExplanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    printing(monkeypatch, sampled, 0, families=True)
    result = CliRunner().invoke(app, ["explain", str(joined), "--curves", "0"])
    assert result.exit_code == 0, result.output
    assert "whose attractors differ by the sample alone" in result.output
    assert "whose attractors differ otherwise, explained" in result.output


def test_the_command_prints_shares_and_the_rest(
    store: Path, explained: BoundaryExplanation, monkeypatch: pytest.MonkeyPatch
) -> None:
    printing(monkeypatch, explained, 3, families=False)
    result = CliRunner().invoke(app, ["explain", str(store), "--curves", "3", "--rows", "4"])
    assert result.exit_code == 0, result.output
    assert "whose regions differ, explained" in result.output
    assert "(100.0 %)" in result.output
    assert "why no curve" in result.output


def test_the_command_fails_where_a_region_has_no_boundary(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with open_survey(store) as dataset:
        wrong = dataset.isel(delta=slice(-4, None), epsilon=slice(4)).load()
    wrong["region"][0, -1] = 5
    monkeypatch.setattr("gear_rattle.workers.open_survey", lambda *_: wrong)
    assert CliRunner().invoke(app, ["explain", str(store), "--curves", "0"]).exit_code == 1


def test_nothing_to_explain_is_said() -> None:
    empty = regions_only(0.6, (0.4, 1.0), (0.005, 0.3)).drop_vars("region")
    with pytest.raises(SurveyError, match="no regions and no attractors"):
        explain(empty)
