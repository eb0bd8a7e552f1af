"""Surveys that are refined: computed cells are those of the plain survey, filled ones true, and audits say how true."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from depth import deep
from pydantic import ValidationError
from written import write_tile

import rattle
from gear_rattle.workers import (
    SurveyRequest,
    compute_tile,
    create_store,
    finish_store,
    join_attractors_of_survey,
    open_survey,
    run_survey,
    tiles_of,
)
from gear_rattle.workers.storage.location import place_of
from gear_rattle.workers.survey import tiles as computing
from gear_rattle.workers.survey.refined.asked import BLOCK
from gear_rattle.workers.survey.refined.audit import AUDITED, DISAGREED, random_numbers_of_cells, share_upper_bound
from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import flag_leaves_with_differing_cells
from gear_rattle.workers.survey.refined.shares import _divide_fractions
from rattle.attractors.samples import Outcome

pytestmark = pytest.mark.usefixtures("templates_once")

#: Quiet, periodic and chaotic cells, on both sides of SN1 and of the quiet limit; blocks are cut at two ends.
AXES: dict[str, Any] = {"delta": (0.55, 0.75, 70), "epsilon": (0.02, 0.12, 45)}
SAMPLED: dict[str, Any] = {
    "quantities": ("region", "orbits", "attractors", "lyapunov", "grazing"),
    "initial_conditions": {"count": 4},
}
REFINED = SurveyRequest(**AXES, **SAMPLED, refine=True)


def tile_arrays(request: SurveyRequest) -> dict[str, np.ndarray]:
    """All variables of the grid of a request, put together from its tiles."""
    found: dict[str, np.ndarray] = {}
    for tile in tiles_of(request):
        for name, values in compute_tile(request, tile)[0].items():
            whole = found.setdefault(name, np.zeros((*values.shape[:-2], *request.shape), values.dtype))
            whole[tile.selection] = values
    return found


def changed(request: SurveyRequest, **fields: Any) -> SurveyRequest:
    return SurveyRequest.model_validate(request.model_dump() | fields)


@pytest.fixture(scope="module")
def refined() -> dict[str, np.ndarray]:
    return tile_arrays(REFINED)


@pytest.fixture(scope="module")
def plain() -> dict[str, np.ndarray]:
    return tile_arrays(changed(REFINED, refine=None))


def test_computed_cells_are_those_of_the_plain_survey(
    refined: dict[str, np.ndarray], plain: dict[str, np.ndarray]
) -> None:
    computed = refined["source_level"] == 0
    assert 0.2 < computed.mean() < 0.8
    for name, values in plain.items():
        assert refined[name][..., computed].tobytes() == values[..., computed].tobytes(), name


OTHER = [pytest.param(each, marks=deep) for each in ({"delta": 32, "epsilon": 32}, {"delta": 64})]


@pytest.mark.parametrize("tile", [{"delta": 70, "epsilon": 32}, *OTHER])
def test_tiles_do_not_show(refined: dict[str, np.ndarray], tile: dict[str, int]) -> None:
    for name, values in tile_arrays(changed(REFINED, tile=tile)).items():
        assert values.tobytes() == refined[name].tobytes(), name


def test_regions_are_filled_as_they_are() -> None:
    """The closed forms are the oracle: nothing of the plane of Figure 7 is lost on the way."""
    request = SurveyRequest(delta=(0.4, 1.0, 300), epsilon=(0.005, 0.3, 200), quantities=("region",), refine=True)
    found = tile_arrays(request)
    expected = rattle.regions(request.delta.values(), request.epsilon.values()[:, None])
    assert (found["source_level"] == 0).mean() < 0.3
    assert set(np.unique(expected)) == {1, 2, 3, 4, 5}
    assert (found["region"] == expected).all()
    assert not (found["audit"] == DISAGREED).any()


def test_filled_orbits_solve_the_equations_of_their_cell(refined: dict[str, np.ndarray]) -> None:
    delta, epsilon = REFINED.delta.values(), REFINED.epsilon.values()
    filled = np.argwhere((refined["attractor_kind"] == Outcome.PERIODIC) & (refined["source_level"] > 0))
    assert len(filled) > 100
    for slot, i, j in filled[:: len(filled) // 60]:
        tau, v = refined["attractor_phase"][slot, i, j], refined["attractor_velocity"][slot, i, j]
        label = tuple(int(refined[f"attractor_{name}"][slot, i, j]) for name in ("m", "n_plus", "n_minus"))
        orbit = rattle.Gear(float(delta[j]), float(epsilon[i])).orbit(tau, v, label[1])
        assert (orbit.m, orbit.walls.count(1), orbit.walls.count(-1)) == label
        assert orbit.admissible
        assert (orbit.times[0], orbit.speeds[0]) == pytest.approx((tau, v), abs=1e-9)
        exponents = np.log(np.abs(orbit.multipliers)) / label[0]
        assert refined["attractor_lyapunov"][slot, :, i, j] == pytest.approx(np.sort(exponents)[::-1], abs=1e-7)


def test_what_is_not_known_of_filled_cells_is_not_told(refined: dict[str, np.ndarray]) -> None:
    filled = refined["source_level"] > 0
    chaotic = (refined["attractor_kind"] == Outcome.CHAOTIC) & filled
    assert chaotic.any()
    assert np.isnan(np.moveaxis(refined["attractor_lyapunov"], 1, 0)[:, chaotic]).all()
    for name in ("lyapunov_max", "sum_rule_error", "impulse_balance_error"):
        assert np.isnan(refined[name][chaotic.any(axis=0)]).all(), name
    settled = filled & ~chaotic.any(axis=0) & (refined["attractor_kind"] == Outcome.PERIODIC).any(axis=0)
    assert (refined["sum_rule_error"][settled] < 1e-8).all()


def test_shares_of_filled_cells_add_up_and_are_wider(
    refined: dict[str, np.ndarray], plain: dict[str, np.ndarray]
) -> None:
    """Against 256 samples of every seventh cell."""
    filled = refined["source_level"] > 0
    listed = np.nansum(refined["attractor_fraction"], axis=0) + refined["unlisted_fraction"]
    assert listed[filled] == pytest.approx(1.0, abs=1e-6)
    i, j = (x[::7] for x in np.nonzero(filled))
    delta, epsilon = REFINED.delta.values()[j], REFINED.epsilon.values()[i]
    truth = rattle.attractors_of(delta, epsilon, count=256, seed=9)
    quiet = np.bincount(truth.cell, truth.samples * (truth.kind == Outcome.QUIET), i.size) / 256
    error = np.abs(refined["quiet_fraction"][i, j] - quiet)
    assert (error <= refined["fraction_error"][i, j] + 0.06).mean() > 0.95
    # One sample of 4 tells the share less well than the samples around do.
    assert np.sqrt((error**2).mean()) < np.sqrt(((plain["quiet_fraction"][i, j] - quiet) ** 2).mean())
    assert (refined["fraction_error"][filled] >= 0.0).all()


def test_an_audit_of_all_cells_finds_each_that_would_be_wrong(plain: dict[str, np.ndarray]) -> None:
    """Then all are computed; what disagreed is what the edges had not told."""
    found = tile_arrays(changed(REFINED, refine={"audit": 1.0}))
    assert not found["source_level"].any()
    for name, values in plain.items():
        assert found[name].tobytes() == values.tobytes(), name
    assert (found["audit"] > 0).mean() > 0.2


def test_audits_are_a_share_of_the_cells_wherever_they_are_looked_at() -> None:
    whole = Blocks(slice(0, 600), slice(0, 500), (600, 500))
    some = Blocks(slice(64, 128), slice(32, 96), (600, 500))
    found = random_numbers_of_cells(whole, 5).reshape(whole.shape)
    assert (random_numbers_of_cells(some, 5).reshape(some.shape) == found[64:129, 32:97]).all()
    for share in (0.03, 0.5):
        assert (found < share).mean() == pytest.approx(share, abs=4 * np.sqrt(share / found.size))
    assert (found != random_numbers_of_cells(whole, 6).reshape(whole.shape)).any()


def test_the_bound_of_an_audit_is_exact() -> None:
    assert share_upper_bound(0, 30_000) == pytest.approx(1 - 0.05 ** (1 / 30_000), rel=1e-9)
    assert share_upper_bound(3, 3) == share_upper_bound(0, 0) == 1.0
    p = share_upper_bound(2, 50)  # of which so few or fewer are found once in twenty
    assert (1 - p) ** 50 + 50 * p * (1 - p) ** 49 + 1225 * p**2 * (1 - p) ** 48 == pytest.approx(0.05, rel=1e-6)


def test_chance_does_not_look_like_a_border() -> None:
    """Cells that all have something, of which samples miss some; and cells of which half have it."""
    rng = np.random.default_rng(4)
    known = np.ones((400, 12, 12), bool)
    for share in (0.01, 0.03, 0.05, 0.1, 0.5):
        seen = rng.binomial(64, share, known.shape)
        assert flag_leaves_with_differing_cells(seen, known, 64).mean() < 0.2, share
        seen[:, :, :6] = 0
        assert share < 0.05 or flag_leaves_with_differing_cells(seen, known, 64).mean() > 0.9, share
    assert not flag_leaves_with_differing_cells(np.zeros(known.shape, int), known, 64).any()
    assert not flag_leaves_with_differing_cells(np.full(known.shape, 64), known, 64).any()


def test_a_share_is_divided_among_orbits_of_one_label() -> None:
    """Parts are by weight, equal if all weights are 0; unsampled orbits get none unless there are no others."""
    of = np.array([0, 0, 1, 1, 2, 2, 3])
    weight = np.array([3.0, 1.0, 0.0, 0.0, 2.0, -1.0, -1.0])
    assert _divide_fractions(of, weight).tolist() == [0.75, 0.25, 0.5, 0.5, 1.0, -1.0, 1.0]


def test_blocks_have_the_corners_of_the_plane() -> None:
    blocks = Blocks(slice(32, 96), slice(64, 70), (96, 70))
    assert blocks.frame == (slice(32, 96), slice(64, 70))
    assert [x.tolist() for x in blocks.last_indices] == [[32, 31], [5, 5]]
    edges = blocks.edge_cells(blocks.undivided_leaves())
    rows, columns = np.divmod(edges, blocks.shape[1])
    assert ((rows % BLOCK == 0) | (rows == 63) | (columns == 0) | (columns == 5)).all()
    assert edges.size == 3 * 6 + 61 * 2
    quarters = blocks.divide_leaves(blocks.undivided_leaves())
    assert set(zip(*(x.tolist() for x in quarters[:3]), strict=True)) == {(0, 0, 0), (0, 16, 0), (1, 0, 0), (1, 16, 0)}


def test_the_store_tells_what_was_filled_and_audited(tmp_path: Path, refined: dict[str, np.ndarray]) -> None:
    with run_survey(REFINED, out=tmp_path / "survey.zarr") as survey:
        for name, values in refined.items():
            if values.dtype.kind != "c" and name in survey:
                assert survey[name].values.tobytes() == values.tobytes(), name
        told = survey.attrs
    assert told["refined_cells_filled"] == int((refined["source_level"] > 0).sum())
    assert told["refined_cells_audited"] == int((refined["audit"] >= AUDITED).sum()) > 0
    wrong = int((refined["audit"] == DISAGREED).sum())
    assert told["refined_cells_disagreed"] == wrong
    assert told["refined_wrong_share_upper"] == share_upper_bound(wrong, told["refined_cells_audited"])
    with run_survey(REFINED, out=tmp_path / "survey.zarr") as again:  # it is complete, and says the same
        assert again.attrs == told


def test_a_run_that_stopped_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    request = changed(REFINED, quantities=("region",), tile={"delta": 32, "epsilon": 32})
    for name, first in (("whole", 0), ("stopped", 4)):
        create_store(request, tmp_path / name)
        for tile in tiles_of(request)[first:]:
            write_tile(request, str(tmp_path / name), tile, compute_tile(request, tile)[0])
    with run_survey(request, out=tmp_path / "stopped") as one:
        finish_store(tmp_path / "whole")
        with open_survey(tmp_path / "whole") as other:
            xr.testing.assert_identical(one.drop_attrs(), other.drop_attrs())


@deep
def test_families_are_joined_over_filled_cells(tmp_path: Path) -> None:
    """C's family is where the closed form has it stable, filled or not, and has one slot."""
    request = changed(REFINED, quantities=(*REFINED.quantities, "families"), tile={"delta": 32, "epsilon": 32})
    create_store(request, tmp_path / "survey.zarr")
    for tile in tiles_of(request):
        write_tile(request, str(tmp_path / "survey.zarr"), tile, compute_tile(request, tile)[0])
    place = place_of(tmp_path / "survey.zarr")
    with place.lock_for_writing():
        join_attractors_of_survey(request, place)
    with open_survey(place) as survey, open_survey(place, "families") as table:
        kind, family = survey.attractor_kind.values, survey.attractor_family.values
        assert ((family >= 0) == np.isin(kind, (Outcome.QUIET, Outcome.PERIODIC, Outcome.CHAOTIC))).all()
        assert (family[kind == Outcome.QUIET] == 0).all()
        for orbit, label in (("C", (1, 1, 0)), ("D", (1, 1, 1))):
            same = [survey[f"attractor_{name}"] == n for name, n in zip(("m", "n_plus", "n_minus"), label, strict=True)]
            listed = np.logical_and.reduce([kind == Outcome.PERIODIC, *(each.values for each in same)]).any(axis=0)
            stable = survey.orbit_stable.sel(orbit=orbit).values
            assert listed[stable].all()
            assert (stable & (survey.source_level.values > 0)).any()
        assert int(table.cells[0]) >= (kind == Outcome.QUIET).any(axis=0).sum()


