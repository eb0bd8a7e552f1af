"""Damaged parts of a store are named and repaired, and whole ones stay as they are, to the last byte."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from depth import deep, either
from written import compute_and_write_tile

import gear_rattle.workers.storage.store
from gear_rattle.workers import (
    Axis,
    SurveyError,
    SurveyRequest,
    create_store,
    examine,
    finish_store,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.storage.location import StoreDirectory
from gear_rattle.workers.storage.manifest import read_manifest, read_root_attributes, set_store_attributes
from gear_rattle.workers.survey.version import code_version

REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.9, num=4),
    epsilon=Axis(start=0.05, stop=0.2, num=4),
    quantities=("region", "orbits", "grazing"),
    tile={"delta": 2, "epsilon": 2},
)
ROOT, OWN = "zarr.json", "manifest.json"


_template_of = cache(gear_rattle.workers.storage.store.template_of)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "survey.zarr"
    create_store(REQUEST, path)
    for tile in tiles_of(REQUEST):
        compute_and_write_tile(REQUEST, str(path), tile)
    finish_store(path)
    return path


@pytest.fixture
def store(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "survey.zarr"))


@pytest.fixture(autouse=True)
def _curves_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The template is computed once: the same curves are mended many times."""
    monkeypatch.setattr(gear_rattle.workers.storage.store, "template_of", _template_of)


