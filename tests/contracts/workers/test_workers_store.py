"""The store: created whole or not at all, never over anything else, written in whole chunks."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from written import compute_and_write_tile, write_tile

import gear_rattle.workers.storage.store
from gear_rattle.workers import (
    Axis,
    StorageError,
    SurveyError,
    SurveyRequest,
    Tile,
    create_store,
    finish_store,
    open_survey,
    tiles_done,
)
from gear_rattle.workers.cluster.runner import run_tiles
from gear_rattle.workers.storage.location import place_of
from gear_rattle.workers.storage.manifest import set_store_attributes
from gear_rattle.workers.storage.store import add_to_store, read_variable_in_bands
from gear_rattle.workers.survey.tiles import compute_tile, tiles_of

# No attractors: these tests are about files.
REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.9, num=5),
    epsilon=Axis(start=0.05, stop=0.2, num=7),
    quantities=("region", "orbits", "grazing"),
    tile={"delta": 2, "epsilon": 4},
)
TILES = tiles_of(REQUEST)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("template") / "survey.zarr"
    create_store(REQUEST, path)
    return path


@pytest.fixture
def store(template: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(template, tmp_path / "survey.zarr"))


def snapshot(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def fill(store: Path, tiles: list[Tile]) -> None:
    for tile in tiles:
        compute_and_write_tile(REQUEST, str(store), tile)


def test_created_whole_and_alone(template: Path) -> None:
    assert [path.name for path in template.parent.iterdir()] == ["survey.zarr"]
    assert tiles_done(REQUEST, template) == set()


def test_created_in_new_and_in_empty_directories(tmp_path: Path) -> None:
    create_store(REQUEST, tmp_path / "new" / "deep" / "survey.zarr")
    (tmp_path / "empty").mkdir()
    create_store(REQUEST, tmp_path / "empty")
    assert tiles_done(REQUEST, tmp_path / "empty") == set()


def test_the_same_survey_is_resumed_untouched(store: Path) -> None:
    fill(store, TILES[:2])
    before = snapshot(store)
    create_store(REQUEST.model_copy(update={"name": "renamed"}), store)
    assert snapshot(store) == before
    assert tiles_done(REQUEST, store) == {0, 1}


def test_another_survey_is_refused_untouched(store: Path) -> None:
    before = snapshot(store)
    with pytest.raises(SurveyError, match="another survey or population: choose another path"):
        create_store(REQUEST.model_copy(update={"beta": 0.5}), store)
    assert snapshot(store) == before


def test_another_version_is_refused_untouched(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = snapshot(store)
    for module in ("survey.request", "storage.store"):
        monkeypatch.setattr(f"gear_rattle.workers.{module}.code_version", lambda: "9.9")
    with pytest.raises(SurveyError, match=r"computed by version .* this is version 9\.9"):
        create_store(REQUEST, store)
    assert snapshot(store) == before


@pytest.mark.parametrize("content", [{"notes.txt": "mine"}, {"zarr.json": "{}"}, {"zarr.json": "not json"}])
def test_a_foreign_directory_is_refused_untouched(tmp_path: Path, content: dict[str, str]) -> None:
    for name, text in content.items():
        (tmp_path / name).write_text(text)
    before = snapshot(tmp_path)
    with pytest.raises(SurveyError, match="not a survey or population: choose another path"):
        create_store(REQUEST, tmp_path)
    with pytest.raises(SurveyError):
        tiles_done(REQUEST, tmp_path)
    with pytest.raises(SurveyError):
        finish_store(tmp_path)
    assert snapshot(tmp_path) == before


def test_a_foreign_zarr_group_is_refused_untouched(tmp_path: Path) -> None:
    xr.Dataset({"mine": ("x", [1.0])}).to_zarr(tmp_path / "other.zarr", zarr_format=3, consolidated=False)
    before = snapshot(tmp_path)
    with pytest.raises(SurveyError, match="not a survey"):
        create_store(REQUEST, tmp_path / "other.zarr")
    with pytest.raises(SurveyError):
        open_survey(tmp_path / "other.zarr")
    assert snapshot(tmp_path) == before


def test_a_file_is_refused_untouched(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("mine")
    for target in (path, path / "below"):
        with pytest.raises(SurveyError, match="choose"):
            create_store(REQUEST, target)
    assert path.read_text() == "mine"


def test_a_creation_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_space(*_: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.rename", no_space)
    with pytest.raises(SurveyError, match="No space left"):
        create_store(REQUEST, tmp_path / "survey.zarr")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("winner", [REQUEST, REQUEST.model_copy(update={"seed": 1})], ids=["same", "other"])
def test_of_two_creators_the_first_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, winner: SurveyRequest) -> None:
    path, template_of = tmp_path / "survey.zarr", gear_rattle.workers.storage.store.template_of

    def overtaken(request: SurveyRequest, created: str | None) -> dict[str, bytes]:
        place_of(path).build(template_of(winner, created))
        return template_of(request, created)

    monkeypatch.setattr(gear_rattle.workers.storage.store, "template_of", overtaken)
    if winner == REQUEST:
        create_store(REQUEST, path)
    else:
        with pytest.raises(SurveyError, match="another survey"):
            create_store(REQUEST, path)
    assert tiles_done(winner, path) == set()
    assert list(tmp_path.iterdir()) == [path]


MISALIGNED = [
    Tile(0, delta=slice(1, 3), epsilon=slice(0, 4)),
    Tile(0, delta=slice(0, 1), epsilon=slice(0, 4)),
    Tile(0, delta=slice(0, 4), epsilon=slice(0, 4)),
    Tile(0, delta=slice(0, 2), epsilon=slice(4, 8)),
    Tile(0, delta=slice(-2, 0), epsilon=slice(0, 4)),
    Tile(0, delta=slice(6, 5), epsilon=slice(0, 4)),
]


@pytest.mark.parametrize("tile", MISALIGNED, ids=str)
def test_a_misaligned_tile_is_refused_at_submission_and_at_the_write(store: Path, tile: Tile) -> None:
    before = snapshot(store)
    with pytest.raises(SurveyError, match="not one whole chunk"):
        write_tile(REQUEST, str(store), tile, {"region": np.ones((4, 2), "int8")})
    with pytest.raises(SurveyError, match="not one whole chunk"):
        run_tiles(REQUEST, store, [tile], None, lambda _: None, lambda: False)  # type: ignore[arg-type]  # refused before a client is used
    assert snapshot(store) == before


def test_values_of_another_shape_are_refused(store: Path) -> None:
    before = snapshot(store)
    with pytest.raises(SurveyError, match="region has shape"):
        write_tile(REQUEST, str(store), TILES[0], {"region": np.ones((1, 1), "int8")})
    assert snapshot(store) == before


def test_a_tile_interrupted_before_its_status_is_not_done(store: Path) -> None:
    values, _ = compute_tile(REQUEST, TILES[0])
    values["orbit_multiplier_real"] = values["orbit_multiplier_real"][:, :1]  # the write fails here
    with pytest.raises(SurveyError):
        write_tile(REQUEST, str(store), TILES[0], values)
    assert tiles_done(REQUEST, store) == set()
    fill(store, TILES[:1])
    assert tiles_done(REQUEST, store) == {0}


def test_a_deleted_survey_does_not_come_back(store: Path) -> None:
    fill(store, TILES[:1])
    moved = store.rename(store.with_name("moved"))
    with pytest.raises(SurveyError, match="gone"):
        fill(store, TILES[1:2])
    assert not store.exists()
    assert tiles_done(REQUEST, moved) == {0}


@pytest.mark.parametrize(
    "work",
    [
        lambda store: fill(store, TILES[1:2]),
        lambda store: tiles_done(REQUEST, store),
        finish_store,
        lambda store: add_to_store(store, {}, {}),
        lambda store: set_store_attributes(place_of(store), {"rounds": 1}),
        lambda store: list(read_variable_in_bands(place_of(store), "region")),
    ],
)
@pytest.mark.parametrize("is_known", [False, True])  # in this process
def test_a_store_that_was_moved_away_is_gone_and_not_damaged(
    store: Path, work: Callable[[Path], object], is_known: bool
) -> None:
    if is_known:
        fill(store, TILES[:1])
    store.rename(store.with_name("moved"))
    with pytest.raises(StorageError, match=r"is gone: it was moved or deleted") as refused:
        work(store)
    assert "damaged" not in str(refused.value)
    assert "not a survey" not in str(refused.value)


def test_unfinished_says_how_many_tiles_are_missing(store: Path) -> None:
    fill(store, TILES[1:])
    before = snapshot(store)
    with pytest.raises(SurveyError, match="lacks 1 of its 6 tiles: compute the same request again"):
        finish_store(store)
    assert snapshot(store) == before


def test_finishing_sweeps_dates_and_keeps_everything_readable(store: Path) -> None:
    fill(store, TILES)
    running = xr.open_zarr(store, consolidated=True).load()
    stray = store / "region" / "c" / "0" / "0.0123.partial"
    stray.write_bytes(b"half a chunk")
    finish_store(store)
    assert not stray.exists()
    finished = xr.open_zarr(store, consolidated=True).load()
    assert "date_completed" in finished.attrs
    xr.testing.assert_equal(finished, running)
    before = snapshot(store)
    finish_store(store)
    assert snapshot(store) == before


def test_consolidated_metadata_covers_everything_from_the_start(store: Path) -> None:
    root = json.loads((store / "zarr.json").read_text())
    nodes = {str(path.parent.relative_to(store)) for path in store.rglob("zarr.json")} - {"."}
    assert set(root["consolidated_metadata"]["metadata"]) == nodes
    fill(store, TILES)
    assert json.loads((store / "zarr.json").read_text()) == root


def test_two_runs_of_one_store_exclude_each_other(store: Path) -> None:
    with place_of(store).lock_for_writing():
        with pytest.raises(SurveyError, match="another run: wait"):
            finish_store(store)
        with pytest.raises(SurveyError, match="another run: wait"):
            run_tiles(REQUEST, store, TILES, None, lambda _: None, lambda: False)  # type: ignore[arg-type]  # refused before a client is used
    fill(store, TILES)
    finish_store(store)


@pytest.mark.parametrize("where", ["missing.zarr", "http://127.0.0.1:9/survey", "unknown://x"])
def test_opening_what_is_not_there(tmp_path: Path, where: str) -> None:
    with pytest.raises(SurveyError, match="no survey can be opened at"):
        open_survey(where if ":" in where else tmp_path / where)


def test_open_survey_is_only_a_convenience(store: Path) -> None:
    fill(store, TILES[:1])
    with open_survey(store, as_stored=True) as ours, xr.open_zarr(store) as theirs:
        xr.testing.assert_identical(ours.load(), theirs.load())