@deep
def test_slices_and_machines_are_refined_as_planes(tmp_path: Path) -> None:
    fields: dict[str, Any] = {
        "quantities": ("region", "attractors"),
        "initial_conditions": {"count": 1},
        "refine": True,
    }
    axes: dict[str, Any] = {"delta": (0.5, 0.8, 36), "epsilon": (0.02, 0.1, 10)}
    whole = SurveyRequest(**axes, **fields, beta=(0.5, 0.6, 2))
    run_survey(whole, out=tmp_path / "third").close()
    with open_survey(tmp_path / "third") as third:
        plane = run_survey(**axes, **fields, beta=0.6)
        for name, values in plane.items():
            assert third[name].isel(beta=1).values.tobytes() == values.values.tobytes(), name
        assert third.attrs["refined_cells_filled"] > 0


def test_a_cell_that_fails_leaves_its_tile_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise rattle.RattleError("no flight")

    monkeypatch.setattr(computing, "refine_cells", fails)
    request = changed(REFINED, quantities=("region",), delta=(0.55, 0.75, 6), epsilon=(0.02, 0.12, 5))
    arrays, record = compute_tile(request, tiles_of(request)[0])
    assert record.filled_cells == 0
    assert (arrays["status"] == 1).all()
    assert not arrays["source_level"].any()