def contents(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def assert_named_and_mended(store: Path, before: dict[str, bytes], *names: str) -> None:
    assert set(names) <= set(examine(store).template)
    create_store(REQUEST, store)
    finish_store(store)  # what a run does when no tile is missing
    after = contents(store)
    assert examine(store).is_whole
    assert tiles_done(REQUEST, store) == set(range(REQUEST.n_tiles))
    changed = {key for key in before if before[key] != after.get(key)}
    assert changed <= {ROOT, OWN}  # dated anew where its own date could not be trusted
    root, had = json.loads(after[ROOT]), json.loads(before[ROOT])
    del root["attributes"]["date_completed"], had["attributes"]["date_completed"]
    assert root == had
    known, knew = (json.loads(each[OWN])["manifest"] for each in (after, before))
    assert known | {"root": []} == knew | {"root": []}


def test_single_bits_of_the_root_are_named_and_mended(store: Path) -> None:
    """Many of them, over the whole file, and every bit of the last byte."""
    before = contents(store)
    size = len(before[ROOT])
    many = either(70, 700)
    flips = [(size * k // many, k % 8) for k in range(many)] + [(size - 1, bit) for bit in range(8)]
    for number, (position, bit) in enumerate(flips):
        content = bytearray(before[ROOT])
        content[position] ^= 1 << bit
        (store / ROOT).write_bytes(content)
        if same_json(content, before[ROOT]):
            continue
        with pytest.raises(SurveyError, match=r"zarr.json of .* is lost or damaged"):
            read_root_attributes(StoreDirectory(store))
        if number % 50 == 0:
            assert_named_and_mended(store, before, ROOT)


def same_json(one: bytes, other: bytes) -> bool:
    """Return whether two documents are equal as JSON, such as `1e5` and `1E5`."""
    try:
        return bool(json.loads(one) == json.loads(other))
    except ValueError:
        return False


def edited_root(change: Callable[[dict[str, Any]], None]) -> Callable[[Path], None]:
    def edit(store: Path) -> None:
        root = json.loads((store / ROOT).read_bytes())
        change(root)
        (store / ROOT).write_text(json.dumps(root))

    return edit


def _described(root: dict[str, Any], name: str) -> Any:
    return root["consolidated_metadata"]["metadata"][name]


EDITS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "another type": lambda root: _described(root, "region").update(data_type="int64", fill_value=0),
    "another fill value": lambda root: _described(root, "orbit_phase").update(fill_value=0.0),
    "another shape": lambda root: _described(root, "status").update(shape=[2, 4]),
    "no checksum": lambda root: _described(root, "region").update(codecs=[{"name": "bytes"}]),
    "a variable is gone": lambda root: root["consolidated_metadata"]["metadata"].pop("region"),
    "a variable too many": lambda root: root["consolidated_metadata"]["metadata"].update(
        mine=_described(root, "region")
    ),
    "another survey's hash": lambda root: root["attributes"].update(content_hash="0" * 64),
    "another request": lambda root: root["attributes"].update(request="{}"),
    "another version": lambda root: root["attributes"].update(code_version="0"),
    "another date": lambda root: root["attributes"].update(date_created="1990-01-01T00:00:00+00:00"),
    "no attributes": lambda root: root.update(attributes={}),
    "no consolidated metadata": lambda root: root.update(consolidated_metadata=None),
    "attributes are a list": lambda root: root.update(attributes=[1]),
}


#: What else of a variable's description may be edited than its type, and of the survey's than its request.
OTHERS = {
    "another fill value",
    "another shape",
    "no checksum",
    "another survey's hash",
    "another version",
    "another date",
}


@pytest.mark.parametrize(
    "change", [pytest.param(edit, id=name, marks=deep if name in OTHERS else ()) for name, edit in EDITS.items()]
)
def test_edits_of_the_root_are_named_and_mended(store: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    before = contents(store)
    edited_root(change)(store)
    assert_named_and_mended(store, before, ROOT)


@pytest.mark.parametrize(
    "content",
    [*(pytest.param(each, marks=deep) for each in (b"", b"{")), b"[]", b"\xff", b"[" * 100_000, None],
    ids=str,
)
@pytest.mark.parametrize("key", [ROOT, OWN])
def test_a_root_that_is_none(store: Path, key: str, content: bytes | None) -> None:
    before = contents(store)
    (store / key).unlink() if content is None else (store / key).write_bytes(content)
    assert_named_and_mended(store, before, key)


def test_without_both_nobody_knows_what_it_was(store: Path) -> None:
    for key in (ROOT, OWN):
        (store / key).write_bytes(b"{}")
    before = contents(store)
    with pytest.raises(SurveyError, match="not a survey"):
        create_store(REQUEST, store)
    with pytest.raises(SurveyError, match="from a copy"):
        examine(store)
    assert contents(store) == before


def test_a_chunk_that_is_not_there_is_lost_once_the_survey_was_completed(store: Path) -> None:
    """`status` alone, and all of a tile: neither is "not computed yet"."""
    (store / "status/c/0/1").unlink()
    for chunk in store.glob("*/c/**/1/0"):
        chunk.unlink()
    found = examine(store)
    assert not found.is_whole
    assert found.done == {0, 3}
    assert found.damaged[1] == ("status",)
    assert "region" in found.damaged[2]
    assert "status" in found.damaged[2]
    assert tiles_done(REQUEST, store) == {0, 3}  # which a run computes again


def test_a_tile_that_the_manifest_lacks_is_lost_once_the_survey_was_completed(store: Path) -> None:
    place = StoreDirectory(store)
    manifest = read_manifest(place)
    assert manifest is not None
    others = {index: digests for index, digests in manifest.tiles.items() if index != 2}
    place.put(OWN, replace(manifest, tiles=others).to_bytes())
    found = examine(store)
    assert found.done == {0, 1, 3}
    assert found.damaged == {2: tuple(manifest.chunks)}


def test_a_tile_of_a_survey_that_was_not_completed_is_not_lost(tmp_path: Path) -> None:
    create_store(REQUEST, tmp_path / "survey.zarr")
    compute_and_write_tile(REQUEST, str(tmp_path / "survey.zarr"), tiles_of(REQUEST)[0])
    found = examine(tmp_path / "survey.zarr")
    assert found.is_whole
    assert (found.done, found.tiles, found.completed) == ({0}, 4, "")


def of_another_version(store: Path) -> Path:
    """A store without a manifest: as version 1.0.0a1 left it."""
    (store / OWN).unlink()
    root = json.loads((store / ROOT).read_text())
    root["attributes"] = {**root["attributes"], "code_version": "1.0.0a1+0123456789abcdef"}
    (store / ROOT).write_text(json.dumps(root))
    return store


def test_a_store_of_another_version_is_decoded(store: Path) -> None:
    found = examine(of_another_version(store))
    assert found.is_whole
    assert found.was_checked_by_decoding
    assert found.version == "1.0.0a1+0123456789abcdef"
    assert found.files > 100
    chunk = store / "region/c/1/0"
    chunk.write_bytes(chunk.read_bytes()[::-1])
    (store / "status/c/0/1").unlink()
    assert set(examine(store).template) == {"region/c/1/0", "status/c/0/1"}


def test_a_store_of_another_version_with_our_manifest_is_verified_by_it(store: Path) -> None:
    set_store_attributes(StoreDirectory(store), {"code_version": "1.0.0a1+0123456789abcdef"})
    found = examine(store)
    assert found.is_whole
    assert not found.was_checked_by_decoding
    assert found.version == "1.0.0a1+0123456789abcdef"


def test_a_lost_manifest_hides_no_lost_and_no_damaged_chunk(store: Path) -> None:
    """Lost and damaged chunks are computed again, and whole ones are kept."""
    before = contents(store)
    (store / OWN).unlink()
    (store / "region/c/0/1").unlink()
    chunk = store / "region/c/1/0"
    chunk.write_bytes(chunk.read_bytes()[::-1])
    assert set(examine(store).template) == {OWN, "region/c/0/1", "region/c/1/0"}
    create_store(REQUEST, store)
    assert tiles_done(REQUEST, store) == {0, 3}
    for index in (1, 2):
        compute_and_write_tile(REQUEST, str(store), tiles_of(REQUEST)[index])
    finish_store(store)
    assert contents(store) == before


def test_a_damaged_root_of_another_survey_is_not_ours(store: Path) -> None:
    edited_root(lambda root: root["attributes"].update(content_hash=REQUEST.content_hash(), title="x"))(store)
    before = contents(store)
    other = REQUEST.model_copy(update={"beta": 0.5})
    with pytest.raises(SurveyError, match="another survey"):
        create_store(other, store)
    assert contents(store) == before


@pytest.mark.parametrize(
    "name",
    [
        "region",
        pytest.param("status", marks=deep),
        "delta",
        pytest.param("curves/G1/point_delta", marks=deep),
        "codimension_two",
    ],
)
def test_other_metadata_is_named_and_mended(store: Path, name: str) -> None:
    before = contents(store)
    path = store / name / "zarr.json"
    path.write_bytes(path.read_bytes().replace(b"3", b"4"))
    assert_named_and_mended(store, before, f"{name}/zarr.json")


def test_tiles_are_written_as_the_request_says_whatever_the_store_says(store: Path, whole: Path) -> None:
    """Written as int64 because the root said so, thousands of values were other ones, without an error."""
    edited_root(lambda root: _described(root, "region").update(data_type="int64"))(store)
    path = store / "region" / "zarr.json"
    path.write_text(json.dumps(json.loads(path.read_bytes()) | {"data_type": "int64"}))
    for tile in tiles_of(REQUEST):
        compute_and_write_tile(REQUEST, str(store), tile)
    for tile in range(REQUEST.n_tiles):
        chunk = f"region/c/{tile // 2}/{tile % 2}"
        assert (store / chunk).read_bytes() == (whole / chunk).read_bytes()


def test_swapped_chunks_are_damage(store: Path) -> None:
    """Chunks are swapped with another place, and with a similar variable; each is whole by its own checksum."""
    swap(store / "orbit_phase/c/0/0/0", store / "orbit_phase/c/0/1/1")
    swap(store / "orbit_phase/c/0/0/1", store / "orbit_velocity/c/0/0/1")
    xr.open_zarr(store).load()  # plain xarray reads them
    assert examine(store).damaged == {
        0: ("orbit_phase",),
        1: ("orbit_phase", "orbit_velocity"),
        3: ("orbit_phase",),
    }
    assert tiles_done(REQUEST, store) == {2}


def test_a_swapped_template_is_damage(store: Path) -> None:
    swap(store / "curves/SN1/point_delta/c/0", store / "curves/SN1/point_epsilon/c/0")
    found = examine(store)
    assert not found.damaged
    assert set(found.template) == {"curves/SN1/point_delta/c/0", "curves/SN1/point_epsilon/c/0"}


def test_a_whole_tile_in_the_place_of_another_is_damage(store: Path) -> None:
    """Every chunk of it; those of one content name no difference."""
    for chunk in store.glob("*/c/**/0/0"):
        other = chunk.parents[1] / "1" / "1"
        if other.is_file() and chunk.read_bytes() != other.read_bytes():
            swap(chunk, other)
    xr.open_zarr(store).load()
    assert examine(store).damaged.keys() == {0, 3}
    assert tiles_done(REQUEST, store) == {1, 2}


def swap(one: Path, other: Path) -> None:
    first, second = one.read_bytes(), other.read_bytes()
    assert first != second
    one.write_bytes(second)
    other.write_bytes(first)


@pytest.mark.parametrize("lost", ["status/c/1/0", "region/c/1/0"])
def test_a_file_of_a_tile_that_is_lost_is_damage(store: Path, lost: str) -> None:
    (store / lost).unlink()
    found = examine(store)
    assert found.done == {0, 1, 3}
    assert found.damaged == {2: (lost.partition("/")[0],)}


def test_other_readers_do_not_see_the_manifest(store: Path) -> None:
    manifest = read_manifest(StoreDirectory(store))
    assert manifest is not None
    assert set(manifest.chunks) >= {"status", "region"}
    assert "checksums" not in xr.open_datatree(store, engine="zarr")


def test_damage_is_mended_by_one_run_at_a_time(store: Path) -> None:
    edited_root(EDITS["another type"])(store)
    before = contents(store)
    with StoreDirectory(store).lock_for_writing(), pytest.raises(SurveyError, match="another run"):
        create_store(REQUEST, store)
    assert contents(store) == before


def test_a_store_of_another_version_is_left_alone(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(store)
    monkeypatch.setattr(gear_rattle.workers.storage.store, "code_version", lambda: f"{code_version()}.1")
    monkeypatch.setattr(SurveyRequest, "content_hash", lambda _: "other")
    with pytest.raises(SurveyError, match="computed by version"):
        create_store(REQUEST, store)
    assert contents(store) == before
