"""Populations tile by tile: the library's numbers, resumed to the same bytes, read back to the same answers."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError

import gear_rattle.workers.populations.tiles
import rattle
from gear_rattle.workers import (
    PopulationRequest,
    SurveyError,
    SurveyRequest,
    create_store,
    examine,
    finish_store,
    parse_request_document,
    run_tiles_in_this_process,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.answers import read_finished_population
from gear_rattle.workers.kinds import compute_tile, evaluate_cells_one_by_one
from gear_rattle.workers.populations.numbers import convert_to_request_field, to_library_form
from gear_rattle.workers.storage.integrity import read_manifest
from gear_rattle.workers.storage.location import place_of
from rattle.populations.gears import ComputedGears, compute_gears

FIELDS: dict[str, Any] = {
    "gear": {
        "delta": 0.6,
        "epsilon": {"distribution": "uniform", "low": 0.03, "high": 0.21},
        "beta": {"distribution": "normal", "mean": 0.6, "deviation": 0.02},
    },
    "correlation": [[1.0, 0.3], [0.3, 1.0]],
    "gears": 24,
    "count": 8,
    "share": 0.7,
    "judged": 6,
    "pairs": 6,
    "tile": 10,
}
MACHINE = {
    "gear": {
        "inertia": 0.003,
        "drag": 1.5e-3,
        "backlash": 300e-6,
        "eccentricity": {"distribution": "normal", "mean": 15e-6, "deviation": 5e-6, "low": 0.0},
        "radius": 0.05,
        "rpm": 3000.0,
    },
    "gears": 10,
    "count": 4,
}
REQUEST = PopulationRequest.model_validate(FIELDS)
TILES = tiles_of(REQUEST)


def never() -> bool:
    return False


def files(path: Path) -> dict[str, bytes]:
    """Every file of a store, without what says when it was made."""
    found = {
        str(each.relative_to(path)): each.read_bytes()
        for each in sorted(path.rglob("*"))
        if each.is_file() and each.name != "zarr.json"
    }
    known = json.loads(found["manifest.json"])["manifest"] | {"date_created": "", "root": []}
    return found | {"manifest.json": json.dumps(known).encode()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "population.zarr"
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, TILES, lambda _: None, never)
    finish_store(path)
    return path


def test_a_store_answers_what_the_library_does(whole: Path) -> None:
    given = {name: to_library_form(value) for name, value in REQUEST.gear.library_numbers.items()}
    exact = rattle.population(given, FIELDS["correlation"], gears=24, count=8, share=0.7, judged=6, pairs=6)
    found = read_finished_population(whole)
    for a, b in zip(found.rows, exact.rows, strict=True):
        assert np.array_equal(a, b, equal_nan=True)
    assert found.quiet == exact.quiet
    assert found.passing == exact.passing
    assert found.worst(3) == exact.worst(3)
    assert found.plan.rows == 24 + 6 * 5


def test_the_store_is_over_gears_and_says_what_it_holds(whole: Path) -> None:
    with xr.open_zarr(whole) as found:
        assert dict(found.sizes) == {"gear": 54, "sample": 8}
        assert found["epsilon"].dims == ("gear",)
        assert found["energy"].dims == ("gear", "sample")
        assert found.attrs["kind"] == "population"
        assert list(found["part"].values).count(0) == 24
        assert found["part"].attrs["flag_meanings"].split()[2:] == [
            *("sharing_epsilon", "sharing_beta", "sharing_all_but_epsilon", "sharing_all_but_beta")
        ]
        assert np.array_equal(found["quiet_fraction"], (found["energy"] == 0.0).mean("sample").astype("float32"))
        assert (found["status"] > 0).all()


@pytest.mark.parametrize("kept", [(0,), (1, 3)])
def test_a_population_that_is_resumed_has_the_same_bytes(whole: Path, kept: tuple[int, ...], tmp_path: Path) -> None:
    path = tmp_path / "population.zarr"
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, [TILES[i] for i in reversed(kept)], lambda _: None, never)
    with pytest.raises(SurveyError, match=r"lacks .* gears: wait until all gears are computed"):
        read_finished_population(path)
    create_store(REQUEST, path)
    done = tiles_done(REQUEST, path)
    assert done == set(kept)
    run_tiles_in_this_process(REQUEST, path, [each for each in TILES if each.index not in done], lambda _: None, never)
    finish_store(path)
    assert files(path) == files(whole)


def test_what_is_damaged_is_found_and_made_again(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "population.zarr"
    create_store(REQUEST, path)
    run_tiles_in_this_process(REQUEST, path, TILES, lambda _: None, never)
    chunk = path / "energy" / "c" / "2" / "0"
    chunk.write_bytes(chunk.read_bytes()[::-1])
    assert examine(path).damaged == {2: ("energy",)}
    run_tiles_in_this_process(REQUEST, path, [TILES[2]], lambda _: None, never)
    assert examine(path).is_whole
    assert files(path) == files(whole)


def test_a_lost_status_of_a_finished_population_is_damage(whole: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(whole, tmp_path / "population.zarr"))
    (path / "status" / "c" / "1").unlink()
    assert examine(path).damaged == {1: ("status",)}


def test_every_chunk_is_known_to_be_of_its_tile(whole: Path) -> None:
    manifest = read_manifest(place_of(whole))
    assert manifest is not None
    for key in files(whole):
        if "/c/" in key:
            assert manifest.tile_index_of(key) == int(key.split("/c/")[1].split("/")[0])
    for key in (
        "energy/c/9/0",
        "energy/c/0",
        "energy/c/00/0",
        "energy/c/0/1",
        "nothing/c/0",
        "zarr.json",
        "status/c/x",
    ):
        assert manifest.tile_index_of(key) is None


def test_a_gear_that_fails_is_the_only_one_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(plan: Any, start: int, stop: int) -> ComputedGears:
        if start <= 3 < stop:
            raise ArithmeticError("no luck")
        return compute_gears(plan, start, stop)

    exact, _ = compute_tile(REQUEST, TILES[0])
    monkeypatch.setattr(gear_rattle.workers.populations.tiles, "compute_gears", failing)
    arrays, record = compute_tile(REQUEST, TILES[0])
    assert record.failed_cells == ((0, 3, "ArithmeticError: no luck"),)
    assert np.flatnonzero(arrays["status"] == 3).tolist() == [3]
    others = np.arange(10) != 3
    for name, values in exact.items():
        assert np.array_equal(arrays[name][others], values[others], equal_nan=True)
    assert np.isnan(arrays["energy"][3]).all()
    assert len(list(evaluate_cells_one_by_one(REQUEST, TILES[0], 7))) == 3


def test_a_gear_that_failed_is_undecided_in_the_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    test = tmp_path / "population.zarr"
    create_store(REQUEST, test)
    monkeypatch.setattr(
        gear_rattle.workers.populations.tiles,
        "_evaluate_gears",
        _no_third(gear_rattle.workers.populations.tiles._evaluate_gears),
    )
    run_tiles_in_this_process(REQUEST, test, TILES, lambda _: None, never)
    found = read_finished_population(test)
    assert np.isnan(found.rows.energy[3]).all()
    assert np.array_equal(found.rows.values, REQUEST.plan.values(np.arange(REQUEST.n_cells)))
    assert found.quiet.high - found.quiet.low > 1 / 24


def _no_third(evaluate: Any) -> Any:
    def evaluated(request: Any, rows: slice) -> Any:
        if rows.start <= 3 < rows.stop:
            raise ArithmeticError("no luck")
        return evaluate(request, rows)

    return evaluated


def test_a_machine_has_powers_and_its_own_units(tmp_path: Path) -> None:
    request, path = PopulationRequest.model_validate(MACHINE), tmp_path / "population.zarr"
    assert request.plan.rows_per_sobol_part == 0  # one number varies
    create_store(request, path)
    run_tiles_in_this_process(request, path, tiles_of(request), lambda _: None, never)
    with xr.open_zarr(path) as found:
        assert found["eccentricity"].attrs["units"] == "m"
        assert found["power"].attrs["units"] == "W"
        machine = rattle.Machine(**{**request.gear.library_numbers, "eccentricity": float(found["eccentricity"][2])})
        assert float(found["epsilon"][2]) == machine.epsilon
        assert float(found["power"][2]) == pytest.approx(float(found["energy"][2].mean()) * machine.units.power)


def test_what_decides_no_number_changes_no_hash() -> None:
    def hashed(**changes: Any) -> str:
        return PopulationRequest.model_validate(FIELDS | changes).content_hash()

    assert hashed(name="another") == REQUEST.content_hash()
    assert len({hashed(**{name: 7}) for name in ("gears", "count", "seed", "judged", "tile", "pairs")}) == 6
    assert parse_request_document(REQUEST.model_dump(mode="json")) == REQUEST
    axis = {"start": 0.5, "stop": 0.7, "num": 6}
    assert isinstance(parse_request_document({"delta": axis, "epsilon": axis}), SurveyRequest)


@pytest.mark.parametrize(
    "kind",
    [
        rattle.Normal(1.0, 2.0, 0.0),
        rattle.Normal(20.0, 2.0, high=23.0),
        rattle.Uniform(1.0, 2.0),
        rattle.Triangular(1.0, 2.0, 3.0),
        rattle.LogNormal(1.0, 0.2),
        rattle.Measured((1.0, 2.0, 4.0)),
    ],
)
def test_distributions_survive_a_request(kind: Any) -> None:
    request = PopulationRequest.model_validate(
        FIELDS | {"gear": {"delta": convert_to_request_field(kind), "epsilon": 0.1}, "correlation": None}
    )
    assert request.gear.library_numbers == {"delta": kind, "epsilon": 0.1}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"gear": {"delta": 0.6, "epsilon": 0.1}}, "nothing varies: give a distribution"),
        ({"gear": FIELDS["gear"] | {"rpm": 3000.0}}, "both define the gear"),
        ({"correlation": [[1.0, 2.0], [2.0, 1.0]]}, "numbers from -1 to 1"),
        ({"correlation": [[1.0]]}, "a row and a column for each number that varies"),
        ({"gear": FIELDS["gear"] | {"beta": {"distribution": "normal", "mean": 0.6, "deviation": 0.2}}}, "above 0"),
        ({"gear": FIELDS["gear"] | {"beta": {"distribution": "normal", "mean": 0.6, "deviation": 0.0}}}, "deviation"),
        ({"gear": MACHINE["gear"] | {"radius": 50.0}, "correlation": None}, "radius must be in metres"),  # type: ignore[operator]
        ({"share": 0.9, "margin": 0.1}, "give either share or margin, not both"),
        ({"tile": 60_000, "gears": 70_000, "count": 100, "pairs": 0}, "use a smaller tile"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_what_to_do(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        PopulationRequest.model_validate(FIELDS | changes)


def test_a_survey_has_no_population_to_answer_of(tmp_path: Path) -> None:
    axis = {"start": 0.5, "stop": 0.7, "num": 2}
    request = SurveyRequest(delta=axis, epsilon=axis, quantities=["region"])
    create_store(request, tmp_path / "survey.zarr")
    with pytest.raises(SurveyError, match="holds no population that can be read"):
        read_finished_population(tmp_path / "survey.zarr")