def test_the_stiff_gear_is_refined_by_regions_and_attractors() -> None:
    request = SurveyRequest(
        model="stiff", kappa=1e3, delta=(0.6, 0.602, 4), epsilon=(0.02, 0.0202, 4),
        quantities=("attractors",), initial_conditions={"count": 1}, refine=True,
    )  # fmt: skip
    arrays, record = compute_tile(request, tiles_of(request)[0])
    assert record.filled_cells == 4
    assert arrays["n_attractors"].min() >= 1


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"quantities": ("region", "basins")}, "basins cannot be filled from other cells"),
        ({"quantities": ("attractors", "intensity")}, "intensity cannot be filled from other cells"),
        ({"quantities": ("orbits",)}, "refine compares regions or attractors"),
        ({"model": "stiff", "kappa": 1e3}, "available only for the impacting model"),
        ({"tile": {"delta": 48}}, "use a multiple of 32"),
        ({"refine": {"audit": 0}}, "greater than 0"),
        ({"refine": 3}, "refine"),
    ],
)
def test_what_cannot_be_refined_is_refused(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        SurveyRequest(**{**AXES, "refine": True, **fields})


def test_a_refined_survey_is_another_one() -> None:
    assert REFINED.content_hash() != changed(REFINED, refine=None).content_hash()
    assert changed(REFINED, refine=False) == changed(REFINED, refine=None)
    assert changed(REFINED, refine={"audit": 0.02}).content_hash() == REFINED.content_hash()
